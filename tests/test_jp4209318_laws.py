"""The laws of JP4209318 (5) to (29) in runs of the plant: braked with slide, with readhesion, without slide, and driven."""

from dataclasses import replace

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, solve_ivp

from alloc.evaluation.wheel_damage import tangential_force, wheel_damage
from alloc.laws import GRAVITY
from alloc.plant.curves import SlipRatioCurve
from alloc.plant.rail import Patch, Rail
from alloc.plant.trains import find_train
from alloc.run.driving import NO_COMMAND, drive
from alloc.run.event import Event
from studies.jp4209318 import build_train

START, RADIUS, INERTIA, AXLES = 100.0 / 3.6, 0.43, 120.0, 12
ROTATING = INERTIA / RADIUS**2
TRAIN = build_train(3, shoe_force_share=0.14)
RAIL = Rail(0.125, (150.0, 150.0, 0.0), curve=SlipRatioCurve(0.03, residual_ratio=1.0))
"""The same for all axles and not calibrated on anything, so that a test can state its adhesion in one line."""


def course(driver, of=TRAIN, rail=RAIL, duration=40.0, speed=START, step=1e-3):
    """A run that `driver` drives."""
    numbers = {"duration": duration, "initial_speed": speed, "step": step}
    return drive(Event("laws", of, rail, NO_COMMAND, **numbers), driver)


def braked(valve=lambda time: 0.0, **given):
    """A stop from 100 km/h at full pressure, until 2 m/s."""

    def driver(sense, units, brakes):
        brakes.pressure_target, brakes.valve = 550e3, valve(round(sense.time, 6))
        return sense.speed > 2.0

    return course(driver, **given)


def readhering():
    """Valves that release for one second of every two and a half: wheels slide and readhere."""
    return braked(lambda time: 2.0 if time % 2.5 > 1.5 else 0.0)


def without_slide():
    """A stop on a rail that carries three times the brake force."""
    return braked(rail=replace(RAIL, level=0.4))


def driven():
    """Eight cars that start on a rail that is too slippery for their torque between 2 and 4 s."""

    def driver(sense, units, brakes):
        units.applied = 1000.0 if sense.time < 3.0 else 300.0

    slippery = Rail(0.2, patches=(Patch(0.4, begin=2.0, until=4.0),))
    return course(driver, find_train("commuter-8car"), slippery, 6.0, 5.0)


@pytest.fixture(scope="module", params=[braked, readhering])
def run(request):
    """A stop with locked wheels, and one in which wheels slide and readhere."""
    return request.param()


def omega(run):
    """Angular speeds [rad/s], (instants, axles)."""
    return run["rim_speed"].values / RADIUS


def applied(run):
    """Force of motors and shoes at the rims [N], (instants, axles)."""
    unit, torque = run["axle_unit"].values, run["motor_torque"].values * run["unit_gear"].values
    motor = np.pad(torque, ((0, 0), (0, 1)))[:, unit]  # the last is none
    return motor / RADIUS - run["brake_force"].values


def reaction(run):
    """F_m of (12) [N] of every axle, a magnitude: what answers its own brake; equal to it without slide."""
    return -(run["rail_force"].values + ROTATING * run["acceleration"].values[:, None])


def adhesion(v, w):
    """Magnitude [N] that `RAIL` gives a wheel of 8 t, at speeds v of the train [m/s] and w of the wheel [rad/s]."""
    x = (v - RADIUS * w) / (0.03 * v)
    rise = np.where(x <= 1.0, 2.0 * x / (1.0 + x * x), 1.0)
    return 8000.0 * GRAVITY * 0.125 * 150.0 / (3.6 * v + 150.0) * rise


def test_both_forms_of_the_model_are_the_plants_motion():
    """(5)-(8) and (13)-(16), written down apart from the plant and integrated with another method."""
    opened, shut = 2.2, 4.2

    def filled(time, start):
        return 1.0 - (1.0 - start) * np.exp(-time / 1.2)

    def brake_force(time):  # one release; dead time 0.05 s, then first order with 1.2 s
        time, full = max(time - 0.05, 0.0), 0.14 * 8000.0 * GRAVITY
        if time <= opened:
            return full * filled(time, 0.0)
        released = filled(opened, 0.0) * np.exp(-(min(time, shut) - opened) / 1.2)
        return full * (released if time <= shut else filled(time - shut, released))

    def first(time, state):
        force = adhesion(state[0], state[1:])
        deceleration = force.sum() / TRAIN.mass  # (7)
        return np.append(-deceleration, -RADIUS / INERTIA * (brake_force(time) - force))  # (8)

    def second(time, state):
        # F_m of (12) contains the deceleration, which (15) makes of F_m: a linear system
        whole = TRAIN.mass + AXLES * ROTATING
        force = np.linalg.solve(np.eye(AXLES) - ROTATING / whole, adhesion(state[0], state[1:]))
        deceleration = force.sum() / whole  # (15)
        own = RADIUS / INERTIA * (brake_force(time) - force)
        return np.append(-deceleration, -own - deceleration / RADIUS)  # (16)

    recorded = braked(lambda time: 2.0 if opened <= time < shut else 0.0, duration=6.0)
    time, forms = recorded["time"].values, []
    for form in (first, second):
        state, parts = np.append(START, np.full(AXLES, START / RADIUS)), []
        for begin, end in ((0, 5), (5, 225), (225, 425), (425, 599)):  # the valves' edges
            span, at = (time[begin], time[end]), time[begin : end + 1]
            solved = solve_ivp(form, span, state, "LSODA", at, rtol=1e-9, atol=1e-9)
            state = solved.y[:, -1]
            parts.append(solved.y.T[: None if end == 599 else -1])
        forms.append(np.concatenate(parts))
    motion = np.column_stack([recorded["speed"].values, omega(recorded)])
    slide = motion[:, 0] - RADIUS * motion[:, 1]
    assert slide[:300].max() > 2.0
    assert slide[425].max() < 0.3  # readhered
    assert slide[-1].min() > 2.0
    np.testing.assert_allclose(forms[1], forms[0], atol=1e-6)
    np.testing.assert_allclose(forms[0], motion, atol=1e-5)


