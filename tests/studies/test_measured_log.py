"""Logs by API and by command: what can be analysed is, with a remark; what cannot is refused by file, column and row."""

import json
import re
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from scipy.io import savemat

from alloc.errors import PlantError
from alloc.plant.laws import GRAVITY
from alloc.recording import load, save
from studies.files.study_error import StudyError
from studies.logs.force_reports import resistance_report
from studies.logs.mapping import column_names, parse_column
from studies.logs.measured_log import check_log, read_log
from studies.logs.measured_run import MeasuredTrain, analyse_run
from studies.logs.remarks import MOST
from studies.logs.report import fit_remarks
from studies.logs.simulated import write_log
from studies.logs.train import read_log_train, write_log_train
from studies.scenario.train_file import read_train_file
from tests.simulation.slides import TRAIN as THREE_CARS
from tests.simulation.slides import braked, readhering

INERTIA, RADIUS = 100.0, 0.43
TRAIN = MeasuredTrain(
    name="two cars",
    car_mass=np.array([20e3, 20e3]),
    axle_car=np.array([0, 0, 1, 1]),
    axle_load=np.full(4, 10e3 * GRAVITY),
    radius=np.full(4, RADIUS),
    inertia=np.full(4, INERTIA),
    driven=np.zeros(4, dtype=bool),
)


def make_table(count=600, period=0.02) -> pd.DataFrame:
    """A stop from 25 m/s at 0.8 m/s2 after two seconds of coasting; axle 2 slides for two seconds."""
    time = period * np.arange(count)
    braking = np.maximum(time - 2.0, 0.0)
    speed = 25.0 - 0.8 * braking
    force = np.where(time > 2.0, -(10e3 + INERTIA / RADIUS**2) * 0.8, 0.0)
    slide = 4.0 * np.sin(0.5 * np.pi * np.clip(time - 5.0, 0.0, 2.0)) ** 2
    table = pd.DataFrame({"time_s": time, "speed_ms": speed})
    for axle in range(1, 5):
        slip = slide if axle == 2 else np.zeros(count)
        table[f"axle{axle}_speed_ms"] = speed - slip
        # the rail gives every axle the same; the brake also turns the wheelset
        turning = INERTIA / RADIUS**2 * np.gradient(slip, time)
        table[f"axle{axle}_force_kn"] = 1e-3 * (force - turning)
    return table


@pytest.fixture
def table() -> pd.DataFrame:
    return make_table()


def reading(table: pd.DataFrame, train: MeasuredTrain = TRAIN):
    log = check_log(table, train, "log")
    found = analyse_run(log.run, train)
    return log, found, [*log.remarks, *fit_remarks(log, found)]


def test_a_sound_log_has_no_remarks_and_one_slide_in_every_unit(table):
    other = pd.DataFrame({"time_s": table["time_s"], "speed_kmh": 3.6 * table["speed_ms"]})
    for axle in range(1, 5):
        other[f"axle{axle}_speed_rads"] = table[f"axle{axle}_speed_ms"] / RADIUS
        other[f"axle{axle}_torque_nm"] = 1e3 * table[f"axle{axle}_force_kn"] * RADIUS
    logs = [reading(one) for one in (table, other)]
    for name in ("speed", "rim_speed", "applied_force"):
        one, two = (getattr(log.run, name) for log, _, _ in logs)
        np.testing.assert_allclose(two, one, rtol=1e-12, atol=1e-9)
    _, found, remarks = logs[0]
    assert remarks == []
    (event,) = found.events
    assert (event.axle, event.kind, event.cut) == (1, "slide", False)
    assert event.largest_slip == pytest.approx(-4.0)
    assert 5.0 < event.start < event.end < 7.0


def test_columns_are_documented_and_understood():
    for name in column_names():
        stem, units = name.rsplit("_", 1)
        for unit in units.split("|"):
            column = parse_column(stem.replace("N_", "12_").replace("K_", "3_") + f"_{unit}")
            assert column is not None
            assert column.unit == unit
    assert parse_column("axle0_speed_kmh") is None
    assert parse_column("speed") is None


