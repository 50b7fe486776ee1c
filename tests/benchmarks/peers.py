"""Peers of the MPC's solver: the horizon's problem as other packages take it, alone and in the real-time iteration's place.

- the iteration's loop in Python, its quadratic programs solved by DAQP (Arnstroem, Bemporad, Axehall: A dual active-set
  solver for embedded quadratic programming, IEEE Trans. Automatic Control 67 (2022) 4362-4369) or by any of `qpsolvers`
  (Caron et al., github.com/qpsolvers/qpsolvers), with default settings, as who tries them in the loop's place would have;
- do-mpc, which solves the problem to convergence by ipopt (Fiedler, Karg, Lueken, Brandner, Heinlein, Brabender, Lucia:
  do-mpc: Towards FAIR nonlinear and robust model predictive control, Control Engineering Practice 140 (2023) 105676); it
  comes with the extra `bench`. The penalty of slip stands in the cost, without a slack: its own soft constraints cost in
  proportion to the excess, not to its square. The slip at the horizon's begin counts too, which no torque changes;
- a step of acados' real-time iteration per call (Verschueren, Frison, Kouzoupis, Frey, van Duijkeren, Zanelli, Novoselnik,
  Albin, Quirynen, Diehl: acados: a modular open-source framework for fast embedded optimal control, Math. Prog. Comp. 14
  (2022) 147-183); `acados_template` does not come with this project, see docs.acados.org.

Stage by stage the last torque joins the state, so that its change is the business of one stage, and everything is divided by
its scale, so that a tolerance means the same for every unknown. The problem itself is that of `mpc.condensing`.
"""

import shutil
import tempfile
import warnings
import weakref
from collections.abc import Callable
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from typing import Any, NamedTuple

import casadi as cs
import daqp
import numpy as np
import qpsolvers
from scipy.sparse import csc_matrix

from alloc.onboard.host import UnitContext
from alloc.plant.model import Floats
from alloc.records import ByReference
from mpc.box_qp import box_workspace, solve_box_qp
from mpc.condensing import condense, simulate, trajectory_cost
from mpc.model import UnitModel, slip_matrix, substeps, unit_model
from mpc.period import FAILURES, HorizonProblem, HorizonSolution, RealTimeIteration, cost_of
from mpc.settings import MpcSettings
from mpc.solver import HALVINGS, NO_SOLUTION, NOT_FINITE, linearise_at
from mpc.unit import OptiIteration


def right_side(model: UnitModel) -> cs.Function:
    """CasADi function (state, torque, parameters) -> derivative of the state."""
    return cs.Function("right_side", [model.state, model.torque, model.parameters], [model.rate])


def step_function(model: UnitModel, step: float, substeps: int) -> cs.Function:
    """CasADi function (state, torque, parameters) -> state after `step` [s], classical Runge-Kutta."""
    x, u, p = model.state, model.torque, model.parameters
    f, h = right_side(model), step / substeps
    for _ in range(substeps):
        k1 = f(x, u, p)
        k2 = f(x + 0.5 * h * k1, u, p)
        k3 = f(x + 0.5 * h * k2, u, p)
        k4 = f(x + h * k3, u, p)
        x = x + h / 6.0 * (k1 + 2.0 * k2 + 2.0 * k3 + k4)
    return cs.Function("step", [model.state, u, p], [x])


def with_numbers(problem: HorizonProblem) -> HorizonProblem:
    """The problem of one unit with plain numbers, as solvers of one torque take it."""
    target, before, upper, reference = (
        float(np.ravel(value)[0])
        for value in (problem.target, problem.before, problem.upper, problem.reference)
    )
    return problem._replace(target=target, before=before, upper=upper, reference=reference)


class Stages(NamedTuple):
    """Functions of one stage. State (axles + 3,): the model's and the last torque; control: torque; all scaled."""

    step: cs.Function
    """(state, control, parameters of the model) -> next state."""
    excess: cs.Function
    """(state, slip limit (axles,)) -> excess of each axle's slip, (axles,); its positive part is penalised."""
    scale: Floats
    """Scales of the state, (axles + 3,)."""
    torque_scale: float
    """[N m]"""

    def start(self, problem: HorizonProblem) -> Floats:
        """Scaled state at the beginning of the horizon, (axles + 3,)."""
        return np.append(problem.state, problem.before) / self.scale

    def rollout(self, problem: HorizonProblem, controls: Floats) -> Floats:
        """Scaled states after each of the scaled `controls` (horizon,): (horizon, axles + 3)."""
        states, state = [], self.start(problem)
        for control in controls:
            state = np.asarray(self.step(state, control, problem.parameters)).ravel()
            states.append(state)
        return np.array(states)


