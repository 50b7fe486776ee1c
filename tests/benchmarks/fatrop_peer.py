"""The optimal control problem solved to convergence by fatrop, an interior-point method that uses the stages' structure.

Vanroye, Sathya, De Schutter, Decre: FATROP: a fast constrained optimal control problem solver for robot trajectory
optimization and control, IROS 2023. A peer of the real-time iteration in tests and benchmarks, never used in the loop.
"""

from typing import Any

import casadi as cs
import numpy as np

from alloc.onboard.host import UnitContext
from mpc.horizon import HorizonProblem, HorizonSolution
from mpc.settings import MpcSettings
from tests.benchmarks.stages import stages

CONTROL, SLACK, STATE = range(3)
"""Kinds of an unknown."""


class FatropSolver:
    """Solver of `HorizonProblem` by fatrop to `tolerance`; a local optimum, as it depends on the guess.

    A stage's unknowns are the state at its begin, the torque and the slacks of the slip limit at its begin. The first
    has no slacks, for its state is measured; the last has no torque.
    """

    def __init__(
        self,
        context: UnitContext,
        settings: MpcSettings,
        *,
        tolerance: float = 1e-9,
        warm_start: bool = False,
    ) -> None:
        n, axles, w = settings.horizon, context.axles, settings.weights
        self._stages = made = stages(context, settings)
        self._horizon, self._warm = n, warm_start
        size = made.scale.size
        parameters = cs.SX.sym("parameters", made.step.numel_in(2))
        limit, target = cs.SX.sym("limit", axles), cs.SX.sym("target")
        start = cs.SX.sym("start", size)
        states = [cs.SX.sym(f"state_{k}", size) for k in range(n + 1)]
        unknowns, kinds, constraints, equal = [], [], [], []
        cost = cs.SX(0)
        for k, state in enumerate(states):
            unknowns.append(state)
            kinds += [STATE] * size
            if k < n:
                control = cs.SX.sym(f"control_{k}")
                unknowns.append(control)
                kinds.append(CONTROL)
                cost += w.tracking * (control - target) ** 2 + w.rate * (control - state[-1]) ** 2
                # this sign: fatrop raises an exception without a reason on the other
                constraints.append(states[k + 1] - made.step(state, control, parameters))
                equal += [True] * size
            if k == 0:
                constraints.append(state - start)
                equal += [True] * size
            else:
                slack = cs.SX.sym(f"slack_{k}", axles)
                unknowns.append(slack)
                kinds += [SLACK] * axles
                cost += w.slip / axles * cs.sumsqr(slack)
                constraints.append(slack - made.excess(state, limit))
                equal += [False] * axles
        self._kinds, self._equal = np.array(kinds), np.array(equal)
        options: dict[str, Any] = {
            "print_time": False,
            "error_on_fail": False,
            "structure_detection": "manual",
            "N": n,
            "nx": [size] * (n + 1),
            "nu": [1] + [1 + axles] * (n - 1) + [axles],
            "ng": [size] + [axles] * n,
            "equality": equal,
            "fatrop.print_level": 0,
            "fatrop.tolerance": tolerance,
            "fatrop.max_iter": 500,
        }
        if warm_start:
            options |= {"fatrop.mu_init": 1e-6}
        problem = {
            "x": cs.vertcat(*unknowns),
            "p": cs.vertcat(start, parameters, limit, target),
            "f": cost,
            "g": cs.vertcat(*constraints),
        }
        self._solver = cs.nlpsol("fatrop_peer", "fatrop", problem, options)
        self._multipliers: dict[str, cs.DM] = {}

    def forget(self) -> None:
        """Start the next solve without multipliers."""
        self._multipliers = {}

    def solve(self, problem: HorizonProblem, guess: np.ndarray | None = None) -> HorizonSolution:
        """Solve from `guess` (horizon,) [N m], by default the target cut to the bounds.

        With `warm_start` the multipliers of the last solution are taken up too. A failure is in the status; the residual
        is not told (nan).
        """
        made, scale = self._stages, self._stages.torque_scale
        if not np.isfinite(np.concatenate([np.ravel(value) for value in problem])).all():
            # fatrop would not come back
            bad = np.full(self._horizon, np.nan)
            return HorizonSolution(bad, np.nan, np.nan, 0, "not finite")
        torques = np.full(self._horizon, problem.target) if guess is None else guess
        controls = np.clip(torques, 0.0, problem.upper) / scale
        start, trajectory = made.start(problem), made.rollout(problem, controls)
        excess = np.array(
            [np.asarray(made.excess(state, problem.slip_limit)).ravel() for state in trajectory]
        )
        first = np.empty(self._kinds.size)
        first[self._kinds == STATE] = np.concatenate([start, trajectory.ravel()])
        first[self._kinds == CONTROL] = controls
        first[self._kinds == SLACK] = np.maximum(excess, 0.0).ravel()
        answer = self._solver(
            x0=first,
            p=np.concatenate(
                [start, problem.parameters, problem.slip_limit, [problem.target / scale]]
            ),
            lbx=np.where(self._kinds == STATE, -np.inf, 0.0),
            ubx=np.where(self._kinds == CONTROL, problem.upper / scale, np.inf),
            lbg=0.0,
            ubg=np.where(self._equal, 0.0, np.inf),
            **self._multipliers,
        )  # fmt: skip
        if self._warm:
            self._multipliers = {"lam_x0": answer["lam_x"], "lam_g0": answer["lam_g"]}
        stats = self._solver.stats()
        found = np.asarray(answer["x"]).ravel()[self._kinds == CONTROL] * scale
        return HorizonSolution(
            torques=np.clip(found, 0.0, problem.upper),
            cost=float(answer["f"]),
            residual=float("nan"),
            iterations=int(stats["iter_count"]),
            status="ok" if stats["success"] else str(stats["return_status"]),
        )
