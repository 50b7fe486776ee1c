"""The optimal control problem of a control period as on paper, for the m units of a train; for m = 1 it is that of "mpc".

All counts positive along the demand. Unit j has a mean torque T of its motors, of which the command u is held over a period,
and an axle with most slip s. With w the angular speed of that axle, v the train's speed, R the gear ratio:

    lag dT/dt = u - T,     J dw/dt = R T - r (N mu(s) - air),     s = r w - v

The curve mu(s) is believed: a line through the present pair (s^, mu^) with the elasticity e as its slope, or the rational
curve through it with that elasticity. With c the unit's share of the mass, o the slip beyond its soft limit l, and f the
tension of each coupler that the commands ask for::

    minimise    sum over steps k of   (sum_j c_j (u_jk - target_j))^2
                                    + sum_j c_j (w_u (u_jk - u_j,k-1)^2 + w_s o_jk^2 + w_e (u_jk - mean_k)^2)
                                    + w_c sum f_k^2
    subject to  0 <= u_jk <= upper_j,     s_jk <= l_j + o_jk

The cost is a pure number: torques count over that of a coefficient of `COEFFICIENT`, slips over `SLIP`, tensions over the
train's load times `COEFFICIENT`. Its first term is effort missed: units replace each other. The others are the price of
changes of torque (ride, wear of drives), of slip (wheel damage, instability), of unevenness, of tensions.

`mpc.plan` solves the same for one unit and a line without CasADi, on board; `tests/mpc/test_problem.py` holds it to this.
CasADi is imported where a solver is built: it takes longer to import than a run takes.
"""

import threading
from dataclasses import dataclass, field
from functools import lru_cache
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc import backends
from alloc.compilation import signals_afterwards
from alloc.onboard.columns import ONE
from alloc.schema.errors import InputError
from alloc.schema.tables import Column, Rows, Table

Floats = NDArray[np.float64]
COEFFICIENT, SLIP = 0.1, 0.05
"""Scales: coefficient whose torque is one, slip that is one [m/s]."""

BELIEVED = Table(
    "unit of a problem",
    slip=Column(0.0, "m s-1", "slip of its axle with most slip, when the plan begins"),
    torque=Column(0.0, "N m", "torque of each motor then"),
    before=Column(0.0, "N m", "torque commanded until then"),
    target=Column(0.0, "N m", "torque wanted"),
    upper=Column(0.0, "N m", "most torque that may be commanded"),
    limit=Column(0.1, "m s-1", "slip limit l"),
    coefficient=Column(0.1, ONE, "coefficient mu^ of the present pair"),
    pair_slip=Column(0.1, "m s-1", "slip s^ of the present pair"),
    elasticity=Column(0.5, ONE, "elasticity e of the curve there"),
    air=Column(0.0, "N", "air brake force per axle"),
    acceleration=Column(0.0, "m s-2", "acceleration dv/dt of the train"),
    radius=Column(0.43, "m", "wheel radius r"),
    gear=Column(7.0, ONE, "gear ratio R"),
    load=Column(1e5, "N", "axle load N"),
    inertia=Column(100.0, "kg m2", "inertia J of a wheelset"),
    lag=Column(0.005, "s", "time constant of the torque"),
    share=Column(1.0, ONE, "share c of the mass of all units"),
)
"""What is believed of a unit; a row of it for each unit of a problem."""
_ABOVE = {"pair_slip", "radius", "gear", "load", "inertia", "lag"}
_LARGEST = np.finfo(float).max
_LEAST = dict.fromkeys(_ABOVE, 5e-324) | {"coefficient": 0.0, "share": 0.0}
LEAST = np.array([_LEAST.get(name, -_LARGEST) for name in BELIEVED.columns])
MOST = np.array([np.inf if name in ("limit", "upper") else _LARGEST for name in BELIEVED.columns])
"""Least and greatest value of each column for which the model is one."""
LIMIT, ELASTICITY = map(list(BELIEVED.columns).index, ("limit", "elasticity"))


