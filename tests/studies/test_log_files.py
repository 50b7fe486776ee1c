"""The same log in the formats of many loggers gives the same numbers."""

import sys
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from studies.files.study_error import StudyError
from studies.log_accuracy import defects as spoil
from studies.logs.columns import factor, kinds_of
from studies.logs.gradients import GradientLine
from studies.logs.mapping import Mapping, read_mapping
from studies.logs.measured_log import check_log, read_log
from studies.logs.measured_run import analyse_run
from studies.logs.remarks import MOST, grouped
from tests.studies.test_measured_log import RADIUS, TRAIN, make_table

TABLE = make_table()
TABLE.columns = pd.Index([name.replace("speed_ms", "speed_kmh") for name in TABLE])
TABLE[[name for name in TABLE if "speed" in name]] *= 3.6
GERMAN = {"time_s": "Zeit", "speed_kmh": "v_GPS"} | {
    f"axle{n}_{what}": f"{short}_Achse{n}"
    for n in range(1, 5)
    for what, short in (("speed_kmh", "n"), ("force_kn", "F"))
}
SPELT = {"Zeit": "s", "v_GPS": "km/h", "n": "1/min", "F": "kN"}


def times(kind: str) -> pd.DataFrame:
    at = pd.Timestamp("2026-03-29 00:59:58") + pd.to_timedelta(TABLE["time_s"], unit="s")
    shown = {
        "utc": at.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ"),
        "german": at.dt.strftime("%d.%m.%Y %H:%M:%S,%f"),
        "seconds": at.dt.strftime("%Y-%m-%d %H:%M:%S"),
        "clock": at.dt.strftime("%H:%M:%S.%f"),
        "datetime": at,
        "epoch": TABLE["time_s"] + 1.774e9,
        "milliseconds": np.round(1e3 * (TABLE["time_s"] + 1.774e9)).astype(np.int64),
        "single": (TABLE["time_s"] + 1.774e9).astype(np.float32),
    }
    return TABLE.assign(time_s=shown[kind])


def foreign(path: Path, encoding: str = "cp1252") -> None:
    table = spoil.by_rpm(TABLE, np.full(4, RADIUS))
    table.columns = pd.Index([GERMAN[name.replace("_rpm", "_kmh")] for name in table])
    units = [f"[{SPELT[name.split('_')[0] if name not in SPELT else name]}]" for name in table]
    text = "# Fahrt über Land\n" + ";".join(table) + "\n" + ";".join(units) + "\n"
    text += table.to_csv(index=False, header=False, sep=";", decimal=",")
    path.write_text(text, encoding=encoding)


WRITERS = {
    "plain.csv": lambda p: TABLE.to_csv(p, index=False),
    "mark.csv": lambda p: TABLE.to_csv(p, index=False, encoding="utf-8-sig"),
    "semicolon.csv": lambda p: TABLE.to_csv(p, index=False, sep=";", decimal=","),
    "tab.txt": lambda p: TABLE.to_csv(p, index=False, sep="\t"),
    "wide.csv": lambda p: TABLE.to_csv(p, index=False, sep=";", encoding="utf-16"),
    "packed.csv.gz": lambda p: TABLE.to_csv(p, index=False),
    "packed.csv.xz": lambda p: TABLE.to_csv(p, index=False),
    "table.parquet": lambda p: TABLE.to_parquet(p),
    "rpm.csv": lambda p: spoil.by_rpm(TABLE, np.full(4, RADIUS)).to_csv(p, index=False),
    "foreign.csv": foreign,
    "cut.csv": lambda p: p.write_text(TABLE.to_csv(index=False)[:-20]),
    "swapped.csv": lambda p: TABLE.iloc[[1, 0, *range(2, 600)]].to_csv(p, index=False),
    **{f"{kind}.csv": lambda p, k=kind: times(k).to_csv(p, index=False)
       for kind in ("utc", "german", "seconds", "clock", "epoch", "milliseconds", "single")},
    **{f"{kind}.parquet": lambda p, k=kind: times(k).to_parquet(p) for kind in ("datetime", "single")},
}  # fmt: skip


