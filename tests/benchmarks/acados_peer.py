"""One step of acados' real-time iteration per call: the peer in plain C, where acados is installed.

Verschueren, Frison, Kouzoupis, Frey, van Duijkeren, Zanelli, Novoselnik, Albin, Quirynen, Diehl: acados: a modular
open-source framework for fast embedded optimal control, Math. Prog. Comp. 14 (2022) 147-183. `acados_template` does not
come with this project; see docs.acados.org for how to install it. Never used in the loop.
"""

import shutil
import tempfile
import warnings
import weakref
from pathlib import Path
from typing import Any

import casadi as cs
import numpy as np

from alloc.onboard.host import UnitContext
from mpc.period import HorizonProblem, HorizonSolution, RealTimeIteration
from mpc.settings import MpcSettings
from tests.benchmarks.stages import Stages, stages, with_numbers

UNBOUNDED = 1e9
"""What acados takes for no bound."""


def _description(template: Any, made: Stages, settings: MpcSettings, axles: int) -> Any:
    """acados' description of the horizon's problem; a step counts as one unit of time, so that costs are sums."""
    n, w = settings.horizon, settings.weights
    size, constants = made.scale.size, made.step.numel_in(2)
    state, control = cs.SX.sym("state", size), cs.SX.sym("control")
    parameters = cs.SX.sym("parameters", constants + axles)
    ocp = template.AcadosOcp()
    ocp.model.name = f"unit_{axles}"
    ocp.model.x, ocp.model.u, ocp.model.p = state, control, parameters
    ocp.model.disc_dyn_expr = made.step(state, control, parameters[:constants])
    excess = made.excess(state, parameters[constants:])
    ocp.model.con_h_expr = ocp.model.con_h_expr_e = excess
    ocp.parameter_values = np.ones(constants + axles)
    # half the sum of weighted squares of (torque - target, torque - last torque)
    ocp.cost.cost_type, ocp.cost.cost_type_e = "LINEAR_LS", "LINEAR_LS"
    ocp.cost.W = 2.0 * np.diag([w.tracking, w.rate])
    ocp.cost.Vu, ocp.cost.Vx = np.ones((2, 1)), np.zeros((2, size))
    ocp.cost.Vx[1, -1] = -1.0
    ocp.cost.yref = np.zeros(2)
    ocp.cost.W_e, ocp.cost.Vx_e, ocp.cost.yref_e = (
        np.zeros((0, 0)),
        np.zeros((0, size)),
        np.zeros(0),
    )
    square, none = np.full(axles, 2.0 * w.slip / axles), np.zeros(axles)
    for end in ("", "_e"):
        setattr(ocp.constraints, "lh" + end, np.full(axles, -UNBOUNDED))
        setattr(ocp.constraints, "uh" + end, none)
        setattr(ocp.constraints, "idxsh" + end, np.arange(axles))
        for name, value in (("Zl", square), ("Zu", square), ("zl", none), ("zu", none)):
            setattr(ocp.cost, name + end, value)
    ocp.constraints.x0 = np.zeros(size)
    ocp.constraints.idxbu = np.array([0])
    ocp.constraints.lbu, ocp.constraints.ubu = np.zeros(1), np.ones(1)
    options = ocp.solver_options
    if hasattr(options, "N_horizon"):
        options.N_horizon = n
    else:  # before acados 0.4
        ocp.dims.N = n
    options.tf = float(n)
    options.integrator_type = "DISCRETE"
    options.nlp_solver_type = "SQP_RTI"
    options.hessian_approx = "GAUSS_NEWTON"
    options.qp_solver = "PARTIAL_CONDENSING_HPIPM"
    options.qp_solver_warm_start = 1
    return ocp


