"""The joint problem of several units: its quadratic model is solved, and it splits as it should."""

import numpy as np
import pytest

from alloc.records import ByReference
from mpc.group import even_split
from mpc.period import RealTimeIteration
from mpc.settings import GroupSettings, MpcError, MpcSettings
from mpc.solver import step as step_of
from tests.mpc.groups import UNLOADING, car_of_four, problem, rolling, small_cars
from tests.mpc.parts import model_at_guess

EVENNESS = 0.05
SETTINGS = MpcSettings()


def _converged(group, data, settings=SETTINGS, guess=None, calls=100):
    """Torques (horizon, units) of the iteration repeated at a constant state, and its solution."""
    solver = RealTimeIteration(group, settings, EVENNESS)
    solver.restart(data.before if guess is None else guess)
    costs = []
    for _ in range(calls):
        solution = solver.solve(data)
        assert solution.status == "ok"
        costs.append(solution.cost)
    assert np.all(np.diff(costs) <= 1e-12 * costs[0]), "no step may raise the cost"
    return solution.torques.reshape(settings.horizon, -1), solution


@pytest.mark.parametrize("seed", range(8))
def test_the_step_solves_the_quadratic_model(seed):
    # the KKT conditions of a box: a projected gradient step of the model leaves its solution where it is
    group = car_of_four()
    data = problem(group, seed)
    solver = RealTimeIteration(group, SETTINGS, EVENNESS)
    rng = np.random.default_rng(seed)
    guess = solver.torques.reshape(SETTINGS.horizon, -1)
    guess[:] = rng.uniform(0.0, data.upper, guess.shape)
    quadratic = model_at_guess(solver, data)
    hessian, gradient = quadratic.hessian.copy(), quadratic.gradient.copy()
    np.testing.assert_array_equal(hessian, hessian.T)
    assert np.linalg.eigvalsh(hessian)[0] > 0.5 * EVENNESS * solver._terms.unit.share.min()
    start = solver.torques.copy()
    assert step_of(ByReference(solver.period))
    end, scale = solver.period.guess.trial.copy(), solver.period.guess.scale
    step = (end - start) / scale
    free = end - scale * (gradient + hessian @ step)
    projected = np.clip(free.reshape(guess.shape), 0.0, data.upper).ravel()
    np.testing.assert_allclose(projected, end, atol=1e-9 * scale.max())
    decrease = gradient @ step + 0.5 * step @ hessian @ step
    assert decrease < 0.0


def test_bounds_were_active_in_some_of_these_problems():
    group, active = car_of_four(), 0
    for seed in range(8):
        data = problem(group, seed)
        torques, _ = _converged(group, data, calls=2)
        active += np.sum((torques == 0.0) | (torques >= np.asarray(data.upper) - 1e-9))
    assert active > 0


@pytest.mark.parametrize("guess", [300.0, np.array([0.0, 600.0, 100.0, 500.0])])
def test_identical_units_split_equally_whatever_the_guess(guess):
    group = car_of_four(transfer=0.0)
    data = rolling(group, 0.12, 300.0, [500.0, 700.0, 400.0, 600.0])
    torques, _ = _converged(group, data, guess=guess)
    np.testing.assert_allclose(torques, torques[:, :1] * np.ones(4), rtol=1e-4)
    assert torques[-1].mean() == pytest.approx(550.0, rel=0.1)


def test_exchanged_units_exchange_their_torques():
    group = car_of_four(transfer=0.0)
    order = [2, 0, 3, 1]
    peak, torque, target = np.array([0.08, 0.1, 0.12, 0.14]), np.array([100.0, 200.0, 300.0, 400.0]), 500.0  # fmt: skip
    straight, _ = _converged(group, rolling(group, peak, torque, target))
    moved, _ = _converged(group, rolling(group, peak[order], torque[order], target))
    assert np.ptp(straight[-1]) > 50.0
    np.testing.assert_allclose(moved, straight[:, order], atol=1e-3)


def test_load_transfer_gives_the_loaded_axles_more():
    # one rail for all, more wanted than it carries: each axle gets what its load can hold
    with_transfer, without = (
        _converged(group, rolling(group, 0.1, 400.0, 900.0))[0][SETTINGS.horizon // 2]
        for group in (car_of_four(), car_of_four(transfer=0.0))
    )
    force = with_transfer.sum() * 7.07 / 0.43
    load = 78e3 - np.array(UNLOADING) * force
    assert np.ptp(load) > 0.05 * load.mean()
    np.testing.assert_array_equal(np.argsort(with_transfer), np.argsort(load))
    np.testing.assert_allclose(with_transfer / load, (with_transfer / load).mean(), rtol=0.02)
    assert np.ptp(without) < 1e-4 * without.mean()
    assert with_transfer.mean() == pytest.approx(without.mean(), rel=0.02)


def test_a_unit_on_bad_rail_is_made_up_for():
    group = small_cars(2)
    data = rolling(group, [0.04, 0.2, 0.2, 0.2], 200.0, 500.0)
    torques, _ = _converged(group, data)
    last = torques[-1]
    carried = 0.04 * 78e3 * 0.43 / 7.07 * (1.0 + 155.0 / (0.43**2 * 13.75e3))
    assert last[0] < 1.15 * carried
    assert np.all(last[1:] > 520.0)
    assert last.mean() == pytest.approx(500.0, rel=0.05)


def test_even_split_is_one_level_that_gives_the_total():
    rng = np.random.default_rng(0)
    for _ in range(50):
        n = 5
        scale, mass = rng.uniform(300.0, 900.0, n), rng.uniform(0.1, 1.0, n)
        share, carried, limit = mass / mass.sum(), rng.uniform(100.0, 900.0, n), rng.uniform(300.0, 900.0, n)  # fmt: skip
        target = rng.uniform(50.0, 700.0, n)
        split = even_split(target, carried, limit, scale, share)
        upper = np.minimum(carried, limit)
        assert np.all(split <= upper * (1 + 1e-9))
        wanted, most = share @ (target / scale), share @ (upper / scale)
        assert share @ (split / scale) == pytest.approx(min(wanted, most), rel=1e-9)
        below = split < upper * (1 - 1e-9)
        if below.any():
            level = (split / scale)[below].max()
            assert (split / scale)[below].min() == pytest.approx(level, rel=1e-9)
            assert np.all((upper / scale)[~below] <= level * (1 + 1e-9))


@pytest.mark.parametrize(
    ("field", "value"),
    [
        ("steps", 0),
        ("steps", 2.0),
    ],
)
def test_impossible_settings_are_named(field, value):
    with pytest.raises(MpcError, match=field):
        GroupSettings(**{field: value})