@pytest.fixture(scope="module")
def damage():
    log = check_log(TABLE, TRAIN, "log")
    return analyse_run(log.run, TRAIN).total_damage


@pytest.mark.parametrize("name", WRITERS)
def test_every_format_gives_the_same(tmp_path, damage, name):
    path = tmp_path / name
    WRITERS[name](path)
    log = read_log(path, TRAIN)
    found = analyse_run(log.run, TRAIN)
    assert found.total_damage == pytest.approx(damage, rel=2e-3)
    assert [event.axle for event in found.events] == [1]
    assert len(grouped(log.remarks)) <= MOST


def test_guesses_are_printed(tmp_path):
    foreign(tmp_path / "log.csv")
    log = read_log(tmp_path / "log.csv", TRAIN)
    guesses = [remark.text for remark in log.remarks if remark.kind == "guess"]
    assert "'n_Achse1' to 'n_Achse4': axle 1 to 4 speed in 1/min" in guesses
    assert "'v_GPS': speed in km/h" in guesses


MAPPING = """
[columns]
"Zeit" = { is = "time" }
"v_GPS" = { is = "speed" }
"n_Achse1" = { is = "axle1_speed", unit = "rpm" }
"n_Achse2" = { is = "axle2_speed" }
"F_Achse1" = { is = "axle1_force", unit = "kN", sign = -1 }
"F_Achse2" = { is = "axle2_force" }
[wheels]
radius_mm = [430.0, 420.0, 430.0, 430.0]
"""


def test_a_mapping_says_what_is_used_and_how(tmp_path):
    foreign(tmp_path / "log.csv")
    (tmp_path / "log.toml").write_text(MAPPING)
    log = read_log(tmp_path / "log.csv", TRAIN, read_mapping(tmp_path / "log.toml"))
    plain = check_log(TABLE, TRAIN, "log")
    assert np.isnan(log.run.rim_speed[:, 2:]).all()
    np.testing.assert_allclose(
        log.run.applied_force[:, 0], -plain.run.applied_force[:, 0], rtol=1e-9
    )
    # a radius that is told is used, and where the wheel rolls freely it shows that 420 mm is not its own
    (wrong,) = (remark.text for remark in log.remarks if remark.kind == "radius")
    assert "turns 2.3 % slower than the train where it rolls freely" in wrong
    np.testing.assert_allclose(log.run.rim_speed[:, 1], plain.run.rim_speed[:, 1], rtol=1e-6)
    assert not [remark for remark in log.remarks if remark.kind == "guess"]
    left = [remark.text for remark in log.remarks if "mapping file does not name" in remark.text]
    assert any("'n_Achse3' to 'n_Achse4': axle 3 to 4 speed in 1/min" in text for text in left)
    assert any("axle 3 to 4 force" in text for text in left)
    assert not any("Achse1" in text or "v_GPS" in text for text in left)


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (('"v_GPS"', '"v_GSP"'), "no column 'v_GSP'; did you mean 'v_GPS'?"),
        (('"axle1_speed"', '"axle1_sped"'), "'axle1_sped' is no quantity"),
        (('"rpm"', '"bar"'), "unit 'bar' is no unit of a speed"),
        (("sign = -1", "sing = -1"), "unknown key"),
        (("[430.0, 420.0, 430.0, 430.0]", "[430.0]"), "1 radii for 4 axles"),
    ],
)
def test_a_faulty_mapping_is_refused(tmp_path, change, words):
    foreign(tmp_path / "log.csv")
    (tmp_path / "log.toml").write_text(MAPPING.replace(*change))
    with pytest.raises(StudyError) as caught:
        read_log(tmp_path / "log.csv", TRAIN, read_mapping(tmp_path / "log.toml"))
    assert words in str(caught.value)


