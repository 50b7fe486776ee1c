"""Energy, momentum and symmetry of the plant: couplers, draft gears, load transfer, gradients and resistance."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.balance import coupler_spring_energy, draft_gear_energy, mechanical_energy
from alloc.errors import PlantError
from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve, SlipRatioCurve
from alloc.plant.array_model import ArrayModel
from alloc.plant.laws import (
    GRAVITY,
    coupler_damper_force,
    coupler_spring_force,
    coupler_stretch,
    friction_draft_gear,
)
from alloc.plant.model import build
from alloc.plant.rail import Line, Patch, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Coupler, DraftGear, Sander, Train
from tests.cases import looped
from tests.plant.numpy_plant import environment_at

DRAFT_GEAR = Coupler(stiffness=5e6, stiffening=1e9, damping=1e5, slack=0.01)


RESISTANCE = (3e3, 60.0, 8.0)


@looped("curve", [PiecewiseCurve(), POLACH_WET, SlipRatioCurve(0.03, 0.7)])
def test_energy_closes_over_slip_slide_and_lock(run, train, curve):
    """Motor work = change of kinetic and elastic energy + friction + shoes + resistance + couplers."""
    level = 0.35 if curve is POLACH_WET else 0.2
    rail = Rail(level, patches=(Patch(0.3, begin=0.5, until=9.0, fade=0.1),), curve=curve)
    line = Line((0.0, 30.0), (0.0, 0.02), ((20.0, 60.0),), 2.0, curves=((10.0, 40.0, 300.0),))
    couplers = (DRAFT_GEAR, DRAFT_GEAR)
    whole = train("TMT", resistance=RESISTANCE, couplers=couplers, load_transfer=True)
    if curve is POLACH_WET:  # sand changes the force between wheel and rail, and no balance
        whole = replace(
            whole, cars=(replace(whole.cars[0], sanders=(Sander(2, 0.03),)), *whole.cars[1:])
        )
    model = build(whole, rail, line)

    trace = run(
        model, 4.0, 8.0, step=2e-4, sample=2e-3,
        command=lambda t: 1900.0 if t < 1.5 else 0.0,
        pressure=lambda t: 400e3 if t > 1.5 else 0.0,
        sand_rate=lambda t: 0.03 if t > 1.0 else 0.0,
    )  # fmt: skip
    assert (trace.sand.max() > 0.0) == (curve is POLACH_WET)
    slip = 0.43 * trace.rows("omega") - trace.rows("speed")[:, model.structure.axle_body]
    assert slip.max() > 0.5  # slip
    assert slip.min() < -1.0  # slide
    assert np.abs(trace.rows("omega")[-1]).min() < 1e-6 < trace.rows("speed")[-1].min()  # lock

    energy = np.array([mechanical_energy(model, state) for state in trace.state])
    motors, shoes, resistance, couplers_lost = trace.rows("work").T
    friction = trace.rows("friction_work").sum(axis=1)
    turned_over = max(np.abs(motors).max(), friction.max() + shoes.max())
    residual = energy - energy[0] - (motors - shoes - resistance - couplers_lost - friction)
    assert np.abs(residual).max() < 1e-6 * turned_over
    for lost in (friction, shoes, couplers_lost):
        assert lost[-1] > 0.0
        assert np.diff(lost).min() > -1e-9 * turned_over  # dissipation never gives back


def test_gradient_gives_back_what_it_took(run, train):
    """Rolling over a crest without resistance: the work against the gradient is that of lifting the train."""
    line = Line((0.0, 200.0, 300.0), (0.0, 0.01, 0.0))
    model = build(train("T", brake=False), Rail(0.3), line)
    trace = run(model, 20.0, 25.0, sample=0.1)
    lifted = model.train.mass * GRAVITY * 100.0 * 0.01 / np.sqrt(1.0 + 0.01**2)
    assert trace.rows("work")[-1, 2] == pytest.approx(lifted, rel=1e-3)


@looped("couplers", [None, (DRAFT_GEAR, DRAFT_GEAR)])
def test_momentum_follows_the_motors(run, train, couplers):
    """Sum of m v and J omega / r of a train without resistance grows by the motors' impulse only."""
    model = build(train("TMT", couplers=couplers), Rail(0.1))
    trace = run(model, 2.0, 10.0, command=2500.0, step=5e-4, sample=0.01)
    s = model.structure
    carried = trace.rows("speed") @ s.body_mass
    rotating = trace.rows("omega") @ (s.inertia / s.radius)
    lag, t = s.unit_lag[0], trace.time
    per_torque = (s.gear / s.radius).sum()
    impulse = per_torque * 2500.0 * (t - lag * (1.0 - np.exp(-t / lag)))
    momentum = carried + rotating
    np.testing.assert_allclose(momentum - momentum[0], impulse, rtol=1e-5, atol=1e-6 * momentum[0])
    assert (0.43 * trace.rows("omega")[-1].max() - trace.rows("speed")[-1].max()) > 1.0  # slipped


