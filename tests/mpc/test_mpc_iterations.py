"""The default number of iterations does as well in the closed loop as convergence; the residual tells where one does not."""

import math
from dataclasses import replace

import numpy as np
import pytest

from alloc.metrics import evaluate
from mpc.settings import MpcSettings
from mpc.unit import MpcController
from studies.scenario.loading import load_scenario
from tests.mpc.drop import drop_event, run_mpc

CONVERGED = MpcSettings(iterations=1000, tolerance=1e-6, step_time=1e-6)
ONE = MpcSettings(iterations=1)


class _Accounting(MpcController):
    """Adds up its own stage cost along the run, and keeps the residuals."""

    def __init__(self, context, settings=None):
        super().__init__(context, settings)
        self._radius = context.radius
        self.cost, self.residuals, self._last = 0.0, [], 0.0

    def decide(self, sense):
        decision = super().decide(sense)
        assert decision.ok
        self.residuals.append(decision.residual)
        weights, scale = self.settings.weights, float(self._solver.period.guess.scale[0])
        slip = sense.omega * self._radius - sense.speed
        excess = np.maximum(
            math.copysign(1.0, sense.target) * slip - self._unit.solver.terms.axle.slip_limit, 0.0
        )
        if sense.target != 0.0:
            self.cost += (
                weights.tracking * ((decision.torque - sense.target) / scale) ** 2
                + weights.rate * ((decision.torque - self._last) / scale) ** 2
                + weights.slip * np.mean((excess / weights.slip_scale) ** 2)
            )
        self._last = decision.torque
        return decision


def _figures(event, settings=None):
    run, made = run_mpc(event, settings, _Accounting)
    figures = evaluate(run)
    cost = sum(controller.cost for controller in made)
    residuals = np.concatenate([controller.residuals for controller in made])
    return cost, figures["effort_ratio"], figures["damage"], figures["slip_time"], residuals


EVENTS = {
    "drop": lambda: drop_event(duration=5.5),
    "falling-adhesion": lambda: replace(load_scenario("falling-adhesion").event(0), duration=8.0),
}


@pytest.fixture(scope="module", params=EVENTS)
def converged(request):
    event = EVENTS[request.param]()
    return event, _figures(event, CONVERGED)


def test_the_default_is_within_two_percent_of_the_converged_controller(converged):
    event, (cost, effort, damage, slip_time, residuals) = converged
    assert np.quantile(residuals, 0.99) < 1e-4, "the yardstick itself must be converged"
    own = _figures(event)
    assert own[0] == pytest.approx(cost, rel=0.02)
    assert own[1] == pytest.approx(effort, rel=0.01)
    assert own[2] == pytest.approx(damage, rel=0.01)
    assert own[3] == pytest.approx(slip_time, rel=0.01, abs=0.1)


def test_one_iteration_is_not_and_its_residual_says_so(converged):
    event, (cost, *_) = converged
    one = _figures(event, ONE)
    assert one[0] > 1.03 * cost
    default = _figures(event)
    # the torque scale is that of a coefficient of 0.1: 0.1 of it is 0.01
    rash, calm = (np.mean(figures[-1] > 0.1) for figures in (one, default))
    assert rash > 2.0 * calm


def test_a_decision_tells_its_residual(context, make_sense):
    controller = MpcController(context)
    for slip in (0.0, 0.02, 0.2):
        assert controller.decide(make_sense(slip=slip)).residual >= 0.0
    assert controller.decide(make_sense(target=0.0)).residual == 0.0
    assert math.isnan(controller.decide(make_sense(speed=math.nan)).residual)
    # the same reading again and again: the residual falls below the tolerance
    controller = MpcController(context, MpcSettings(iterations=50, step_time=1e-4))
    assert controller.decide(make_sense(slip=0.1, torque=600.0)).residual <= 1e-2
