"""The optimal control problem given to do-mpc, which solves it to convergence by ipopt.

Fiedler, Karg, Lueken, Brandner, Heinlein, Brabender, Lucia: do-mpc: Towards FAIR nonlinear and robust model predictive
control, Control Engineering Practice 140 (2023) 105676. It comes with the extra `bench` of this project. Its own soft
constraints cost in proportion to the excess; here the excess is a further input, whose square is the cost. Never used in the loop.
"""

import warnings
from typing import Any

import casadi as cs
import numpy as np

from alloc.onboard.host import UnitContext
from mpc.horizon import HorizonProblem, HorizonSolution
from mpc.settings import MpcSettings
from tests.benchmarks.ipopt_peer import ipopt_options
from tests.benchmarks.stages import Stages, stages


def load_do_mpc() -> Any:
    """The package; raises `ImportError` where it is not installed."""
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # it warns of each optional part that is not there
        import do_mpc
    return do_mpc


def _model(do_mpc: Any, made: Stages, axles: int) -> Any:
    """A step of the unit; inputs are the torque and the excesses of slip at its end."""
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
        do_mpc, w = load_do_mpc(), settings.weights
        self._stages = made = stages(context, settings)
        self._horizon, self._warm = settings.horizon, warm_start
        model = _model(do_mpc, made, context.axles)
        x, u, p = model.x["state"], model.u, model.p
        self._controller = mpc = do_mpc.controller.MPC(model)
        mpc.settings.n_horizon, mpc.settings.t_step = settings.horizon, settings.step
        mpc.settings.store_lagr_multiplier, mpc.settings.store_solver_stats = False, []
        mpc.settings.nlpsol_opts = ipopt_options(tolerance, warm_start)
        excess = cs.fmax(made.excess(x, p["limit"]), 0.0)
        slip = w.slip / context.axles * cs.sumsqr(excess)
        cost = w.tracking * (u["torque"] - p["target"]) ** 2 + w.rate * (u["torque"] - x[-1]) ** 2
        mpc.set_objective(mterm=slip, lterm=cost + slip)
        mpc.set_rterm(torque=0.0)  # the last torque is a state
        mpc.bounds["lower", "_u", "torque"] = 0.0
        self._given = mpc.get_p_template(1)
        mpc.set_p_fun(lambda _: self._given)
        mpc.setup()

    def forget(self) -> None:
        """Start the next solve without multipliers, and forget the record of the last ones."""
        self._controller.reset_history()
        self._controller.flags["initial_run"] = False

    def solve(self, problem: HorizonProblem, guess: np.ndarray | None = None) -> HorizonSolution:
        """Solve from `guess` (horizon,) [N m], by default the target cut to the bounds.

        With `warm_start` the multipliers of the last solution are taken up too. A failure is in the status.
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
        mpc.flags["set_initial_guess"] = True
        mpc.make_step(start)
        stats = mpc.solver_stats
        found = np.array([float(mpc.opt_x_num["_u", k, 0, "torque"]) for k in range(self._horizon)])
        return HorizonSolution(
            torques=np.clip(found * scale, 0.0, problem.upper),
            cost=float(mpc.S.get_stats["f"]) if False else float("nan"),
            residual=float(stats["iterations"]["inf_du"][-1]),
            iterations=int(stats["iter_count"]),
            status="ok" if stats["success"] else str(stats["return_status"]),
        )
