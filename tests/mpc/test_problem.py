"""The optimal control problem: its plant is the simulated one, its solution is one, its fast twin solves the same."""

import signal
from dataclasses import replace

import casadi
import numpy as np
import pytest

from alloc.plant.curves import RationalCurve
from alloc.plant.dynamics import derivative
from alloc.schema.errors import InputError
from mpc import problem
from mpc.plan import plan_torques
from mpc.problem import (
    BELIEVED,
    COEFFICIENT,
    SLIP,
    SOLVERS,
    Problem,
    Weights,
    one_step,
    slip_rate,
    solve,
    tensions,
    torque_scale,
)
from mpc.unit import MPC
from studies.files.scenario_files import load_scenario
from tests.cases import looped

PERIOD = 0.01


def believed(rng, m=1):
    """Random rows: from locomotive to tram, dry to slippery; the slip limit acts in most."""
    u = BELIEVED.rows(m)
    u.radius, u.gear = rng.uniform(0.3, 0.55, m), rng.uniform(3.0, 7.0, m)
    u.load, u.inertia = rng.uniform(4e4, 2e5, m), rng.uniform(40.0, 300.0, m)
    u.lag, u.acceleration = rng.choice([0.005, 0.02, 0.05, 0.1], m), rng.uniform(-1.0, 1.0, m)
    u.coefficient, u.pair_slip = rng.uniform(0.02, 0.4, m), np.exp(rng.uniform(-4.0, 0.4, m))
    u.elasticity, u.share = rng.uniform(0.1, 0.9, m), 1.0 / m
    one = torque_scale(u)
    carried = one * u.coefficient / COEFFICIENT
    u.torque, u.before = carried * rng.uniform(0.5, 1.2, m), carried * rng.uniform(0.5, 1.2, m)
    u.target = carried * rng.uniform(0.2, 3.0, m)
    u.upper, u.air = u.target * rng.choice([1.0, 0.8], m), rng.choice([0.0, 2e3], m)
    u.slip, u.limit = u.pair_slip * rng.uniform(0.5, 1.5, m), u.pair_slip * rng.uniform(0.7, 1.3, m)
    return u


def weights(rng):
    return Weights(float(rng.choice([0.0, 0.3, 2.0])), float(rng.choice([0.1, 2.0])))


def matrices(u, n, period=PERIOD):
    """Slips over SLIP of one unit are free + answer @ torques over their scale: the step as matrices."""
    stiff = u.radius**2 * u.load / u.inertia
    slope = u.elasticity * u.coefficient / u.pair_slip
    keep, left = np.exp(-stiff * slope * period), np.exp(-period / u.lag)
    share, reach = u.lag / period * (1.0 - left), (1.0 - keep) / (stiff * slope)
    pull = reach * u.radius * u.gear / u.inertia
    onward = np.array([[keep, pull * share], [0.0, left]])
    into = np.array([pull * (1.0 - share), 1.0 - left])
    rest = stiff * (u.air / u.load - u.coefficient * (1.0 - u.elasticity)) - u.acceleration
    state, free, answer = np.array([u.slip, u.torque]), np.empty(n), np.zeros((n, n))
    for k in range(n):
        state = onward @ state + [reach * rest, 0.0]
        free[k] = state[0] / SLIP
        one = np.linalg.matrix_power(onward, k) @ into * torque_scale(u) / SLIP
        answer += one[0] * np.eye(n, k=-k)
    return free, answer


def twin(u, w, n, start=None):
    """What `mpc.plan` makes of a row, over the scale of torque, from the command in force on, or from a plan."""
    m = MPC.rows(1)[0]
    m.horizon, m.change_weight, m.slip_weight = n, w.change, w.slip
    m.torques[:n] = min(u.before, u.upper) / torque_scale(u) if start is None else start
    assert plan_torques(m, u, PERIOD)
    return m.torques[:n]


# the plant as believed