def test_units_are_those_of_a_library():
    assert factor("1/min", "turning") == pytest.approx(2.0 * np.pi / 60.0)
    assert factor("[km/h]", "speed") == pytest.approx(1.0 / 3.6)
    assert factor("‰", "slope") == pytest.approx(1e-3)
    assert factor("kN", "torque") is None
    assert kinds_of("bar") == {"pressure"}


def test_mdf_is_read_with_the_clock_of_each_channel(tmp_path, damage):
    asammdf = pytest.importorskip("asammdf")
    file = asammdf.MDF(version="4.10")
    for every, part in ((1, "speed"), (5, "force")):
        rows = TABLE.iloc[::every]
        file.append(
            [
                asammdf.Signal(rows[name].to_numpy(), rows["time_s"].to_numpy(), name=GERMAN[name],
                               unit="km/h" if part == "speed" else "kN")
                for name in TABLE if part in name
            ]
        )  # fmt: skip
    file.save(tmp_path / "log.mf4")
    log = read_log(tmp_path / "log.mf4", TRAIN)
    assert analyse_run(log.run, TRAIN).total_damage == pytest.approx(damage, rel=0.02)


def test_tdms_is_read(tmp_path, damage):
    tdms = pytest.importorskip("nptdms")
    with tdms.TdmsWriter(tmp_path / "log.tdms") as writer:
        writer.write_segment(
            [
                tdms.ChannelObject(
                    "run", name, TABLE[name].to_numpy(),
                    {"wf_increment": 0.02, "wf_start_offset": 0.0, "wf_samples": 1},
                )
                for name in TABLE if name != "time_s"
            ]
        )  # fmt: skip
    log = read_log(tmp_path / "log.tdms", TRAIN)
    assert analyse_run(log.run, TRAIN).total_damage == pytest.approx(damage, rel=1e-6)


@pytest.mark.parametrize(("ending", "package"), [("mf4", "asammdf"), ("tdms", "npTDMS")])
def test_a_missing_package_is_named_with_its_extra(tmp_path, monkeypatch, ending, package):
    monkeypatch.setitem(sys.modules, package.lower(), None)
    (tmp_path / f"log.{ending}").write_bytes(b"-")
    with pytest.raises(StudyError, match=rf"needs the package {package}.*readhesion\[logs\]"):
        read_log(tmp_path / f"log.{ending}", TRAIN)


def test_pressure_position_and_a_line_take_part(tmp_path):
    table = TABLE.drop(columns=[name for name in TABLE if "force" in name])
    way = np.cumsum(table["speed_kmh"] / 3.6 * 0.02)
    table = table.assign(
        km=(1000.0 + way) / 1e3, p1=np.maximum(-TABLE["axle1_force_kn"], 0.0) * 0.5
    )
    names = {
        name: {"is": name.rsplit("_", 1)[0], "unit": "km/h"} for name in table if "speed" in name
    }
    names |= {"time_s": {"is": "time", "unit": "s"}, "km": {"is": "position", "unit": "km"}}
    names["p1"] = {"is": "car1_pressure", "unit": "bar", "newton_per_kpa": 20.0}
    mapping = Mapping.model_validate({"columns": names})
    line = GradientLine(np.array([0.0, 1100.0]), np.array([0.0, 0.02]))
    log = check_log(table, TRAIN, "log", mapping, line)
    expected = np.minimum(1e3 * TABLE["axle1_force_kn"], 0.0)
    for axle in (0, 1):  # of the first car
        np.testing.assert_allclose(log.run.applied_force[:, axle], expected, atol=1e-6)
    assert np.isnan(log.run.applied_force[:, 2:]).all()
    np.testing.assert_array_equal(log.grade, np.where(log.position < 1100.0, 0.0, 0.02))