def stages(context: UnitContext, settings: MpcSettings) -> Stages:
    """Stage functions of the unit of `context`."""
    model = unit_model(context)
    torque_scale = float(cost_of(context, settings).unit.scale[0])
    scale = np.array([1.0, *[1.0 / context.radius] * context.axles, torque_scale, torque_scale])
    state, control = cs.SX.sym("state", model.states + 1), cs.SX.sym("control")
    limit = cs.SX.sym("limit", context.axles)
    physical = (cs.DM(scale) * state)[: model.states]
    step = step_function(model, settings.step, substeps(context, settings.step))
    end = step(physical, torque_scale * control, model.parameters)
    ahead = cs.vertcat(end / cs.DM(scale[:-1]), control)
    slip = cs.DM(slip_matrix(context)) @ physical
    return Stages(
        step=cs.Function("stage", [state, control, model.parameters], [ahead]),
        excess=cs.Function(
            "excess", [state, limit], [(slip - limit) / settings.weights.slip_scale]
        ),
        scale=scale,
        torque_scale=torque_scale,
    )


class PythonIteration(RealTimeIteration):
    """A `RealTimeIteration` whose `solve` is written with NumPy; a subclass solves the quadratic program."""

    def __init__(self, units, settings, evenness=0.0):
        super().__init__(units, settings, evenness)
        made = self.period
        self._parts = [ByReference(part) for part in (made.around, made.terms, made.quadratic)]

    def program(self, hessian, gradient, lower, upper):
        """Step of the scaled torques that minimises the quadratic model within the bounds, (n,); None if there is none."""
        raise NotImplementedError

    def solve(self, problem):
        """As the compiled one."""
        self.take(problem)
        made, settings = self.period, self._settings
        around, terms, quadratic = self._parts
        upper, scale = made.now.upper, made.guess.scale
        self.torques[:] = np.clip(self.torques, 0.0, upper)
        cost, residual, done = np.nan, np.inf, 0
        while done < self.most:
            linearise_at(self.torques, self._period)
            condense(around, self.torques, terms, quadratic)
            cost = trajectory_cost(made.around.nodes, self.torques, terms)
            scaled = self.torques / scale
            projected = np.clip(scaled - made.quadratic.gradient, 0.0, upper / scale)
            residual = float(np.abs(projected - scaled).max())
            if not np.isfinite([cost, residual]).all():
                return self._answer(cost, residual, done, FAILURES[NOT_FINITE])
            near = residual <= settings.tolerance
            if near and done > 0:
                break
            done += 1
            bounds = -scaled, (upper - self.torques) / scale
            step = self.program(made.quadratic.hessian, made.quadratic.gradient, *bounds)
            if step is None:
                return self._answer(cost, residual, done, FAILURES[NO_SOLUTION])
            trial = np.clip(self.torques + scale * step, 0.0, upper)
            if not self._better(problem, trial, cost) or near:
                break
        return self._answer(cost, residual, done, "ok")

    def _answer(self, *found):
        return HorizonSolution(self.torques.copy(), *found)

    def _better(self, problem, trial, cost):
        """Take the trial torques, halving the step while the cost rises; False if no step lowers it."""
        made, terms = self.period, self._parts[1]
        for _ in range(HALVINGS + 1):
            made.guess.nodes[0] = problem.state
            simulate(
                self._model.slope, trial, made.now.constants, made.rules.step / made.now.substeps[0],
                int(made.now.substeps[0]), made.guess.nodes, made.guess.scratch,
            )  # fmt: skip
            if trajectory_cost(made.guess.nodes, trial, terms) <= cost:
                self.torques[:] = trial
                return True
            trial = 0.5 * (trial + self.torques)
        return False


PRIMAL_TOLERANCE = 1e-12


"""Violation of a bound that DAQP leaves, in scaled torques."""


