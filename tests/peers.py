"""What peers take over what this project takes, in CPU time: integrators of the plant, solvers of the MPC's problem.

    python tests/peers.py        make peers

Peers that are missing are left out: jax, diffrax, qpmpc, do-mpc do not come with the project. Each has a process, where it
and this project are called in turn. Stored as docs/tables/peers-table.md. QP solvers are a study: readhesion sweep solvers.
"""

import inspect
import os
import signal
import subprocess
import sys
import time
import warnings
from importlib import import_module
from pathlib import Path
from types import FunctionType, SimpleNamespace
from typing import Any

import numba
import numpy as np
import pandas as pd

from alloc import backends, laws
from alloc.plant.dynamics import advance_period, state_places
from alloc.run.simulation import ADVANCE, Simulation
from mpc.plan import line_dynamics, plan_torques
from mpc.problem import BELIEVED, SLIP, Problem, solve, torque_scale
from mpc.unit import MPC
from studies.files.scenario_files import load_scenario
from studies.runner.rows import markdown_table

TABLE = Path(__file__).parents[1] / "docs" / "tables" / "peers-table.md"
ROUNDS, PATIENCE = 7, 120
"""Calls in turn; seconds after which a peer is given up."""
SPAN, STEP, ERROR, TRAINS = 10.0, 2.5e-3, 1e-6, 32
"""Time [s] that is integrated; step [s], or tolerance; trains at once."""
os.environ["XLA_FLAGS"] = "--xla_cpu_multi_thread_eigen=false intra_op_parallelism_threads=1"

# the plant: eight rigid cars under constant torques; peers have no map of motors, no works, no pressures


def start_plant() -> tuple[Any, Any, Any]:
    """World of a train on wet rail, the peers' state, and this project's whole plant over `SPAN`."""
    run = Simulation(load_scenario("wet-start").event(0), "alone", "perturb-observe")
    for _ in range(300):
        run.run_to(ADVANCE)
    w, commands = run.world, run.recording.cylinders
    _, omega, _, pressure, _ = state_places(w.wheelsets, w.cars, w.drives, w.cylinders, w.plant[0])
    begin, arrays = w.state.copy(), (*w[2:6], w.patches, w.line, *w[9:14])

    @numba.njit(error_model="numpy")
    def advance(state, stages, arrays, plant):
        for _ in range(round(SPAN / plant.period)):
            advance_period(3.0, state, stages, *arrays, plant, commands)

    def call() -> None:
        w.state[:] = begin
        advance(w.state, w.stages, arrays, w.plant[0])

    return w, np.concatenate([begin[1:2], begin[omega:pressure]]), call


def make_rate(w: Any, law: Any, join: Any, total: Any, unit: Any) -> Any:
    """Rates of speed, angular speeds and torques, in any language of arrays."""
    a, n, mass, lag = w.wheelsets, w.wheelsets.size, w.plant[0].body_mass, w.drives.lag + 0.0
    curve, offset, command = tuple(w.curve[:5]), w.plant[0].law_offset, w.drives.applied + 0.0
    numerator, constant = a.law_numerator + 0.0, a.law_constant + a.increment
    radius, load, inertia, gear = a.radius + 0.0, a.static_load + 0.0, a.inertia + 0.0, a.gear + 0.0
    names = "resistance", "resistance_linear", "resistance_quadratic"
    drag = tuple(float(w.cars[name].sum()) for name in names)
    speed_law, coefficient, resistance = law.speed_law, law.piecewise_coefficient, law.resistance

    def rate(t, y):
        speed, omega, torque = y[0], y[1 : 1 + n], y[1 + n :]
        offered = speed_law(speed, numerator, offset, constant)
        force = load * coefficient(radius * omega - speed, offered, *curve)
        turning = (gear * torque[unit] - radius * force) / inertia
        pull = total(force) - resistance(speed, *drag)
        return join((pull / mass, turning, (command - torque) / lag))

    return rate


def laws_of(finish: Any, **operations: Any) -> Any:
    """The text of the laws with the operations of another language of arrays."""
    scope: dict[str, Any] = {"__name__": laws.__name__}
    exec(inspect.getsource(laws), scope)
    scope |= operations
    own = {name: law for name, law in scope.items() if isinstance(law, FunctionType)}
    scope |= {name: finish(law) for name, law in own.items() if law.__module__ == laws.__name__}
    return SimpleNamespace(**scope)


