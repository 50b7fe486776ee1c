"""Draft gear: slack, stiffening, damping, energy, and the two-car oscillation."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.balance import coupler_spring_energy
from alloc.plant.laws import coupler_damper_force, coupler_spring_force, coupler_stretch
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.train import Coupler

few = settings(max_examples=60, deadline=None, derandomize=True)


@few
@given(elongation=st.floats(-0.2, 0.2), slack=st.floats(0.0, 0.05))
def test_no_force_inside_the_slack(elongation, slack):
    stretch = float(coupler_stretch(elongation, slack))
    if abs(elongation) <= 0.5 * slack:
        assert stretch == 0.0
        assert coupler_spring_force(stretch, 1e7, 1e9) == 0.0
        assert coupler_damper_force(stretch, 1.0, 1e5) == 0.0
    else:
        assert stretch == pytest.approx(elongation - np.sign(elongation) * 0.5 * slack)


@few
@given(stretch=st.floats(-0.1, 0.1), stiffening=st.floats(0.0, 1e10))
def test_force_is_the_derivative_of_the_energy(stretch, stiffening):
    d = 1e-6
    rise = coupler_spring_energy(stretch + d, 4e6, stiffening) - coupler_spring_energy(
        stretch - d, 4e6, stiffening
    )
    force = coupler_spring_force(stretch, 4e6, stiffening)
    assert rise / (2.0 * d) == pytest.approx(force, rel=1e-6, abs=1.0)


def test_gear_stiffens():
    """k s + k3 s^3, odd, and steeper the further it is stretched."""
    stretch = np.linspace(-0.08, 0.08, 161)
    force = coupler_spring_force(stretch, 4e6, 1.5e9)
    np.testing.assert_allclose(force, -force[::-1])
    assert np.all(np.diff(np.diff(force[80:])) > 0.0)
    assert coupler_spring_force(0.07, 4e6, 1.5e9) == pytest.approx(4e6 * 0.07 + 1.5e9 * 0.07**3)


@few
@given(stretch=st.floats(-0.1, 0.1), rate=st.floats(-2.0, 2.0))
def test_damper_only_takes_energy(stretch, rate):
    assert coupler_damper_force(stretch, rate, 1e5) * rate >= 0.0


def test_two_cars_oscillate_at_their_frequency(run, train):
    """w^2 = k (1/m1 + 1/m2) with masses that contain the rolling wheelsets."""
    t = train("TM").coupled(Coupler(stiffness=2e6, damping=0.0))
    model = build(t, Rail(0.3))
    state = model.initial_state(20.0)
    state[model.layout.position] = [0.0, -0.01]
    trace = run(model, 2.0, state=state, step=5e-4)
    gap = trace.rows("position")[:, 0] - trace.rows("position")[:, 1]
    s = model.structure
    mass = s.body_mass + np.bincount(s.axle_body, s.inertia / s.radius**2)
    expected = np.sqrt(2e6 * (1.0 / mass).sum())
    rising = np.flatnonzero((gap[:-1] < 0.0) & (gap[1:] >= 0.0))
    crossing = trace.time[rising] - gap[rising] * 5e-4 / (gap[rising + 1] - gap[rising])
    assert 2.0 * np.pi / np.diff(crossing).mean() == pytest.approx(expected, rel=2e-3)


def test_slack_is_taken_up_before_the_wagons_move(run, train):
    t = train("MT").coupled(Coupler(stiffness=5e6, damping=1e5, slack=0.04))
    trace = run(build(t, Rail(0.3)), 2.0, 0.0, command=1500.0, step=5e-4)
    gap = trace.rows("position")[:, 0] - trace.rows("position")[:, 1]
    speed = trace.rows("speed")
    taut = np.argmax(gap > 0.02)
    assert taut > 10
    assert np.all(speed[:taut, 1] == 0.0)
    assert speed[-1, 1] > 0.1
