"""Stops on very low adhesion: what a perfect one is, what is measured, what is asked for, what is said."""

import json
import math
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from alloc.loop import CHUNKS
from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import Onboard, ReferenceSpeed
from alloc.plant.laws import GRAVITY
from alloc.plant.model import build, level_for
from alloc.plant.rail import Line, Rail
from alloc.plant.sets import find_set
from alloc.simulation import simulate
from studies.core.statement import FAILS, HOLDS, TOO_FEW
from studies.files.study_error import StudyError
from studies.stops.wsp_acceptance_study import (
    BELIEF,
    CURVES,
    DRAWN,
    JUMP,
    LEVELS,
    PATCHED,
    REFERENCE_SPEED,
    ROLLING,
    UNIFORM,
    WSP_ACCEPTANCE,
    acceptance_statements,
    adhesion_share,
    air_braked,
    cells,
    chosen_cases,
    discs,
    drawn_case,
    gripping,
    longest_lock,
    measured,
    perfect_stop,
    rail_of,
    shoes,
    stop_of,
    stopped_run,
    table_cases,
)
from tests.studies.made_tables import acceptance_table

TRAIN = discs(2)
SPEED = 20.0
TRUTH = ReferenceSpeed(source="truth")
MANY = ((-math.inf, 0.05), (80.0, 0.02), (120.0, 0.08), (260.0, 0.03))


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("level", [0.02, 0.08, 0.3])
def test_a_level_is_the_maximum_of_its_curve_at_15_m_per_s(curve, level):
    friction = level_for(CURVES[curve], level, REFERENCE_SPEED, TRAIN)
    contact = build(TRAIN, Rail(0.1, curve=CURVES[curve])).environment.contact
    found = CURVES[curve].limit(friction, REFERENCE_SPEED, contact)[0]
    assert np.mean(found) == pytest.approx(level)


@pytest.mark.parametrize("grade", [0.0, 0.03, -0.02])
def test_a_perfect_stop_on_uniform_rail_is_that_of_constant_deceleration(grade):
    model = build(TRAIN, rail_of("polach", 0.05, TRAIN), Line(grades=(grade,)))
    held = GRAVITY * (0.05 + grade / math.hypot(1.0, grade))
    found = perfect_stop(model, SPEED)
    assert found.distance == pytest.approx(SPEED**2 / 2.0 / held, rel=1e-4)
    assert found.time == pytest.approx(SPEED / held, rel=1e-4)


def test_down_a_slope_steeper_than_the_adhesion_nobody_stops():
    model = build(TRAIN, rail_of("piecewise", 0.02, TRAIN), Line(grades=(-0.03,)))
    assert math.isinf(perfect_stop(model, SPEED).distance)


@pytest.mark.parametrize("curve", CURVES)
@pytest.mark.parametrize("grade", [0.0, 0.02, -0.01])
def test_a_perfect_stop_uses_all_the_adhesion_of_any_rail(curve, grade):
    model = build(TRAIN, rail_of(curve, MANY, TRAIN), Line(grades=(grade,)))
    found = perfect_stop(model, SPEED)
    assert adhesion_share(model, SPEED, found.distance) == pytest.approx(1.0, abs=2e-3)
    assert adhesion_share(model, SPEED, 2.0 * found.distance) < 0.9


def test_on_uniform_rail_the_share_is_the_type_tests_formula():
    model = build(find_set("commuter-8car"), rail_of("slip-ratio", 0.04, find_set("commuter-8car")))
    used = adhesion_share(model, SPEED, 700.0)
    assert used == pytest.approx(SPEED**2 / 2.0 / 700.0 / (0.04 * GRAVITY))
    assert adhesion_share(model, SPEED, 350.0, SPEED / math.sqrt(2.0)) == pytest.approx(used)


def test_a_train_with_motors_brakes_with_air_alone_and_keeps_its_masses():
    train = find_set("commuter-8car")
    braked = air_braked(train)
    assert build(braked, rail_of("piecewise", 0.1, TRAIN)).layout.units == 0
    assert (braked.mass, braked.rotating_mass) == (train.mass, train.rotating_mass)
    assert len(braked.brake_groups) == 16
    with pytest.raises(StudyError, match="no air brake"):
        air_braked(find_set("one-axle"))


