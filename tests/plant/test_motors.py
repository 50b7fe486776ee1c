"""Motors that share an inverter or a voltage: laws of their torque, all back ends, energy, stability, what is refused."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.balance import mechanical_energy
from alloc.errors import PlantError
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.laws import induction_motor_torque, series_motor_torque
from alloc.plant.model import Model, build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Motors, Train
from tests.cases import looped
from tests.plant.conftest import FLAT
from tests.plant.numpy_plant import compiled_rate
from tests.plant.test_engine import _random, assert_back_ends_agree

BREAKDOWN, SLIP = 10e3, 40.0
"""Breakdown torque [N m] and slip at it [rad/s] of an induction motor; a series motor takes the second as its base speed."""
KINDS = {
    "induction": {"breakdown_torque": BREAKDOWN, "slip_speed": SLIP},
    "series": {"slip_speed": SLIP},
}
SPEEDS = st.floats(0.0, 500.0)


def _with_motors(train: Train, kind: str, group: str = "1C4M") -> Train:
    def changed(car):
        if car.motors is None:
            return car
        return replace(car, motors=replace(car.motors, kind=kind, group=group, **KINDS[kind]))

    return replace(train, cars=tuple(map(changed, train.cars)))


def _model(kind: str, group: str = "1C4M", name: str = "commuter-8car") -> Model:
    return build(_with_motors(find_set(name), kind, group), Rail(0.2, curve=PiecewiseCurve()))


@given(st.floats(-0.99, 0.99), SPEEDS, SPEEDS, SPEEDS)
def test_a_faster_motor_gives_less_and_the_mean_one_what_is_asked(share, mean, own, other):
    torque = share * BREAKDOWN
    at_mean = induction_motor_torque(torque, BREAKDOWN, SLIP, mean, mean)
    assert at_mean == pytest.approx(torque, rel=1e-9, abs=1e-6)
    found = induction_motor_torque(torque, BREAKDOWN, SLIP, mean, own)
    assert abs(found) <= BREAKDOWN * (1.0 + 1e-12)
    # the torque's slope is steepest without slip between field and rotor
    assert abs(found - torque) <= 2.0 * BREAKDOWN / SLIP * abs(own - mean) + 1e-6
    assert series_motor_torque(torque, SLIP, mean, mean) == pytest.approx(torque)
    slow, fast = sorted((own, other))
    assert abs(series_motor_torque(torque, SLIP, mean, fast)) <= abs(
        series_motor_torque(torque, SLIP, mean, slow)
    )
    field = mean + SLIP * share / (1.0 + np.sqrt(1.0 - share**2))  # speed at which it gives nothing
    if max(abs(field - slow), abs(field - fast)) < SLIP:  # both on the stable branch
        assert induction_motor_torque(torque, BREAKDOWN, SLIP, mean, fast) <= 1e-6 + (
            induction_motor_torque(torque, BREAKDOWN, SLIP, mean, slow)
        )


@looped(("kind", "group"), [("induction", "1C4M"), ("induction", "1C2M"), ("series", "1C4M")])
def test_back_ends_agree_and_the_stiffness_bounds_the_jacobian(kind, group):
    model = _model(kind, group)
    assert_back_ends_agree(model, (1.0, 20.0))


@looped("kind", KINDS)
def test_energy_closes_and_the_axle_that_slips_is_relieved(run, train, kind):
    increments = (-0.05, 0.0, 0.0, 0.0)  # the first axle has the worst rail
    slips = {}
    for name, whole in (("torque", train("M")), (kind, _with_motors(train("M"), kind))):
        model = build(whole, Rail(0.2, increments=increments, curve=PiecewiseCurve()))
        trace = run(model, 2.0, 5.0, step=2e-4, sample=2e-3, command=850.0)
        energy = np.array([mechanical_energy(model, state) for state in trace.state])
        motors, shoes, resistance, couplers = trace.rows("work").T
        friction = trace.rows("friction_work").sum(axis=1)
        residual = energy - energy[0] - (motors - shoes - resistance - couplers - friction)
        assert np.abs(residual).max() < 1e-6 * np.abs(motors).max()
        rim = 0.43 * trace.rows("omega")
        slips[name] = float((rim[:, 0] - trace.rows("speed")[:, 0]).max())
    assert slips["torque"] > 1.0
    assert slips[kind] < 0.5 * slips["torque"]


@looped("kind", KINDS)
def test_a_single_motor_has_all_the_torque_of_its_inverter(kind):
    alone = build(replace(find_set("commuter-8car"), cars=_single("torque")), Rail(0.2))
    own = build(replace(find_set("commuter-8car"), cars=_single(kind)), Rail(0.2))
    state, inputs, _ = _random(own, 1)
    slopes = [compiled_rate(model, state, inputs)[0] for model in (alone, own)]
    np.testing.assert_array_equal(*slopes)


def _single(kind: str):
    train = find_set("commuter-8car")
    if kind == "torque":
        cars = (
            replace(car, motors=replace(car.motors, group="1C1M")) if car.motors else car
            for car in train.cars
        )
        return tuple(cars)
    return _with_motors(train, kind, "1C1M").cars


@looped(
    ("fault", "word"),
    [
        ({"kind": "synchronous"}, "kind"),
        ({"kind": "induction", "slip_speed": 1.0, "breakdown_torque": 4000.0}, "must exceed"),
        ({"kind": "series", "slip_speed": -1.0}, "slip_speed"),
    ],
)
def test_what_does_not_fit_is_refused(fault, word):
    with pytest.raises(PlantError, match=word):
        Motors("1C4M", 7.0, FLAT, FLAT, **fault)