class Weights(NamedTuple):
    """Prices, each [1]."""

    change: float = 0.3
    """w_u of changes of torque."""
    slip: float = 2.0
    """w_s of slip beyond its limit."""
    even: float = 0.0
    """w_e of unevenness: torque beside the mean of all units."""
    coupler: float = 0.0
    """w_c of tensions."""


@dataclass(frozen=True)
class Problem:
    """The problem of a control period; raises `InputError` for what is none."""

    units: Rows
    """Rows of `BELIEVED`, (m,)."""
    period: float = 0.01
    """Control period [s]."""
    horizon: int = 15
    """Number n of steps, of a control period each."""
    curve: str = "line"
    """Believed curve: "line" or "rational"."""
    weights: Weights = field(default_factory=Weights)
    couplers: Any = ()
    """Tension of each coupler over the weighed torques c u of the units, (couplers, m) [1]; see `tensions`."""

    def __post_init__(self) -> None:
        u, w, couplers = self.units, self.weights, read_array(self.couplers)
        rows = isinstance(u, np.ndarray) and u.ndim == 1 and u.dtype == BELIEVED.dtype
        prices = isinstance(w, Weights) and all(is_number(price, 0.0) for price in w)
        wide = couplers.ndim == 2 and couplers.shape[1:] in ((np.size(u),), (0,))
        for name, fits, need in (
            ("units", rows and u.size > 0, "rows of `BELIEVED`, one or more, as BELIEVED.rows(2)"),
            ("period", is_number(self.period, 5e-324), "a time [s] above 0"),
            ("horizon", is_number(self.horizon, 1, whole=True), "a whole number, 1 or more"),
            ("curve", self.curve in ("line", "rational"), "'line' or 'rational'"),
            ("weights", prices, "`Weights` of finite numbers, 0 or greater"),
            ("couplers", wide and np.isfinite(couplers).all(), "finite numbers (couplers, units)"),
        ):
            if not fits:
                text = " ".join(repr(getattr(self, name)).split())  # arrays have lines
                raise InputError(f"{name} = {text:.80}: give {need}")
        object.__setattr__(self, "couplers", couplers)
        object.__setattr__(self, "units", BELIEVED.rows_in(u))
        values = self.rows
        wrong = ~((values >= LEAST) & (values <= MOST))
        if self.curve == "rational":  # of another elasticity there is no such curve
            wrong[:, ELASTICITY] |= np.abs(values[:, ELASTICITY]) >= 1.0
        for j, k in np.argwhere(wrong)[:1]:
            bound = {5e-324: "above 0", 0.0: "0 or greater"}.get(
                LEAST[k], "finite; of a rational curve's elasticity, less than 1"
            )
            raise InputError(
                f"unit {j}: {list(BELIEVED.columns)[k]} = {values[j, k]:g} must be {bound}"
            )

    @property
    def rows(self) -> Floats:
        """The units as plain numbers, (m, columns)."""
        return np.array(self.units.tolist(), dtype=float).reshape(self.units.size, -1)


def read_array(values: ArrayLike) -> Floats:
    """`values` as numbers, nothing as (0, 0); what is no array of numbers becomes one nan."""
    try:
        array = np.asarray(values, dtype=float)
    except (TypeError, ValueError):
        return np.array(np.nan)
    return array if array.size else np.zeros((0, 0))


def is_number(value: Any, least: float, whole: bool = False) -> bool:
    """Whether `value` is a finite number of `least` or more, and a `whole` one where that is asked for."""
    kinds = (int, np.integer) if whole else (int, float, np.integer, np.floating)
    return (
        isinstance(value, kinds) and not isinstance(value, bool) and bool(least <= value < np.inf)
    )


class Plan(NamedTuple):
    """The solution of a problem."""

    torques: Floats
    """Commands over the horizon [N m], (m, n); the first column is what is commanded now."""
    slips: Floats
    """Slips after each step [m/s], (m, n)."""
    cost: float
    """Cost [1]; nan where there is no solution."""
    solved: bool
    """Whether the solver says so, and all numbers are finite and meet the conditions of optimality; else they are nan."""


