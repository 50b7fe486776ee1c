"""Preparation and feedback apart: what the feedback phase neglects, what it asks for, and what both give together."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.records import ByReference
from mpc.belief import with_predicted_curve
from mpc.period import RealTimeIteration, move
from mpc.settings import MpcError, MpcSettings
from mpc.solver import linearise_at
from mpc.unit import MpcController
from tests.benchmarks.daqp_peer import DaqpIteration
from tests.mpc.conftest import make_unit

CONVERGED = MpcSettings(
    phases_apart=True, tolerance=1e-9, iterations=1000, step_time=1e-6, horizon=8
)
SIZES = np.array([1.0, 0.5, 0.25, 0.125])
"""Of a change between the phases."""


def _order(errors):
    """Order in which errors vanish with `SIZES`."""
    return np.log2(np.array(errors[:-1]) / np.array(errors[1:]))


def _prepared(context, random_problem, number, settings=CONVERGED):
    """A problem, and a solver that has solved it and is prepared for what comes a period later."""
    data, solver = random_problem(context, number), RealTimeIteration(context, settings)
    solver.restart(data.before)
    solver.solve(data)
    assert solver.prepare(data, 0.01)
    return data, solver


@pytest.fixture
def unit():
    return with_predicted_curve(make_unit())


@pytest.mark.parametrize("number", range(4))
def test_the_prepared_trajectory_moves_to_first_order(unit, random_problem, number):
    data, rng, errors = random_problem(unit, number), np.random.default_rng(number), []
    change, torque = 0.02 * rng.normal(size=data.state.size), rng.uniform(-30.0, 30.0)
    for size in SIZES:
        solver = RealTimeIteration(unit, CONVERGED)
        solver.restart(400.0)
        solver.take(data._replace(upper=1e6))
        period = ByReference(solver.period)
        linearise_at(solver.torques, period)
        solver.period.now.state[:] = data.state + size * change
        solver.period.now.upper[:] = 400.0 + size * min(
            torque, -torque
        )  # the bound moves the guess
        move(period)
        moved = solver.period.around.nodes.copy()
        linearise_at(solver.torques, period)
        errors.append(np.abs(moved - solver.period.around.nodes).max())
    assert errors[0] > 1e-9
    assert np.median(_order(errors)) == pytest.approx(2.0, abs=0.4)


def test_one_step_answers_most_of_what_was_not_predicted(unit, random_problem):
    """What is left is of first order: how the sensitivities themselves change with the state is not in the step."""
    settings, left = CONVERGED, []
    for number in range(8):
        data, solver = _prepared(unit, random_problem, number, settings)
        change = 0.002 * np.random.default_rng(number).normal(size=data.state.size)
        before = solver.torques.copy()
        measured = data._replace(state=solver.period.now.state + change)
        found = solver.solve(measured).torques
        other = RealTimeIteration(unit, replace(settings, phases_apart=False))
        other.torques[:] = found
        wanted = other.solve(measured)
        assert wanted.residual < 1e-6
        whole = np.abs(before - wanted.torques).max()
        assert whole > 0.1
        left.append(np.abs(found - wanted.torques).max() / whole)
    assert np.median(left) < 0.1
    assert max(left) < 0.8, "slip that passes its limit bends the problem"


def test_what_was_predicted_is_answered_as_prepared(unit, random_problem):
    data, solver = _prepared(unit, random_problem, 1)
    prepared, state = solver.torques.copy(), solver.period.now.state.copy()
    found = solver.solve(data._replace(state=state))
    np.testing.assert_allclose(found.torques, prepared, rtol=1e-7, atol=1e-6)
    assert found.residual < 1e-7


def test_other_solvers_are_not_passed_over(context):
    with pytest.raises(MpcError, match="phases_apart"):
        MpcController(context, MpcSettings(phases_apart=True), DaqpIteration)