def test_wrong_shoe_friction_acts_and_is_not_known_on_board():
    plain, wrong = (
        build(gripping(TRAIN, f), rail_of("piecewise", 0.1, TRAIN)) for f in (1.0, 1.15)
    )
    np.testing.assert_allclose(wrong.structure.shoe_gain, 1.15 * plain.structure.shoe_gain)
    known = [equipment(model, Onboard()).group.gain for model in (plain, wrong)]
    np.testing.assert_array_equal(*known)


def test_shoes_and_discs_brake_alike_at_the_reference_speed():
    for speed, sign in ((REFERENCE_SPEED, 0), (3.0, 1), (30.0, -1)):
        forces = []
        for train in (discs(1), shoes(1)):
            s = build(train, rail_of("piecewise", 0.1, TRAIN)).structure
            a, b, c = s.shoe_friction.T
            forces.append((s.shoe_gain * (a / (3.6 * speed + b) + c)).sum())
        assert round((forces[1] / forces[0] - 1.0) * 10.0) in (
            {0} if not sign else {sign, 2 * sign}
        )
        assert np.sign(forces[1] / forces[0] - 1.0 + 1e-12) == sign or sign == 0


def lock_run(pattern, speed=10.0):
    """A run of two axles, of which the first stands where `pattern` says so."""
    standing = np.array(pattern, dtype=bool)
    rim = np.stack([np.where(standing, 0.0, speed), np.full(standing.size, speed)], axis=1)
    time = 0.02 * np.arange(standing.size)
    variables = {
        "speed": ("time", np.full(standing.size, speed)),
        "rim_speed": (("time", "axle"), rim),
    }
    return xr.Dataset(variables, {"time": time})


def test_the_longest_lock_is_one_of_one_axle_above_5_km_per_h():
    assert longest_lock(lock_run([0, 1, 1, 0, 1, 1, 1, 0])) == pytest.approx(0.06)
    assert longest_lock(lock_run([0, 0])) == 0.0
    assert longest_lock(lock_run([1, 1, 1], speed=1.0)) == 0.0


@pytest.fixture(scope="module")
def stop():
    asked = stop_of(TRAIN, "slip-ratio", 0.08, SPEED).under(TRUTH)
    return asked, stopped_run(asked.event)


def test_a_stop_is_measured_from_the_command_to_the_stand(stop):
    asked, run = stop
    found = measured(run, asked)
    assert found["stopped"]
    assert found["locked_axle_s"] == found["longest_lock_s"] == 0.0
    assert found["adhesion_used"] == pytest.approx(
        SPEED**2 / 2.0 / found["distance_m"] / (0.08 * GRAVITY)
    )
    assert 0.85 < found["adhesion_used"] < 1.0
    assert 1.0 < found["over_perfect"] < 1.15
    best = perfect_stop(asked.event.model, SPEED)
    assert found["over_perfect"] == pytest.approx(found["distance_m"] / best.distance)
    assert found["damage_kj"] > 0.0
    assert found["air_nl"] > 0.0
    # no running resistance: it is all the rail's
    assert found["adhesion_used_at_rail"] == pytest.approx(found["adhesion_used"], rel=1e-9)


@pytest.mark.parametrize("grade", [0.0, 0.03, -0.03])
def test_a_train_that_rolls_before_its_command_has_then_the_speed_asked_for(grade):
    """Running resistance and wheelsets count too: the perfect stop is one from this speed."""
    train = replace(find_set("freight-5"), resistance=(3000.0, 100.0, 10.0))
    asked = stop_of(train, "slip-ratio", 0.08, SPEED, grade, duration=ROLLING)
    run = stopped_run(asked.event)
    at = int(np.argmax(run["driver_command"].values < 0.0))
    assert run["speed"].values[at] == pytest.approx(SPEED, rel=2e-4)
    assert run["position"].values[at] == pytest.approx(0.0, abs=0.05)


