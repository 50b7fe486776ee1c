"""The optimal control problem solved to convergence by ipopt: what the real-time iteration is measured against.

Multiple shooting on CasADi's symbols; the soft slip limit has an explicit slack. Neither the formulation nor the solver is
shared with the real-time iteration, only the model's right side is. Built once; never used in the loop.
"""

from typing import Any

import casadi as cs
import numpy as np

from alloc.onboard.host import UnitContext
from mpc.condensing import TORQUE_SCALE
from mpc.horizon import HorizonProblem, HorizonSolution, weight_vector
from mpc.settings import MpcSettings
from mpc.unit_model import slip_matrix, substeps, unit_model

OPTIONS: dict[str, Any] = {
    "print_time": False,
    "error_on_fail": False,
    "ipopt.print_level": 0,
    "ipopt.sb": "yes",
    "ipopt.bound_relax_factor": 0.0,
    "ipopt.max_iter": 500,
}


class ReferenceSolver:
    """Solver of `HorizonProblem` by ipopt to `tolerance`; a local optimum, as it depends on the guess."""

    def __init__(
        self,
        context: UnitContext,
        settings: MpcSettings,
        *,
        tolerance: float = 1e-9,
        warm_start: bool = False,
    ) -> None:
        model = unit_model(context)
        weights = weight_vector(context, settings)
        n, axles, states = settings.horizon, context.axles, model.states
        self._axles, self._horizon, self._weights = axles, n, weights
        self._scale = scale = float(weights[TORQUE_SCALE])
        step = model.step_function(settings.step, substeps(context, settings.step))
        w = settings.weights
        # scaled, so that ipopt's tolerance means the same for every unknown
        state_scale = np.array([1.0, *[1.0 / context.radius] * axles, scale])
        self._state_scale = state_scale
        nodes, torques = cs.SX.sym("nodes", states, n), cs.SX.sym("torques", n)
        slack = cs.SX.sym("slack", axles, n)
        start, constants = (
            cs.SX.sym("start", states),
            cs.SX.sym("constants", model.parameters.numel()),
        )
        limit, target, before = cs.SX.sym("limit", axles), cs.SX.sym("target"), cs.SX.sym("before")
        physical = cs.diag(state_scale) @ nodes
        previous = cs.horzcat(start, physical[:, :-1])
        ends = step.map(n)(previous, scale * torques.T, cs.repmat(constants, 1, n))
        defects = (ends - physical) / cs.repmat(cs.DM(state_scale), 1, n)
        excess = (cs.DM(slip_matrix(context)) @ physical - cs.repmat(limit, 1, n)) / w.slip_scale
        changes = torques - cs.vertcat(before / scale, torques[:-1])
        cost = (
            w.tracking * cs.sumsqr(torques - target / scale)
            + w.rate * cs.sumsqr(changes)
            + w.slip / axles * cs.sumsqr(slack)
        )
        unknowns = cs.vertcat(cs.vec(nodes), torques, cs.vec(slack))
        data = cs.vertcat(start, constants, limit, target, before)
        constraints = cs.vertcat(cs.vec(defects), cs.vec(slack - excess))
        # no early end at a looser tolerance
        options = OPTIONS | {"ipopt.tol": tolerance, "ipopt.acceptable_tol": tolerance}
        if warm_start:
            options |= {"ipopt.warm_start_init_point": "yes", "ipopt.mu_init": 1e-6}
        self._solver = cs.nlpsol(
            "reference", "ipopt", {"x": unknowns, "p": data, "f": cost, "g": constraints},
            options,
        )  # fmt: skip
        self._step, self._warm = step, warm_start
        self._slip, self._slip_scale = slip_matrix(context), w.slip_scale
        self._multipliers: dict[str, cs.DM] = {}

    def solve(self, problem: HorizonProblem, guess: np.ndarray | None = None) -> HorizonSolution:
        """Solve from `guess` (horizon,) [N m], by default the target cut to the bounds.

        With `warm_start` the multipliers of the last solution are taken up too. A failure is in the status.
        """
        n, axles, scale = self._horizon, self._axles, self._scale
        torques = np.clip(
            np.full(n, problem.target) if guess is None else guess, 0.0, problem.upper
        )
        x, nodes, slack = problem.state, [], []
        for torque in torques:
            x = np.asarray(self._step(x, torque, problem.parameters)).ravel()
            nodes.append(x / self._state_scale)
            excess = self._slip @ x - problem.slip_limit
            slack.append(np.maximum(excess, 0.0) / self._slip_scale)
        levels = [problem.target, problem.before]
        data = np.concatenate([problem.state, problem.parameters, problem.slip_limit, levels])
        states = self._state_scale.size
        free, slacks = np.full(n * states, np.inf), np.full(n * axles, np.inf)
        start = np.concatenate([*nodes, torques / scale, *slack])
        answer = self._solver(
            x0=start,
            p=data,
            lbx=np.concatenate([-free, np.zeros(n), np.zeros(n * axles)]),
            ubx=np.concatenate([free, np.full(n, problem.upper / scale), slacks]),
            lbg=np.zeros(n * (states + axles)),
            ubg=np.concatenate([np.zeros(n * states), slacks]),
            **self._multipliers,
        )
        if self._warm:
            self._multipliers = {"lam_x0": answer["lam_x"], "lam_g0": answer["lam_g"]}
        stats = self._solver.stats()
        found = np.asarray(answer["x"]).ravel()[n * states : n * states + n] * scale
        return HorizonSolution(
            torques=np.clip(found, 0.0, problem.upper),
            cost=float(answer["f"]),
            residual=float(stats["iterations"]["inf_du"][-1]),
            iterations=int(stats["iter_count"]),
            status="ok" if stats["success"] else str(stats["return_status"]),
        )