def test_the_wheel_is_the_simulated_one():
    rng, curve = np.random.default_rng(1), RationalCurve(peak_slip=0.2)
    event = load_scenario("wet-patch").event(0)
    w = replace(event, rail=replace(event.rail, level=0.1, curve=curve)).world()
    axles, plant, n = w.wheelsets, w.plant[0], w.wheelsets.size
    omega, pair = 2, 0.07
    w.state[1] = 20.0
    w.state[omega : omega + n] = (20.0 + rng.uniform(0.01, 0.5, n)) / axles.radius
    w.state[omega + n : omega + n + w.drives.size] = rng.uniform(0.0, 900.0, w.drives.size)
    rate = np.zeros_like(w.state)
    derivative(
        0.0, w.state, rate, axles, w.cars, w.drives, w.cylinders, w.patches, w.line, w.effort, w.retard,
        w.curve, w.scatter, plant,
    )  # fmt: skip
    unit = BELIEVED.rows(1)[0]
    unit.pair_slip, unit.elasticity = pair, (1.0 - (pair / 0.2) ** 2) / (1.0 + (pair / 0.2) ** 2)
    for i in np.flatnonzero(axles.unit >= 0):
        a, torque = axles[i], w.state[omega + n + axles[i].unit]
        unit.radius, unit.gear, unit.load, unit.inertia = a.radius, a.gear, a.axle_load, a.inertia
        unit.acceleration, unit.coefficient = rate[1], curve(pair, a.offered)
        slip = a.radius * w.state[omega + i] - 20.0
        expected = a.radius * rate[omega + i] - rate[1]
        assert float(slip_rate(slip, torque, unit, "rational")) == pytest.approx(expected, abs=1e-9)


@looped("curve", ("line", "rational"))
def test_a_step_halved_errs_a_quarter(curve):
    u, step = believed(np.random.default_rng(2)), one_step(curve)
    u.lag, u.pair_slip, u.coefficient, u.slip, u.elasticity = 0.05, 0.1, 0.1, 0.2, 0.3
    u.torque = torque_scale(u)

    def after(parts):
        slip, torque = float(u.slip[0]), float(u.torque[0])
        for _ in range(parts):
            slip, torque = step(slip, torque, 1.3 * u.torque, 0.02 / parts, list(u.tolist()[0]))
        return float(slip)

    errors = [abs(after(parts) - after(512)) for parts in (2, 4, 8)]
    assert errors[0] / errors[1] == pytest.approx(4.0, abs=0.7)
    assert errors[1] / errors[2] == pytest.approx(4.0, abs=0.4)


# the solution


def test_the_twin_satisfies_the_optimality_conditions():
    rng = np.random.default_rng(3)
    for _ in range(200):
        row, w, n = believed(rng)[0], weights(rng), int(rng.integers(1, 31))
        u, scale = twin(row, w, n), torque_scale(row)
        (free, answer), change = matrices(row, n), np.eye(n) - np.eye(n, k=-1)
        over, changes = np.maximum(free + answer @ u - row.limit / SLIP, 0.0), change @ u
        changes[0] -= row.before / scale
        slope = u - row.target / scale + w.change * change.T @ changes + w.slip * answer.T @ over
        upper = row.upper / scale
        assert ((u >= 0.0) & (u <= upper)).all()
        assert (slope[u < upper] > -1e-8).all()
        assert (slope[u > 0.0] < 1e-8).all()


def test_the_twin_solves_the_problem():
    """From the command in force, and from near a plan of CasADi's; there the cost shows the rest to 1e-7 alone."""
    rng, active, worst = np.random.default_rng(4), 0, [0.0, 0.0]
    for _ in range(1000):
        u, w = believed(rng), weights(rng)
        found, scale = solve(Problem(u, PERIOD, weights=w)), torque_scale(u)[0]
        assert found.solved
        plan = found.torques[0] / scale
        off = rng.uniform(-1.0, 1.0, 15) * 10.0 ** rng.uniform(-17.0, -4.0, 15)
        for k, start in enumerate((None, np.clip(plan + off, 0.0, u.upper[0] / scale))):
            worst[k] = max(worst[k], np.abs(plan - twin(u[0], w, 15, start)).max())
        active += bool((found.slips > u.limit[0]).any())
    assert worst[0] < 1e-10
    assert worst[1] < 1e-6
    assert active > 500


@looped("solver", [one for one in SOLVERS if one != "daqp"])
def test_solvers_agree(solver):
    rng = np.random.default_rng(5)
    for m in (1, 1, 3):
        u, couplers = believed(rng, m), tensions(range(m), np.ones(m + 1))
        one = Problem(u, PERIOD, 8, weights=Weights(0.3, 2.0, 0.1, 0.1), couplers=couplers)
        best, found = solve(one), solve(one, solver)
        assert found.cost == pytest.approx(best.cost, rel=1e-6)
        assert found.torques == pytest.approx(
            best.torques, rel=1e-3, abs=1e-4 * torque_scale(u).min()
        )
        assert found.slips == pytest.approx(best.slips, rel=1e-3, abs=1e-4)


