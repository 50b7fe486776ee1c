"""Friction draft gear: its two lines, what it loses, its energy, and the published train of 70 vehicles."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.balance import draft_gear_energy, mechanical_energy
from alloc.errors import PlantError
from alloc.plant.array_model import ArrayModel
from alloc.plant.laws import coupler_stretch, friction_draft_gear
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Coupler, DraftGear

ONE = DraftGear(in_series=1, slack=0.0)
PRELOAD, RESTORING, STRUCTURE, LOADING, UNLOADING = 240e3, 50e3, 2.5e8, 2.57e7, 2.85e6
few = settings(max_examples=100, deadline=None, derandomize=True)


def law(gear, stretch, rate, travel):
    *wedges, fluidity, damping = gear.wedges()
    return friction_draft_gear(stretch, rate, travel, tuple(wedges), fluidity, damping)


def drawn(gear, stretch, step):
    """Tension, travel and lost work over a course of the stretch, one value per `step` [s]."""
    travel, lost, found = 0.0, 0.0, []
    for s, rate in zip(stretch, np.gradient(stretch, step), strict=True):
        tension, creep, power = law(gear, s, rate, travel)
        found.append((tension, travel, lost))
        travel, lost = travel + step * creep, lost + step * power
    return np.array(found).T


@pytest.mark.parametrize("side", [1.0, -1.0], ids=["draft", "buff"])
def test_slow_cycle_follows_both_lines_and_the_structure_between(side):
    stretch = side * np.concatenate([np.linspace(0.0, 0.06, 4000), np.linspace(0.06, 0.0, 4000)])
    tension, _, lost = drawn(ONE, stretch, 1e-3)  # 15 mm/s: 3 kN of viscous force
    way, force = side * stretch, side * tension
    loaded = np.where(
        way < PRELOAD / STRUCTURE, STRUCTURE * way, PRELOAD + LOADING * (way - PRELOAD / STRUCTURE)
    )
    first, back = slice(100, 4000), slice(4500, 7900)
    np.testing.assert_allclose(force[first], loaded[first], rtol=0.0, atol=6e3)
    np.testing.assert_allclose(force[back], RESTORING + UNLOADING * way[back], rtol=0.0, atol=6e3)
    # on the way from one line to the other
    turned = slice(4005, 4130)
    slope = np.diff(force[turned]) / np.diff(way[turned])
    np.testing.assert_allclose(slope, STRUCTURE, rtol=1e-2)
    # what went in and did not come back
    assert np.trapezoid(tension, stretch) == pytest.approx(lost[-1], rel=1e-3)
    assert lost[-1] > 0.5 * np.trapezoid(force[:4000], way[:4000])


def test_wedges_stop_at_the_end_of_the_stroke():
    stretch = np.linspace(0.0, 0.1, 4000)
    tension, travel, _ = drawn(replace(ONE, damping=0.0), stretch, 1e-3)
    greatest = PRELOAD + LOADING * (0.09 - PRELOAD / STRUCTURE)
    at = np.searchsorted(stretch, 0.09)
    assert tension[at] == pytest.approx(greatest, rel=0.01)
    assert tension[-1] == pytest.approx(greatest + STRUCTURE * 0.01, rel=0.02)
    assert travel.max() <= ONE.wedges()[5] * (1.0 + 1e-3)


@few
@given(
    stretch=st.floats(-0.1, 0.1),
    rate=st.floats(-2.0, 2.0),
    travel=st.floats(-0.08, 0.08),
    gears=st.integers(1, 2),
)
def test_power_is_only_lost_and_all_of_it_is_accounted_for(stretch, rate, travel, gears):
    gear = DraftGear(in_series=gears)
    tension, creep, lost = law(gear, stretch, rate, travel)
    assert lost >= -1e-9 * abs(tension * rate)
    step = 1e-7
    corners = stretch, travel, stretch - travel
    if min(map(abs, corners)) < 1e-5:
        return  # the energy has a corner there
    parameters = gear.wedges()
    before = draft_gear_energy(stretch - step * rate, travel - step * creep, parameters)
    after = draft_gear_energy(stretch + step * rate, travel + step * creep, parameters)
    stored = (after - before) / (2.0 * step)
    assert tension * rate == pytest.approx(stored + lost, rel=1e-3, abs=20.0)


def test_gears_in_series_share_the_stretch():
    stretch = np.linspace(0.0, 0.05, 1000)
    undamped = replace(ONE, damping=0.0)
    one, *_ = drawn(undamped, stretch, 1e-3)
    two, *_ = drawn(replace(undamped, in_series=2), 2.0 * stretch, 1e-3)
    np.testing.assert_allclose(two, one, rtol=1e-9)


def short_train(train, gear):
    return train("MTT", resistance=(3e3, 60.0, 8.0)).coupled(gear)


@pytest.fixture
def jerked(run, train):
    """A train that starts, is drawn taut, and then brakes at its head; by step [s] of the integration."""

    def of(gear=None, step=5e-4, sample=0.02):
        model = build(short_train(train, gear or DraftGear()), Rail(0.3), Line((0.0,), (0.005,)))
        return model, run(
            model, 6.0, 1.0, step=step, sample=sample,
            command=lambda t: 1200.0 if t < 3.0 else -1200.0,
            pressure=lambda t: 0.0 if t < 3.0 else np.array([150e3, 150e3, 0.0, 0.0, 0.0, 0.0]),
        )  # fmt: skip

    return of


def test_energy_closes_and_couplers_only_lose(jerked):
    model, trace = jerked(DraftGear(preload=20e3, restoring=5e3), step=1e-4, sample=2e-3)
    travel = trace.rows("gear_travel")
    assert travel.max() > 1e-3  # wedges slid in draft
    assert travel.min() < -1e-3  # and in buff
    energy = np.array([mechanical_energy(model, state) for state in trace.state])
    motors, shoes, resistance, couplers = trace.rows("work").T
    friction = trace.rows("friction_work").sum(axis=1)
    residual = energy - energy[0] - (motors - shoes - resistance - couplers - friction)
    turned_over = np.abs(motors).max() + friction.max() + shoes.max()
    assert np.abs(residual).max() < 1e-6 * turned_over
    assert np.diff(couplers).min() >= -1e-12 * turned_over
    assert couplers[-1] > 1e-3 * turned_over


def test_forces_do_not_depend_on_the_step(jerked):
    forces = []
    for step in (5e-4, 2.5e-4, 1e-4):
        model, trace = jerked(step=step)
        forces.append(ArrayModel.of(model).coupler_forces(trace.state.T)[0])
    errors = [(force - forces[-1]) / np.abs(forces[-1]).max() for force in forces[:-1]]
    assert np.abs(errors[0]).max() < 0.05
    assert np.abs(errors[1]).max() < 0.01
    # an impact falls between two records now and then; over the run there is next to nothing
    assert np.sqrt((errors[0] ** 2).mean()) < 3e-3
    assert np.sqrt((errors[1] ** 2).mean()) < 1e-3


def test_trains_without_friction_have_no_rows_for_it(train):
    plain = build(train("TMT").coupled(Coupler()), Rail(0.2)).layout
    assert plain.draft_gears == plain.gear_travel.stop - plain.gear_travel.start == 0
    mixed = replace(train("TMT"), couplers=(Coupler(slack=0.02), DraftGear()))
    model = build(mixed, Rail(0.2))
    assert model.layout.draft_gears == 2
    state = model.initial_state(10.0)
    state[model.layout.position] = [0.0, -0.012, -0.0375]
    tension, creep, _ = ArrayModel.of(model).coupler_forces(state)
    expected = 2e7 * coupler_stretch(0.012, 0.02), STRUCTURE / 2.0 * (0.0255 - 0.025)
    np.testing.assert_allclose(tension, expected, rtol=0.05)
    assert creep[0] == 0.0


@pytest.mark.parametrize("speed", [0.0, 10.0])
def test_published_train_settles_at_the_forces_of_its_masses(run, speed):
    """70 vehicles of 85 t, 20 kN/s to 600 kN: 600 (70 - i) / 70 kN in coupler i, without resistance.

    Wheelsets are alike in all vehicles, so their rotating masses share the force as the masses do. Damping of three times
    the default only shortens the wait.
    """
    train = replace(find_set("heavy-70"), resistance=(0.0, 0.0, 0.0))
    model = build(train.coupled(DraftGear(damping=3e7)), Rail(1.2))
    motors = train.cars[0].motors
    per_newton = train.cars[0].wheel_radius / (4.0 * motors.gear_ratio)
    trace = run(
        model, 62.0, speed, sample=0.1, step=5e-4,
        command=lambda t: per_newton * min(20e3 * t, 600e3),
    )  # fmt: skip
    tension = ArrayModel.of(model).coupler_forces(trace.state[-20:].T)[0]
    exact = 600e3 * (70.0 - np.arange(1.0, 70.0)) / 70.0
    np.testing.assert_allclose(tension, np.repeat(exact[:, None], 20, axis=1), rtol=1e-3)


def test_faulty_gears_are_refused():
    for changes, message in (
        ({"loading": 1e6}, "unloading"),
        ({"structure": 1e7}, "loading"),
        ({"preload": 40e3}, "restoring"),
        ({"stroke": 1e-4}, "stroke"),
        ({"viscosity": 0.0}, "viscosity"),
        ({"slack": -0.01}, "slack"),
        ({"in_series": 0}, "in_series"),
    ):
        with pytest.raises(PlantError, match=message):
            DraftGear(**changes)
