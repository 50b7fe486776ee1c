"""A demand that the rail does not carry pulls slip beyond its limit by a bounded share, however great it is."""

import numpy as np
import pytest

from alloc.plant.adhesion import RationalCurve
from mpc.group import GroupProblem, WheelsAndRail
from mpc.settings import MpcSettings
from mpc.unit import EXCESS, tracked_coefficient
from tests.mpc.groups import small_cars

WEIGHTS = MpcSettings().weights


def _most(held, slip):
    w = WEIGHTS
    return float(
        tracked_coefficient(held, slip, w.coefficient_scale, w.tracking, w.slip, w.slip_scale)
    )


@pytest.mark.parametrize("peak_slip", [0.02, 0.05, 0.2])
@pytest.mark.parametrize("steepness", [2.5, 4.0, 12.0])
@pytest.mark.parametrize("demand", [0.2, 1.0, 5.0])
def test_at_rest_slip_exceeds_its_limit_by_no_more(peak_slip, steepness, demand):
    """The least of the cost at rest on a rational curve, by search over slips up to the peak."""
    curve, peak, w = RationalCurve(peak_slip, steepness), 0.12, WEIGHTS
    limit = 0.7 * peak_slip
    slip = np.linspace(1e-4, peak_slip, 20001)
    mu = curve.coefficient(slip, peak, 10.0)
    held = float(curve.coefficient(limit, peak, 10.0))

    def cost(target):
        excess = np.maximum(slip - limit, 0.0) / w.slip_scale
        return w.tracking * ((mu - target) / w.coefficient_scale) ** 2 + w.slip * excess**2

    tracked = min(demand, _most(held, limit))
    assert slip[np.argmin(cost(tracked))] <= limit * (1.0 + EXCESS) + 1e-5
    assert tracked >= min(demand, held), "what the rail carries is tracked"


def test_narrow_peaks_bound_the_demand_and_wide_ones_do_not():
    assert _most(0.12, 0.04) < 0.15
    assert _most(0.12, 0.3) > 0.6, "more than any motor gives"


def test_more_slip_and_less_adhesion_allow_more():
    slips = [_most(0.1, s) for s in (0.02, 0.04, 0.08)]
    assert slips == sorted(slips)
    assert _most(0.02, 0.03) > _most(0.2, 0.03) - 0.2
    assert np.isfinite(_most(0.0, 0.03))


def test_a_group_tracks_its_total_as_far_as_its_units_together_may():
    group = small_cars(2)
    problem = GroupProblem(group, MpcSettings())
    axles = problem.unit.size
    per = problem._scale / WEIGHTS.coefficient_scale
    rail = WheelsAndRail(
        np.full(axles, 0.12), np.full(axles, 0.03), 0.12 * per, *np.zeros((2, per.size))
    )
    state = 10.0, np.full(axles, 10.0 / 0.43), 0.1 * per
    little, much = 0.1 * per, 3.0 * per

    def tracked(target):
        limit = np.full(per.size, 1e6)
        return problem.problem(state, rail, (0.05, 4.0), target, 0.1 * per, limit).target

    np.testing.assert_array_equal(tracked(little), little)
    np.testing.assert_allclose(tracked(much), _most(0.12, 0.03) * per, rtol=1e-12)
    # one unit asks for less than it may: the other may ask for what is left
    uneven = np.where(np.arange(per.size) == 0, 0.01, 0.14) * per
    np.testing.assert_array_equal(tracked(uneven), uneven)
