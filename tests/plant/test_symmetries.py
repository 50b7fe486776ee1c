"""The same train told in two ways gives the same run."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve, SlipRatioCurve
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail
from alloc.plant.train import Coupler, Train

DRAFT_GEAR = Coupler(stiffness=5e6, stiffening=1e9, damping=1e5, slack=0.02)
RESISTANCE = (3e3, 60.0, 8.0)


def _uneven_train(car) -> Train:
    """Cars that differ, none of them symmetric about its middle."""
    six = {
        "axle_positions": (1.0, 3.0, 8.0, 10.5, 16.0, 18.0),
        "bogie_of_axle": (0, 0, 1, 1, 2, 2),
        "wheel_inertia": (150.0, 160.0, 170.0, 180.0, 190.0, 200.0),
        "driven": (True, True, False, True, True, True),
    }
    cars = (
        car(False, axle_positions=(2.0, 4.0, 14.0, 16.5)),
        car(True, "1C2M", mass=45e3, **six),
        car(True, "1C1M", driven=(True, False, True, True)),
    )
    return Train("uneven", cars, RESISTANCE, (DRAFT_GEAR, replace(DRAFT_GEAR, slack=0.0)), True)


@pytest.mark.parametrize(
    "curve", [PiecewiseCurve(), POLACH_WET, SlipRatioCurve(0.03, 0.7)], ids=lambda c: type(c).__name__
)  # fmt: skip
@pytest.mark.parametrize("command", [1800.0, -1800.0], ids=["drive", "brake"])
def test_reversed_train_mirrors_the_run(run, car, curve, command):
    """A train backing up does what the train turned round does ahead, on the mirrored line."""
    train = _uneven_train(car)
    length = sum(c.length for c in train.cars)
    level = 0.3 if curve is POLACH_WET else 0.15
    growth = tuple(np.linspace(0.0, 0.02, train.axle_count))
    patch = Patch(0.6, start=20.0, end=400.0, edge=4.0)
    ahead = build(
        train.reversed(), Rail(level, patches=(patch,), increments=growth[::-1], curve=curve)
    )
    mirrored = replace(patch, start=-patch.end, end=-patch.start)
    back = build(train, Rail(level, patches=(mirrored,), increments=growth, curve=curve))
    inputs = {"pressure": 100e3, "sample": 0.05, "step": 1e-3}
    one = run(ahead, 3.0, 15.0, position=length, command=command, **inputs)
    two = run(back, 3.0, -15.0, position=0.0, command=-command, **inputs)

    def same(name, sign):
        mirror = sign * two.rows(name)[:, ::-1]
        scale = np.abs(mirror).max()
        np.testing.assert_allclose(one.rows(name), mirror, rtol=1e-8, atol=1e-8 * scale)

    same("speed", -1.0)
    same("omega", -1.0)
    same("torque", -1.0)
    same("pressure", 1.0)
    same("friction_work", 1.0)
    np.testing.assert_allclose(
        one.rows("position"), length - two.rows("position")[:, ::-1], rtol=1e-9
    )
    assert (
        np.abs(0.43 * one.rows("omega") - one.rows("speed")[:, ahead.structure.axle_body]).max()
        > 0.1
    )


def test_turning_round_twice_is_the_same_train(car):
    train = _uneven_train(car)
    twice = train.reversed().reversed()
    assert [c.axle_positions for c in twice.cars] == [c.axle_positions for c in train.cars]
    assert twice == train


def test_one_coupled_car_is_the_rigid_car(run, train):
    rigid, coupled = (
        train("M", resistance=RESISTANCE),
        train("M", resistance=RESISTANCE, couplers=()),
    )
    rail = Rail(0.12, scatter=0.01, conditioning=0.2)
    states = [
        run(build(t, rail), 2.0, 10.0, command=2000.0, pressure=5e3).state for t in (rigid, coupled)
    ]
    np.testing.assert_array_equal(states[0], states[1])


def test_stiff_couplers_approach_the_rigid_train(run, train):
    stiff = train("TMT").coupled(Coupler(stiffness=1e9, damping=2e6))
    rail = Rail(0.1)
    speeds = [
        run(build(t, rail), 2.0, 10.0, command=2500.0, step=1e-4, sample=0.1).rows("speed")[:, 0]
        for t in (train("TMT"), stiff)
    ]
    np.testing.assert_allclose(speeds[0], speeds[1], rtol=2e-4)
