"""Reference speed from axle speeds, bounded by what a train can do."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from alloc.errors import OnboardError
from alloc.onboard.parameters import Belief, Onboard, ReferenceSpeed
from alloc.onboard.sensing import acceleration_from_command, follow_reference
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from alloc.simulation import DriverCommand, Event, simulate

SPEEDS = st.floats(0, 80)


@given(SPEEDS, SPEEDS, st.floats(-1.5, 1.5), st.floats(0.0, 1.0))
def test_rate_is_bounded_by_what_a_train_can_do(reference, candidate, commanded, margin):
    least, greatest = acceleration_from_command(commanded, margin)
    new = follow_reference(reference, candidate, least, greatest, 0.01)
    assert new - reference <= (max(commanded, 0) + margin) * 0.01 + 1e-12
    assert reference - new <= (max(-commanded, 0) + margin) * 0.01 + 1e-12


def test_plausible_candidate_is_taken():
    assert follow_reference(10.0, 10.005, -0.3, 1.1, 0.01) == 10.005


def test_common_slip_cannot_run_away_with_the_reference():
    reference = 5.0
    least, greatest = acceleration_from_command(0.8, 0.3)
    for k in range(300):  # all wheels gain 5 m/s2 for 3 s
        reference = follow_reference(reference, 5.0 + 5.0 * 0.01 * k, least, greatest, 0.01)
    assert reference < 5.0 + 3.0 * greatest + 1e-9


def reference_error(bound: str) -> float:
    """Largest error [m/s] of the reference speed of a locomotive that pulls six cars on bad rail: no axle runs free."""
    freight = find_set("freight-5")
    locomotive = replace(freight, cars=freight.cars[:1], couplers=None)
    rail = Rail(0.10)
    onboard = Onboard(belief=Belief(curve=rail.curve), reference=ReferenceSpeed(bound))
    event = Event(
        "all axles slip", build(locomotive, rail), DriverCommand((0.0,), (1.2,)), onboard, 8.0
    )
    run = simulate(event, "alone", "pi-creep")
    return float(np.abs(run["reference_speed"] - run["speed"]).max())


def test_estimated_forces_hold_the_reference_where_no_axle_runs_free():
    by_command, by_forces = reference_error("command"), reference_error("forces")
    assert by_command > 2.0
    assert by_forces < 0.35 * by_command


def test_with_free_axles_the_bound_does_not_matter():
    rail = Rail(0.08)
    errors = []
    for bound in ("command", "forces"):
        onboard = Onboard(belief=Belief(curve=rail.curve), reference=ReferenceSpeed(bound))
        model = build(find_set("commuter-8car"), rail)
        event = Event("free axles", model, DriverCommand((0.0,), (0.83,)), onboard, 8.0)
        run = simulate(event, "alone", "cut-and-ramp")
        errors.append(float(np.abs(run["reference_speed"] - run["speed"]).max()))
    assert max(errors) < 0.02


def test_margins_follow_the_bound():
    assert ReferenceSpeed().margin == 0.3
    assert ReferenceSpeed("forces").margin == 0.1
    assert ReferenceSpeed("forces", 0.2).margin == 0.2


@pytest.mark.parametrize(
    ("arguments", "named"), [(("speed",), "bound"), (("forces", -0.1), "margin")]
)
def test_impossible_bounds_are_refused(arguments, named):
    with pytest.raises(OnboardError, match=named):
        ReferenceSpeed(*arguments)
