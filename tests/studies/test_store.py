"""The table on disk: rows resume, replace their like, and survive what goes wrong while they are written."""

import hashlib
import os
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr

from studies.core.cell import Key
from studies.core.store import SUMS, TABLE, Store, StoreWarning
from studies.files.study_error import StudyError

RUN = xr.Dataset({"speed": ("time", np.arange(100.0))}, {"time": np.arange(100.0)})


def row(seed: int, status: str = "ok", **values) -> dict:
    cell = {"cell": f"cell {seed}", "code_hash": "c0de", "seed": seed}
    return cell | {"status": status, "reason": ""} | values


@pytest.fixture
def store(tmp_path):
    return Store(tmp_path / "a" / "b")


def test_an_empty_folder_has_no_rows(store):
    assert store.read().empty
    assert store.cells() == {}


def test_rows_are_found_again_by_another_store(store):
    store.add([row(0, damage=1.5), row(1, damage=2.5)])
    again = Store(store.folder)
    assert again.cells() == {"cell 0": True, "cell 1": True}
    assert again.read()["damage"].tolist() == [1.5, 2.5]


def test_a_row_replaces_the_one_of_the_same_identity(store):
    store.add([row(0, "failed", reason="because")])
    store.add([row(0, damage=3.0)])
    table = store.read()
    assert len(table) == 1
    assert table.loc[0, "status"] == "ok"
    assert table.loc[0, "damage"] == 3.0


def test_a_failed_row_is_kept_with_its_reason_but_is_not_done(store):
    store.add([row(0, "failed", reason="the wheels came off")])
    assert store.cells() == {"cell 0": False}
    assert store.read().loc[0, "reason"] == "the wheels came off"


def test_an_interrupted_write_leaves_the_old_table_and_no_litter(store, monkeypatch):
    store.add([row(0)])

    def interrupted(self, path, **_):
        with open(path, "w") as file:
            file.write("half a tab")
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(pd.DataFrame, "to_parquet", interrupted)
        with pytest.raises(KeyboardInterrupt):
            store.add([row(1)])
    assert store.cells().keys() == {"cell 0"}
    assert {path.name for path in store.folder.iterdir()} == {TABLE, SUMS, ".lock"}


def test_writers_at_the_same_time_lose_nothing(store):
    with ThreadPoolExecutor(4) as pool:
        list(pool.map(lambda seed: Store(store.folder).add([row(seed)]), range(12)))
    assert store.cells().keys() == {f"cell {seed}" for seed in range(12)}


def test_rows_come_back_in_the_order_asked_for(store):
    store.add([row(0), row(1), row(2)])
    keys = [Key("event", f"cell {seed}", "c0de") for seed in (2, 0)]
    assert store.rows_of(keys)["seed"].tolist() == [2, 0]


def test_rows_of_one_cell_stay_together_in_their_order_and_are_replaced_as_one(store):
    store.add([row(0, place=2), row(1, place=0), row(0, place=1)])
    keys = [Key("event", f"cell {seed}", "c0de") for seed in (1, 0)]
    assert store.rows_of(keys)["place"].tolist() == [0, 2, 1]
    store.add([row(0, place=3)])
    assert store.rows_of(keys)["place"].tolist() == [0, 3]


