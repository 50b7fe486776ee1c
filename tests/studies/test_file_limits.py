"""Files from elsewhere: a small one that unfolds to gigabytes, or to hours, is refused soon and in little memory."""

import bz2
import gzip
import lzma
import subprocess
import sys
import textwrap
from pathlib import Path

import netCDF4
import numpy as np
import pandas as pd
import pyarrow as pa
import pyarrow.parquet as pq
import pytest

from paper_figs.saving import data_of
from paper_figs.style import COLUMN, new_panels
from studies.command_line.main import run
from studies.files.limits import VARIABLE, Limits
from studies.files.strict import read_toml
from studies.files.study_error import StudyError
from studies.files.writable import as_csv
from studies.logs.recorder_files import read_recording
from studies.logs.report_tables import COLUMNS, write_events
from studies.railtoolkit.reading import read_train

READ = """
import resource, sys, warnings
from pathlib import Path
import pyarrow.compute
from studies.files.strict import read_toml
from studies.logs.simulated import recorded_run
from studies.logs.recorder_files import read_recording
from studies.railtoolkit.reading import read_train

warnings.simplefilter("ignore")
small = Path("small.parquet")
read_recording(small), read_recording(small.with_suffix(".csv"))  # threads and their stacks
now = int(Path("/proc/self/statm").read_text().split()[0]) * resource.getpagesize()
resource.setrlimit(resource.RLIMIT_AS, (now + 700_000_000,) * 2)
for name in sys.argv[1:]:
    read = {".yaml": read_train, ".nc": recorded_run}.get(Path(name).suffix, read_recording)
    try:
        read_toml(name, "scenario", "") if name.endswith("toml") else read(Path(name))
        print(name, "was read")
    except ValueError as error:
        print(name, error)
"""
HEAD = "schema: https://railtoolkit.org/schema/rolling-stock.json\nschema_version: '2022.05'\na0: &a0 [x]\n"
ROW = b"0,1,1,1\n"
NAMES = b"time_s,speed_kmh,axle1_speed_kmh,axle1_force_kn\n"
LIMIT, LINE, DEEP = "--limits 0.2 doubles it", "bytes", "deep"


def chain(form: str, times: int, length: int) -> str:
    """Lines of YAML each of which repeats the one before so many times."""
    repeated = (", ".join([f"*a{k - 1}"] * times) for k in range(1, length))
    return "".join(f"a{k}: &a{k} {form.format(one)}\n" for k, one in enumerate(repeated, 1))


def bombs() -> dict[str, str]:
    """Files of less than 1 MB, but for the long line and what parquet needs; what is said of them by name."""
    said = {}
    for name, pack in (("gz", gzip.compress), ("bz2", bz2.compress), ("xz", lzma.compress)):
        said[f"rows.csv.{name}"] = LIMIT
        Path(f"rows.csv.{name}").write_bytes(pack(NAMES) + pack(ROW * 700_000) * 10)
    words = gzip.compress(ROW * 700_000) + gzip.compress(b"0,word,b,c\n" * 100_000) * 25
    Path("words.csv.gz").write_bytes(gzip.compress(NAMES) + words)  # none in the first block
    said["words.csv.gz"] = LIMIT
    for name, rows in (("first.csv", 0), ("later.csv", 1000), ("late.csv", 3_000_000)):
        said[name] = LINE
        with open(name, "wb") as file:
            file.writelines(
                [NAMES * (rows > 0), ROW * rows, b"1," + b"1" * 50_000_000, b"\n1,2,3,4\n"]
            )
    zeros = pa.table(
        {"time_s": np.zeros(10_000_000, np.int8), "speed_kmh": np.zeros(10_000_000, np.int8)}
    )
    with pq.ParquetWriter("rows.parquet", zeros.schema, compression="zstd") as file:
        for _ in range(4):
            file.write_table(zeros, row_group_size=10_000_000)
    indices = pa.array(np.zeros(1000, np.int8))
    texts = pa.DictionaryArray.from_arrays(indices, pa.array(["x" * 5_000_000]))
    pq.write_table(
        pa.table({"time_s": np.arange(1000.0), "w": texts}), "texts.parquet", compression="zstd"
    )
    with netCDF4.Dataset("fill.nc", "w") as file:
        file.createDimension("time", 10**9)
        file.createVariable("time", "f8", ("time",), zlib=True, chunksizes=(10**6,))
    said |= {"rows.parquet": LIMIT, "texts.parquet": LIMIT, "fill.nc": LIMIT}
    chains = {
        "nine": (chain("[{}]", 9, 12) + "vehicles: *a11\n", LIMIT),
        "text": (f"b: &b {'x' * 20_000}\nc: [{', '.join(['*b'] * 1000)}]\n", LIMIT),
        "merge": (chain("{{<<: [{}]}}", 40, 9), LIMIT),
        "deep": (chain("[{}]", 1, 900), DEEP),
        "self": ("b: &b [*b]\n", "stands in what it repeats"),
        "sixty": ("b: 1" + ":1" * 40_000, "a number of 80001 digits"),
        "tag": ("b: !!timestamp soon", "not YAML"),
    }  # fmt: skip
    for name, (text, words) in chains.items():
        Path(f"{name}.yaml").write_text(HEAD + text)
        said[f"{name}.yaml"] = words
    for name, text in (
        ("bare", "a." * 40_000),
        ("quoted", '"a" . ' * 15_000),
        ("table", "[" + "'a'." * 20_000),
    ):
        Path(f"{name}.toml").write_text(f"{text}a = 1")
        said[f"{name}.toml"] = DEEP
    return said


