"""The air brake in the MPC: what it gives counts as adhesion that is used, and is expected to go on."""

import math
from dataclasses import replace

import numpy as np
import pytest

from alloc.metrics import evaluate
from alloc.onboard.parameters import Braking, Onboard
from alloc.plant.adhesion import PiecewiseCurve, SlipRatioCurve
from alloc.records import ByReference
from alloc.simulation import simulate
from mpc.belief import LEAST_AIR, with_predicted_curve
from mpc.model import air_place, parameters, unit_model
from mpc.period import RealTimeIteration
from mpc.settings import MpcSettings, SlipSearch
from mpc.unit import pose, unit_problem
from studies.scenario.loading import shipped_scenario
from tests.benchmarks.unit_step import right_side
from tests.mpc.drop import drop_event
from tests.mpc.synthetic_axles import SyntheticUnit

AIR = 0.04


def blended(curve, air=AIR, **settings):
    """A unit whose air brake gives a coefficient of `air`, on a rail of 0.12."""
    unit = SyntheticUnit(curve, 0.12, MpcSettings(**settings))
    unit.air = air
    return unit


@pytest.mark.parametrize("air", [0.02, 0.06])
def test_what_is_believed_of_the_rail_does_not_depend_on_who_brakes(air):
    one, other = (blended(PiecewiseCurve(), part) for part in (air, 0.0))
    for k in range(400):
        for unit in (one, other):
            unit.period(0.06 * unit.swing + 0.01 * math.sin(0.03 * k))
    np.testing.assert_allclose(one.belief.peak, other.belief.peak, rtol=0.02)
    assert one.search.elasticity == pytest.approx(other.search.elasticity, abs=0.02)
    assert one.belief.record.air.coefficient[0] == pytest.approx(air, rel=0.05)


def test_elasticity_is_that_of_all_force():
    """That of the motors' part alone would be larger by the share that they do not give."""
    curve = SlipRatioCurve()
    unit = blended(curve, search=SlipSearch(seek=False, given_share=0.5))
    slip = 0.5 * float(curve.limit(0.12, unit.speed)[1])
    for _ in range(400):
        unit.period(slip * unit.swing)
    mu = [float(unit.coefficient(slip * f)) for f in (0.99, 1.01)]
    own = (math.log(mu[1]) - math.log(mu[0])) / (math.log(1.01) - math.log(0.99))
    assert unit.search.elasticity == pytest.approx(own, rel=0.12)


def test_no_estimate_and_a_small_difference_count_as_no_air():
    for air, reading in ((AIR, {"estimate": math.nan}), (0.9 * LEAST_AIR, {})):
        unit = blended(PiecewiseCurve(), air)
        for _ in range(200):
            unit.period(0.03, **reading)
        assert unit.belief.record.air.coefficient[0] == 0.0


def test_the_prediction_has_the_torque_at_every_wheelset(make_context):
    context = make_context()
    rate, none = right_side(unit_model(context)), parameters(context, 0.1)
    with_air = none.copy()
    with_air[air_place(context)] = 500.0
    state = np.array([10.0, *[10.02 / context.radius] * context.axles, 300.0])
    change = rate(state, 300.0, with_air) - rate(state, 300.0, none)
    expected = [0.0, *[500.0 / context.inertia] * context.axles, 0.0]
    np.testing.assert_allclose(np.asarray(change).ravel(), expected, atol=1e-9)


@pytest.mark.parametrize("air", [0.0, AIR, 0.5])
def test_the_motors_bound_is_what_the_air_brake_leaves(air):
    unit = SyntheticUnit(PiecewiseCurve(), 0.12)
    record, predicted = unit.belief.record, with_predicted_curve(unit.context)
    solver = RealTimeIteration(predicted, unit.settings)
    made = unit_problem(predicted, unit.settings, record, solver.period)
    record.air.coefficient[0] = air
    record.load[:] *= [0.7, 0.9, 1.2, 1.2]  # it lies with the axles as they are loaded
    pose(ByReference(made), 1e5, 1e5)
    least, c = record.axles.peak.min(), made.per_coefficient
    expected = max((1.0 + unit.settings.headroom) * least * c - air * c, 0.0)
    np.testing.assert_allclose(made.solver.now.upper, expected)
    torque = air * unit.context.axle_load * unit.context.radius
    np.testing.assert_allclose(made.solver.now.parameters[air_place(predicted)], torque)


def test_a_blended_stop_uses_what_the_rail_carries():
    event = drop_event(
        command=-0.9, speed=15.0, level=0.09, drop=0.7, truth=SlipRatioCurve(0.03, 0.8)
    )
    event = replace(event, onboard=replace(Onboard(), braking=Braking()))
    used = {
        name: evaluate(simulate(event, "alone", name))["utilisation_short"]
        for name in ("mpc", "cut-and-ramp")
    }
    # the slip that it starts with lies at twice that of this peak
    assert used["mpc"] > max(0.935, used["cut-and-ramp"] - 0.01)


def test_cars_and_trains_know_the_air_brake_as_a_unit_does():
    """Without it what shoes take of the rail passes for adhesion that is gone: seven points, and 5 % of the effort."""
    found = {
        name: evaluate(simulate(shipped_scenario("wet-stop").event(3), "alone", name))
        for name in ("mpc", "mpc-car", "mpc-train")
    }
    for name, least in (("mpc-car", 0.92), ("mpc-train", 0.88)):
        assert found[name]["utilisation_short"] > least
        assert found[name]["effort_ratio"] > found["mpc"]["effort_ratio"] - 0.01
