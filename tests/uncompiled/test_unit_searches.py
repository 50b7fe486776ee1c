"""Searches bring the reference of a unit that slips as it says to the peak of its curve, and stop at their bounds."""

import numpy as np
import pytest

from alloc.onboard.controllers.collection import control
from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import Onboard
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from tests.cases import looped
from tests.onboard.test_searches import concave


@pytest.fixture
def obedient():
    """Course of the reference of a unit that slips as its reference says, on a curve `coefficient(slip)`."""

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
            control(name)(eq, st, m, 0.8)
            # limited by the rail, as long as it is searched for
            m.unit.torque_factor[0] = 0.7
            m.worst_slip[0] = st.law.creep.reference if search is None else search.reference[0]
            course.append(m.worst_slip[0])
        return np.array(course)

    return run


@looped("name", ["perturb-observe", "steepest-gradient"])
@looped("reference", [0.05, 0.45])
def test_both_searches_bring_the_reference_to_the_peak(obedient, name, reference):
    onboard = Onboard(creep=type(Onboard().creep)(reference=reference))
    course = obedient(name, onboard, concave)
    assert abs(course[0] - reference) < 1e-9
    assert np.abs(course[-300:] - 0.23).max() <= 0.03


@looped("name", ["perturb-observe", "steepest-gradient"])
@looped("slope", [-1.0, 1.0])
def test_on_an_endless_slope_the_reference_stops_at_its_bound(obedient, name, slope):
    course = obedient(name, Onboard(), lambda slip: 0.1 + 0.1 * slope * slip, time=60.0)
    bounds = Onboard().perturb_observe
    assert course.min() >= bounds.lowest
    assert course.max() <= bounds.highest
    end = bounds.highest if slope > 0.0 else bounds.lowest
    assert np.abs(course[-500:] - end).max() <= 0.06  # it turns at the bound and comes back


def test_pi_creep_does_not_search(obedient):
    assert set(obedient("pi-creep", Onboard(), concave, time=3.0)) == {Onboard().creep.reference}