def test_slips_and_cost_are_those_of_the_torques():
    rng = np.random.default_rng(6)
    for _ in range(50):
        u, w, n = believed(rng)[0], weights(rng), 12
        found = solve(Problem(u.reshape(1), PERIOD, n, weights=w))
        (free, answer), own = matrices(u, n), found.torques[0] / torque_scale(u)
        assert found.slips[0] / SLIP == pytest.approx(free + answer @ own, abs=1e-9)
        over = np.maximum(found.slips[0] - u.limit, 0.0) / SLIP
        change = np.diff(own, prepend=u.before / torque_scale(u))
        cost = ((own - u.target / torque_scale(u)) ** 2).sum() + w.change * (change**2).sum()
        assert found.cost == pytest.approx(cost + w.slip * (over**2).sum(), rel=1e-6, abs=1e-8)


def test_a_rational_curve_is_the_line_where_the_slip_stays_at_the_pair():
    u = believed(np.random.default_rng(7))
    u.elasticity, u.lag, u.acceleration, u.air = 0.4, 0.01, 0.0, 0.0
    u.slip, u.limit = u.pair_slip, u.pair_slip
    u.torque = u.before = torque_scale(u) * u.coefficient / COEFFICIENT
    u.target = u.upper = 3.0 * u.torque
    line, rational = (solve(Problem(u, curve=one), "ipopt") for one in ("line", "rational"))
    assert rational.torques[0, 0] == pytest.approx(line.torques[0, 0], rel=0.02)
    assert not np.allclose(rational.torques, line.torques, rtol=1e-6)


def test_a_unit_of_another_size_is_the_same():
    u = believed(np.random.default_rng(8), 3)
    larger = u.copy()
    for one in ("load", "inertia", "torque", "before", "target", "upper", "air"):
        larger[one] *= 3.0
    first, second = solve(Problem(u)), solve(Problem(larger))
    assert second.torques == pytest.approx(3.0 * first.torques, rel=1e-6, abs=1e-6)
    assert second.slips == pytest.approx(first.slips, rel=1e-6)


# a train


def test_units_replace_each_other():
    u = believed(np.random.default_rng(9)).repeat(2)
    u.share, u.slip, u.limit, u.elasticity, u.lag = 0.5, 0.01, 5.0, 0.5, 0.005
    u.torque = u.before = u.target = torque_scale(u)
    u.upper = [0.4 * u.target[0], 3.0 * u.target[0]]
    torques = solve(Problem(u, horizon=10, weights=Weights(0.01, 2.0))).torques[:, -1]
    assert torques == pytest.approx(u.target[0] * np.array([0.4, 1.6]), rel=0.02)


def test_a_price_of_tensions_lowers_them():
    u = believed(np.random.default_rng(10)).repeat(2)
    u.share, u.slip, u.limit, u.air = 0.5, 0.01, 5.0, 0.0
    u.torque = u.before = [torque_scale(u)[0], 0.0]
    u.target = u.upper = torque_scale(u)[0]
    couplers = tensions([0, 1], np.ones(2))
    assert couplers == pytest.approx(np.array([[0.5, -0.5]]))
    sizes = []
    for price in (0.0, 10.0):
        found = solve(Problem(u, weights=Weights(coupler=price), couplers=couplers))
        sizes.append(np.abs(couplers @ found.torques).max())
    assert sizes[1] < 0.5 * sizes[0]


def test_tensions_are_those_of_a_train_whose_cars_accelerate_alike():
    masses, units = np.array([4.0, 3.0, 2.0, 1.0]), [0, 2]
    force = np.array([5.0, 7.0])
    push = np.array([5.0, 0.0, 7.0, 0.0]) - masses * force.sum() / masses.sum()
    assert tensions(units, masses) @ force == pytest.approx(np.cumsum(push)[:-1])


# faults


@looped(("name", "values"), [
    ("units", (BELIEVED.rows(0), BELIEVED.rows(2)[0], BELIEVED.rows(2).tolist(), MPC.rows(1), None)),
    ("period", (0.0, -0.01, np.inf, np.nan, "0.01", None, True, [0.01])), ("horizon", (0, 15.0, "15", None, True)),
    ("curve", ("cubic", None, 1)), ("weights", (Weights(slip=-1.0), Weights(change=np.nan), Weights("1"), (1.0, 2.0), None)),
    ("couplers", (np.ones((1, 3)), np.ones(2), [[1.0], [1.0, 2.0]], [[1.0, np.nan]], "one", None, 1.0)),
])  # fmt: skip
def test_a_field_that_is_none_is_named_in_one_line(name, values):
    for value in values:
        with pytest.raises(InputError, match=rf"^{name} = .*: give .*$"):
            Problem(**({"units": BELIEVED.rows(2)} | {name: value}))
    assert Problem(BELIEVED.rows(2), couplers=[[1, -1]]).couplers.shape == (1, 2)