def solve(problem: Problem, solver: str = "daqp") -> Plan:
    """Solve a problem by a solver of `SOLVERS`.

    The solver of a shape (units, steps, curve, couplers) is built once and kept. Ctrl-C ends the program after the solve.
    Raises `InputError` for an unknown solver, and for a rational curve, which makes no QP, with one of QPs.
    """
    m, n, couplers = problem.units.size, problem.horizon, len(problem.couplers)
    able = [name for name in SOLVERS if problem.curve == "line" or name not in QUADRATIC]
    if solver not in able:
        names = ", ".join(able)
        raise InputError(f"solver = {solver!r} for curve {problem.curve!r}: give one of {names}")
    u, w = problem.units, problem.weights
    # else torques or slips may be exchanged at no cost
    convex = min(u.share) > 0.0 and (m == 1 or w.change + w.even > 0.0)
    # to build takes a hundred times as long as to solve
    function = build_solver(m, n, problem.curve, couplers, solver, convex)
    with signals_afterwards():
        try:
            results = function(problem.rows.T, [problem.period, *w], problem.couplers)
        except RuntimeError:  # CasADi's answer to bounds that exclude each other
            results = [np.full((m, n), np.nan)] * 2 + [np.nan] * 2
    torque, slip, cost, residual = map(np.asarray, results)
    if not (np.isfinite(torque).all() and np.isfinite(slip).all() and residual <= TOLERANCE):
        return Plan(np.full((m, n), np.nan), np.full((m, n), np.nan), np.nan, False)
    return Plan(torque * torque_scale(u)[:, None], slip * SLIP, float(cost.item()), True)


def plan_row(row: Floats, torques: Floats, period: float, change: float, slip: float) -> bool:
    """Put the torques over their scale that solve one unit's problem into `torques` (n,); whether they do.

    What `solve` finds for a line by DAQP, without its checks: `row` is one of `BELIEVED` as numbers, `change` and `slip` are
    `Weights`. Numbers pass through kept arrays: to make CasADi's own takes longer than to solve.
    """
    solver = keep_solver(torques.size, threading.get_ident())
    solver.row[:], solver.numbers[:3] = row, (period, change, slip)
    solver.solve()
    # a solver that fails leaves zeros or what is no number, and CasADi's greatest of numbers overlooks what is none
    numbers = np.isfinite(solver.torques).all() and not np.isnan(row).any()
    solved = bool(numbers and solver.residual[0] <= TOLERANCE)
    if solved:
        torques[:] = solver.torques
    return solved


@lru_cache(maxsize=16)
def keep_solver(n: int, thread: int) -> Any:
    """The solver of one unit for a `thread`, with the arrays that it reads and writes."""
    buffer, solve = build_solver(1, n, "line", 0, "daqp").buffer()
    arrays = {
        "row": np.zeros(len(BELIEVED.columns)),
        "numbers": np.zeros(1 + len(Weights._fields)),
        "torques": np.zeros(n),
        "residual": np.zeros(1),
    }
    for place, name in enumerate(("row", "numbers")):
        buffer.set_arg(place, arrays[name].data)
    for place, name in ((0, "torques"), (3, "residual")):
        buffer.set_res(place, arrays[name].data)
    # the call does not keep the buffer alive
    return SimpleNamespace(buffer=buffer, solve=solve, **arrays)


def torque_scale(units: Any) -> Any:
    """Torque of each motor [N m] that counts as one."""
    return COEFFICIENT * units.load * units.radius / units.gear


def tensions(car_of_unit: Any, masses: Any) -> Floats:
    """`Problem.couplers`, (cars - 1, m), of a train of cars with these `masses` (cars,) [kg]; `car_of_unit` (m,).

    The force of the units ahead of a coupler, less what the cars ahead take of all: a train without elasticity.
    """
    ahead = np.arange(len(masses) - 1)[:, None]
    pulled = np.cumsum(masses)[:-1, None] / np.sum(masses)
    return np.asarray((np.asarray(car_of_unit)[None, :] <= ahead) - pulled, dtype=float)


# The plant as believed


