"""The optimal control problem of a control period, whole, in `casadi.Opti`: of a unit, of a car's units, of a train.

**Model.** One rigid body of speed v [m/s] carries wheelsets i of angular speed w_i [rad/s] and units j of motor torque
T_j [N m]. All counts positive in the direction of the demand. States and inputs, a torque command per unit:

    x = (v, w_1 .. w_n, T_1 .. T_m),    u = (u_1 .. u_m)

    mass dv/dt = sum_i F_i - mass g sin(gradient)    the gradient stands for all drag (`mpc.old.belief`)
    I_i dw_i/dt = gear_j T_j - r_i F_i + air_j       motor, rail and air brake (`mpc.old.belief`)
    lag_j dT_j/dt = u_j - T_j                        motors
    F_i = mu(s_i) N_i,    s_i = r_i w_i - v          adhesion curve at the slip; N_i less what the car's force unloads

These are the plant's equations (`alloc.old.plant.laws`) on symbols, see `mpc.old.model`; believed values are parameters.

**Problem.** F(x, u) takes the state on by a step of the horizon, by classical Runge-Kutta steps (`mpc.old.model` says how
many), while u is constant. With u_-1 the command in force, e_ki the slack of a soft limit of slip, and c_j the share of
unit j in the mass (c_i that of an axle):

    minimise  sum_k tracking (sum_j c_j (u_kj - target_j) / U_j)^2     total effort, whichever unit delivers it
                  + rate sum_j c_j ((u_kj - u_k-1,j) / U_j)^2          changes of torque
                  + evenness sum_j c_j ((u_kj - reference_j) / U_j)^2  who delivers it, in a group (`even_split`)
                  + slip sum_i c_i e_k+1,i^2                           slip beyond its limit (`mpc.old.slip_search`)
    subject to  x_0 = state measured,    x_k+1 = F(x_k, u_k),    0 <= u_kj <= upper_j,
                e_ki >= 0,    e_ki >= (s_ki - limit_i) / S

U_j, the torque of a coefficient of 0.1, S, and the weights are those of `mpc.old.settings`. Targets and upper bounds come from
`mpc.old.unit` and `mpc.old.group`.

**Solution.** All states are unknowns (Bock, Plitt: A multiple shooting algorithm for direct solution of optimal control
problems, IFAC Proceedings 17 (1984) 1603-1608). `mpc.old.solver` has eliminated x and e, and must find the same; it is a
thousand times faster. Opti: Andersson, Gillis, Horn, Rawlings, Diehl: CasADi, Math. Prog. Comp. 11 (2019) 1-36.
"""

from functools import lru_cache
from typing import Any

import casadi as cs
import numpy as np

from mpc.old.condensing import needed_substeps
from mpc.old.model import UnitModel, stiffness_of, unit_model
from mpc.old.period import Plan, Problem, cost_of, solve_compiled, weights_of
from mpc.old.settings import MpcError, Weights

COMMON = {"expand": True, "print_time": False, "record_time": True}
QUIET = dict.fromkeys(("print_header", "print_iteration", "print_status"), False)
QP_QUIET = dict.fromkeys(("print_header", "print_iter", "print_info", "error_on_fail"), False)
IPOPT = {"print_level": 0, "sb": "yes", "tol": 1e-9, "bound_relax_factor": 0.0, "max_iter": 500}
FATROP = {"print_level": 0, "tolerance": 1e-9, "max_iter": 500}
OPTIONS: dict[str, dict[str, Any]] = {
    "ipopt": {"ipopt": IPOPT},
    "fatrop": {"structure_detection": "auto", "fatrop": FATROP},
    "sqpmethod": QUIET | {"qpsol": "qrqp", "qpsol_options": QP_QUIET, "tol_du": 1e-7},
}
"""Of the solvers, named as CasADi does."""


