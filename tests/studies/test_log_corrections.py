"""What recorders do to a log and the analysis makes up for: the wheel damage is that of the clean log, and it is said."""

from collections.abc import Callable

import numpy as np
import pandas as pd
import pytest

from alloc.metrics import METRICS
from alloc.plant.sets import find_set
from studies.blended.events import scenario as drawn_stop
from studies.core.job import Job, simulate_job
from studies.ladder.events import scenario as drawn_start
from studies.log_accuracy import defects as spoil
from studies.logs.channel_values import forwards
from studies.logs.export import log_table, rounded
from studies.logs.known_train import MeasuredTrain
from studies.logs.measured_log import check_log
from studies.logs.measured_run import analyse_run
from studies.scenario.loading import load_scenario
from tests.simulation.slides import driven
from tests.studies.test_log_defects import SHARE, Clean, clean

Change = Callable[[pd.DataFrame], pd.DataFrame]


def set_back(table: pd.DataFrame) -> pd.DataFrame:
    return table.assign(time_s=table["time_s"].where(table["time_s"] < 5.0, table["time_s"] - 0.3))


def at(table: pd.DataFrame, row: int, name: str, value: float) -> pd.DataFrame:
    table = table.copy()
    table.loc[row, name] = value
    return table


CORRECTED: dict[str, tuple[Change, str, str]] = {
    "one force reversed": (lambda t: t.assign(axle2_force_kn=-t["axle2_force_kn"]), "sign", "against the forces"),
    "all forces reversed": (
        lambda t: t.assign(**{n: -t[n] for n in spoil.forces_of(t)}), "sign", "count the other way round",
    ),
    "clock set back": (set_back, "time", "set back by 0."),
    "a value that no wheel reaches": (
        lambda t: at(t, 400, "axle3_speed_kmh", 90.0), "faulty", "to which no wheel jumps",
    ),
    "a first value": (lambda t: at(t, 0, "axle3_speed_kmh", 90.0), "faulty", "to which no wheel jumps"),
    "a last value": (
        lambda t: at(t, len(t) - 1, "axle3_speed_kmh", 130.0), "faulty", "to which no wheel jumps",
    ),
    "-9999, once": (lambda t: at(t, 400, "axle3_speed_kmh", -9999.0), "missing", "-9999"),
    "wheels rounded": (lambda t: spoil.rounded_to(t, spoil.speeds_of(t), 0.1), "sampling", "rounded"),
}  # fmt: skip


@pytest.fixture(scope="module")
def stop() -> Clean:
    """Eight cars that stop on wet rail."""
    scenario = load_scenario("wet-stop")
    run = simulate_job(Job(scenario, "greedy", "cut-and-ramp", 0))
    return clean(run, scenario.event(0).model.train)


@pytest.fixture(scope="module")
def start() -> Clean:
    """Eight cars whose motors pull; their trailers roll freely."""
    return clean(driven(), find_set("commuter-8car"))


@pytest.mark.parametrize("name", CORRECTED)
def test_the_defect_is_made_up_for_and_said(stop, name):
    change, kind, words = CORRECTED[name]
    log, found = stop.found(change(stop.table))
    assert [r for r in log.remarks if r.kind == kind and words in r.text]
    assert found.total_damage == pytest.approx(stop.damage, rel=SHARE)
    assert abs(len(found.events) - stop.slips) <= 2


@pytest.mark.parametrize("error", [-0.02, 0.01])
def test_a_wheel_that_rolls_freely_tells_its_radius(start, error):
    free = [i for i in spoil.axles_of(start.table) if start.table[f"axle{i}_force_kn"].max() < 0.1]
    log, found = start.found(spoil.by_radius(start.table, {free[0]: 1.0 + error}))
    (remark,) = [r for r in log.remarks if r.kind == "radius"]
    assert f"{100 * abs(error):.1f} % {'faster' if error > 0.0 else 'slower'}" in remark.text
    fast = log.run.speed > 5.0
    own = log.run.rim_speed[fast, free[0] - 1]
    np.testing.assert_allclose(own, log.run.speed[fast], rtol=2e-3)
    assert found.total_damage == pytest.approx(start.damage, rel=SHARE)


def test_a_scale_that_all_wheels_share_is_that_of_the_train_speed(stop):
    log, found = stop.found(stop.table.assign(speed_kmh=1.01 * stop.table["speed_kmh"]))
    (remark,) = [r for r in log.remarks if r.kind == "radius"]
    assert "all wheels turn 1.0 % slower" in remark.text
    assert found.total_damage == pytest.approx(stop.damage, rel=SHARE)


def test_a_recorder_with_a_clock_of_its_own_is_found_by_the_wheels_that_roll(start):
    log, found = start.found(spoil.rear_late(start.table, 0.3))
    (remark,) = [r for r in log.remarks if "than the others" in r.text]
    assert remark.text.startswith("axles 17 to 32: recorded 0.29")
    # the last 0.3 s of those axles are not in the log
    assert found.total_damage == pytest.approx(start.damage, rel=0.08)


