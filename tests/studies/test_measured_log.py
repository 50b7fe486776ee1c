"""Faulty logs: what can be analysed is, with a remark, and what cannot is refused by file, column and row."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest

from alloc.errors import PlantError
from alloc.plant.laws import GRAVITY
from studies.files.study_error import StudyError
from studies.logs.columns import column_names, parse_column
from studies.logs.measured_log import check_log, read_log
from studies.logs.measured_run import MeasuredTrain, analyse_run
from studies.logs.measured_train import read_log_train, write_log_train
from studies.logs.momentum_check import fitting_units
from studies.scenario.train_file import read_train_file

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
        table[f"axle{axle}_force_kn"] = 1e-3 * (
            force - INERTIA / RADIUS**2 * np.gradient(slip, time)
        )
    return table


@pytest.fixture
def table() -> pd.DataFrame:
    return make_table()


def remarks(table, kind):
    return [r for r in check_log(table, TRAIN, "log").remarks if r.kind == kind]


def test_a_sound_log_has_no_remarks_and_one_slide(table):
    log = check_log(table, TRAIN, "log")
    assert log.remarks == ()
    (event,) = analyse_run(log.run, TRAIN).events
    assert (event.axle, event.kind, event.cut) == (1, "slide", False)
    assert event.largest_slip == pytest.approx(-4.0)
    assert 5.0 < event.start < event.end < 7.0


def test_every_unit_of_a_quantity_gives_the_same(table):
    other = pd.DataFrame({"time_s": table["time_s"], "speed_kmh": 3.6 * table["speed_ms"]})
    for axle in range(1, 5):
        other[f"axle{axle}_speed_rads"] = table[f"axle{axle}_speed_ms"] / RADIUS
        other[f"axle{axle}_torque_nm"] = 1e3 * table[f"axle{axle}_force_kn"] * RADIUS
    one, two = (check_log(item, TRAIN, "log").run for item in (table, other))
    for name in ("speed", "rim_speed", "applied_force"):
        np.testing.assert_allclose(getattr(two, name), getattr(one, name), rtol=1e-12, atol=1e-9)


def test_columns_are_documented_and_understood():
    for name in column_names():
        stem, units = name.rsplit("_", 1)
        for unit in units.split("|"):
            column = parse_column(stem.replace("N_", "12_").replace("K_", "3_") + f"_{unit}")
            assert column is not None
            assert column.unit == unit
    assert parse_column("axle0_speed_kmh") is None
    assert parse_column("speed") is None


def test_a_gap_is_reported_and_never_bridged(table):
    cut = table.drop(index=range(250, 300)).reset_index(drop=True)
    (gap,) = remarks(cut, "gap")
    assert "gap of 1.02 s from 4.98 s to 6 s" in gap.text
    assert gap.row == 250
    log = check_log(cut, TRAIN, "log")
    found = analyse_run(log.run, TRAIN)
    assert found.covered[0] == pytest.approx(table["time_s"].iloc[-1] - 1.02)
    (event,) = found.events  # its beginning is in the gap
    assert event.cut
    assert event.start == pytest.approx(6.0)
    assert np.isnan(event.onset_coefficient)  # and with it the adhesion
    # what happened in the gap is not in Q
    whole = analyse_run(check_log(table, TRAIN, "log").run, TRAIN)
    assert 0.0 < found.total_damage < 0.8 * whole.total_damage


def test_a_single_lost_row_is_no_gap(table):
    lost = table.drop(index=77).reset_index(drop=True)
    log = check_log(lost, TRAIN, "log")
    assert log.remarks == ()
    assert log.run.part.max() == 0


def test_missing_values_of_one_axle_leave_the_others_alone(table):
    table.loc[260:279, "axle2_speed_ms"] = np.nan
    (missing,) = remarks(table, "missing")
    assert missing.column == "axle2_speed_ms"
    assert "rows 261 to 280, 5.2 s to 5.58 s" in missing.text
    found = analyse_run(check_log(table, TRAIN, "log").run, TRAIN)
    assert np.isnan(found.coefficient[260:280, 1]).all()
    assert np.isfinite(found.coefficient[:, 0]).all()
    assert [event.cut for event in found.events] == [True]


def test_without_forces_slips_are_found_all_the_same(table):
    bare = table[[name for name in table if "force" not in name]]
    assert len(remarks(bare, "missing")) == 4
    found = analyse_run(check_log(bare, TRAIN, "log").run, TRAIN)
    (event,) = found.events
    assert np.isnan([event.onset_coefficient, event.damage, event.utilisation]).all()
    assert np.isnan(found.axle_damage).all()


def test_an_axle_without_speed_is_not_analysed(table):
    del table["axle2_speed_ms"]
    (missing,) = remarks(table, "missing")
    assert "axle 2 is not analysed" in missing.text
    assert analyse_run(check_log(table, TRAIN, "log").run, TRAIN).events == []


def test_a_stuck_speed_is_cut_out(table):
    table.loc[300:400, "axle1_speed_ms"] = table["axle1_speed_ms"][300]
    (stuck,) = remarks(table, "stuck")
    assert (stuck.column, stuck.row) == ("axle1_speed_ms", 301)
    run = check_log(table, TRAIN, "log").run
    assert np.isnan(run.rim_speed[300:401, 0]).all()
    assert np.isfinite(run.rim_speed[:300, 0]).all()
    table.loc[300:400, "speed_ms"] = table["speed_ms"][300]
    assert remarks(table, "stuck")[0].column == "speed_ms"


def test_a_locked_wheel_is_a_slide_and_a_dead_sensor_is_not(table):
    table.loc[300:400, "axle1_speed_ms"] = 0.0
    (dead,) = remarks(table, "stuck")
    assert "dead sensor" in dead.text  # within one row no brake stops a wheelset
    table.loc[280:300, "axle1_speed_ms"] = np.linspace(table["axle1_speed_ms"][280], 0.0, 21)
    (locked,) = remarks(table, "stuck")
    assert "locked wheel" in locked.text
    (dead,) = remarks(table.assign(axle1_force_kn=0.0), "stuck")
    assert "no brake holds the wheel" in dead.text
    found = analyse_run(check_log(table, TRAIN, "log").run, TRAIN)
    assert any(event.axle == 0 and event.slip_ratio == 1.0 for event in found.events)
    table["axle1_speed_ms"] = 0.0
    (dead,) = remarks(table, "stuck")
    assert "cut out" in dead.text


def test_uneven_and_coarse_sampling_is_reported(table):
    rng = np.random.default_rng(2)
    table["time_s"] += rng.uniform(-0.005, 0.005, len(table))
    (uneven,) = remarks(table, "sampling")
    assert "uneven sampling" in uneven.text
    (coarse,) = remarks(make_table(40, 0.3), "sampling")
    assert "short slips are missed" in coarse.text


def test_unknown_columns_are_named_with_the_nearest_known_one(table):
    table["axle1_sped_ms"] = 1.0
    (unknown,) = remarks(table, "unknown")
    assert "did you mean 'axle1_speed_ms'?" in unknown.text


def test_a_wheel_of_another_radius_is_seen_while_it_rolls(table):
    table["axle3_speed_ms"] *= 1.012
    (radius,) = remarks(table, "radius")
    assert (radius.column, "1.2 % faster" in radius.text) == ("axle3_speed_ms", True)


@pytest.mark.parametrize(
    ("factor", "words"),
    [
        (1e-3, "0.012 % of the axle load"),
        (0.3, "wrong unit"),
        (0.8, "1.3 ± 0.0034 times their impulse"),
    ],
)
def test_forces_that_do_not_fit_the_motion_are_seen(table, factor, words):
    for axle in range(1, 5):
        table[f"axle{axle}_force_kn"] *= factor
    (found,) = remarks(table, "balance")
    assert words in found.text


@pytest.mark.parametrize(
    ("factor", "words"),
    [(0.6214, "mile/h that are taken for km/h"), (1.0 / 3.6, "m/s that are taken for km/h")],
)
def test_the_unit_that_would_fit_is_named(table, factor, words):
    table[[name for name in table if "speed" in name]] *= factor
    (found,) = remarks(table, "balance")
    assert words in found.text


@pytest.mark.parametrize(
    ("ratio", "words"),
    [(1.6, "mile/h"), (4.4, "lbf"), (10.0, "kgf"), (980.0, "kN that are taken for N"), (2.0, ""), (-3.6, "")],
)  # fmt: skip
def test_units_are_named_where_one_is_near(ratio, words):
    found = fitting_units(ratio)
    assert words in found
    assert bool(found) == bool(words)


def test_a_force_that_never_changes_is_remarked_on(table):
    table["axle4_force_kn"] = -9.0
    assert [remark.column for remark in remarks(table, "stuck")] == ["axle4_force_kn"]


def test_couplers_are_used_all_or_none(table):
    three = MeasuredTrain(**{**vars(TRAIN), "car_mass": np.full(3, 13e3)})
    table["coupler1_force_kn"] = 0.0
    log = check_log(table, three, "log")
    assert log.run.coupler_force is None
    assert "1 of 2 are there, number 2 is not" in log.remarks[-1].text
    table["coupler2_force_kn"] = 0.0
    force = analyse_run(check_log(table, three, "log").run, three).car_force
    np.testing.assert_allclose(force[200:], 13e3 * 0.8, rtol=1e-6)
    table.loc[300:310, "coupler2_force_kn"] = np.nan
    force = analyse_run(check_log(table, three, "log").run, three).car_force
    assert np.isnan(force[300:311]).all()
    np.testing.assert_allclose(force[311:], 13e3 * 0.8, rtol=1e-6)


FAULTS = {
    "backwards": (
        lambda t: t.assign(time_s=t["time_s"].where(t.index < 300, t["time_s"] - 6.0)),
        "row 301: time goes back: 0 s after 5.98 s",
    ),
    "no time": (
        lambda t: t.assign(time_s=t["time_s"].where(t.index > 400)),
        "'time_s', row 1: has no time",
    ),
    "short": (lambda t: t.head(5), "5 rows; give 10"),
    "neither speed nor forces": (
        lambda t: t[
            ["time_s", *(name for name in t if name.startswith("axle") and "speed" in name)]
        ],
        "'speed_kmh or speed_ms': is missing and cannot be estimated: axle 1 has no force",
    ),
    "neither speed nor wheels": (
        lambda t: t.drop(columns="speed_ms").assign(
            **{f"axle{n}_speed_ms": np.nan for n in range(1, 5)}
        ),
        "no wheel has a speed",
    ),
    "misspelt": (lambda t: t.rename(columns={"speed_ms": "sped_ms"}), "is it 'sped_ms'?"),
    "missing time": (lambda t: t.drop(columns="time_s"), "'time_s': is missing"),
    "no wheels": (lambda t: t[["time_s", "speed_ms"]], "axleN_speed_kmh"),
    "text": (
        lambda t: t.assign(axle1_speed_ms=np.where(t.index == 3, "2:7", "1")),
        "'axle1_speed_ms', row 4: '2:7' is not a number",
    ),
    "km/h as m/s": (
        lambda t: t.assign(axle1_speed_ms=3.6 * t["axle1_speed_ms"]),
        "'axle1_speed_ms': 3.6 times the train's speed",
    ),
    "m/s as km/h": (
        lambda t: t.rename(columns={"speed_ms": "speed_kmh"}),
        "3.6 times the train's speed in column 'speed_kmh'",
    ),
    "miles as kilometres": (
        lambda t: t.assign(axle3_speed_ms=t["axle3_speed_ms"] / 1.609344),
        "'axle3_speed_ms': 0.621 times the train's speed in column 'speed_ms' all the time: their units do not agree",
    ),
    "too fast": (
        lambda t: t.assign(speed_ms=10 * t["speed_ms"]),
        "'speed_ms', row 1: 250 m/s is faster than any train",
    ),
    "negative at times": (
        lambda t: t.assign(axle2_speed_ms=np.where(t.index < 60, -9.0, t["axle2_speed_ms"])),
        "'axle2_speed_ms', row 1: -9 m/s is negative",
    ),
    "N as kN": (
        lambda t: t.assign(axle1_force_kn=1e3 * t["axle1_force_kn"]),
        "exceed the axle load of 98.07 kN; wrong unit?",
    ),
    "axle 5": (
        lambda t: t.assign(axle5_speed_ms=1.0),
        "'axle5_speed_ms': train 'two cars' has 4 axles",
    ),
    "two units": (lambda t: t.assign(speed_kmh=1.0), "'speed_kmh': is the same as 'speed_ms'"),
    "force and torque": (
        lambda t: t.assign(axle1_torque_nm=1.0),
        "is the same as 'axle1_force_kn'",
    ),
    "nothing known": (lambda t: t.assign(speed_ms=np.nan), "at no instant"),
}


@pytest.mark.parametrize("fault", FAULTS)
def test_a_log_that_cannot_be_analysed_is_refused(table, fault):
    spoil, words = FAULTS[fault]
    with pytest.raises(StudyError) as caught:
        check_log(spoil(table), TRAIN, "day.csv")
    assert words in str(caught.value)
    assert "log 'day.csv': column " in str(caught.value)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("", "no table of csv"),
        ("0.0,1.0\n0.1,1.0\n", "give every column a name"),
        ("time_s,speed_ms,speed_ms\n0,1,1\n", "'speed_ms' is there twice"),
        ("time_s,speed_ms\n0,1\n1,2,3\n2,3\n4,4,4\n", "2 rows have another number of fields"),
    ],
)
def test_files_that_are_no_tables_are_refused(tmp_path, text, words):
    path = tmp_path / "log.csv"
    path.write_text(text)
    with pytest.raises(StudyError, match=words):
        read_log(path, TRAIN)


def test_other_files_are_refused(tmp_path):
    (tmp_path / "log.parquet").write_text("no")
    for name, words in (("log.xlsx", "must be .csv or .parquet"), ("none.csv", "does not exist"),
                        ("log.parquet", "no table of parquet")):  # fmt: skip
        with pytest.raises(StudyError, match=words):
            read_log(tmp_path / name, TRAIN)


def test_csv_and_parquet_hold_the_same_log(table, tmp_path):
    table.to_csv(tmp_path / "log.csv", index=False)
    table.to_parquet(tmp_path / "log.parquet", index=False)
    runs = [read_log(tmp_path / f"log.{ending}", TRAIN).run for ending in ("csv", "parquet")]
    for name in ("time", "speed", "rim_speed", "applied_force"):
        np.testing.assert_allclose(getattr(runs[0], name), getattr(runs[1], name), rtol=1e-14)


@pytest.mark.parametrize("coupler", [None, np.array([[2e7, 1e9, 2e5, 0.01]])])
def test_a_trains_file_reads_back(tmp_path, coupler):
    resistance = np.array([[300.0, 5.0, 2.0], [200.0, 4.0, 1.0]])
    train = replace(TRAIN, resistance=resistance, coupler=coupler)
    write_log_train(train, tmp_path / "train.toml")
    back = read_log_train(str(tmp_path / "train.toml"))
    for name, value in vars(train).items():
        if name == "name":
            assert back.name == value
        else:
            np.testing.assert_equal(value is None, getattr(back, name) is None)
            if value is not None:
                np.testing.assert_allclose(getattr(back, name), value, rtol=1e-14)


def test_a_scenarios_train_file_is_known_too():
    path = str(Path(__file__).parents[2] / "docs" / "plugins" / "tram.toml")
    train, described = read_log_train(path), read_train_file(path)
    np.testing.assert_allclose(train.car_mass, [car.mass for car in described.cars])
    assert train.driven.sum() == 4
    np.testing.assert_array_equal(train.radius, 0.31)


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("name = 'x'\ncars = []\n", "key 'cars'"),
        (
            "name = 'x'\n[[cars]]\nmass_t = 30.0\nwheel_radius_mm = 0.43\nwheel_inertia_kgm2 = [90.0]\n",
            "wheel_radius_mm",
        ),
        ("nam = 'x'\n", "unknown key 'nam'; did you mean 'name'?"),
        ("name = 'x'\n[[cars]]\nmass_t = 30.0\nwheel_inertia_kgm2 = [90.0]\n", "wheel_radius_mm"),
        (
            "name = 'x'\n[[cars]]\nmass_t = 30.0\nwheel_radius_mm = 430.0\nwheel_inertia_kgm2 = [90.0]\n"
            "axle_load_t = [40.0]\n",
            "axle_load_t sums to 40 t",
        ),
        (
            "name = 'x'\n[[cars]]\nmass_t = 30.0\nwheel_radius_mm = 430.0\nwheel_inertia_kgm2 = [90.0]\n"
            "driven = [true, false]\n",
            "driven has 2 entries for 1",
        ),
        (
            "name = 'x'\n[[couplers]]\nstiffness_n_per_m = 2e7\n"
            "[[cars]]\nmass_t = 30.0\nwheel_radius_mm = 430.0\nwheel_inertia_kgm2 = [90.0]\n",
            "1 couplers for 1 cars",
        ),
        ("name = \n", "is not TOML"),
    ],
)
def test_a_faulty_train_file_is_refused(tmp_path, text, words):
    path = tmp_path / "train.toml"
    path.write_text(text)
    with pytest.raises(StudyError) as caught:
        read_log_train(str(path))
    assert words in str(caught.value)


def test_trains_that_do_not_exist_are_refused():
    with pytest.raises(StudyError, match=r"'none.toml' does not exist"):
        read_log_train("none.toml")
    with pytest.raises(PlantError, match="did you mean 'freight-5'"):
        read_log_train("freight5")
