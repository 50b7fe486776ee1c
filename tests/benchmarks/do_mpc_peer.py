"""The optimal control problem given to do-mpc, which solves it to convergence by ipopt.

Fiedler, Karg, Lueken, Brandner, Heinlein, Brabender, Lucia: do-mpc: Towards FAIR nonlinear and robust model predictive
control, Control Engineering Practice 140 (2023) 105676. It comes with the extra `bench` of this project.

The penalty of slip stands in the cost, without a slack: do-mpc's own soft constraints cost in proportion to the excess, not
to its square. The slip at the horizon's begin counts too, which no torque changes. A peer in tests and benchmarks.
"""

import warnings
from typing import Any

import casadi as cs
import numpy as np

from alloc.onboard.host import UnitContext
from mpc.period import HorizonProblem, HorizonSolution
from mpc.settings import MpcSettings
from tests.benchmarks.stages import Stages, stages

OPTIONS: dict[str, Any] = {
    "print_time": False, "error_on_fail": False, "ipopt.print_level": 0, "ipopt.sb": "yes",
    "ipopt.bound_relax_factor": 0.0, "ipopt.max_iter": 500,
}  # fmt: skip


def ipopt_options(tolerance: float, warm_start: bool) -> dict[str, Any]:
    """Options of CasADi's nlpsol; `warm_start`: for guesses and multipliers that are near the solution."""
    # no early end at a looser tolerance
    options = OPTIONS | {"ipopt.tol": tolerance, "ipopt.acceptable_tol": tolerance}
    if warm_start:
        options |= {"ipopt.warm_start_init_point": "yes", "ipopt.mu_init": 1e-6}
    return options


def _model(do_mpc: Any, made: Stages, axles: int) -> Any:
    """A step of the unit, as do-mpc takes it."""
    model = do_mpc.model.Model("discrete", "SX")
    state = model.set_variable("_x", "state", (made.scale.size, 1))
    torque = model.set_variable("_u", "torque")
    constants = model.set_variable("_p", "constants", (made.step.numel_in(2), 1))
    model.set_variable("_p", "limit", (axles, 1))
    model.set_variable("_p", "target")
    model.set_rhs("state", made.step(state, torque, constants))
    model.setup()
    return model


class DoMpcSolver:
    """Solver of `HorizonProblem` by do-mpc to `tolerance`; a local optimum, as it depends on the guess.

    Raises `ImportError` where do-mpc is not installed.
    """

    def __init__(
        self,
        context: UnitContext,
        settings: MpcSettings,
        *,
        tolerance: float = 1e-9,
        warm_start: bool = False,
    ) -> None:
        self._stages = made = stages(context, settings)
        self._horizon, self._warm = settings.horizon, warm_start
        with warnings.catch_warnings():
            # of optional parts that are not there, and of CasADi's ways with NumPy
            warnings.simplefilter("ignore")
            import do_mpc

            self._controller = do_mpc.controller.MPC(_model(do_mpc, made, context.axles))
            self._given = self._set_up(settings, ipopt_options(tolerance, warm_start))

    def _set_up(self, settings: MpcSettings, options: dict[str, Any]) -> Any:
        """Write down the problem; returns where the parameters of a period are to be put."""
        mpc, made, w = self._controller, self._stages, settings.weights
        x, torque, p = mpc.model.x["state"], mpc.model.u["torque"], mpc.model.p
        mpc.settings.n_horizon, mpc.settings.t_step = settings.horizon, settings.step
        mpc.settings.store_lagr_multiplier, mpc.settings.store_solver_stats = False, []
        mpc.settings.nlpsol_opts = options
        excess = cs.fmax(made.excess(x, p["limit"]), 0.0)
        slip = w.slip / excess.numel() * cs.sumsqr(excess)
        tracking, rate = w.tracking * (torque - p["target"]) ** 2, w.rate * (torque - x[-1]) ** 2
        mpc.set_objective(mterm=slip, lterm=tracking + rate + slip)
        mpc.set_rterm(torque=0.0)  # the last torque is a state
        mpc.bounds["lower", "_u", "torque"] = 0.0
        given = mpc.get_p_template(1)
        mpc.set_p_fun(lambda _: given)
        mpc.setup()
        mpc.flags["set_initial_guess"] = True  # every solve has its own
        return given

    def forget(self) -> None:
        """Start the next solve without multipliers, and forget the record of the last ones."""
        self._controller.reset_history()
        self._controller.flags["initial_run"] = False

    def solve(self, problem: HorizonProblem, guess: np.ndarray | None = None) -> HorizonSolution:
        """Solve from `guess` (horizon,) [N m], by default the target cut to the bounds.

        With `warm_start` the multipliers of the last solution are taken up too. A failure is in the status; the cost is not
        told (nan).
        """
        mpc, made, scale = self._controller, self._stages, self._stages.torque_scale
        if not self._warm:
            self.forget()
        torques = np.full(self._horizon, problem.target) if guess is None else guess
        controls = np.clip(torques, 0.0, problem.upper) / scale
        start, trajectory = made.start(problem), made.rollout(problem, controls)
        self._given["_p", 0, "constants"] = problem.parameters
        self._given["_p", 0, "limit"] = problem.slip_limit
        self._given["_p", 0, "target"] = problem.target / scale
        guessed, most = mpc.opt_x_num, mpc.ub_opt_x
        guessed["_x", 0, 0, 0] = start
        for k, (control, state) in enumerate(zip(controls, trajectory, strict=True)):
            guessed["_x", k + 1, 0, 0] = state
            guessed["_u", k, 0, "torque"] = control
            most["_u", k, 0, "torque"] = problem.upper / scale
        mpc.make_step(start)
        stats = mpc.solver_stats
        found = np.array([float(mpc.opt_x_num["_u", k, 0, "torque"]) for k in range(self._horizon)])
        return HorizonSolution(
            torques=np.clip(found * scale, 0.0, problem.upper),
            cost=float("nan"),
            residual=float(stats["iterations"]["inf_du"][-1]),
            iterations=int(stats["iter_count"]),
            status="ok" if stats["success"] else str(stats["return_status"]),
        )
