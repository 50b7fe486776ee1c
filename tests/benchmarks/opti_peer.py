"""The optimal control problem as a user of CasADi's Opti writes it down, solved to convergence by ipopt.

Andersson, Gillis, Horn, Rawlings, Diehl: CasADi: a software framework for nonlinear optimization and optimal control, Math.
Prog. Comp. 11 (2019) 1-36. A peer in tests and benchmarks, never used in the loop.
"""

import casadi as cs
import numpy as np

from alloc.onboard.host import UnitContext
from mpc.horizon import HorizonProblem, HorizonSolution
from mpc.settings import MpcSettings
from tests.benchmarks.ipopt_peer import ipopt_options
from tests.benchmarks.stages import stages


class OptiSolver:
    """Solver of `HorizonProblem` by ipopt to `tolerance`; a local optimum, as it depends on the guess."""

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
        self._warm, self._multipliers = warm_start, None
        self._opti = opti = cs.Opti()
        self._states = states = opti.variable(made.scale.size, n + 1)
        self._controls = controls = opti.variable(1, n)
        self._slack = slack = opti.variable(axles, n)
        self._start = opti.parameter(made.scale.size)
        self._constants = opti.parameter(made.step.numel_in(2))
        self._limit, self._target, self._upper = (opti.parameter(k) for k in (axles, 1, 1))
        each = cs.repmat(self._constants, 1, n)
        opti.subject_to(states[:, 0] == self._start)
        opti.subject_to(states[:, 1:] == made.step.map(n)(states[:, :-1], controls, each))
        excess = made.excess.map(n)(states[:, 1:], cs.repmat(self._limit, 1, n))
        opti.subject_to(cs.vec(slack - excess) >= 0)
        opti.subject_to(cs.vec(slack) >= 0)
        opti.subject_to(opti.bounded(0, controls.T, cs.repmat(self._upper, n, 1)))
        opti.minimize(
            w.tracking * cs.sumsqr(controls - self._target)
            + w.rate * cs.sumsqr(controls - states[-1, :-1])
            + w.slip / axles * cs.sumsqr(slack)
        )
        opti.solver("ipopt", ipopt_options(tolerance, warm_start) | {"expand": True})

    def forget(self) -> None:
        """Start the next solve without multipliers."""
        self._multipliers = None

    def solve(self, problem: HorizonProblem, guess: np.ndarray | None = None) -> HorizonSolution:
        """Solve from `guess` (horizon,) [N m], by default the target cut to the bounds.

        With `warm_start` the multipliers of the last solution are taken up too. A failure is in the status.
        """
        opti, made, scale = self._opti, self._stages, self._stages.torque_scale
        torques = np.full(self._controls.numel(), problem.target) if guess is None else guess
        controls = np.clip(torques, 0.0, problem.upper) / scale
        start, trajectory = made.start(problem), made.rollout(problem, controls)
        excess = [
            np.asarray(made.excess(state, problem.slip_limit)).ravel() for state in trajectory
        ]
        opti.set_value(self._start, start)
        opti.set_value(self._constants, problem.parameters)
        opti.set_value(self._limit, problem.slip_limit)
        opti.set_value(self._target, problem.target / scale)
        opti.set_value(self._upper, problem.upper / scale)
        opti.set_initial(self._states, np.column_stack([start, *trajectory]))
        opti.set_initial(self._controls, controls)
        opti.set_initial(self._slack, np.maximum(excess, 0.0).T)
        opti.set_initial(opti.lam_g, 0.0 if self._multipliers is None else self._multipliers)
        try:
            opti.solve()
            status = "ok"
        except RuntimeError:  # it says the same in many words
            status = str(opti.return_status())
        if self._warm:
            self._multipliers = opti.debug.value(opti.lam_g)
        stats, found = opti.stats(), np.ravel(opti.debug.value(self._controls))
        return HorizonSolution(
            torques=np.clip(found * scale, 0.0, problem.upper),
            cost=float(opti.debug.value(opti.f)),
            residual=float(stats["iterations"]["inf_du"][-1]),
            iterations=int(stats["iter_count"]),
            status=status,
        )