def _built(template: Any, ocp: Any, folder: Path) -> Any:
    """The solver, generated and compiled in this folder."""
    if hasattr(getattr(ocp, "code_gen_options", None), "json_file"):
        ocp.code_gen_options.code_export_directory = str(folder)
        ocp.code_gen_options.json_file = "problem.json"
        return template.AcadosOcpSolver(ocp, verbose=False)
    ocp.code_export_directory = str(folder)  # before acados 0.5.6
    return template.AcadosOcpSolver(ocp, json_file=str(folder / "problem.json"), verbose=False)


class AcadosSolver:
    """Solver of `HorizonProblem` by one Gauss-Newton step of acados per call, from its last solution.

    Raises `ImportError` where `acados_template` is not installed.
    """

    def __init__(self, context: UnitContext, settings: MpcSettings) -> None:
        self._stages = stages(context, settings)
        self._horizon = settings.horizon
        with warnings.catch_warnings():
            # of names of its own that acados calls old and still reads, and of CasADi's that it was not tested with
            warnings.simplefilter("ignore")
            import acados_template as template

            folder = Path(tempfile.mkdtemp(prefix="readhesion-acados-"))
            weakref.finalize(self, shutil.rmtree, folder, ignore_errors=True)
            ocp = _description(template, self._stages, settings, context.axles)
            self._solver = _built(template, ocp, folder)

    def restart(self, problem: HorizonProblem, torque: float) -> None:
        """Forget the guess: hold `torque` [N m] over the horizon, with the states that follow."""
        controls = np.full(self._horizon, torque / self._stages.torque_scale)
        trajectory = self._stages.rollout(problem, controls)
        self._solver.set(0, "x", self._stages.start(problem))
        for k, state in enumerate(trajectory):
            self._solver.set(k, "u", controls[k : k + 1])
            self._solver.set(k + 1, "x", state)

    @property
    def own_time(self) -> float:
        """Time of the last step as acados counts it [s]: without Python's part, that of handing data over."""
        return float(self._solver.get_stats("time_tot"))

    def shift(self) -> None:
        """Move the guess on by one period."""
        for k in range(self._horizon):
            self._solver.set(k, "x", self._solver.get(k + 1, "x"))
            if k < self._horizon - 1:
                self._solver.set(k, "u", self._solver.get(k + 1, "u"))

    def solve(self, problem: HorizonProblem) -> HorizonSolution:
        """Improve the guess by one step. Cost and residual are not told (nan): states are unknowns of their own here.

        They fit the torques at convergence only.
        """
        solver, scale = self._solver, self._stages.torque_scale
        start = self._stages.start(problem)
        parameters = np.concatenate([problem.parameters, problem.slip_limit])
        wanted, most = np.array([problem.target / scale, 0.0]), np.array([problem.upper / scale])
        for k in range(self._horizon):
            solver.set(k, "p", parameters)
            solver.set(k, "yref", wanted)
            solver.constraints_set(k, "ubu", most)
        solver.set(self._horizon, "p", parameters)
        solver.set(0, "lbx", start)
        solver.set(0, "ubx", start)
        flag = solver.solve()
        torques = scale * np.array([solver.get(k, "u")[0] for k in range(self._horizon)])
        return HorizonSolution(
            torques=np.clip(torques, 0.0, problem.upper),
            cost=float("nan"),
            residual=float("nan"),
            iterations=1,
            status="ok" if flag == 0 else f"acados status {flag}",
        )


class AcadosIteration(RealTimeIteration):
    """A `RealTimeIteration` whose `solve` is a step of acados, for the closed loop."""

    def __init__(self, units, settings):
        super().__init__(units, settings)
        self._peer = AcadosSolver(units, settings)
        self._starts = True

    @property
    def own_time(self):
        return self._peer.own_time

    def restart(self, torque):
        super().restart(torque)
        self._starts = True

    def shift(self):
        super().shift()
        if not self._starts:
            self._peer.shift()

    def solve(self, problem):
        one = with_numbers(problem)
        if self._starts:  # only now there is a state to start from
            self._peer.restart(one, float(self.torques[0]))
            self._starts = False
        solution = self._peer.solve(one)
        self.torques[:] = solution.torques
        return solution
