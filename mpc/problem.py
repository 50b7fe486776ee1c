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

import io
from contextlib import redirect_stderr
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
    if solver not in SOLVERS or (problem.curve == "rational" and solver != "ipopt"):
        names = "ipopt" if problem.curve == "rational" else ", ".join(SOLVERS)
        raise InputError(f"solver = {solver!r} for curve {problem.curve!r}: give one of {names}")
    u, w, rows = problem.units, problem.weights, problem.rows.T
    # else torques or slips may be exchanged at no cost
    convex = min(u.share) > 0.0 and w.slip > 0.0 and (m == 1 or w.change + w.even > 0.0)
    # to build takes a hundred times as long as to solve
    function = build_solver(m, n, problem.curve, couplers, solver, convex)
    rows[LIMIT] = np.minimum(rows[LIMIT], MOST_SLIP)
    numbers = [problem.period, *problem.weights]
    # of a solver that fails CasADi would print all arguments
    with signals_afterwards(), redirect_stderr(io.StringIO()):
        try:
            results = [np.asarray(part) for part in function(rows, numbers, problem.couplers)]
        except RuntimeError:  # CasADi's answer to a solver that fails
            results = [np.full((m, n), np.nan)] * 2 + [np.full(1, np.nan)] * 2
    torque, slip, cost, residual = results
    if not (np.isfinite(torque).all() and np.isfinite(slip).all() and residual <= TOLERANCE):
        return Plan(np.full((m, n), np.nan), np.full((m, n), np.nan), np.nan, False)
    return Plan(torque * torque_scale(u)[:, None], slip * SLIP, float(cost.item()), True)


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


SOLVERS: dict[str, dict[str, Any]] = {
    "daqp": {},
    "osqp": {"osqp": {"verbose": False, "eps_abs": 1e-9, "eps_rel": 1e-9, "max_iter": 20000}},
    "ipopt": {"ipopt": {"print_level": 0, "sb": "yes", "tol": 1e-10}},
}
"""CasADi's names of solvers, and their options. DAQP: active set, exact; OSQP: ADMM; ipopt: interior points, any curve."""
PROXIMAL = {"daqp": {"daqp": {"eps_prox": 1e-5}}}
"""Options where the cost is not strictly convex: DAQP has no answer without. Where it is, torques would move by 3e-9."""
TOLERANCE = 1e-5
"""Residual of the conditions of Karush, Kuhn and Tucker that counts as none: of a constraint, over the size of a slope."""
MOST_SLIP = 1e3
"""Slip limit [m/s] that stands for none."""


@lru_cache(maxsize=16)
def build_solver(
    m: int, n: int, curve: str, couplers: int, solver: str, convex: bool = True
) -> Any:
    """Function (rows of `BELIEVED` transposed, [period, weights], couplers) -> torques, slips over their scales, cost,
    residuals of primal feasibility, stationarity and complementarity."""
    import casadi as cs

    opti = cs.Opti() if solver == "ipopt" else cs.Opti("conic")
    u, over = opti.variable(m, n), opti.variable(m, n)
    rows = opti.parameter(len(BELIEVED.columns), m)
    numbers = opti.parameter(1 + len(Weights._fields))
    tension = opti.parameter(couplers, m if couplers else 0)
    parts: Any = cs.vertsplit(numbers)
    unit, period, w = name_columns(rows), parts[0], Weights(*parts[1:])
    share = unit.share.T
    scale, step = torque_scale(unit).T, one_step(curve).map(m)
    slip, torque, before, cost, slips = unit.slip, unit.torque, unit.before.T / scale, 0.0, []
    for k in range(n):
        slip, torque = step(slip, torque, (u[:, k] * scale).T, period, rows)
        slips.append(slip.T / SLIP)
        short, change = u[:, k] - unit.target.T / scale, u[:, k] - before
        uneven = u[:, k] - cs.dot(share, u[:, k]) / cs.sum1(share)
        cost += cs.dot(share, short) ** 2
        cost += cs.dot(share, w.change * change**2 + w.slip * over[:, k] ** 2 + w.even * uneven**2)
        if couplers:
            cost += w.coupler * cs.sumsqr(tension @ (share * u[:, k]))
        opti.subject_to(opti.bounded(0.0, u[:, k], unit.upper.T / scale))
        opti.subject_to(slips[k] - over[:, k] <= unit.limit.T / SLIP)
        before = u[:, k]
    opti.minimize(cost)
    options = SOLVERS[solver] if convex else PROXIMAL.get(solver, SOLVERS[solver])
    opti.solver(solver, {"print_time": False, **options})
    g, dual, slope = opti.g, opti.lam_g, cs.gradient(cost, opti.x)
    below, above, push = opti.lbg - g, g - opti.ubg, cs.jacobian(g, opti.x).T
    size = 1.0 + cs.fabs(slope) + cs.fabs(push) @ cs.fabs(dual)
    # a multiplier above 0 belongs to the upper bound; it or the distance from there is 0
    slack = cs.fmin(cs.fabs(dual), cs.fabs(cs.if_else(dual > 0.0, above, below)))
    stationarity = cs.fabs(slope + push @ dual) / size
    residual = cs.mmax(cs.vertcat(below, above, stationarity, slack / cs.norm_inf(size)))
    arguments = [opti.x, dual, rows, numbers, tension]
    judge = cs.Function("judge", arguments, [u, cs.horzcat(*slips), cost, residual]).expand()
    return opti.to_function("problem", arguments[2:], judge.call(arguments))
