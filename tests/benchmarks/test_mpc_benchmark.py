"""Step time of the real-time iteration against warm-started ipopt, on the same problems in the same run.

Only the ratio is checked: both times are taken on the same machine, so it does not depend on how fast that is. Run with
`make bench`.
"""

import time

import numpy as np
import pytest

from alloc.onboard.host import UnitContext
from alloc.plant.adhesion import PiecewiseCurve
from mpc.horizon import HorizonProblem
from mpc.real_time import RealTimeIteration
from mpc.reference import ReferenceSolver
from mpc.settings import MpcSettings
from mpc.unit_model import parameters, substeps, unit_model

SETTINGS = MpcSettings()  # horizon of 20 steps, one torque
LEAST_SPEED_UP = 20.0


@pytest.fixture(scope="module")
def context():
    return UnitContext(
        unit=0, axles=4, radius=0.43, inertia=155.0, gear_ratio=7.07, axle_load=78e3, mass=55e3,
        torque_lag=5e-3, curve=PiecewiseCurve(), period=SETTINGS.step,
    )  # fmt: skip


@pytest.fixture(scope="module")
def problems(context):
    """A second of readhesion: wheels at 0.3 m/s of slip, more torque wanted than the rail carries."""
    model, peak, speed = unit_model(context), np.array([0.118, 0.12, 0.122, 0.125]), 10.0
    constants = parameters(context, peak)
    step = model.step_function(SETTINGS.step, substeps(context, SETTINGS.step))
    state = np.array([speed, *[(speed + 0.3) / context.radius] * 4, 600.0])
    solver, torque, made = RealTimeIteration(context, SETTINGS), 600.0, []
    solver.restart(torque)
    limit = context.curve.limit(peak, speed)[1]
    for _ in range(100):
        made.append(HorizonProblem(state, constants, limit, 900.0, torque, 1000.0))
        solver.shift()
        torque = float(solver.solve(made[-1]).torques[0])
        state = np.asarray(step(state, torque, constants)).ravel()
    return made


def _times(solve, problems, repeats=1):
    taken = []
    for _ in range(repeats):
        for problem in problems:
            started = time.perf_counter()
            solution = solve(problem)
            taken.append(time.perf_counter() - started)
            assert solution.status == "ok"
    return np.array(taken) * 1e3


@pytest.mark.parametrize("exact", [False, True], ids=["Gauss-Newton", "exact-Hessian"])
def test_real_time_iteration_against_warm_ipopt(benchmark, context, problems, exact):
    solver = RealTimeIteration(context, MpcSettings(exact_hessian=exact, iterations=1))  # per step

    def step(problem):
        solver.shift()
        return solver.solve(problem)

    solver.restart(600.0)
    _times(step, problems)  # not timed: first calls load the compiled functions
    solver.restart(600.0)
    real_time = _times(step, problems, repeats=3)

    reference, guess = ReferenceSolver(context, SETTINGS, warm_start=True), None

    def solve(problem):
        nonlocal guess
        solution = reference.solve(problem, guess)
        guess = np.append(solution.torques[1:], solution.torques[-1])
        return solution

    # the first has nothing to start from
    ipopt = _times(solve, problems[:30])[1:]
    ratio = float(np.median(ipopt) / np.median(real_time))
    for name, values in (("real_time", real_time), ("ipopt", ipopt)):
        benchmark.extra_info[f"{name}_median_ms"] = float(np.median(values))
        benchmark.extra_info[f"{name}_p99_ms"] = float(np.quantile(values, 0.99))
    benchmark.extra_info["ratio_of_medians"] = ratio
    solver.restart(600.0)
    benchmark(lambda: [step(problem) for problem in problems[:10]])
    print(
        f"\nreal-time iteration: median {np.median(real_time):.3f} ms, p99 {np.quantile(real_time, 0.99):.3f} ms; "
        f"warm ipopt: median {np.median(ipopt):.1f} ms, p99 {np.quantile(ipopt, 0.99):.1f} ms; ratio {ratio:.0f}"
    )
    assert ratio >= LEAST_SPEED_UP
