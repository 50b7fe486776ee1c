"""Cost of the plant per axle and step of RK4, one train at a time: ours on several trains, and all ways on one of them.

`make bench` measures; as an ordinary test each way takes a few steps and only its result is checked. Ratios are
compared within one run only, with wide margins: the machine may be busy.
"""

import math
import time

import casadi
import numpy as np
import pytest
from scipy.integrate import solve_ivp

from alloc.plant import compiled
from alloc.plant.array_model import ArrayModel, Local
from alloc.plant.model import Inputs, Model, build
from alloc.plant.rail import Patch, Rail, logarithmic_increments
from alloc.plant.sets import find_set
from tests.benchmarks.jax_peer import advance_with_jax
from tests.plant.numpy_plant import environment_at, right_side, runge_kutta_step

SPEED = 20.0
STATES = 64
"""States that JAX advances side by side."""
STEPS = 20
"""Steps per round; a multiple of them where a way is fast."""
PEER = "high-speed-16car"
"""The train on which all ways are measured."""
STEP = {"one-axle": 5e-5, "freight-17": 5e-4}
"""Step of each train [s], where it is not the usual one."""


def _step(name: str) -> float:
    return STEP.get(name, 1e-3)


def _model(name: str) -> Model:
    train = find_set(name)
    rail = Rail(
        0.9, "shinkansen", patches=(Patch(0.6, start=-40.0),), scatter=0.012, seed=3,
        increments=tuple(logarithmic_increments(train.axle_count)),
    )  # fmt: skip
    model = build(train, rail)
    assert model.substeps(_step(name)) == 1, "such a step is too long"
    return model


def _inputs(model: Model) -> Inputs:
    inputs = model.zero_inputs()
    inputs.torque_command[:] = np.linspace(300.0, 900.0, model.layout.units)
    return inputs


def _start(model: Model, slip: float = 0.0):
    """The train at `SPEED`; every second wheel turns faster by the share `slip`."""
    state = model.initial_state(SPEED)
    state[model.layout.omega][::2] *= 1.0 + slip
    return state


def _compiled(name: str, slip: float = 0.0):
    model, step = _model(name), _step(name)
    inputs, w, start = _inputs(model), compiled.workspace(model, step), _start(model, slip)

    def advance(steps):
        state = start.copy()
        compiled.advance(w, 0.0, step, steps, state, inputs)
        return state

    return advance


def _numpy(name: str, slip: float = 0.0):
    model, step = _model(name), _step(name)
    rate, start = right_side(model, _inputs(model)), _start(model, slip)

    def advance(steps):
        state = start
        for k in range(steps):
            state = runge_kutta_step(rate, k * step, step, state)
        return state

    return advance


def _scipy():
    model = _model(PEER)
    rate, start = right_side(model, _inputs(model)), _start(model)

    def advance(steps):
        end = steps * _step(PEER)
        tolerances = {"rtol": 1e-6, "atol": 1e-6, "max_step": 3.0 * _step(PEER)}
        solution = solve_ivp(rate, (0.0, end), start, **tolerances)
        assert solution.success
        return solution.y[:, -1]

    return advance


def _casadi_rate():
    """Symbols and right side in SX, environment held at its starting values (CasADi has no field of the rail)."""
    model = _model(PEER)
    state, start = casadi.SX.sym("state", model.layout.rows), _start(model)
    inputs = Inputs(*map(casadi.DM, _inputs(model)))
    held = Local(*map(casadi.DM, environment_at(model, 0.0, start)))
    return state, ArrayModel.of(model).derivative(state, inputs, held), start


def _casadi_function():
    state, slope, start = _casadi_rate()
    rate = casadi.Function("rate", [state], [slope])
    x = casadi.SX.sym("x", state.numel())
    ahead = runge_kutta_step(lambda _, value: rate(value), 0.0, _step(PEER), x)
    step = casadi.Function("step", [x], [ahead])

    def advance(steps):
        value = start
        for _ in range(steps):
            value = step(value)
        return np.asarray(value).ravel()

    return advance