@pytest.mark.parametrize("listed", [True, False])
@pytest.mark.parametrize(
    "damage", [lambda whole: whole[: len(whole) // 2], lambda whole: b"", lambda whole: b"no table"]
)
def test_a_broken_table_is_set_aside_with_one_line(store, damage, listed):
    store.add([row(0)])
    whole = store.path.read_bytes()
    store.path.write_bytes(damage(whole))
    if not listed:
        (store.folder / SUMS).unlink()
    with pytest.warns(
        StoreWarning, match=r"runs\.parquet' is broken \(.*; it is now 'runs\.parquet\.broken-1'"
    ) as said:
        assert store.read().empty
    assert len(said) == 1
    assert "\n" not in str(said[0].message)
    assert (store.folder / "runs.parquet.broken-1").read_bytes() == damage(whole)
    store.add([row(1)])
    assert store.cells() == {"cell 1": True}


def test_a_file_that_another_writer_finishes_meanwhile_is_no_fault(store, monkeypatch):
    gone = store.folder / ".1234.part.parquet"
    monkeypatch.setattr(Path, "rglob", lambda *_: iter([gone]))
    assert Store(store.folder).read().empty


def test_any_flipped_bit_is_noticed(store):
    store.add([row(0, damage=1.5)])
    whole = store.path.read_bytes()
    for place in np.random.default_rng(0).choice(len(whole), 40, replace=False):
        broken = bytearray(whole)
        broken[place] ^= 1 << (place % 8)
        store.path.write_bytes(broken)
        with pytest.warns(StoreWarning, match="it is not as it was written"):
            assert store.read().empty


def test_a_crash_after_the_checksums_were_lost_loses_no_table(store, monkeypatch):
    store.add([row(0)])
    (store.folder / SUMS).unlink()

    def killed(self, *_):
        raise KeyboardInterrupt

    with monkeypatch.context() as patch:
        patch.setattr(
            "os.replace",
            lambda old, new: killed(old) if str(new).endswith(TABLE) else Path(old).rename(new),
        )
        with pytest.raises(KeyboardInterrupt):
            store.add([row(1)])
    assert store.cells() == {"cell 0": True}


def test_checksums_are_those_of_the_usual_tool(store):
    store.add([row(0)])
    store.add([row(1)])
    digest = hashlib.sha256(store.path.read_bytes()).hexdigest()
    assert (store.folder / SUMS).read_text() == f"{digest}  runs.parquet\n"


@pytest.mark.parametrize("column", ["scenario", "other version"])
def test_a_table_of_another_version_is_refused_and_left_alone(store, column):
    table = pd.DataFrame({"scenario": ["x"], "seed": [0]})
    if column == "other version":
        table = pd.DataFrame([row(0)])
        table.attrs["schema"] = 99
    table.to_parquet(store.path)
    whole = store.path.read_bytes()
    for use in (store.read, store.cells, lambda: store.add([row(1)])):
        with pytest.raises(
            StudyError, match="one of another version of this program; move it away or choose"
        ):
            use()
    assert store.path.read_bytes() == whole


@pytest.mark.parametrize(
    "label", ["../../out/exact", "/etc/exact", "..", "a/../../b", "C:\\x/y", "né w/α", "x" * 300]
)
def test_no_label_leads_out_of_the_folder(store, label):
    path = store.run_path(Key(label, "0123456789abcdef", "c0de"))
    assert path.resolve().is_relative_to((store.folder / "runs").resolve())
    assert len(path.relative_to(store.folder).parts) <= 3
    store.save_run(Key(label, "0123456789abcdef", "c0de"), RUN)
    assert store.has_run(Key(label, "0123456789abcdef", "c0de"))


def test_a_broken_run_does_not_count_as_kept(store):
    key = Key("event/rule", "0123456789abcdef", "c0de")
    assert not store.has_run(key)
    path = store.save_run(key, RUN)
    assert store.has_run(key)
    path.write_bytes(path.read_bytes()[:-100])
    with pytest.warns(StoreWarning, match="broken-1"):
        assert not store.has_run(key)
    store.save_run(key, RUN)
    assert store.has_run(key)


def test_files_have_the_users_umask(store):
    before = os.umask(0o027)
    try:
        store.add([row(0)])
        run = store.save_run(Key("event/rule", "0123456789abcdef", "c0de"), RUN)
    finally:
        os.umask(before)
    for path in (store.path, store.folder / SUMS, run):
        assert path.stat().st_mode & 0o777 == 0o640


def test_what_a_killed_writer_left_is_deleted_when_it_is_old(store):
    left, fresh = store.folder / ".1234.part.parquet", store.folder / ".5678.part.parquet"
    for path in (left, fresh):
        path.write_text("half")
    os.utime(left, (0, 0))
    Store(store.folder)
    assert not left.exists()
    assert fresh.exists()


def test_a_folder_that_cannot_be_written_is_refused(tmp_path):
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match=r"cannot be written: .*; choose another with --out"):
        Store(tmp_path / "file" / "results")


def test_random_kills_and_damages_lose_nothing(tmp_path):
    """500 trials and more: `python -m tests.studies.crashes FOLDER 500 0`."""
    words = [sys.executable, "-m", "tests.studies.crashes", str(tmp_path), "40", "1"]
    done = subprocess.run(words, cwd=Path(__file__).parents[2], capture_output=True, text=True)
    assert done.returncode == 0, done.stderr
    assert done.stdout.endswith("60 rows: equal\n")