@pytest.mark.parametrize("late", [0.15, 0.3])
def test_forces_that_would_have_the_speed_measured_too_early_are_late(start, late):
    log, found = start.found(spoil.shifted(start.table, spoil.forces_of(start.table), late))
    (remark,) = [r for r in log.remarks if r.kind == "delay"]
    assert f"all forces are recorded {late:.2f}" in remark.text
    assert f"in the last {late:.2g} s they are held" in remark.text
    assert found.total_damage == pytest.approx(start.damage, rel=SHARE)


@pytest.mark.parametrize("late", [0.0, 0.2])
def test_wagons_that_start_one_after_another_are_no_delay(late):
    scenario = load_scenario("freight-start")
    run = simulate_job(Job(scenario, "greedy", "cut-and-ramp", 3))
    plain = clean(run, scenario.event(3).model.train)
    log, found = plain.found(spoil.shifted(plain.table, spoil.forces_of(plain.table), late))
    assert [r.kind for r in log.remarks] == ["delay"] * (late > 0.0)
    assert abs(log.run.speed_delay.value) < 0.01
    assert found.total_damage == pytest.approx(plain.damage, rel=SHARE)


ON_HILLS: dict[str, tuple[int, str, Callable[[pd.DataFrame, np.ndarray], pd.DataFrame]]] = {
    "late, and wheels lock": (
        49,
        "perturb-observe",
        lambda t, _: spoil.speed_with_gaps(t, 1.07, 0.5),
    ),
    "pulses, and it rolls back": (
        1,
        "cut-and-ramp",
        lambda t, radius: spoil.counted(t, radius, 0.01),
    ),
    "rounded, and it rolls back": (
        1,
        "cut-and-ramp",
        lambda t, _: spoil.rounded_to(t, spoil.speeds_of(t), 0.1),
    ),
}


@pytest.mark.parametrize("name", ON_HILLS)
def test_stops_on_hills_whose_wheels_lock_or_roll_back(name):
    """Drawn stops in which 3 to 280 % of Q were lost."""
    k, controller, change = ON_HILLS[name]
    scenario = drawn_stop(211, k)
    run = simulate_job(Job(scenario, "cooperative", controller, 0))
    train = scenario.event(0).model.train
    measured, table = MeasuredTrain.of(train), rounded(log_table(run, train))
    log = check_log(change(table, measured.radius), measured, "log")
    found = analyse_run(log.run, measured)
    damage = 1e3 * METRICS.find("damage").function(run)
    assert found.total_damage == pytest.approx(damage, rel=SHARE)


def test_a_speed_that_cannot_be_followed_is_taken_as_it_stands():
    """A drawn start whose sensors say 0 below 1.8 km/h: by them it stands, and then jumps."""
    scenario = drawn_start(307, 18)
    run = simulate_job(Job(scenario, "cooperative", "mpc", 0))
    train = scenario.event(0).model.train
    measured, table = MeasuredTrain.of(train), rounded(log_table(run, train))
    log = check_log(spoil.zero_below(table, 1.8), measured, "log")
    moves = log.run.speed > 1.0
    np.testing.assert_allclose(log.run.speed[moves], table["speed_kmh"][moves] / 3.6, atol=0.05)


def test_a_pulse_back_is_no_fault_and_a_speed_far_below_0_is():
    counts = np.tile([1.0, 0.0], 200)
    counts[300:] *= -1.0
    speed, remarks = forwards("axle1_speed", 3.4 * counts, "log")
    assert (np.isfinite(speed).all(), remarks) == (True, [])
    smooth = np.linspace(20.0, 0.0, 400)
    smooth[100:103] = -3.4
    speed, remarks = forwards("axle1_speed", smooth, "log")
    assert np.isnan(speed[100:103]).all()
    assert "3 values that no train has" in remarks[0].text


@pytest.mark.parametrize("kmh", [0.05, 0.1, 0.2])
def test_a_noisy_start_on_a_hill_has_no_delay(kmh):
    scenario = load_scenario("gradient-start")
    run = simulate_job(Job(scenario, "cooperative", "perturb-observe", 4))
    plain = clean(run, scenario.event(4).model.train)
    log, found = plain.found(spoil.noisy(plain.table, kmh, 3))
    assert abs(log.run.speed_delay.value) < 0.02
    assert found.total_damage == pytest.approx(plain.damage, rel=0.05)


def test_a_wheel_that_never_creeps_as_little_as_the_others_is_named(start):
    pulls = [i for i in spoil.axles_of(start.table) if start.table[f"axle{i}_force_kn"].max() > 1.0]
    log, _ = start.found(spoil.by_radius(start.table, {pulls[0]: 1.03}))
    (remark,) = [r for r in log.remarks if r.kind == "radius"]
    assert remark.column == f"axle{pulls[0]}_speed_kmh"
    assert "than the others: its radius" in remark.text