@pytest.fixture
def inside(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv(VARIABLE, "0.1")


@pytest.mark.skipif(not sys.platform.startswith("linux"), reason="limits memory as Linux does")
def test_small_files_that_unfold_are_refused_in_bounded_memory(inside):
    said = bombs()
    table = pd.DataFrame({"time_s": np.arange(1000.0), "state": "on"})
    table.to_parquet("small.parquet")
    table.to_csv("small.csv")
    command = [sys.executable, "-c", textwrap.dedent(READ), *said]
    done = subprocess.run(command, capture_output=True, text=True, timeout=300)
    lines = done.stdout.splitlines()
    assert len(lines) == len(said), done.stderr[-1000:]
    for line, (name, words) in zip(lines, said.items(), strict=True):
        assert line.startswith(name)
        assert words in line, line


def test_a_factor_raises_the_limits_and_is_checked(inside, monkeypatch, capsys):
    assert Limits().values > 2 * 720_000 * 64
    rows = 200_000
    frame = pd.DataFrame({f"c{k}": np.arange(rows) for k in range(64)})
    frame.to_parquet("log.parquet")
    with pytest.raises(StudyError, match=r"more than 12000000 values .* readhesion --limits 0\.2"):
        read_recording(Path("log.parquet"))
    Path("long.toml").write_text("a = 1\n" + "#" * 150_000)
    with pytest.raises(StudyError, match=r"more than 100000 bytes; .* --limits 0\.2 doubles it"):
        read_toml("long.toml", "scenario", "")
    monkeypatch.setenv(VARIABLE, "0.2")
    assert read_recording(Path("log.parquet")).take("c7")[-1] == rows - 1
    assert read_toml("long.toml", "scenario", "") == {"a": 1}
    for wrong in ("0", "-1", "nan", "1e9"):
        assert run(["--limits", wrong, "list"]) == 2
        assert f"--limits {wrong.replace('1e9', '1e+09')}: give a factor" in capsys.readouterr().err


def test_aliases_within_reason_and_prose_with_dots_are_read(inside):
    Path("stock.yaml").write_text(HEAD + "b: [*a0, *a0]\nc: {<<: {k: 1}, l: 2}\n")
    with pytest.raises(StudyError, match="key 'vehicles' is missing"):
        read_train("stock.yaml")
    prose = 'title = "' + "One. Two, and three... e.g. 1.2.3.4. " * 20 + '"\n'
    Path("a.toml").write_text(prose + "x = [" + "0.1, 2.5e-3," * 200 + "]\n[a.b.c.d]\ne.f = 1\n")
    assert read_toml("a.toml", "scenario", "")["a"]["b"]["c"]["d"]["e"]["f"] == 1


def test_names_that_a_spreadsheet_would_compute_get_an_apostrophe_and_numbers_stay(tmp_path):
    bad = ["=1+1", "+cmd", "-x", "@SUM(A1)", "\tx", '=HYPERLINK("http://x")']
    good = ["-1.5", "+2", "1=2", "", "wet-start", "-inf", "'q"]
    table = pd.DataFrame({"=name": [*bad, *good], "number": np.linspace(-1.0, 1.0, 13)})
    read = pd.read_csv(pd.io.common.StringIO(as_csv(table)), dtype=str, keep_default_na=False)
    assert list(read) == ["'=name", "number"]
    assert read["'=name"].tolist() == [f"'{text}" for text in bad] + good
    assert read["number"].astype(float).tolist() == table["number"].tolist()
    event = dict.fromkeys(COLUMNS, -1.5) | {"kind": "@slip"}
    write_events([{"log": "=1+1.csv", "events": [event], "small_events": []}], tmp_path / "a.csv")
    line = (tmp_path / "a.csv").read_text().splitlines()[1]
    assert "-1.5,'@slip," in line
    figure, axes = new_panels(COLUMN, 2.0)
    axes.plot([0.0, -1.0], [2.0, 3.0], label="=1+1")
    drawn = data_of(figure).decode()
    assert "'=1+1" in drawn
    assert ",=1+1" not in drawn
    assert ",-1," in drawn