def test_what_is_lost_for_seconds_is_filled_in_and_said_and_for_longer_it_is_a_gap(table):
    """Rows of one second in which a slide grows; the slide's own wheel; thirteen seconds."""
    whole = analyse_run(check_log(table, TRAIN, "log").run, TRAIN).total_damage
    second = table.drop(index=range(250, 300)).reset_index(drop=True)
    own = table.assign(axle2_speed_ms=table["axle2_speed_ms"].where(abs(table.index - 275) > 25))
    for lost in (second, own):
        log, found, remarks = reading(lost)
        assert found.covered[:2] == pytest.approx(table["time_s"].iloc[-1])
        assert log.run.part.max() == 0
        assert [one.kind for one in remarks][1:] == ["gap"]
        assert re.search(r"\d+ % of Q is filled in", remarks[1].text)
        (event,) = found.events  # its beginning is not in the log, and with it the adhesion
        assert event.cut
        assert np.isnan(event.onset_coefficient)
        assert abs(found.total_damage - whole) < 2.0 * found.errors.total
    assert "gap of 1.02 s from 4.98 s to 6 s" in reading(second)[2][0].text
    assert "rows 251 to 301" in reading(own)[2][0].text
    long = make_table(1500).drop(index=range(250, 900)).reset_index(drop=True)
    log, found, (gap,) = reading(long)
    assert ("gap of 13.02 s" in gap.text, gap.row, log.run.part.max()) == (True, 250, 1)
    assert found.covered[0] == pytest.approx(29.98 - 13.02)
    assert found.events == []
    log, _, remarks = reading(table.drop(index=77).reset_index(drop=True))  # a single row
    assert (remarks, log.run.part.max()) == ([], 0)


def test_an_axle_without_a_force_has_slips_and_one_without_a_speed_is_not_analysed(table):
    _, found, remarks = reading(table[[name for name in table if "force" not in name]])
    assert [one.kind for one in remarks] == 4 * ["missing"]
    (event,) = found.events
    assert np.isnan([event.onset_coefficient, event.damage, event.utilisation]).all()
    assert np.isnan(found.axle_damage).all()
    _, found, (missing,) = reading(table.drop(columns="axle2_speed_ms"))
    assert "axle 2 is not analysed" in missing.text
    assert found.events == []


def test_a_stuck_speed_is_filled_in(table):
    table.loc[300:400, "axle1_speed_ms"] = table["axle1_speed_ms"][300]
    log, _, (stuck,) = reading(table)
    assert (stuck.column, stuck.row) == ("axle1_speed_ms", 301)
    assert "filled in, 6 s to 8 s" in stuck.text
    np.testing.assert_allclose(log.run.rim_speed[300:401, 0], log.run.speed[300:401], rtol=2e-3)
    table.loc[300:400, "speed_ms"] = table["speed_ms"][300]
    log, _, remarks = reading(table)
    assert [one.column for one in remarks] == ["speed_ms", "axle1_speed_ms"]
    np.testing.assert_allclose(log.run.speed, make_table()["speed_ms"], atol=0.03)


def test_a_locked_wheel_is_a_slide_and_a_dead_sensor_is_not(table):
    at_once = table.copy()
    at_once.loc[300:400, "axle1_speed_ms"] = 0.0  # within one row no brake stops a wheelset
    locked = at_once.copy()
    locked.loc[280:300, "axle1_speed_ms"] = np.linspace(table["axle1_speed_ms"][280], 0.0, 21)
    rounding = locked.copy()
    rounding.loc[300:400, "axle1_speed_ms"] = np.random.default_rng(3).uniform(0.0, 1e-12, 101)
    for log, wheel_locks in (
        (at_once, False), (locked, True), (rounding, True), (locked.assign(axle1_force_kn=0.0), False),
        (table.assign(axle1_speed_ms=0.0), False),
    ):  # fmt: skip
        _, found, remarks = reading(log)
        (stuck,) = [one for one in remarks if one.kind == "stuck"]
        assert ("a locked wheel" in stuck.text) == wheel_locks
        assert any(one.axle == 0 and one.slip_ratio > 0.999 for one in found.events) == wheel_locks


def test_uneven_and_coarse_sampling_and_what_is_not_known_are_said(table):
    rng = np.random.default_rng(2)
    uneven = table.assign(time_s=table["time_s"] + rng.uniform(-0.005, 0.005, len(table)))
    for log, kind, words in (
        (uneven, "sampling", "uneven sampling"), (make_table(40, 0.3), "sampling", "short slips are missed"),
        (table.assign(axle1_sped_ms=1.0), "unknown", "did you mean 'axle1_speed_ms'?"),
        (table.assign(axle4_force_kn=-9.0), "stuck", "the same value all the time"),
        (table.assign(speed_ms=np.nan), "missing", "no value at all"),
    ):  # fmt: skip
        said = [one.text for one in check_log(log, TRAIN, "log").remarks if one.kind == kind]
        assert words in said[0]


