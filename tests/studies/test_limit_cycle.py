"""The reduced model agrees with the plant it is reduced from, and its predictions with simulated runs."""

import numpy as np
import pytest

from alloc.event import DriverCommand
from alloc.onboard.controllers.simple import TorqueTable
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from studies.readhesion_paper.lanes import simulate_tables
from studies.readhesion_paper.limit_cycle import (
    SLIP,
    critical_gain,
    critical_width,
    growth,
    reduced_model,
)
from studies.readhesion_paper.paper import rail
from tests.plant.numpy_plant import compiled_rate

ACCELERATION = 3.0 / 3.6
NARROW, WIDE = TorqueTable(width=0.2 / 3.6), TorqueTable(width=0.8 / 3.6)
LAG = 5e-3


@pytest.fixture(scope="module")
def train():
    return find_set("one-axle")


def model(train, table, peak=0.12, curve=None):
    return reduced_model(train, table, curve or PiecewiseCurve(), peak, ACCELERATION)


@pytest.fixture(scope="module")
def runs(train):
    """The paper's cases A and B, simulated."""
    return simulate_tables(
        train, [rail(0.12)] * 2, [NARROW, WIDE], DriverCommand((0.0,), (ACCELERATION,)), 0.0, 14.0
    )


@pytest.mark.parametrize("slip", [0.003, 0.02])
def test_slip_accelerates_as_in_the_plant(train, slip):
    """On a rail good enough for the parabola to begin late, the micro-slip line is the plant's own curve."""
    peak, torque, speed = 0.4, 700.0, 5.0
    plant = build(train, Rail(peak))
    s, n = plant.structure, plant.layout
    state = plant.initial_state(speed)
    state[n.omega], state[n.torque] = (speed + slip) / s.radius[0], torque
    slope, _ = compiled_rate(plant, state, plant.zero_inputs())
    rate = s.radius[0] * slope[n.omega][0] - slope[n.speed][0]
    reduced = model(train, NARROW, peak)
    point = np.array([slip, torque, 0.0, 0.0, 1.0])
    assert reduced.rates(reduced.mode(point))[SLIP] @ point == pytest.approx(rate, rel=1e-9)


@pytest.mark.parametrize(("lag", "tau", "filter_time"), [(5e-3, 0.18, 0.25), (0.02, 0.1, 1.0)])
def test_critical_gain_of_one_filter_time_is_that_of_hurwitz(lag, tau, filter_time):
    """(1 + a s)(1 + b s)(1 + c s) + L has its roots on the imaginary axis at 1 + L = (a + b + c)(1/a + 1/b + 1/c)."""
    table = TorqueTable(rise=filter_time, fall=filter_time, time_constant=tau)
    times = np.array([lag, tau, filter_time])
    expected = times.sum() * (1.0 / times).sum() - 1.0
    assert critical_gain(table, lag) == pytest.approx(expected, rel=2e-3)


def test_swings_grow_with_the_gain():
    sizes = [growth(NARROW, LAG, gain) for gain in (50.0, 100.0, 200.0, 400.0, 800.0)]
    assert sizes == sorted(sizes)
    assert sizes[0] < 1.0 < sizes[-1]


def test_between_the_filter_times_lies_the_critical_gain_of_both():
    both = critical_gain(TorqueTable(rise=1.8, fall=0.25, time_constant=0.18), LAG)
    fast = critical_gain(TorqueTable(rise=0.25, fall=0.25, time_constant=0.18), LAG)
    slow = critical_gain(TorqueTable(rise=1.8, fall=1.8, time_constant=0.18), LAG)
    assert fast < both < slow


def test_the_critical_width_has_the_critical_gain(train):
    width = critical_width(model(train, NARROW))
    at_width = model(train, TorqueTable(width=width))
    assert at_width.gain == pytest.approx(critical_gain(NARROW, at_width.lag), rel=1e-6)


def test_wheels_run_away_at_the_predicted_factor(train, runs):
    """Case B: the factor settles, and far out on the curve's tail it is the one of the equilibrium."""
    predicted = model(train, WIDE).runaway()
    late = (runs.time > 12.0) & (runs.time < 13.9)
    assert runs.slip[late, 1].min() > 1.0
    assert predicted.slip_rate > 0.0
    assert runs.factor[late, 1] == pytest.approx(predicted.factor, abs=5e-3)
    growth_rate = np.gradient(runs.slip[late, 1], runs.time[late])
    assert growth_rate == pytest.approx(predicted.slip_rate, rel=0.05)


def test_the_limit_cycle_is_about_as_simulated(train, runs):
    """Case A. The reduced curve has a corner for its peak, which costs several per cent of the period."""
    predicted = model(train, NARROW).limit_cycle()
    late = (runs.time > 10.0) & (runs.time < 13.9)
    torque, slip = runs.torque[late, 0], runs.slip[late, 0]
    starts = np.flatnonzero((np.diff(torque[:-1]) < 0.0) & (np.diff(torque[1:]) >= 0.0))
    period = np.diff(runs.time[late][starts]).mean()
    assert predicted.period == pytest.approx(period, rel=0.12)
    assert np.ptp(predicted.torque) == pytest.approx(np.ptp(torque), rel=0.25)
    assert predicted.slip[1] == pytest.approx(slip.max(), rel=0.25)


def test_a_rail_that_carries_the_plan_needs_no_limit_cycle(train):
    assert model(train, NARROW, peak=0.2).limit_cycle() is None