def test_what_is_no_problem_is_refused():
    for column, value in [("elasticity", np.nan), ("share", -0.1), ("coefficient", -0.1), ("target", np.inf), *(
        (name, wrong) for name in ("lag", "radius", "gear", "load", "inertia", "pair_slip") for wrong in (0.0, np.nan)
    )]:  # fmt: skip
        u = BELIEVED.rows(2)
        u[column][1] = value
        with pytest.raises(InputError, match=f"unit 1: {column} = "):
            Problem(u)
    u = BELIEVED.rows(1)
    for u.elasticity in (-1.0, 1.0, 1.5):
        Problem(u)
        with pytest.raises(InputError, match="elasticity"):
            Problem(u, curve="rational")
    u = BELIEVED.rows(2)
    with pytest.raises(InputError, match="ipopt"):
        solve(Problem(u, curve="rational"), "daqp")
    with pytest.raises(InputError, match="osqp"):
        solve(Problem(u), "cplex")


def test_a_problem_without_a_solution_says_so():
    u = believed(np.random.default_rng(11))
    u.upper = -1.0
    found = solve(Problem(u))
    assert not found.solved
    assert np.isnan(found.torques).all()


def test_without_a_price_every_solver_has_a_plan_of_the_least_cost():
    """Of slip, of a unit, of changes; and without a limit of slip: then torques or slips can be exchanged."""
    rng = np.random.default_rng(14)
    for _ in range(5):
        for m, change, slip, shares, limit in (
            (1, 0.3, 0.0, 1.0, 0.1), (1, 0.3, 0.0, 1.0, np.inf), (2, 0.3, 2.0, [1.0, 0.0], 0.1), (3, 0.0, 2.0, 0.3, 0.1),
        ):  # fmt: skip
            u = believed(rng, m)
            u.share, u.limit = shares, limit
            plans = [solve(Problem(u, weights=Weights(change, slip)), one) for one in SOLVERS]
            assert all(one.solved for one in plans)
            costs = [one.cost for one in plans]
            assert costs == pytest.approx([costs[0]] * len(SOLVERS), rel=1e-5, abs=1e-5)


def test_a_plan_counts_as_solved_by_all_its_numbers(monkeypatch):
    """Whatever the solver says of itself: spoiled torques, slips, and a residual are noticed."""
    u, function = (
        believed(np.random.default_rng(15)),
        problem.build_solver(1, 15, "line", 0, "daqp"),
    )
    for place, value in ((0, np.nan), (1, np.inf), (3, 2.0 * problem.TOLERANCE), (3, np.nan)):

        def spoiled(*given, place=place, value=value):
            parts = [np.array(part) for part in function(*given)]
            parts[place].flat[-1] = value
            return parts

        monkeypatch.setattr(problem, "build_solver", lambda *_, spoiled=spoiled: spoiled)
        found = solve(Problem(u))
        assert not found.solved
        assert np.isnan([*found.torques.flat, *found.slips.flat, found.cost]).all()


def test_a_solver_is_built_once():
    u = believed(np.random.default_rng(12))
    solve(Problem(u))
    before = problem.build_solver.cache_info().misses
    for _ in range(5):
        solve(Problem(believed(np.random.default_rng(13))))
    assert problem.build_solver.cache_info().misses == before


@looped("swallowed", (RuntimeError("interrupted"), None))
def test_ctrl_c_ends_a_solve(swallowed):
    def interrupted(*_):
        signal.raise_signal(signal.SIGINT)
        if swallowed:
            raise swallowed
        return [casadi.DM.zeros(1, 15), casadi.DM.zeros(1, 15), casadi.DM(0.0), casadi.DM(0.0)]

    # a shell's background jobs ignore what Ctrl-C sends
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(problem, "build_solver", lambda *_: interrupted)
        with pytest.raises(KeyboardInterrupt):
            solve(Problem(BELIEVED.rows(1)))
    assert signal.signal(signal.SIGINT, before) is signal.default_int_handler