@lru_cache(maxsize=3)
def posed(model: UnitModel, weights: Weights, evenness: float, grid: Any, solver: str) -> Any:
    """The problem for all groups of one shape; `grid`: steps, length of one [s], Runge-Kutta steps in one.

    Returns Opti, its parameters, its unknowns ((x_k, u_k-1), u_k and e_k, scaled), F and the scaled excess of slip.
    """
    n, m, size, (horizon, step, substeps) = model.axles, model.units, model.states, grid
    scalars: list[Any] = [model.state, model.torque, model.parameters, cs.SX.sym("limit", n)]
    x, u, p, limit = scalars
    rate = cs.Function("rate", [x, cs.vertcat(u, p)], [model.rate])
    after = cs.simpleRK(rate, substeps, 4).expand()(x, cs.vertcat(u, p), step)
    F = cs.Function("F", [x, u, p], [after])
    over = (model.steps.slip - limit) / weights.slip_scale
    excess = cs.Function("excess", [x, p, limit], [over])

    opti = cs.Opti()
    given = [opti.parameter(k) for k in (size, p.numel(), n, m, m, m, m, size, m, n)]
    start, p, limit, target, before, upper, reference, scale, share, axle_share = given
    U = scale[-m:]
    states, torques, slacks, cost = [opti.variable(size + m)], [], [], cs.MX(0.0)
    for k in range(horizon + 1):
        # u_k-1 is a state too: then a stage concerns its own unknowns alone, which fatrop needs
        x, last = scale * states[k][:size], states[k][size:]
        if k > 0:
            slacks.append(opti.variable(n))
        if k < horizon:
            torques.append(opti.variable(m))
            states.append(opti.variable(size + m))
            u = torques[k]
            opti.subject_to(states[k + 1] == cs.vertcat(F(x, U * u, p) / scale, u))
            opti.subject_to(opti.bounded(0.0, u, upper / U))
            cost += weights.tracking * cs.dot(share, u - target / U) ** 2
            cost += weights.rate * cs.dot(share, (u - last) ** 2)
            cost += evenness * cs.dot(share, (u - reference / U) ** 2)
        if k == 0:
            opti.subject_to(states[k] == cs.vertcat(start / scale, before / U))
        else:
            opti.subject_to(slacks[-1] >= 0.0)
            opti.subject_to(slacks[-1] >= excess(x, p, limit))
            cost += weights.slip * cs.dot(axle_share, slacks[-1] ** 2)
    opti.minimize(cost)
    opti.solver(solver, COMMON | OPTIONS[solver])
    return opti, given, (states, torques, slacks), F, excess


def solve(problem: Problem, solver: str = "compiled") -> Plan:
    """A local optimum of the problem, which depends on its guess.

    `solver`: one of `OPTIONS`, or "compiled", that of the loop, with as many steps as the settings allow. One that fails
    says so in the status. Raises `MpcError` for another solver and for arrays of a wrong size.
    """
    units, settings = problem.units, problem.settings
    values, guess = problem.numbers(), problem.guessed()
    if solver == "compiled":
        return solve_compiled(problem)
    if solver not in OPTIONS:
        raise MpcError(f"mpc: no solver {solver!r}; choose compiled, {', '.join(OPTIONS)}")
    if not np.isfinite(np.concatenate([guess.ravel(), *values])).all():  # fatrop would never end
        return Plan(guess, guess[:0], guess[:0], np.nan, "not finite", 0, 0.0)
    state, parameters, limit, _, before, upper, _ = values
    substeps = needed_substeps(stiffness_of(units, settings.step), settings.step, parameters)
    grid = settings.horizon, settings.step, substeps
    opti, given, unknowns, F, excess = posed(
        unit_model(units), weights_of(units, settings), problem.evenness, grid, solver
    )
    terms = cost_of(units, settings)
    U, radius = terms.unit.scale, terms.slip_matrix.max(axis=1)
    scale = np.concatenate([[1.0], 1.0 / radius, U])
    values += [scale, terms.unit.share, terms.axle.share]
    x, starts = state, [[np.concatenate([state / scale, before / U])], [], []]
    for u in guess:
        x = F(x, u, parameters).full().ravel()
        starts[0].append(np.concatenate([x / scale, u / U]))
        starts[1].append(u / U)
        starts[2].append(np.maximum(excess(x, parameters, limit).full(), 0.0))
    for symbol, value in zip(given, values, strict=True):
        opti.set_value(symbol, value)
    for symbols, start in zip(unknowns, starts, strict=True):
        for symbol, value in zip(symbols, start, strict=True):
            opti.set_initial(symbol, value)
    opti.set_initial(opti.lam_g, 0.0)
    try:
        opti.solve()
        status = "ok"
    except RuntimeError:  # it says the same in many words
        status = str(opti.return_status())
    stats = opti.stats()
    found = [np.array([np.ravel(opti.debug.value(s)) for s in symbols]) for symbols in unknowns]
    return Plan(
        np.clip(found[1] * U, 0.0, upper), found[0][:, : state.size] * scale, found[2],
        float(opti.debug.value(opti.f)), status, int(stats["iter_count"]), float(stats["t_wall_total"]),
    )  # fmt: skip
