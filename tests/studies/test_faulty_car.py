"""The estimate names the car of a commuter train that did not deliver its allocated brake force."""

import numpy as np
import pytest

from studies.brake_force.accusations import SOUND, driven_rows, sliding_rows
from studies.brake_force.faulty_car import (
    DECELERATION,
    Fault,
    allocated_stops,
    commuter_train,
    driven_stops,
)

TRAILER, MOTOR = 3, 5


@pytest.fixture(scope="module")
def stops():
    return {
        fault: allocated_stops(fault, 2, draws=3)
        for fault in (None, Fault(TRAILER, (0, 1)), Fault(MOTOR, (), True), Fault(MOTOR, (0, 1), True))
    }  # fmt: skip


def test_the_computers_allocate_in_these_stops(stops):
    for stop, *_ in stops.values():
        assert stop.run.attrs["rule_calls"] > 0
        limited = stop.run["limit"].values != stop.run["expected"].values[:, None]
        assert limited.mean() > 0.1


def test_estimate_is_unbiased_for_every_car(stops):
    for one in stops.values():
        for stop in one:
            found = stop.shortfalls()
            judged = np.isfinite(found.shortfall)
            error = np.abs(found.shortfall - stop.true_shortfall)[judged]
            assert np.all(error < 4.5 * found.deviation[judged])
            assert judged.sum() >= 5


@pytest.mark.parametrize("fault", [Fault(TRAILER, (0, 1)), Fault(MOTOR, (0, 1), True)])
def test_the_car_without_brake_is_named_first(stops, fault):
    for stop in stops[fault]:
        accused = stop.shortfalls().accused
        assert accused[0] == fault.car
        # the lead car's wheels slide on such rails all the time: it is not judged
        mean = stop.allocated[stop.window].mean(axis=0)
        assert np.all(stop.true_shortfall[accused] > SOUND * mean[accused])
        assert stop.slid[0]
        assert np.isnan(stop.shortfalls().shortfall[0])


def test_motors_that_fail_are_replaced_by_air_and_nobody_is_short_for_that(stops):
    for stop in stops[Fault(MOTOR, (), True)]:
        assert MOTOR not in stop.shortfalls().accused
        motors = stop.run["motor_torque"].values[-100:]
        assert np.abs(motors[:, 2]).max() < 1.0 < np.abs(motors[:, 1]).max()


def test_a_sound_train_in_a_dry_stop_delivers_its_shares():
    (stop,) = driven_stops(0, 0.0, 1)
    w = stop.window
    decrement = stop.allocated[w].mean(axis=0).sum() / stop.measured.bare_mass.sum()
    assert decrement == pytest.approx(DECELERATION, rel=1e-6)
    assert np.abs(stop.true_shortfall).max() < 0.08 * stop.allocated.mean()


def test_larger_shortfalls_are_found_more_often():
    rows = {row["missing"]: row for row in driven_rows(4, (0.02, 0.3), 4)}
    assert rows[0.3]["found"] == rows[0.3]["first"] == 1.0
    assert rows[0.02]["found"] <= rows[0.3]["found"]
    assert rows[0.3]["true_share"] - rows[0.02]["true_share"] == pytest.approx(0.28, abs=0.05)


def test_loads_are_drawn():
    one, other = (commuter_train(seed) for seed in (0, 1))
    assert one.cars[0].load != other.cars[0].load
    assert one.couplers is not None
    assert commuter_train(0) == one


def test_a_sliding_trailer_is_not_accused_and_a_faulty_one_beside_it_is():
    sound, faulty = sliding_rows(5, 2)
    for row in (sound, faulty):
        assert row["slides"]
        assert row["sliding_accused"] == 0.0
        assert row["accused_blindly"] == 1.0  # what its wheels say makes the difference
    assert faulty["first"] == 1.0
    assert sound["wrong"] == faulty["wrong"] == 0.0