def by_scipy(method: str) -> tuple[Any, Any]:
    from scipy.integrate import solve_ivp

    w, begin, ours = start_plant()
    total = numba.njit(lambda x: np.array([np.sum(x)]))
    parts = laws_of(numba.njit), np.concatenate, total, np.maximum(w.wheelsets.unit, 0)
    rate, bounds = numba.njit(make_rate(w, *parts)), {"rtol": ERROR, "atol": ERROR}
    return ours, lambda: solve_ivp(rate, (0.0, SPAN), begin, method, **bounds)


def by_jax(kind: str) -> tuple[Any, Any]:
    jax, jnp = import_module("jax"), import_module("jax.numpy")
    jax.config.update("jax_enable_x64", True)
    names = ("maximum", "minimum", "exp", "sqrt", "copysign", "where")
    law = laws_of(lambda law: law, absolute=jnp.abs, **{key: getattr(jnp, key) for key in names})
    w, begin, ours = start_plant()
    unit, total = np.maximum(w.wheelsets.unit, 0), lambda x: x.sum(keepdims=True)
    rate = make_rate(w, law, jnp.concatenate, total, unit)

    def step(y: Any, _: Any) -> Any:
        a = rate(0.0, y)
        b = rate(0.0, y + 0.5 * STEP * a)
        c = rate(0.0, y + 0.5 * STEP * b)
        return y + STEP / 6.0 * (a + 2.0 * b + 2.0 * c + rate(0.0, y + STEP * c)), None

    def integrate(y: Any) -> Any:
        if kind != "diffrax":
            return jax.lax.scan(step, y, None, round(SPAN / STEP))[0]
        d: Any = import_module("diffrax")
        bounds, term = (
            d.PIDController(rtol=ERROR, atol=ERROR),
            d.ODETerm(lambda t, y, _: rate(t, y)),
        )
        places = {"stepsize_controller": bounds, "max_steps": 10**6}
        return d.diffeqsolve(term, d.Tsit5(), 0.0, SPAN, 1e-3, y, **places).ys[-1]

    several = jnp.tile(begin, (TRAINS, 1)) if kind == "vmap" else jnp.array(begin)
    function = jax.jit(jax.vmap(integrate) if kind == "vmap" else integrate)
    return ours, lambda: function(several).block_until_ready()


def by_casadi(method: str) -> tuple[Any, Any]:
    import casadi as cs

    w, begin, ours = start_plant()
    unit, y = np.maximum(w.wheelsets.unit, 0).tolist(), cs.SX.sym("y", begin.size)
    rate = make_rate(w, backends.symbolic, lambda x: cs.vertcat(*x), cs.sum1, unit)
    bounds = {"reltol": ERROR, "abstol": ERROR}
    function = cs.integrator("plant", method, {"x": y, "ode": rate(0.0, y)}, 0.0, SPAN, bounds)
    return ours, lambda: function(x0=begin)


# the MPC's problem of one unit, against the twin on board; qpmpc and do-mpc get a smaller one, without a limit of slip


def start_problems() -> tuple[Any, Any]:
    """Rows of units around the peak, and the twin that solves their problems."""
    rng, m = np.random.default_rng(0), MPC.rows(1)[0]
    rows = BELIEVED.rows(20, coefficient=0.12, acceleration=0.5)
    rows.slip, rows.pair_slip = rng.uniform(0.05, 0.15, (2, 20))
    rows.torque = rows.before = torque_scale(rows) * rng.uniform(0.9, 1.3, 20)
    rows.target = rows.upper = 1.5 * torque_scale(rows)
    return rows, lambda: [plan_torques(m, row, 0.01) for row in rows]


def find_model(row: Any) -> tuple[Any, Any]:
    """Slip, torque and 1 a period on: by themselves, and by the command; all over their scales."""
    keep, left, share, reach, offset = line_dynamics(row, 0.01)
    push = reach * torque_scale(row) / SLIP
    onward = np.array([[keep, push * share, offset / SLIP], [0.0, left, 0.0], [0.0, 0.0, 1.0]])
    return onward, np.array([[push * (1.0 - share)], [1.0 - left], [0.0]])


def by_problem(solver: str) -> tuple[Any, Any]:
    rows, ours = start_problems()
    problems = [Problem(rows[k : k + 1]) for k in range(rows.size)]
    return ours, lambda: [solve(problem, solver) for problem in problems]