def test_couplers_are_used_all_or_none(table):
    three = MeasuredTrain(**{**vars(TRAIN), "car_mass": np.full(3, 13e3)})
    table["coupler1_force_kn"] = 0.0
    log = check_log(table, three, "log")
    assert log.run.coupler_force is None
    assert "1 of 2 are there, number 2 is not" in log.remarks[-1].text
    table["coupler2_force_kn"] = np.where(abs(table.index - 305) > 5, 0.0, np.nan)
    force = analyse_run(check_log(table, three, "log").run, three).car_force
    assert np.isnan(force[300:311]).all()
    for known in (slice(200, 300), slice(311, None)):
        np.testing.assert_allclose(force[known], 13e3 * 0.8, rtol=1e-6)


def scaled(factor: float, *names: str):
    """Speeds in another unit: these, or all."""
    return lambda t: t.assign(**{n: factor * t[n] for n in names or t if "speed" in n})


FAULTS = {
    "backwards": (lambda t: t.assign(time_s=t["time_s"] - 6.0 * (t.index >= 300)), "row 301: time goes back: 0 s after"),
    "no time": (lambda t: t.assign(time_s=t["time_s"].where(t.index > 400)), "'time_s', row 1: has no time"),
    "short": (lambda t: t.head(5), "5 rows; give 10"),
    "neither speed nor forces": (
        lambda t: t[["time_s", *(f"axle{n}_speed_ms" for n in range(1, 5))]],
        "'speed': neither the train's speed nor a force of an axle is there",
    ),
    "neither speed nor wheels": (
        lambda t: t.drop(columns="speed_ms").assign(**{f"axle{n}_speed_ms": np.nan for n in range(1, 5)}),
        "no wheel has a speed",
    ),
    "misspelt": (lambda t: t.rename(columns={"speed_ms": "sped_ms"}), "is it 'sped_ms'?"),
    "missing time": (lambda t: t.drop(columns="time_s"), "'time_s': is missing"),
    "no wheels": (lambda t: t[["time_s", "speed_ms"]], "axleN_speed_kmh"),
    "text": (lambda t: t.assign(axle1_speed_ms=np.where(t.index == 3, "2:7", "1")), "row 4: '2:7' is not a number"),
    "km/h as m/s": (scaled(3.6, "axle1_speed_ms"), "'axle1_speed_ms': 3.6 times the train's speed"),
    "m/s as km/h": (lambda t: t.rename(columns={"speed_ms": "speed_kmh"}), "3.6 times the train's speed in column"),
    "miles as kilometres": (
        scaled(1.0 / 1.609344, "axle3_speed_ms"),
        "'axle3_speed_ms': 0.621 times the train's speed in column 'speed_ms' all the time: their units do not agree",
    ),
    "miles as kilometres, all": (scaled(0.6214), "by the train's momentum the speeds are in mile/h called km/h"),
    "kilometres as miles, all": (scaled(1.609344), "by the train's momentum the speeds are in km/h called mile/h"),
    "m/s as km/h, all": (scaled(1.0 / 3.6), "by the train's momentum the speeds are in m/s called km/h"),
    "too fast": (scaled(10.0, "speed_ms"), "'speed_ms', row 1: 250 m/s is faster than any train"),
    "negative": (lambda t: t.assign(axle2_speed_ms=t["axle2_speed_ms"].where(t.index > 60, -9.0)), "row 1: -9 m/s is"),
    "N as kN": (lambda t: t.assign(axle1_force_kn=1e3 * t["axle1_force_kn"]), "'axle1_force': forces of up to 86 axle"),
    "axle 5": (lambda t: t.assign(axle5_speed_ms=1.0), "'axle5_speed_ms': train 'two cars' has 4 axles"),
    "two units": (lambda t: t.assign(speed_kmh=1.0), "'speed_kmh': is the same as 'speed_ms'"),
    "force and torque": (lambda t: t.assign(axle1_torque_nm=1.0), "is the same as 'axle1_force_kn'"),
}  # fmt: skip


def test_a_log_that_cannot_be_analysed_is_refused(table, tmp_path):
    for name, (spoil, words) in FAULTS.items():
        with pytest.raises(StudyError) as caught:
            check_log(spoil(table), TRAIN, "day.csv")
        assert words in str(caught.value), name
        assert "log 'day.csv': column " in str(caught.value), name
    for name, text, words in (
        ("a.csv", "", "no table of csv"),
        ("b.csv", "0.0,1.0\n0.1,1.0\n", "give every column a name"),
        ("c.csv", "time_s,speed_ms,speed_ms\n0,1,1\n", "'speed_ms' is there twice"),
        ("d.csv", "time_s,speed_ms\n0,1\n1,2,3\n2,3\n4,4,4\n", "2 rows have another number of fields"),
        ("e.xlsx", "no", "must be .csv or .parquet"),
        ("g.csv", None, "does not exist"),
    ):  # fmt: skip
        if text is not None:
            (tmp_path / name).write_text(text)
        with pytest.raises(StudyError, match=words):
            read_log(tmp_path / name, TRAIN)