def coefficient(slip: Any, unit: Any, curve: str) -> Any:
    """Believed coefficient [1] at a `slip` [m/s]."""
    if curve == "line":
        return unit.coefficient * (1.0 + unit.elasticity * (slip - unit.pair_slip) / unit.pair_slip)
    # of 2 x / (1 + x^2) the elasticity is (1 - x^2) / (1 + x^2)
    x = backends.symbolic.sqrt((1.0 - unit.elasticity) / (1.0 + unit.elasticity))
    peak = unit.coefficient * (1.0 + x * x) / (2.0 * x)
    return backends.symbolic.rational_coefficient(slip, peak, unit.pair_slip / x, 2.0)


def slip_rate(slip: Any, torque: Any, unit: Any, curve: str) -> Any:
    """ds/dt [m/s2] under a `torque` of each motor [N m]."""
    rail = unit.load * coefficient(slip, unit, curve) - unit.air
    turning = (unit.gear * torque - unit.radius * rail) / unit.inertia
    return unit.radius * turning - unit.acceleration


@lru_cache(maxsize=4)
def one_step(curve: str) -> Any:
    """(slip, torque, command, period, row of `BELIEVED`) of one unit -> slip, torque a period on.

    The lag is exact. The slip follows the mean torque by exponential Euler steps, which are exact on a line (Hochbruck and
    Ostermann, Acta Numerica 19 (2010) 209-286).
    """
    import casadi as cs

    slip, torque, command, period = (cs.SX.sym(name) for name in ("s", "T", "u", "h"))
    row = cs.SX.sym("row", len(BELIEVED.columns))
    unit = name_columns(row)
    after = command + cs.exp(-period / unit.lag) * (torque - command)
    mean = command - unit.lag / period * (after - torque)
    rate = slip_rate(slip, mean, unit, curve)
    x = period * cs.jacobian(rate, slip)
    small = cs.fabs(x) < 1e-8
    grown = cs.if_else(small, 1.0, cs.expm1(x) / cs.if_else(small, 1.0, x))
    return cs.Function(
        "step", [slip, torque, command, period, row], [slip + period * grown * rate, after]
    )


def name_columns(rows: Any) -> Any:
    """Rows of symbols (columns, m) by the names of the columns of `BELIEVED`."""
    return SimpleNamespace(**{name: rows[i, :] for i, name in enumerate(BELIEVED.columns)})


# The problem