def test_forces_between_cars_are_equal_and_opposite(train):
    """Sum of m a over the bodies = rail forces - resistance, whatever the couplers do."""
    model = build(
        train("TMT", resistance=RESISTANCE, couplers=(DRAFT_GEAR, DRAFT_GEAR)), Rail(0.15)
    )
    n, s, arrays = model.layout, model.structure, ArrayModel.of(model)
    rng = np.random.default_rng(7)
    for _ in range(20):
        state = model.initial_state(20.0)
        state[n.position] += rng.uniform(-0.05, 0.05, n.bodies)
        state[n.speed] += rng.uniform(-0.3, 0.3, n.bodies)
        state[n.omega] += rng.uniform(-2.0, 2.0, n.axles)
        local = environment_at(model, 0.0, state)
        slope = arrays.derivative(state, model.zero_inputs(), local)
        _, _, force = arrays.forces(state, local.peak)
        speed = state[n.speed][s.car_body]
        a, b, c = s.car_resistance.T
        drag = (a + b * speed + c * speed**2) * speed / np.sqrt(speed**2 + 0.05**2)
        total = s.body_mass @ slope[n.speed]
        assert total == pytest.approx(force.sum() - drag.sum(), rel=1e-9, abs=1e-6)


sixty = settings(max_examples=60, deadline=None, derandomize=True)


@sixty
@given(elongation=st.floats(-0.2, 0.2), slack=st.floats(0.0, 0.05))
def test_no_force_inside_the_slack(elongation, slack):
    stretch = float(coupler_stretch(elongation, slack))
    if abs(elongation) <= 0.5 * slack:
        assert stretch == 0.0
        assert coupler_spring_force(stretch, 1e7, 1e9) == 0.0
        assert coupler_damper_force(stretch, 1.0, 1e5) == 0.0
    else:
        assert stretch == pytest.approx(elongation - np.sign(elongation) * 0.5 * slack)


@sixty
@given(stretch=st.floats(-0.1, 0.1), stiffening=st.floats(0.0, 1e10))
def test_force_is_the_derivative_of_the_energy(stretch, stiffening):
    d = 1e-6
    rise = coupler_spring_energy(stretch + d, 4e6, stiffening) - coupler_spring_energy(
        stretch - d, 4e6, stiffening
    )
    force = coupler_spring_force(stretch, 4e6, stiffening)
    assert rise / (2.0 * d) == pytest.approx(force, rel=1e-6, abs=1.0)


@sixty
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


ONE = DraftGear(in_series=1, slack=0.0)


PRELOAD, RESTORING, STRUCTURE, LOADING, UNLOADING = 240e3, 50e3, 2.5e8, 2.57e7, 2.85e6


hundred = settings(max_examples=100, deadline=None, derandomize=True)


def gear_law(gear, stretch, rate, travel):
    *wedges, fluidity, damping = gear.wedges()
    return friction_draft_gear(stretch, rate, travel, tuple(wedges), fluidity, damping)


def drawn(gear, stretch, step):
    """Tension, travel and lost work over a course of the stretch, one value per `step` [s]."""
    travel, lost, found = 0.0, 0.0, []
    for s, rate in zip(stretch, np.gradient(stretch, step), strict=True):
        tension, creep, power = gear_law(gear, s, rate, travel)
        found.append((tension, travel, lost))
        travel, lost = travel + step * creep, lost + step * power
    return np.array(found).T


@looped("side", [1.0, -1.0])
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