def _cvodes():
    state, slope, start = _casadi_rate()
    problem = {"x": state, "ode": slope}

    def advance(steps):
        options = {"abstol": 1e-6, "reltol": 1e-6}
        solver = casadi.integrator("solver", "cvodes", problem, 0.0, steps * _step(PEER), options)
        began = time.perf_counter()
        end = np.asarray(solver(x0=start)["xf"]).ravel()
        # without setting the solver up, the least of all rounds
        advance.seconds = min(advance.seconds, time.perf_counter() - began)
        return end

    advance.seconds = math.inf
    return advance


def _jax(states: int):
    pytest.importorskip("jax")
    model = _model(PEER)
    start = _start(model)
    if states > 1:
        start = np.tile(start, (states, 1))
    advance = advance_with_jax(model, _inputs(model), _step(PEER), start)
    return lambda steps: np.atleast_2d(advance(steps))[-1]


WAYS = {
    "commuter-8car": (lambda: _compiled("commuter-8car"), 20, 1),
    PEER: (lambda: _compiled(PEER), 10, 1),
    "freight-17": (lambda: _compiled("freight-17"), 10, 1),
    "one-axle": (lambda: _compiled("one-axle"), 200, 1),
    f"{PEER} slipping": (lambda: _compiled(PEER, 0.05), 10, 1),
    "numpy": (lambda: _numpy(PEER), 1, 1),
    "solve_ivp": (_scipy, 1, 1),
    "casadi function": (_casadi_function, 1, 1),
    "casadi cvodes": (_cvodes, 1, 1),
    "jax": (lambda: _jax(1), 2, 1),
    f"jax, {STATES} states": (lambda: _jax(STATES), 1, STATES),
}
"""Way, how many times `STEPS` steps one round takes, and its states. Those named by a train are the compiled plant."""


@pytest.fixture(scope="module")
def cost():
    """Nanoseconds per axle, state and step by way, filled in as the benchmarks run."""
    return {}


@pytest.mark.parametrize("way", WAYS)
def test_cost_per_axle_and_step(benchmark, cost, way):
    make, times, states = WAYS[way]
    advance = make()
    name, _, slipping = way.partition(" ")
    name = name if name in WAYS and "-" in name else PEER
    expected = _numpy(name, 0.05 if slipping == "slipping" else 0.0)(STEPS)
    # those with the environment held differ by what it does in 20 ms
    tolerance = 1e-3 if way.startswith("casadi") else 1e-6
    rolling = slice(0, _model(name).layout.omega.stop)
    np.testing.assert_allclose(advance(STEPS)[rolling], expected[rolling], rtol=tolerance)
    if not benchmark.enabled:
        benchmark(lambda: None)
        return
    steps = STEPS * times
    benchmark.pedantic(advance, args=(steps,), rounds=25, warmup_rounds=1)
    # short rounds and the least of many: least disturbed by other processes
    seconds = getattr(advance, "seconds", benchmark.stats.stats.min)
    cost[way] = seconds / (steps * states * find_set(name).axle_count) * 1e9
    benchmark.extra_info["ns per axle-step"] = round(cost[way], 1)


def test_ratios(benchmark, cost):
    """Wide margins; the numbers themselves are in each benchmark's extra info."""
    benchmark(lambda: None)
    if len(cost) < len([way for way in WAYS if "jax" not in way]):
        pytest.skip("needs the costs of the whole module: run with --benchmark-enable")
    benchmark.extra_info.update({way: round(value, 1) for way, value in cost.items()})
    assert cost["numpy"] > 5.0 * cost[PEER]
    assert cost["solve_ivp"] > 5.0 * cost[PEER]
    assert cost["casadi cvodes"] > 5.0 * cost[PEER]
    assert cost["casadi function"] > 2.0 * cost[PEER]  # without the rail's field at that
    for way in ("jax", f"jax, {STATES} states"):
        assert cost.get(way, math.inf) > 2.0 * cost[PEER]