QUADRATIC: dict[str, dict[str, Any]] = {
    "daqp": {},
    "osqp": {"osqp": {"verbose": False, "eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000}},
}
"""CasADi's names of solvers of QPs, and their options. DAQP: active set, exact; OSQP: ADMM."""
SOLVERS = QUADRATIC | {
    "ipopt": {"ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}},
    "sqpmethod": {
        "qpsol": "daqp",
        "qpsol_options": {"print_time": False, "error_on_fail": False, "daqp": {"eps_prox": 1e-5}},
        "convexify_strategy": "eigen-reflect",
        "print_header": False, "print_iteration": False, "print_status": False,
    },
}  # fmt: skip
"""With those of any curve. ipopt: interior points; sqpmethod: a series of QPs by DAQP."""
PROXIMAL = {"daqp": {"daqp": {"eps_prox": 1e-5}}}
"""Options where the cost is not strictly convex: DAQP has no answer without. Where it is, torques would move by 3e-9."""
TOLERANCE = 1e-5
"""Residual of the conditions of Karush, Kuhn and Tucker that counts as none: of a constraint, over the size of a slope."""


def state_problem(m: int, n: int, curve: str, couplers: int) -> SimpleNamespace:
    """The problem of m units and n steps in symbols; variables are torques over their scale and slips beyond the limit."""
    import casadi as cs

    p = SimpleNamespace(
        rows=cs.SX.sym("rows", len(BELIEVED.columns), m),
        numbers=cs.SX.sym("numbers", 1 + len(Weights._fields)),
        couplers=cs.SX.sym("couplers", couplers, m if couplers else 0),
    )
    u, over = cs.SX.sym("u", m, n), cs.SX.sym("over", m, n)
    (period, *prices), step = cs.vertsplit(p.numbers), one_step(curve)
    unit, w = name_columns(p.rows), Weights(*prices)
    share, scale = unit.share.T, torque_scale(unit).T
    free = w.slip == 0.0  # slip without a price has no limit, and what it is beyond that any price
    slip, torque, before, cost, slips = unit.slip, unit.torque, unit.before.T / scale, 0.0, []
    for k in range(n):
        command = (u[:, k] * scale).T
        units = [step(slip[j], torque[j], command[j], period, p.rows[:, j]) for j in range(m)]
        slip, torque = (cs.horzcat(*parts) for parts in zip(*units, strict=True))
        slips.append(slip.T / SLIP)
        short, change = u[:, k] - unit.target.T / scale, u[:, k] - before
        uneven = u[:, k] - cs.dot(share, u[:, k]) / cs.sum1(share)
        beyond = cs.if_else(free, 1.0, w.slip) * over[:, k] ** 2
        cost += cs.dot(share, short) ** 2
        cost += cs.dot(share, w.change * change**2 + beyond + w.even * uneven**2)
        if couplers:
            cost += w.coupler * cs.sumsqr(p.couplers @ (share * u[:, k]))
        before = u[:, k]
    p.torques, p.slips, p.cost = u, cs.horzcat(*slips), cost
    p.x, p.g = cs.veccat(u, over), cs.vec(p.slips - over)
    limit, infinite = cs.if_else(free, cs.inf, unit.limit.T / SLIP), cs.SX.inf(m * n)
    p.least = cs.vertcat(cs.SX.zeros(m * n), -infinite, -infinite)
    p.most = cs.vertcat(cs.repmat(unit.upper.T / scale, n, 1), infinite, cs.repmat(limit, n, 1))
    return p


@lru_cache(maxsize=16)
def build_solver(
    m: int, n: int, curve: str, couplers: int, solver: str, convex: bool = True
) -> Any:
    """Function (rows of `BELIEVED` transposed, [period, weights], couplers) -> torques, slips over their scales, cost,
    residual of primal feasibility, stationarity and complementarity.

    CasADi derives what its solver needs from the statement: of a line the matrices of a QP.
    """
    import casadi as cs

    p = state_problem(m, n, curve, couplers)
    parameters = [p.rows, p.numbers, p.couplers]
    options: dict[str, Any] = {"print_time": False, "error_on_fail": False, "inputs_check": False}
    options |= SOLVERS[solver] if convex else PROXIMAL.get(solver, SOLVERS[solver])
    program = {"x": p.x, "p": cs.veccat(*parameters), "f": p.cost, "g": p.g}
    make = cs.qpsol if solver in QUADRATIC else cs.nlpsol
    optimum = make("optimum", solver, program, options)
    # the conditions of optimality, by the multipliers of all that is bounded
    bounded, dual = cs.vertcat(p.x, p.g), cs.SX.sym("dual", 3 * m * n)
    slope, push = cs.gradient(p.cost, p.x), cs.jtimes(bounded, p.x, dual, True)
    size = 1.0 + cs.fabs(slope) + cs.fabs(push)
    # what stays is within its bounds, and no multiplier belongs to a bound that is not reached
    moved = cs.fmin(cs.fmax(bounded + dual / cs.norm_inf(size), p.least), p.most)
    residual = cs.norm_inf(cs.vertcat((slope + push) / size, bounded - moved))
    results = [p.torques, p.slips, p.cost, residual]
    judge = cs.Function("judge", [p.x, dual, *parameters], results, {"cse": True})
    bounds = cs.Function("bounds", parameters, [p.least, p.most])
    values: Any = [cs.MX.sym("values", part.shape) for part in parameters]
    (least, most), split = bounds(*values), 2 * m * n
    bounds_of_x: Any = {"lbx": least[:split], "ubx": most[:split]}
    bounds_of_g: Any = {"lbg": least[split:], "ubg": most[split:]}
    solution: Any = optimum(p=cs.veccat(*values), **bounds_of_x, **bounds_of_g)
    duals = cs.vertcat(solution["lam_x"], solution["lam_g"])
    return cs.Function("problem", values, judge.call([solution["x"], duals, *values]))
