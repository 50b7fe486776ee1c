"""The laws of JP4209318 (5) to (29) in runs of the plant: braked with slide, with readhesion, without slide, and driven."""

import numpy as np
import pytest
from scipy.integrate import cumulative_trapezoid, solve_ivp

from alloc.old.estimation.wheel_damage import tangential_force, wheel_damage
from alloc.old.plant.laws import GRAVITY
from alloc.old.plant.sets import find_set
from tests.cases import looped
from tests.simulation.slides import (
    START,
    TRAIN,
    applied_force,
    braked,
    driven,
    omega,
    readhering,
    without_slide,
)

RADIUS, INERTIA, AXLES = 0.43, 120.0, 12


ROTATING = INERTIA / RADIUS**2


@pytest.fixture(scope="module", params=["slide", "readhering"])
def run(request):
    """A stop with locked wheels, and one in which wheels slide and readhere."""
    return braked() if request.param == "slide" else braked(readhering)


def reaction(run):
    """F_m of (12) [N] of every axle, a magnitude: what answers its own brake; equal to it without slide."""
    return -(run["rail_force"].values + ROTATING * run["acceleration"].values[:, None])


def brake_forces(run):
    """F_b [N] of every axle, a magnitude."""
    return -applied_force(run, TRAIN)


def test_both_forms_of_the_model_are_the_plants_motion():
    """(5)-(8) and (13)-(16), written down apart from the plant and integrated with another method."""

    opened, shut = 2.2, 4.2

    def brake_force(time):  # one release; dead time 0.05 s, then first order with 1.2 s
        time = max(time - 0.05, 0.0)
        full = 0.14 * 8000.0 * GRAVITY

        def filled(t, start):
            return 1.0 - (1.0 - start) * np.exp(-t / 1.2)

        if time <= opened:
            return full * filled(time, 0.0)
        released = filled(opened, 0.0) * np.exp(-(min(time, shut) - opened) / 1.2)
        return full * (released if time <= shut else filled(time - shut, released))

    def adhesion(v, w):  # magnitude that the rail gives a wheel of 8 t
        x = (v - RADIUS * w) / (0.03 * v)
        rise = np.where(x <= 1.0, 2.0 * x / (1.0 + x * x), 1.0)
        return 8000.0 * GRAVITY * 0.125 * 150.0 / (3.6 * v + 150.0) * rise

    def first(time, state):
        v, w = state[0], state[1:]
        force = adhesion(v, w)
        deceleration = force.sum() / TRAIN.mass  # (7)
        return np.append(-deceleration, -RADIUS / INERTIA * (brake_force(time) - force))  # (8)

    def second(time, state):
        v, w = state[0], state[1:]
        # F_m of (12) contains the deceleration, which (15) makes of F_m: a linear system
        coupling = np.eye(AXLES) - ROTATING / (TRAIN.mass + AXLES * ROTATING)
        force = np.linalg.solve(coupling, adhesion(v, w))
        deceleration = force.sum() / (TRAIN.mass + AXLES * ROTATING)  # (15)
        own = RADIUS / INERTIA * (brake_force(time) - force)
        return np.append(-deceleration, -own - deceleration / RADIUS)  # (16)

    recorded = braked(lambda time: 2.0 if opened <= time < shut else 0.0, duration=6.0)
    time = recorded["time"].values
    forms = []
    for form in (first, second):
        state, parts = np.append(START, np.full(AXLES, START / RADIUS)), []
        for begin, end in ((0, 5), (5, 225), (225, 425), (425, 600)):  # the valves' edges
            solved = solve_ivp(
                form, (time[begin], time[end]), state, "LSODA", time[begin : end + 1],
                rtol=1e-9, atol=1e-9,
            )  # fmt: skip
            state = solved.y[:, -1]
            parts.append(solved.y.T[: None if end == 600 else -1])
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
    fm = reaction(run)
    excess = brake_forces(run) - fm
    time, speed = run["time"].values, run["speed"].values
    falling_behind = np.gradient(speed[:, None] - RADIUS * omega(run), time, axis=0)
    slip_ratio = 1.0 - RADIUS * omega(run) / speed[:, None]
    clear = np.abs(falling_behind) > 0.1
    clear[np.abs(omega(run)) < 0.05] = False  # about to lock: the shoe brings it to rest
    assert (clear & (excess > 0.0)).any()
    assert np.mean(np.sign(excess[clear]) == np.sign(falling_behind[clear])) > 0.999
    steady = (time < 1.0) & (slip_ratio < 0.01).all(axis=1)
    assert brake_forces(run)[steady].max() > 4e3
    # what the growing creep itself takes
    assert np.abs(excess[steady]).max() < 0.1 * brake_forces(run)[steady].max()


