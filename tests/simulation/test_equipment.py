"""Trailers in front, reversal, inverter groups, load signals, telegrams: who leads, what is believed, what is recorded."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import Belief, Onboard, Sensors, Telegrams
from alloc.plant.model import build
from alloc.plant.rail import Rail, logarithmic_increments
from alloc.plant.sets import find_set
from alloc.simulation import DriverCommand, Event, simulate

TRAIN = find_set("commuter-8car")
GROWTH = tuple(logarithmic_increments(TRAIN.axle_count))


PATENT = Onboard(belief=Belief(increments=GROWTH), trigger="slip")
"""Computers that follow (5) from the leader's detection."""


def start(train, rail, onboard=None, **options):
    """A start of `train` that believes the increments (15)."""
    onboard = onboard or Onboard(belief=Belief(increments=GROWTH))
    return Event("start", build(train, rail), DriverCommand((0.0,), (0.8,)), onboard, **options)


def test_behind_a_lead_trailer_the_first_motor_car_leads():
    run = simulate(start(TRAIN, Rail(0.13, increments=GROWTH), duration=3.0), "greedy")
    assert not any(TRAIN.cars[0].driven)
    axles = np.flatnonzero(run["axle_unit"].values == 0)
    assert set(run["axle_car"].values[axles]) == {1}
    assert run.attrs["detections"] > 0


def test_reversed_the_other_end_leads_and_the_increments_follow():
    # the train has motor cars 2, 3, 6, 7 of 8: alike from both ends, but not in its loads
    cars = tuple(replace(car, load=500.0 * k) for k, car in enumerate(TRAIN.cars))
    train = replace(TRAIN, cars=cars)
    rail = Rail(0.125, increments=GROWTH)
    ahead, back = (
        simulate(start(t, rail, PATENT, duration=4.0), "greedy") for t in (train, train.reversed())
    )
    assert ahead["unit_static_load"].values[0] < back["unit_static_load"].values[0]
    for run in (ahead, back):
        allocated = np.flatnonzero(run["case"].values > 0)
        assert allocated.size
        limits = run["limit"].values[allocated[-1]]
        assert limits[0] == limits.min()  # whoever leads has the lowest cap
    eq, eq_back = (
        equipment(build(t, rail), Onboard(belief=Belief(increments=GROWTH)))
        for t in (train, train.reversed())
    )
    np.testing.assert_array_equal(eq.learnt.increment, eq_back.learnt.increment)


@pytest.mark.parametrize(("group", "axles"), [("1C4M", 4), ("1C2M", 2), ("1C1M", 1)])
def test_increments_are_averaged_over_the_units_own_axles(group, axles):
    cars = tuple(
        replace(car, motors=replace(car.motors, group=group)) if car.motors else car
        for car in TRAIN.cars
    )
    model = build(replace(TRAIN, cars=cars), Rail(0.14, increments=GROWTH))
    eq = equipment(model, Onboard(belief=Belief(increments=GROWTH)))
    driven = sum(sum(car.driven) for car in TRAIN.cars)
    assert eq.axles.tolist() == [axles] * (driven // axles)
    for j in range(eq.axles.size):
        own = np.array(GROWTH)[eq.axle_unit == j]
        assert eq.learnt.increment[j] == pytest.approx(own.mean())


@pytest.mark.parametrize("group", ["1C4M", "1C2M", "1C1M"])
def test_every_inverter_group_redistributes(group):
    cars = tuple(
        replace(car, motors=replace(car.motors, group=group)) if car.motors else car
        for car in TRAIN.cars
    )
    event = start(replace(TRAIN, cars=cars), Rail(0.12, increments=GROWTH), PATENT, duration=4.0)
    run = simulate(event, "greedy")
    allocated = run["case"].values > 0
    assert allocated.any()
    last = run["limit"].values[allocated][-1]
    assert np.all(np.diff(last) >= 0.0)
    assert last[-1] > last[0]


def test_load_signals_err_as_stated():
    loaded = replace(TRAIN, cars=tuple(replace(car, load=8000.0) for car in TRAIN.cars))
    model = build(loaded, Rail(0.14))
    exact, wrong = (
        equipment(model, Onboard(sensors=Sensors(load_error=error, seed=3))) for error in (0.0, 0.1)
    )
    np.testing.assert_allclose(exact.load_per_axle, 2000.0)
    relative = wrong.load_per_axle / 2000.0 - 1.0
    assert 0.01 < np.abs(relative).max() < 0.4


def test_a_unit_that_hears_nothing_says_so_in_the_record():
    onboard = Onboard(belief=Belief(increments=GROWTH), telegrams=Telegrams(loss=1.0, silence=0.5))
    run = simulate(start(TRAIN, Rail(0.12, increments=GROWTH), onboard, duration=3.0), "greedy")
    fallen = run["fallen_back"].values
    assert not fallen[:, 0].any()  # B1 needs no telegram
    assert not fallen[run["time"].values < 0.4].any()
    assert fallen[run["time"].values > 0.7, 1:].all()
    assert run.attrs["fallbacks"] == run.sizes["unit"] - 1


def test_jitter_spreads_the_arrival_of_one_telegram():
    onboard = Onboard(
        belief=Belief(increments=GROWTH), telegrams=Telegrams(period=0.1, latency=0.05, jitter=0.2)
    )
    run = simulate(start(TRAIN, Rail(0.12, increments=GROWTH), onboard, duration=4.0), "greedy")
    limit = run["limit"].values
    first_change = [
        np.flatnonzero(np.diff(limit[:, j]) != 0.0)[0] for j in range(1, limit.shape[1])
    ]
    assert len(set(first_change)) > 1