def test_what_running_resistance_takes_the_rail_does_not():
    train = replace(TRAIN, resistance=(3000.0, 0.0, 0.0))
    asked = stop_of(train, "slip-ratio", 0.05, 8.0).under(TRUTH)
    run = stopped_run(asked.event)
    found = measured(run, asked)
    share = 3000.0 / (0.05 * GRAVITY * train.mass)
    less = found["adhesion_used"] - found["adhesion_used_at_rail"]
    assert less == pytest.approx(share, rel=5e-3)
    carried = -run["rail_force"].sum("axle").values * run["speed"].values
    work = float(np.trapezoid(carried, run["time"].values)) / train.mass
    offered = 0.05 * GRAVITY * found["distance_m"]
    assert found["adhesion_used_at_rail"] == pytest.approx(work / offered, rel=5e-3)


def test_a_stop_that_would_be_too_long_a_run_is_cut_off():
    asked = stop_of(find_set("high-speed-16car"), "polach", 0.02, 80.0)
    assert asked.event.duration > asked.perfect.time


def test_a_run_ends_soon_after_its_train_stands_and_is_the_beginning_of_the_whole(stop):
    event, run = stop[0].event, stop[1]
    assert run["speed"].values[-1] < 0.05 < run["speed"].values[0]
    assert run.sizes["time"] < 0.6 * event.duration / event.record_period
    short = replace(event, duration=run.sizes["time"] * event.record_period)
    assert short.hash != event.hash
    whole = simulate(short, "alone", "none")  # which nothing ends before its time
    np.testing.assert_array_equal(whole["rim_speed"], run["rim_speed"])


@pytest.mark.parametrize("every", [1, 5])
def test_the_speed_at_which_a_run_ends_is_recorded(stop, every):
    event, whole = stop[0].event, stop[1]
    chunk = round(event.duration / event.record_period) // CHUNKS
    least = float(
        whole["speed"].values[20 * chunk]
    )  # when it is looked at, the run is just so slow
    event = replace(event, record_period=every * event.record_period)
    run = simulate(event, "alone", "none", until_speed=least)
    assert run["speed"].values[-1] <= least
    assert run["time"].values[-1] < 0.25 * event.duration


def test_who_does_not_stand_in_time_says_so(stop):
    asked, _ = stop
    short = asked._replace(event=replace(asked.event, duration=ROLLING + 5.0))
    found = measured(stopped_run(short.event), short)
    assert not found["stopped"]
    assert math.isnan(found["over_perfect"])
    assert 0.5 < found["adhesion_used"] < 1.0
    assert found["time_s"] == pytest.approx(4.98)


def test_every_case_of_the_table_is_its_own_and_has_the_adhesion_that_it_says():
    found = cells(0, 12)
    assert len({cell.label for cell in found}) == len(found)
    cases = list(table_cases())
    assert {case.curve for case in cases} == set(CURVES)
    assert {len(case.train.cars) for case in cases} == {1, 2, 3, 5, 8}
    assert sum(case.part == BELIEF for case in cases) == 9 * 4 * 3
    for part in (JUMP, PATCHED):  # from each level of the table to another
        steps = [dict(case.levels) for case in cases if case.part == part]
        assert {level[-math.inf] for level in steps} == set(LEVELS)
        assert all(len({*level.values()} & {*LEVELS}) == 2 for level in steps)
    assert [c.label for c in cells(0, 3)] == [c.label for c in found[: len(found) - 9]]


def test_drawn_stops_are_near_the_tables_and_end():
    for k in range(30):
        case = drawn_case(3, k)
        assert case.part == DRAWN
        assert 0.02 <= case.adhesion <= 0.1
        assert abs(case.grade) <= 0.03
        assert math.isfinite(case.stop().perfect.distance)


@pytest.mark.parametrize(
    "asked",
    [
        {"adhesion": [0.0]}, {"adhesion": [math.nan]}, {"adhesion": [0.05, -1.0]}, {"curve": ["polac"]},
        {"speed_kmh": 0.0}, {"speed_kmh": math.inf}, {"train": "one-axle"}, {"law": "fuzy"},
    ],
)  # fmt: skip
def test_what_cannot_be_asked_for_is_refused(asked):
    with pytest.raises(StudyError):
        cells(0, 0, **asked)


