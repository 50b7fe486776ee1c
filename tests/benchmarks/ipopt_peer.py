"""The optimal control problem solved to convergence by ipopt: what the real-time iteration is measured against.

Multiple shooting on CasADi's symbols; the soft slip limit has an explicit slack. Neither the formulation nor the solver is
shared with the real-time iteration, only the model's right side is. Built once; never used in the loop.
"""

from typing import Any

import casadi as cs
import numpy as np

from mpc.horizon import HorizonProblem, HorizonSolution, cost_of
from mpc.settings import MpcSettings
from mpc.unit_model import Units, group_of, slip_matrix, substeps, unit_model, unit_of_axle
from tests.benchmarks.unit_step import step_function

OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 500,
}


def ipopt_options(tolerance: float, warm_start: bool) -> dict[str, Any]:
    """Options of CasADi's nlpsol; `warm_start`: for guesses and multipliers that are near the solution."""
    # no early end at a looser tolerance
    options = OPTIONS | {"ipopt.tol": tolerance, "ipopt.acceptable_tol": tolerance}
    if warm_start:
        options |= {"ipopt.warm_start_init_point": "yes", "ipopt.mu_init": 1e-6}
    return options


class ReferenceSolver:
    """Solver of `HorizonProblem` by ipopt to `tolerance`; a local optimum, as it depends on the guess."""

    def __init__(
        self,
        units: Units,
        settings: MpcSettings,
        evenness: float = 0.0,
        *,
        tolerance: float = 1e-9,
        warm_start: bool = False,
    ) -> None:
        model = unit_model(units)
        n, axles, states, m = settings.horizon, model.axles, model.states, model.units
        terms = cost_of(units, settings)
        self._axles, self._horizon, self._units = axles, n, m
        self._scale = scale = terms.unit.scale
        share, axle_share = terms.unit.share, terms.axle.share
        step = step_function(model, settings.step, substeps(units, settings.step))
        w = settings.weights
        # scaled, so that ipopt's tolerance means the same for every unknown
        radius = np.array([context.radius for context in group_of(units)])[unit_of_axle(units)]
        self._state_scale = state_scale = np.concatenate([[1.0], 1.0 / radius, scale])
        nodes, torques = cs.SX.sym("nodes", states, n), cs.SX.sym("torques", m, n)
        slack = cs.SX.sym("slack", axles, n)
        start, constants = (
            cs.SX.sym("start", states),
            cs.SX.sym("constants", model.parameters.numel()),
        )
        limit = cs.SX.sym("limit", axles)
        target, before, even = (cs.SX.sym(name, m) for name in ("target", "before", "reference"))
        physical = cs.diag(state_scale) @ nodes
        previous = cs.horzcat(start, physical[:, :-1])
        inverse = cs.diag(1.0 / scale)
        ends = step.map(n)(previous, cs.diag(scale) @ torques, cs.repmat(constants, 1, n))
        defects = (ends - physical) / cs.repmat(cs.DM(state_scale), 1, n)
        excess = (cs.DM(slip_matrix(units)) @ physical - cs.repmat(limit, 1, n)) / w.slip_scale
        changes = torques - cs.horzcat(inverse @ before, torques[:, :-1])
        missed = cs.DM(share).T @ (torques - cs.repmat(inverse @ target, 1, n))
        uneven = torques - cs.repmat(inverse @ even, 1, n)
        cost = (
            w.tracking * cs.sumsqr(missed)
            + cs.dot(cs.DM(share), cs.sum2(w.rate * changes**2 + evenness * uneven**2))
            + w.slip * cs.dot(cs.DM(axle_share), cs.sum2(slack**2))
        )
        unknowns = cs.vertcat(cs.vec(nodes), cs.vec(torques), cs.vec(slack))
        data = cs.vertcat(start, constants, limit, target, before, even)
        constraints = cs.vertcat(cs.vec(defects), cs.vec(slack - excess))
        self._solver = cs.nlpsol(
            "reference", "ipopt", {"x": unknowns, "p": data, "f": cost, "g": constraints},
            ipopt_options(tolerance, warm_start),
        )  # fmt: skip
        self._step, self._warm = step, warm_start
        self._slip, self._slip_scale = slip_matrix(units), w.slip_scale
        self._multipliers: dict[str, cs.DM] = {}

    def forget(self) -> None:
        """Start the next solve without multipliers."""
        self._multipliers = {}

    def solve(self, problem: HorizonProblem, guess: np.ndarray | None = None) -> HorizonSolution:
        """Solve from `guess` (horizon * units,) [N m], by default the target cut to the bounds.

        With `warm_start` the multipliers of the last solution are taken up too. A failure is in the status.
        """
        n, m, axles = self._horizon, self._units, self._axles
        start = np.full((n, m), problem.target) if guess is None else guess.reshape(n, m)
        torques = np.clip(start, 0.0, problem.upper)
        x, nodes, slack = problem.state, [], []
        for torque in torques:
            x = np.asarray(self._step(x, torque, problem.parameters)).ravel()
            nodes.append(x / self._state_scale)
            excess = self._slip @ x - problem.slip_limit
            slack.append(np.maximum(excess, 0.0) / self._slip_scale)
        levels = [np.full(m, v) for v in (problem.target, problem.before, problem.reference)]
        data = np.concatenate([problem.state, problem.parameters, problem.slip_limit, *levels])
        states = self._state_scale.size
        free, slacks = np.full(n * states, np.inf), np.full(n * axles, np.inf)
        upper = np.tile(np.full(m, problem.upper) / self._scale, n)
        answer = self._solver(
            x0=np.concatenate([*nodes, (torques / self._scale).ravel(), *slack]),
            p=data,
            lbx=np.concatenate([-free, np.zeros(n * m), np.zeros(n * axles)]),
            ubx=np.concatenate([free, upper, slacks]),
            lbg=np.zeros(n * (states + axles)),
            ubg=np.concatenate([np.zeros(n * states), slacks]),
            **self._multipliers,
        )
        if self._warm:
            self._multipliers = {"lam_x0": answer["lam_x"], "lam_g0": answer["lam_g"]}
        stats = self._solver.stats()
        scaled = np.asarray(answer["x"]).ravel()[n * states : n * (states + m)]
        found = np.clip(scaled.reshape(n, m) * self._scale, 0.0, problem.upper)
        return HorizonSolution(
            torques=found.ravel(),
            cost=float(answer["f"]),
            residual=float(stats["iterations"]["inf_du"][-1]),
            iterations=int(stats["iter_count"]),
            status="ok" if stats["success"] else str(stats["return_status"]),
        )