def by_qpmpc(solver: str) -> tuple[Any, Any]:
    peer = import_module("qpmpc")
    rows, ours = start_problems()
    bounds, goal = (None, np.array([[1.0], [-1.0]]), np.array([1.5, 0.0])), np.zeros(3)
    problems = []
    for row in rows:
        begin = np.array([row.slip / SLIP, row.torque / torque_scale(row), 1.0])
        model = *find_model(row), *bounds, 15, 1e-9, None, 1.0, begin, goal
        problems.append(peer.MPCProblem(*model, target_inputs=np.full(15, 1.5)))
    return ours, lambda: [peer.solve_mpc(problem, solver) for problem in problems]


def by_do_mpc(solver: str) -> tuple[Any, Any]:
    do_mpc = import_module("do_mpc")
    rows, ours = start_problems()
    (onward, into), model = find_model(rows[0]), do_mpc.model.Model("discrete")
    state, command = model.set_variable("_x", "state", (3, 1)), model.set_variable("_u", "command")
    model.set_rhs("state", onward @ state + into * command)
    model.setup()
    control = do_mpc.controller.MPC(model)
    quiet = {"ipopt.print_level": 0, "ipopt.sb": "yes", "print_time": 0}
    control.set_param(n_horizon=15, t_step=0.01, store_full_solution=False, nlpsol_opts=quiet)
    control.set_objective(lterm=(command - 1.5) ** 2, mterm=0 * state[0])
    control.set_rterm(command=0.3)
    control.bounds["lower", "_u", "command"], control.bounds["upper", "_u", "command"] = 0.0, 1.5
    control.setup()
    states = np.array([rows.slip / SLIP, rows.torque / torque_scale(rows), np.ones(rows.size)]).T
    control.x0 = states[0]
    control.set_initial_guess()
    return ours, lambda: [control.make_step(begin) for begin in states]


PLANT, UNIT = "the plant", "the MPC's problem"
PEERS = [
    (PLANT, "JAX, RK4", "jax", by_jax, "one"),
    (PLANT, f"JAX, RK4, {TRAINS} trains at once", "jax", by_jax, "vmap"),
    (PLANT, "diffrax, Tsit5", "diffrax", by_jax, "diffrax"),
    (PLANT, "SciPy RK45, Numba", "scipy", by_scipy, "RK45"),
    (PLANT, "SciPy LSODA, Numba", "scipy", by_scipy, "LSODA"),
    (PLANT, "CasADi, CVODES", "casadi", by_casadi, "cvodes"),
    (UNIT, "CasADi, DAQP", "casadi", by_problem, "daqp"),
    (UNIT, "CasADi, OSQP", "casadi", by_problem, "osqp"),
    (UNIT, "qpmpc, DAQP", "qpmpc", by_qpmpc, "daqp"),
    (UNIT, "do-mpc, ipopt", "do_mpc", by_do_mpc, "ipopt"),
]
"""Problem, peer, its package, and how it is called."""


def compare_calls(number: int) -> None:
    """In a process of its own: print the ratio of least CPU times; an alarm ends a peer that does not end."""
    signal.alarm(PATIENCE)
    warnings.simplefilter("ignore")
    *_, build, choice = PEERS[number]
    calls, least = build(choice), [np.inf, np.inf]
    for k in range(ROUNDS + 1):
        for which, call in enumerate(calls):
            start = time.process_time()
            call()
            if k > 0:  # the first compiles
                least[which] = min(least[which], time.process_time() - start)
    print(least[1] / least[0] / (TRAINS if choice == "vmap" else 1))


def main() -> None:
    lines = []
    for number, (problem, peer, package, *_) in enumerate(PEERS):
        words = [sys.executable, __file__, str(number)]
        result = subprocess.run(words, capture_output=True, text=True)
        text = f"no end in {PATIENCE} s"
        if f"No module named '{package}'" in result.stderr:
            print(f"{peer}: {package} is not installed")
            continue
        if result.returncode != -signal.SIGALRM:
            text = f"{float(result.stdout.split()[-1]):.2g}" if result.stdout else "failed"
        print(problem, peer, text, result.stderr[-200:] if text == "failed" else "", flush=True)
        lines.append((problem, peer, text))
    table = pd.DataFrame(lines, columns=["problem", "peer", "time over ours"])
    TABLE.write_text(markdown_table(table), "utf-8")


if __name__ == "__main__":
    compare_calls(int(sys.argv[1])) if sys.argv[1:] else main()