def test_a_trains_file_reads_back(tmp_path):
    for coupler in (None, np.array([[2e7, 1e9, 2e5, 0.01]])):
        resistance = np.array([[300.0, 5.0, 2.0], [200.0, 4.0, 1.0]])
        train = replace(TRAIN, resistance=resistance, coupler=coupler)
        write_log_train(train, tmp_path / "train.toml")
        back = read_log_train(str(tmp_path / "train.toml"))
        for name, value in vars(train).items():
            if value is None or name == "name":
                assert getattr(back, name) == value
            else:
                np.testing.assert_allclose(getattr(back, name), value, rtol=1e-14)


def test_a_scenarios_train_file_is_known_too():
    path = str(Path(__file__).parents[2] / "docs" / "plugins" / "tram.toml")
    train, described = read_log_train(path), read_train_file(path)
    np.testing.assert_allclose(train.car_mass, [car.mass for car in described.cars])
    assert train.driven.sum() == 4
    np.testing.assert_array_equal(train.radius, 0.31)


CAR = "name = 'x'\n[[cars]]\nmass_t = 30.0\nwheel_inertia_kgm2 = [90.0]\n"
WHEELED = f"{CAR}wheel_radius_mm = 430.0\n"


def test_a_faulty_train_file_is_refused(tmp_path):
    path = tmp_path / "train.toml"
    for text, words in (
        ("name = 'x'\ncars = []\n", "key 'cars'"),
        (f"{CAR}wheel_radius_mm = 0.43\n", "wheel_radius_mm"),
        (CAR, "wheel_radius_mm"),
        ("nam = 'x'\n", "unknown key 'nam'; did you mean 'name'?"),
        (f"{WHEELED}axle_load_t = [40.0]\n", "axle_load_t sums to 40 t"),
        (f"{WHEELED}driven = [true, false]\n", "driven has 2 entries for 1"),
        (f"{WHEELED}[[couplers]]\nstiffness_n_per_m = 2e7\n", "1 couplers for 1 cars"),
        ("name = \n", "is not TOML"),
    ):
        path.write_text(text)
        with pytest.raises(StudyError) as caught:
            read_log_train(str(path))
        assert words in str(caught.value)
    with pytest.raises(StudyError, match=r"'none.toml' does not exist"):
        read_log_train("none.toml")
    with pytest.raises(PlantError, match="did you mean 'freight-5'"):
        read_log_train("freight5")


def test_a_steady_run_teaches_nothing_of_the_mass(table):
    steady = table.assign(**{name: 20.0 for name in table if "speed" in name})
    steady = steady.assign(**{name: 0.5 for name in table if "force" in name})
    mass = resistance_report(check_log(steady, TRAIN, "log"), None)["weights"]["W3"]
    assert not mass["learnt"]
    assert mass["value"] == pytest.approx(TRAIN.car_mass.sum(), rel=1e-3)
    assert mass["deviation"] == pytest.approx(0.1 * TRAIN.car_mass.sum(), rel=1e-2)


@pytest.fixture
def log(tmp_path):
    """Log of three cars that slide."""
    path = tmp_path / "slide.csv"
    write_log(braked(readhering, duration=6.0), THREE_CARS, path)
    return path


def test_a_simulated_event_goes_out_as_a_log_and_comes_back(call, short_file, tmp_path):
    path = tmp_path / "event.csv"
    code, out, _ = call("simulate", short_file, "--json", "--log", path)
    damage = json.loads(out)["metrics"]["damage"]
    assert code == 0
    code, out, _ = call("analyse", path, "--train", tmp_path / "event.train.toml", "--json")
    content = json.loads(out)
    assert code == 0
    assert content["remarks"] == []
    assert content["rows"] == 200
    assert content["damage_kj"] == pytest.approx(damage, rel=5e-3)  # torques jump between records
    assert len(content["axles"]) == 32


