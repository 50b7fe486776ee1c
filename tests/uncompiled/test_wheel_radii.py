"""Relative wheel radii: what rolling wheels tell, and when they are asked."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import Onboard, ReferenceSpeed, Sensors
from alloc.onboard.sensing import AFTER, GATE, sense
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.plant.model import build
from alloc.plant.rail import Rail
from tests.onboard.uneven import uneven_train

SPEED, NOISE, PERIODS = 15.0, 0.02, 150
ONBOARD = Onboard(
    reference=ReferenceSpeed(source="truth", radii_compared=False),
    sensors=Sensors(radius_error=0.005, speed_noise=NOISE, seed=6),
)


class Rolling:
    """Computers that know the speed, and are told of wheels that roll at it, with noise."""

    def __init__(self, onboard=ONBOARD):
        self.model = build(uneven_train(), Rail(0.1))
        self.eq, self.onboard = equipment(self.model, onboard), onboard
        self.st = settings(onboard, RuleSettings(0), "none")
        self.m = memory(self.eq, SPEED, 0.1)
        self.rng, self.read = np.random.default_rng(3), []

    def period(self, commanded=0.0, torque=0.0, pressure=0.0, slip=None):
        eq = self.eq
        omega = SPEED / self.model.structure.radius
        if slip is not None:
            omega = omega * (1.0 + slip)
        noise = NOISE * self.rng.standard_normal(omega.size)
        torque, pressure = np.full(eq.axles.size, torque), np.full(eq.group.unit.size, pressure)
        sense(eq, self.st, self.m, 0.0, commanded, omega, torque, pressure, noise)
        self.read.append(eq.axle_radius * omega + noise)

    @property
    def factor(self):
        return self.m.estimate.radii.factor


def test_the_factors_are_the_posterior_means_of_the_radii():
    """Gaussian prior of every radius, Gaussian readings, mean of all radii unobservable: least squares over all readings."""
    one = Rolling()
    for _ in range(PERIODS):
        one.period()
    taken = np.array(one.read)[-(PERIODS - round(AFTER / 0.01)) :] / SPEED - 1.0
    variance = 2.0 * one.st.reference.noise**2 / SPEED**2
    prior = one.onboard.reference.radius_deviation**2
    ahead = taken - taken.mean(axis=1, keepdims=True)
    expected = ahead.sum(axis=0) / variance / (taken.shape[0] / variance + 1.0 / prior)
    # of the filter's start, and of the second order in the errors
    np.testing.assert_allclose(1.0 - one.factor, expected, atol=1e-4)
    true = one.eq.axle_radius / one.model.structure.radius
    assert np.abs(true / true.mean() - 1.0).max() > 3e-3
    np.testing.assert_allclose(one.factor * true, (one.factor * true).mean(), atol=5e-4)
    assert one.factor.mean() == pytest.approx(1.0, abs=1e-5)


@pytest.mark.parametrize(
    "doing", [{"commanded": -0.5}, {"torque": 200.0}, {"pressure": 50e3}], ids=str
)
def test_nothing_is_learnt_while_a_force_acts_or_shortly_after(doing):
    one = Rolling()
    for _ in range(60):
        one.period(**doing)
    for _ in range(round(AFTER / 0.01) - 1):
        one.period()
    np.testing.assert_array_equal(one.factor, 1.0)
    for _ in range(3):
        one.period()
    assert (one.factor != 1.0).all()


def test_a_wheel_that_cannot_roll_is_left_out():
    one, other = Rolling(), Rolling()
    slip = np.zeros(one.eq.axle_radius.size)
    slip[2] = -1.5 * GATE * ONBOARD.reference.radius_deviation
    for _ in range(PERIODS):
        one.period(slip=slip)
        other.period()
    assert one.factor[2] == 1.0
    kept = np.delete(one.factor / other.factor, 2)
    np.testing.assert_allclose(kept, kept.mean(), atol=2e-4)


def test_what_is_learnt_is_no_acceleration_and_no_slip():
    """Radii wrong by half a per cent at 15 m/s are 0.08 m/s, which the first readings correct at once."""
    one, detections = Rolling(), []
    for _ in range(PERIODS):
        before = one.factor.copy()
        one.period()
        detections.append(int(one.m.counter.unit_detections[0]))
        if (one.factor != before).any():
            np.testing.assert_array_equal(one.m.unit.computed_acceleration, 0.0)
    assert (one.factor != 1.0).all()
    assert detections[-1] == detections[round(AFTER / 0.01) - 2]


def test_without_a_deviation_the_radii_stand():
    one = Rolling(replace(ONBOARD, reference=ReferenceSpeed(source="truth", radius_deviation=0.0)))
    for _ in range(PERIODS):
        one.period()
    np.testing.assert_array_equal(one.factor, 1.0)