@hundred
@given(
    stretch=st.floats(-0.1, 0.1),
    rate=st.floats(-2.0, 2.0),
    travel=st.floats(-0.08, 0.08),
    gears=st.integers(1, 2),
)
def test_power_is_only_lost_and_all_of_it_is_accounted_for(stretch, rate, travel, gears):
    gear = DraftGear(in_series=gears)
    tension, creep, lost = gear_law(gear, stretch, rate, travel)
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


@looped("speed", [0.0, 10.0])
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


SLACK_GEAR = Coupler(stiffness=5e6, stiffening=1e9, damping=1e5, slack=0.02)


def _uneven_train(car) -> Train:
    """Cars that differ, none of them symmetric about its middle."""
    six = {
        "axle_positions": (1.0, 3.0, 8.0, 10.5, 16.0, 18.0),
        "bogie_of_axle": (0, 0, 1, 1, 2, 2),
        "wheel_inertia": (150.0, 160.0, 170.0, 180.0, 190.0, 200.0),
        "driven": (True, True, False, True, True, True),
    }
    cars = (
        car(False, axle_positions=(2.0, 4.0, 14.0, 16.5)),
        car(True, "1C2M", mass=45e3, **six),
        car(True, "1C1M", driven=(True, False, True, True)),
    )
    return Train("uneven", cars, RESISTANCE, (SLACK_GEAR, replace(SLACK_GEAR, slack=0.0)), True)


@looped("curve", [PiecewiseCurve(), POLACH_WET, SlipRatioCurve(0.03, 0.7)])  # fmt: skip
@looped("command", [1800.0, -1800.0])
def test_reversed_train_mirrors_the_run(run, car, curve, command):
    """A train backing up does what the train turned round does ahead, on the mirrored line."""
    train = _uneven_train(car)
    length = sum(c.length for c in train.cars)
    level = 0.3 if curve is POLACH_WET else 0.15
    growth = tuple(np.linspace(0.0, 0.02, train.axle_count))
    patch = Patch(0.6, start=20.0, end=400.0, edge=4.0)
    ahead = build(
        train.reversed(), Rail(level, patches=(patch,), increments=growth[::-1], curve=curve)
    )
    mirrored = replace(patch, start=-patch.end, end=-patch.start)
    back = build(train, Rail(level, patches=(mirrored,), increments=growth, curve=curve))
    inputs = {"pressure": 100e3, "sample": 0.05, "step": 1e-3}
    one = run(ahead, 3.0, 15.0, position=length, command=command, **inputs)
    two = run(back, 3.0, -15.0, position=0.0, command=-command, **inputs)

    def same(name, sign):
        mirror = sign * two.rows(name)[:, ::-1]
        scale = np.abs(mirror).max()
        np.testing.assert_allclose(one.rows(name), mirror, rtol=1e-8, atol=1e-8 * scale)

    same("speed", -1.0)
    same("omega", -1.0)
    same("torque", -1.0)
    same("pressure", 1.0)
    same("friction_work", 1.0)
    np.testing.assert_allclose(
        one.rows("position"), length - two.rows("position")[:, ::-1], rtol=1e-9
    )
    assert (
        np.abs(0.43 * one.rows("omega") - one.rows("speed")[:, ahead.structure.axle_body]).max()
        > 0.1
    )


def test_turning_round_twice_is_the_same_train(car):
    train = _uneven_train(car)
    twice = train.reversed().reversed()
    assert [c.axle_positions for c in twice.cars] == [c.axle_positions for c in train.cars]
    assert twice == train


def test_one_coupled_car_is_the_rigid_car(run, train):
    rigid, coupled = (
        train("M", resistance=RESISTANCE),
        train("M", resistance=RESISTANCE, couplers=()),
    )
    rail = Rail(0.12, scatter=0.01, conditioning=0.2)
    states = [
        run(build(t, rail), 2.0, 10.0, command=2000.0, pressure=5e3).state for t in (rigid, coupled)
    ]
    np.testing.assert_array_equal(states[0], states[1])


def test_stiff_couplers_approach_the_rigid_train(run, train):
    stiff = train("TMT").coupled(Coupler(stiffness=1e9, damping=2e6))
    rail = Rail(0.1)
    speeds = [
        run(build(t, rail), 2.0, 10.0, command=2500.0, step=1e-4, sample=0.1).rows("speed")[:, 0]
        for t in (train("TMT"), stiff)
    ]
    np.testing.assert_allclose(speeds[0], speeds[1], rtol=2e-4)