class DaqpIteration(PythonIteration):
    """The iteration with DAQP's own interface, set up once."""

    def __init__(self, units, settings, evenness=0.0):
        super().__init__(units, settings, evenness)
        n = self.torques.size
        self._daqp = daqp.Model()
        self._daqp.setup(
            np.eye(n), np.zeros(n), np.zeros((0, n)), np.ones(n), -np.ones(n), np.zeros(n, dtype=np.int32),
        )  # fmt: skip
        self._daqp.settings = {**self._daqp.settings, "primal_tol": PRIMAL_TOLERANCE}

    def program(self, hessian, gradient, lower, upper):
        """As any."""
        changed = self._daqp.update(H=hessian, f=gradient, bupper=upper, blower=lower)
        step, _, flag, _ = self._daqp.solve()
        assert min(changed, flag) >= 0
        return step


class Solved(NamedTuple):
    """A quadratic program in scaled torques, and what a solver took for its solution."""

    hessian: Floats
    gradient: Floats
    lower: Floats
    upper: Floats
    step: Floats

    @property
    def error(self) -> float:
        """Greatest difference of a torque from the own solver's, over the torque scale."""
        exact = np.zeros(self.step.size)
        work = ByReference(box_workspace(exact.size))
        steps = solve_box_qp(self.hessian, self.gradient, self.lower, self.upper, exact, work)
        return float(np.abs(self.step - exact).max()) if steps >= 0 else np.nan


class QpsolversIteration(PythonIteration):
    """The iteration with the solver called `name` in `qpsolvers`; a program that it does not solve is a failure."""

    def __init__(self, units, settings, evenness=0.0, *, name):
        super().__init__(units, settings, evenness)
        if name not in qpsolvers.available_solvers:
            raise ImportError(
                f"QP solver {name!r} is not installed; there are {', '.join(solver_names())}"
            )
        self._name = name
        self._matrix = np.array if name in qpsolvers.dense_solvers else csc_matrix
        self.solved = []
        """Programs with their answers."""

    def program(self, hessian, gradient, lower, upper):
        """As any."""
        problem = qpsolvers.Problem(self._matrix(hessian), gradient.copy(), lb=lower, ub=upper)
        try:
            with warnings.catch_warnings():
                # qpsolvers asks OSQP in a way that will change
                warnings.simplefilter("ignore", PendingDeprecationWarning)
                solution = qpsolvers.solve_problem(problem, solver=self._name)
        except qpsolvers.QPError:
            return None
        step = solution.x
        if not solution.found or step is None or not np.isfinite(step).all():
            return None
        self.solved.append(Solved(hessian.copy(), gradient.copy(), lower, upper, step))
        return step


def solver_names() -> list[str]:
    """Names of the solvers that are installed."""
    return sorted(qpsolvers.available_solvers)


def iterations() -> dict[str, Callable[..., RealTimeIteration]]:
    """The iteration with each solver that is installed, by the solver's name."""
    return {name: partial(QpsolversIteration, name=name) for name in solver_names()}


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


TOLERANCE = 1e-8


class FatropIteration(OptiIteration):
    """The problem of `mpc.reference`, by fatrop."""

    solver = "fatrop"


class DoMpcIteration(RealTimeIteration):
    """A `RealTimeIteration` whose `solve` is do-mpc's, with the multipliers of its last solution."""

    def __init__(self, units, settings):
        super().__init__(units, settings)
        self._peer = DoMpcSolver(units, settings, tolerance=TOLERANCE, warm_start=True)

    def restart(self, torque):
        super().restart(torque)
        self._peer.forget()

    def solve(self, problem):
        solution = self._peer.solve(with_numbers(problem), self.torques)
        self.torques[:] = solution.torques
        return solution


CONVERGING: dict[str, Callable[..., RealTimeIteration]] = {
    "Opti with ipopt": OptiIteration,
    "do-mpc with ipopt": DoMpcIteration,
    "fatrop": FatropIteration,
}


"""What makes the iteration of a converging solver, by name: (units, settings) -> iteration."""


PEERS = CONVERGING | {"acados SQP_RTI": AcadosIteration}


NEEDED = {
    "do-mpc with ipopt": ("do_mpc", "do-mpc is not installed: pip install -c constraints.txt -e '.[bench]'"),
    "acados SQP_RTI": ("acados_template", "acados is not installed: see docs.acados.org"),
}  # fmt: skip


"""Package that a peer needs beside this project's, and what to say where it is not there."""


def missing(name: str) -> str:
    """Why the peer called `name` cannot be run here; empty where it can."""
    package, reason = NEEDED.get(name, ("", ""))
    return reason if package and find_spec(package) is None else ""
