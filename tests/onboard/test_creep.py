"""Laws of creep control and of the searches for its reference; then both on a unit whose slip obeys at once."""

import math

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.errors import OnboardError
from alloc.onboard.controllers.collection import control
from alloc.onboard.controllers.creep import hold_slip
from alloc.onboard.controllers.search import (
    PerturbObserve,
    SteepestGradient,
    gradient_step,
    perturbed_step,
)
from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import Onboard
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from tests.compiled_part import from_python

P, I, PERIOD = 0.4, 8.0, 0.01  # noqa: E741 (the controller's own letters)
COEFFICIENT = st.floats(0, 0.4)
SLIP = st.floats(-2, 20)


@given(COEFFICIENT, SLIP, st.floats(0.01, 1), COEFFICIENT)
def test_what_creep_control_allows_lies_between_nothing_and_the_target(
    allowed, slip, reference, ceiling
):
    integral, coefficient = hold_slip(allowed, slip, reference, ceiling, P, I, PERIOD)
    assert 0.0 <= integral <= ceiling
    assert 0.0 <= coefficient <= ceiling


@given(st.floats(0.01, 1), COEFFICIENT)
def test_at_the_reference_nothing_changes(reference, ceiling):
    allowed = 0.7 * ceiling
    found = hold_slip(allowed, reference, reference, ceiling, P, I, PERIOD)
    assert found == (allowed, allowed)


@given(st.integers(1, 2000), st.floats(0.05, 0.3), st.floats(0.01, 2))
def test_adhesion_however_long_does_not_wind_up(ticks, ceiling, excess):
    allowed = 0.0
    for _ in range(ticks):
        allowed, _ = hold_slip(allowed, 0.0, 0.1, ceiling, P, I, PERIOD)
    _, coefficient = hold_slip(allowed, 0.1 + excess, 0.1, ceiling, P, I, PERIOD)
    assert coefficient < ceiling  # the first slip beyond the reference takes torque away


@given(SLIP, SLIP, st.floats(0.01, 1))
def test_more_slip_never_gives_more_torque(one, other, reference):
    low, high = sorted((one, other))
    after = [hold_slip(0.1, slip, reference, 0.2, P, I, PERIOD)[1] for slip in (low, high)]
    assert after[1] <= after[0]


@given(st.sampled_from([-0.01, 0.01]), st.floats(-0.1, 0.1))
def test_a_perturbation_turns_where_the_coefficient_fell(last, change):
    step = perturbed_step(last, change, 0.01)
    assert abs(step) == 0.01
    assert (math.copysign(1, step) == math.copysign(1, last)) == (change >= 0.0)


@given(
    st.floats(-0.03, 0.03),
    st.floats(-0.1, 0.1),
    st.floats(-0.1, 0.1),
    st.floats(1e-3, 10),
)
def test_a_gradient_step_is_bounded_and_points_up_the_slope(last, rise, way, gain):
    least, largest = 0.003, 0.03
    step = gradient_step(last, rise, way, gain, least, largest)
    assert least <= abs(step) <= largest
    if abs(way) >= 0.3 * least and rise != 0.0 and gain * rise / way != 0.0:
        assert math.copysign(1, step) == math.copysign(1, rise) * math.copysign(1, way)


def test_a_quotient_of_next_to_nothing_is_not_believed():
    assert gradient_step(-0.02, 0.1, 1e-6, 1.0, 0.003, 0.03) == -0.003


def concave(slip, top=0.23):
    return 0.12 - 0.3 * (slip - top) ** 2


@pytest.mark.parametrize("start", [0.03, 0.23, 0.45])
def test_perturbation_climbs_and_stays_within_a_step_of_the_nearest_one_to_the_peak(start):
    slip, step, size = start, 0.01, 0.01
    before, course = concave(slip), []
    for _ in range(100):
        slip += step
        step = perturbed_step(step, concave(slip) - before, size)
        before = concave(slip)
        course.append(slip)
    # half a step to the place nearest to the peak, one step past it to see that the coefficient falls
    assert max(abs(s - 0.23) for s in course[50:]) <= 1.5 * size + 1e-9


@pytest.mark.parametrize("start", [0.03, 0.23, 0.45])
def test_the_gradient_climbs_and_stays_within_a_least_step_of_the_peak(start):
    slip, step, least = start, 0.003, 0.003
    before, course = (concave(slip), slip), []
    for _ in range(100):
        slip += step
        step = gradient_step(step, concave(slip) - before[0], slip - before[1], 0.15, least, 0.03)
        before = concave(slip), slip
        course.append(slip)
    assert max(abs(s - 0.23) for s in course[50:]) <= 1.5 * least + 1e-9


@pytest.fixture(scope="module")
def obedient():
    """Course of the reference of a unit that slips as its reference says, on a curve `coefficient(slip)`."""

    controlled = from_python(control)

    def run(name, onboard, coefficient, time=30.0):
        eq = equipment(build(find_set("one-axle"), Rail(0.12)), onboard)
        st = settings(onboard, RuleSettings(0), name)
        m = memory(eq, 5.0, 0.17)
        search = getattr(m.law, name.replace("-", "_"), None)
        to_torque = eq.axle_load[0] * eq.radius[0] / eq.gear[0]
        m.unit.torque_target[0] = 0.17 * to_torque
        m.worst_slip[0] = onboard.creep.reference + 0.2  # the slip that brings it to bear
        course = []
        for _ in range(round(time / onboard.period)):
            m.unit.coefficient_estimate[0] = coefficient(m.worst_slip[0])
            controlled(eq, st, m, 0.8)
            # limited by the rail, as long as it is searched for
            m.unit.torque_factor[0] = 0.7
            m.worst_slip[0] = st.law.creep.reference if search is None else search.reference[0]
            course.append(m.worst_slip[0])
        return np.array(course)

    return run


@pytest.mark.parametrize("name", ["perturb-observe", "steepest-gradient"])
@pytest.mark.parametrize("reference", [0.05, 0.45])
def test_both_searches_bring_the_reference_to_the_peak(obedient, name, reference):
    onboard = Onboard(creep=type(Onboard().creep)(reference=reference))
    course = obedient(name, onboard, concave)
    assert abs(course[0] - reference) < 1e-9
    assert np.abs(course[-300:] - 0.23).max() <= 0.03


@pytest.mark.parametrize("name", ["perturb-observe", "steepest-gradient"])
@pytest.mark.parametrize("slope", [-1.0, 1.0])
def test_on_an_endless_slope_the_reference_stops_at_its_bound(obedient, name, slope):
    course = obedient(name, Onboard(), lambda slip: 0.1 + 0.1 * slope * slip, time=60.0)
    bounds = Onboard().perturb_observe
    assert course.min() >= bounds.lowest
    assert course.max() <= bounds.highest
    end = bounds.highest if slope > 0.0 else bounds.lowest
    assert np.abs(course[-500:] - end).max() <= 0.06  # it turns at the bound and comes back


def test_pi_creep_does_not_search(obedient):
    assert set(obedient("pi-creep", Onboard(), concave, time=3.0)) == {Onboard().creep.reference}


def test_bounds_in_the_wrong_order_are_refused():
    with pytest.raises(OnboardError, match=r"lowest = 0\.6 must be below highest"):
        PerturbObserve(lowest=0.6)
    with pytest.raises(OnboardError, match=r"least = 0\.1 must not exceed largest"):
        SteepestGradient(least=0.1)
