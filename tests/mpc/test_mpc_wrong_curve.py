"""The MPC under a wrong belief about the adhesion curve: with the slope estimated it does as well as with the right one."""

import numpy as np
import pytest

from alloc.metrics import evaluate
from alloc.plant.adhesion import PiecewiseCurve
from mpc.settings import CurveBelief, MpcSettings, PeakBelief
from tests.mpc.drop import HIGH, adhesion_used, drop_event, run_mpc

TRUE_SLOPE = PiecewiseCurve().micro_slope


def _outcome(slope=TRUE_SLOPE, initial=HIGH, estimate=True):
    settings = MpcSettings(belief=PeakBelief(initial=initial), curve=CurveBelief(estimate=estimate))
    run, controllers = run_mpc(drop_event(curve=PiecewiseCurve(micro_slope=slope)), settings)
    assert run.attrs["controller_failures"] == 0
    figures = evaluate(run)
    stretch = np.array([controller.belief.stretch for controller in controllers])
    return adhesion_used(run), figures["slip_time"], figures["damage"], stretch


@pytest.fixture(scope="module")
def right():
    return _outcome(estimate=False)


@pytest.mark.parametrize("ratio", [0.5, 1.0, 2.0])
@pytest.mark.parametrize("peak_error", [-0.3, 0.0, 0.3])
def test_a_wrong_belief_costs_little(right, ratio, peak_error):
    used, slip_time, damage, stretch = _outcome(ratio * TRUE_SLOPE, (1.0 + peak_error) * HIGH)
    assert used > 0.99 * right[0]
    assert slip_time < right[1] + 1.0  # axle-seconds, of 32 axles
    assert damage < 1.03 * right[2]
    np.testing.assert_allclose(stretch, ratio, rtol=0.2)


def test_without_the_estimation_a_slope_too_steep_costs_adhesion_and_one_too_flat_slip(right):
    assert _outcome(2.0 * TRUE_SLOPE, estimate=False)[0] < 0.975 * right[0]
    flat = _outcome(0.5 * TRUE_SLOPE, estimate=False)
    assert flat[1] > 1.2 * right[1]
    assert flat[2] > 1.04 * right[2]