def test_what_is_asked_for_is_run_once_each():
    found = chosen_cases([0.04, 0.06, 0.04], ["polach"], 120.0, "freight-5")
    assert [(c.adhesion, c.curve, c.train.name) for c in found] == [
        (0.04, "polach", "freight-5"), (0.06, "polach", "freight-5")
    ]  # fmt: skip
    assert all(c.speed == pytest.approx(120.0 / 3.6) for c in found)
    assert len(chosen_cases(None, None, 80.0, None)) == 12


def said(table):
    return {statement.name: statement for statement in acceptance_statements(table)}


def test_a_table_in_which_all_is_well_meets_every_aim():
    verdicts = {name: one.verdict for name, one in said(acceptance_table()).items()}
    assert set(verdicts.values()) == {HOLDS}, verdicts


@pytest.mark.parametrize(
    ("name", "where", "change"),
    [
        ("no lock", {"part": UNIFORM, "adhesion": 0.05}, {"locked_axle_s": 0.02}),
        ("stands", {"part": "jump"}, {"stopped": False}),
        ("estimate", {"part": "shoes", "adhesion": 0.08}, {"adhesion_used": 0.944}),
        ("used", {"part": UNIFORM, "adhesion": 0.03}, {"adhesion_used": 0.849}),
        ("used", {"part": UNIFORM, "adhesion": 0.02}, {"adhesion_used": 0.819}),
        ("damage", {"part": UNIFORM, "cars": 3}, {"damage_kj": 5001.0}),
        ("belief", {"part": BELIEF, "friction_factor": 1.15}, {"locked_axle_s": 0.02}),
        ("before", {"part": UNIFORM, "adhesion": 0.12, "cars": 3}, {"damage_kj": 2450.0}),
        ("before", {"part": UNIFORM, "adhesion": 0.08, "curve": "slip-ratio"}, {"adhesion_used": 0.95}),
        ("drawn", {"part": DRAWN}, {"locked_axle_s": 0.02}),
    ],
)  # fmt: skip
def test_an_aim_that_one_kind_of_stop_misses_is_not_met(name, where, change):
    def changed(row):
        return row | (change if all(row[key] == value for key, value in where.items()) else {})

    statement = said(acceptance_table(changed))[name]
    assert statement.verdict == FAILS
    assert all(str(where["part"]) in words for words in statement.conditions)


def test_an_aim_on_which_no_stop_bears_has_no_verdict():
    table = acceptance_table()
    few = said(table[(table["part"] == UNIFORM) & (table["adhesion"] == 0.05)])
    assert few["belief"].verdict == few["before"].verdict == few["drawn"].verdict == TOO_FEW
    assert few["used"].verdict == HOLDS


def test_lists_may_be_given_with_commas_with_spaces_and_again(call, tmp_path):
    common = (
        "sweep",
        "wsp-acceptance",
        "--curve",
        "slip-ratio",
        "--jobs",
        1,
        "--out",
        tmp_path,
        "--json",
    )
    found = []
    for adhesion in (("0.08,0.1",), ("0.08", "0.1"), ("0.08", "--adhesion", "0.1")):
        code, out, _ = call(*common, "--speed-kmh", 40, "--adhesion", *adhesion)
        assert code == 0
        found.append(json.loads(out)["rows"])
    assert found[0] == found[1] == found[2]
    assert [row["adhesion"] for row in found[0]] == [0.08, 0.1]
    for row in found[0]:
        assert (row["curve"], row["train"], row["reference"]) == (
            "slip-ratio",
            "jp4209318-3car",
            "estimated",
        )
        names = (
            "adhesion_used",
            "locked_axle_s",
            "longest_lock_s",
            "damage_kj",
            "air_nl",
            "distance_m",
            "over_perfect",
        )
        assert all(isinstance(row[name], float) for name in names)


def test_the_study_is_in_the_collection_under_its_name():
    assert WSP_ACCEPTANCE.name == "wsp-acceptance"