def test_the_sign_of_the_reaction_tells_sliding_from_readhesion(run):
    """(17)-(19): F_b > F_m while a wheel falls behind the train, F_b < F_m while it comes back, equal before."""
    time, speed, brake = run["time"].values, run["speed"].values[:, None], -applied(run)
    excess, slide = brake - reaction(run), speed - RADIUS * omega(run)
    falling_behind = np.gradient(slide, time, axis=0)  # about to lock, the shoe brings it to rest
    clear = (np.abs(falling_behind) > 0.1) & (np.abs(omega(run)) >= 0.05)
    assert (clear & (excess > 0.0)).any()
    assert np.mean(np.sign(excess[clear]) == np.sign(falling_behind[clear])) > 0.999
    steady = (time < 1.0) & (slide / speed < 0.01).all(axis=1)
    assert brake[steady].max() > 4e3
    assert np.abs(excess[steady]).max() < 0.1 * brake[steady].max()  # the growing creep takes it


def test_wheels_never_turn_faster_than_the_train_runs(run):
    """(20), and its other side (21): the impulse of F_m never exceeds that of F_b."""
    slip, time = RADIUS * omega(run) - run["speed"].values[:, None], run["time"].values
    assert slip.max() < 1e-9
    given, answered = (
        cumulative_trapezoid(f, time, axis=0) for f in (-applied(run), reaction(run))
    )
    assert (given - answered).min() > -1e-6 * given.max()
    # what is missing is the momentum that the wheelsets are behind: J/R^2 times the slip
    np.testing.assert_allclose(given - answered, -ROTATING * slip[1:], atol=4e-4 * given.max())


def test_the_energy_balance_closes(run):
    """(27): kinetic energy of train and wheelsets = shoes + wheel-rail friction + resistance, at every instant."""
    turning = 0.5 * INERTIA * (omega(run) ** 2).sum(axis=1)
    energy = 0.5 * TRAIN.mass * run["speed"].values ** 2 + turning
    friction = run["friction_work"].values.sum(axis=1)
    lost = run["shoe_work"].values + friction + run["resistance_work"].values
    assert np.abs(energy[0] - energy - lost).max() < 1e-6 * energy[0]
    assert friction[-1] > 0.01 * energy[0]


def test_the_bracket_of_the_damage_is_load_times_coefficient(run):
    """F_b + (J/R) d omega/dt, from the series alone, against the adhesion curve, which (27) does not contain."""
    time, turning = run["time"].values, omega(run)
    found = -tangential_force(time, applied(run), turning, INERTIA, RADIUS, 0.02)
    expected = adhesion(run["speed"].values[:, None], turning)
    turns = (turning > 0.05).all(axis=1)
    turns[1:-1] &= turns[2:] & turns[:-2]
    error = np.abs(found - expected)
    assert np.quantile(error[turns], 0.99) < 2e-3 * expected.max()
    assert error[turns].max() < 0.03 * expected.max()  # where valves switch
    assert turns.all() or np.median(error[~turns]) < 1e-4 * expected.max()


@pytest.mark.parametrize("make", [braked, readhering, without_slide, driven])
def test_damage_from_the_series_is_the_plants_friction_work(make):
    """(28) from records of 10 ms against the friction work that the plant integrates itself; (29), but for creep."""
    run = make()
    bound = {driven: 1e-3, readhering: 1e-5}.get(make, 1e-4)
    work, inertia = run["friction_work"].values, RADIUS**2 * run["axle_turning_mass"].values
    known = run["time"].values, applied(run)
    damage = wheel_damage(*known, omega(run), run["speed"].values, inertia, RADIUS)
    np.testing.assert_allclose(damage, work, atol=bound * work[-1].max())
    assert damage[-1].sum() == pytest.approx(work[-1].sum(), rel=bound)
    energy = 0.5 * run.attrs["train_mass"] * (run["speed"].values ** 2).max()
    assert (work[-1].sum() < 0.01 * energy) == (make is without_slide)
    assert work[-1].sum() > 1e4
    rolling = run["speed"].values[:, None] / RADIUS * np.ones(work.shape[1])
    none = wheel_damage(*known, rolling, run["speed"].values, inertia, RADIUS)
    assert np.abs(none).max() < 1e-9 * energy