def test_wheels_never_turn_faster_than_the_train_runs(run):
    """(20), and its other side (21): the impulse of F_m never exceeds that of F_b."""
    slip = RADIUS * omega(run) - run["speed"].values[:, None]
    assert slip.max() < 1e-9
    time = run["time"].values
    fm = reaction(run)
    given = cumulative_trapezoid(brake_forces(run), time, axis=0)
    answered = cumulative_trapezoid(fm, time, axis=0)
    assert (given - answered).min() > -1e-6 * given.max()
    # what is missing is the momentum that the wheelsets are behind: J/R^2 times the slip
    np.testing.assert_allclose(given - answered, -ROTATING * slip[1:], atol=4e-4 * given.max())


def test_the_energy_balance_closes(run):
    """(27): kinetic energy of train and wheelsets = shoes + wheel-rail friction + resistance, at every instant."""
    speed, turning = run["speed"].values, omega(run)
    energy = 0.5 * TRAIN.mass * speed**2 + 0.5 * INERTIA * (turning**2).sum(axis=1)
    friction = run["friction_work"].values.sum(axis=1)
    lost = run["shoe_work"].values + friction + run["resistance_work"].values
    assert np.abs(energy[0] - energy - lost).max() < 1e-6 * energy[0]
    assert friction[-1] > 0.01 * energy[0]


def test_the_bracket_of_the_damage_is_load_times_coefficient(run):
    """F_b + (J/R) d omega/dt, from the series alone, against the adhesion curve, which (27) does not contain."""
    time, turning = run["time"].values, omega(run)
    found = -tangential_force(time, applied_force(run, TRAIN), turning, INERTIA, RADIUS, 0.02)
    v = run["speed"].values[:, None]
    x = (v - RADIUS * turning) / (0.03 * v)
    rise = np.where(x <= 1.0, 2.0 * x / (1.0 + x * x), 1.0)
    expected = 8000.0 * GRAVITY * 0.125 * 150.0 / (3.6 * v + 150.0) * rise
    turns = (turning > 0.05).all(axis=1)
    turns[1:-1] &= turns[2:] & turns[:-2]
    error = np.abs(found - expected)[turns]
    # at the valves' edges the window's mean rounds a corner off
    assert np.quantile(error, 0.99) < 2e-3 * expected.max()
    assert error.max() < 0.03 * expected.max()
    from_locked = np.abs(found - expected)[~turns]
    assert from_locked.size == 0 or np.median(from_locked) < 1e-4 * expected.max()


@looped(
    ("make", "name", "bound"),
    [
        (braked, "jp4209318-3car", 1e-4),
        (lambda: braked(readhering), "jp4209318-3car", 1e-5),
        (driven, "commuter-8car", 1e-3),
    ],
)
def test_damage_from_the_series_is_the_plants_friction_work(make, name, bound):
    """(28) at records of 10 ms against the friction work that the plant integrates with its own step."""
    run, train = make(), find_set(name)
    inertia = np.concatenate([car.wheel_inertia for car in train.cars])
    work = run["friction_work"].values
    damage = wheel_damage(
        run["time"].values, applied_force(run, train), omega(run, train), run["speed"].values,
        inertia, RADIUS,
    )  # fmt: skip
    np.testing.assert_allclose(damage, work, atol=bound * work[-1].max())
    assert damage[-1].sum() == pytest.approx(work[-1].sum(), rel=bound)
    assert work[-1].sum() > 1e4


def test_without_slide_there_is_hardly_any_damage():
    """(29), but for creep: an elastic wheel that brakes at all slips a little, and that dissipates."""
    run = without_slide()
    damage = wheel_damage(
        run["time"].values, applied_force(run, TRAIN), omega(run), run["speed"].values,
        INERTIA, RADIUS,
    )  # fmt: skip
    energy = 0.5 * TRAIN.mass * START**2
    assert damage[-1].sum() == pytest.approx(run["friction_work"].values[-1].sum(), rel=1e-4)
    assert 0.0 < damage[-1].sum() < 0.01 * energy
    rolling = run["speed"].values[:, None] / RADIUS * np.ones(AXLES)
    none = wheel_damage(
        run["time"].values, applied_force(run, TRAIN), rolling, run["speed"].values, INERTIA, RADIUS
    )
    assert np.abs(none).max() < 1e-9 * energy