def test_tables_and_a_figure_are_printed_and_json_has_everything(call, log, tmp_path):
    code, out, _ = call(
        "analyse", log, "--train", "jp4209318-3car", "--figure", tmp_path / "log.png"
    )
    assert code == 0
    assert all(text in out for text in ("slips and slides", "Q [kJ]", "from [s]", "wheel damage Q"))
    assert (tmp_path / "log.png").read_bytes().startswith(b"\x89PNG")
    _, out, _ = call("analyse", log, "--train", "jp4209318-3car", "--json", "--slip-percent", 2)
    content = json.loads(out)
    assert content["criterion"] == {"slip_velocity_ms": pytest.approx(0.2), "slip_ratio": 0.02}
    assert {event["kind"] for event in content["events"]} == {"slide"}
    assert content["cars"] is None
    assert content["axles"][0]["slides"] >= 1


def test_remarks_of_one_kind_are_one_line(call, log, tmp_path):
    table = pd.read_csv(log)
    table.loc[::13, "axle1_speed_kmh"] = None
    spoilt = tmp_path / "spoilt.csv"
    table.drop(index=range(100, 150)).to_csv(spoilt, index=False)
    code, out, _ = call("analyse", spoilt, "--train", "jp4209318-3car")
    assert code == 0
    assert "gap of 0.51 s from 0.99 s to 1.5 s" in out
    assert "no value in 43 rows, the first 1, interpolated" in out
    _, out, _ = call("analyse", spoilt, "--train", "jp4209318-3car", "--json")
    assert len(json.loads(out)["remark_groups"]) <= MOST


def test_several_logs_give_a_report_each_and_a_list_of_slips(call, log, tmp_path):
    other = tmp_path / "other.csv.gz"
    pd.read_csv(log).to_csv(other, index=False)
    code, out, _ = call(
        "analyse", log, other, tmp_path / "none.csv", "--train", "jp4209318-3car",
        "--out", tmp_path / "reports", "--events", tmp_path / "slips.csv",
    )  # fmt: skip
    assert code == 0
    assert "failed" in out
    assert "none.csv" in out
    reports = sorted(path.name for path in (tmp_path / "reports").iterdir())
    assert reports == ["other.csv.gz.json", "slide.csv.json"]
    found = json.loads((tmp_path / "reports" / "slide.csv.json").read_text())
    slips = pd.read_csv(tmp_path / "slips.csv")
    assert len(slips) == 2 * (len(found["events"]) + len(found["small_events"]))
    assert set(slips["kind"]) == {"slide"}


def test_a_log_is_compared_with_a_run_of_the_same_train_alone(call, log):
    own = ("analyse", log, "--train", "jp4209318-3car")
    code, out, _ = call(*own, "--against", log, "--resistance", "--brakes", "--json")
    assert code == 0
    content = json.loads(out)
    assert content["comparison"]["log"] == content["comparison"]["simulated"]
    assert content["comparison"]["damage_differs"] is False
    assert set(content["resistance"]["weights"]) == {"W1", "W2", "W3", "A", "B"}
    assert content["brakes"] is None  # its couplers are not measured
    code, _, err = call(*own, "--against", "wet-stop")
    assert code == 2
    assert "give a run of the same train" in err


def test_a_log_is_compared_with_a_recorded_run(call, tmp_path):
    """Logs and runs, also as files of MATLAB: the run is the one that was saved, and a log is not taken for one."""
    run = braked(readhering, duration=6.0)
    for path, recorded in (
        (tmp_path / "slide.csv", tmp_path / "run.nc"),
        (tmp_path / "slide.mat", tmp_path / "run.mat"),
    ):
        write_log(run, THREE_CARS, path)
        save(run, recorded)
        xr.testing.assert_identical(load(recorded), run)
        options = ("analyse", path, "--train", tmp_path / "slide.train.toml", "--json", "--against")
        for other in (recorded, path):
            code, out, _ = call(*options, other)
            content = json.loads(out)["comparison"]
            assert code == 0
            for name in ("duration_s", "damage_kj", "slides"):
                assert content["log"][name] == pytest.approx(content["simulated"][name], rel=2e-3)

    save(run.drop_vars("unit_gear"), tmp_path / "part.mat")
    savemat(tmp_path / "bare.mat", {"attributes": 1.0})
    save(run.drop_vars("unit_gear"), tmp_path / "part.nc")
    (tmp_path / "text.nc").write_text("time_s;v")
    save(run.assign_attrs(train_mass=2e5), tmp_path / "light.nc")
    for name, words in (
        ("part.nc", "has no 'unit_gear'"),
        ("text.nc", "is no file of netCDF"),
        ("part.mat", "has no 'unit_gear'"),
        ("bare.mat", "is no file of MATLAB"),
        ("light.nc", "200.0 t, that of the log"),
        ("none.nc", "does not exist"),
    ):
        code, _, err = call(*options, tmp_path / name)
        assert code == 2
        assert words in " ".join(err.split())
