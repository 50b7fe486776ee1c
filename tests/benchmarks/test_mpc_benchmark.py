"""Step time of the real-time iteration against its peers, on the same problems in the same run.

Model, horizon and problems are the same for all; peers that converge start from their last solution, shifted. Only ratios
are checked: both times are taken on the same machine, so they do not depend on how fast it is. Run with `make bench`;
medians, 99th percentiles and residuals are in the report's extra_info. `closed_loop.py` has the peers as controllers.
"""

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import pytest

from alloc.onboard.host import UnitContext
from alloc.plant.adhesion import PiecewiseCurve
from mpc.model import Units, group_of, parameters, substeps, torque_per_coefficient, unit_model
from mpc.period import HorizonProblem, RealTimeIteration
from mpc.settings import GroupSettings, MpcSettings
from tests.benchmarks import closed_loop
from tests.benchmarks.closed_loop import drawn_event
from tests.benchmarks.peers import CONVERGING, PEERS, missing, step_function

HORIZON = 20


CURVE = PiecewiseCurve()


RADIUS = 0.43


EVENNESS = GroupSettings().evenness


SPREAD = np.array([0.118, 0.12, 0.122, 0.125])


"""Peak coefficients of up to four axles."""


@dataclass(frozen=True)
class Case:
    """A unit to time, or a car whose axles are `units` of their own; `iteration` makes the solver under test."""

    name: str
    axles: int
    units: int = 1
    iteration: Callable[[Units, MpcSettings], Any] = RealTimeIteration
    peers: tuple[str, ...] = tuple(PEERS)
    """Those that can take the case's problems."""
    least_speed_up: float = 20.0
    """Over ipopt, in medians."""

    @property
    def context(self) -> Units:
        each = self.axles // self.units
        units = tuple(
            UnitContext(
                unit=k, axles=each, radius=RADIUS, inertia=155.0, gear_ratio=7.07, axle_load=78e3,
                mass=13.75e3 * each, torque_lag=5e-3, curve=CURVE, period=0.01,
            )
            for k in range(self.units)
        )  # fmt: skip
        return units if self.units > 1 else units[0]

    def problems(
        self,
        peak: float | np.ndarray,
        speed: float,
        target: float,
        upper: float,
        slip: float,
        number: int,
    ) -> list[HorizonProblem]:
        """`number` periods of a unit under its own real-time iteration, which knows the `peak`.

        From `slip` [m/s] of every wheel on, with a torque of 600 N m.
        """
        context, settings = self.context, MpcSettings(horizon=HORIZON, iterations=1)
        constants = parameters(context, peak)
        step = step_function(unit_model(context), settings.step, substeps(context, settings.step))
        m = self.units
        state = np.array([speed, *[(speed + slip) / RADIUS] * self.axles, *[600.0] * m])
        solver, torque, made = self.iteration(context, settings), self._each(600.0), []
        solver.restart(torque)
        limit = CURVE.limit(np.broadcast_to(peak, self.axles), speed)[1]
        wanted, most = self._each(target), self._each(upper)
        for _ in range(number):
            made.append(HorizonProblem(state, constants, limit, wanted, torque, most, wanted))
            solver.shift()
            torques = solver.solve(made[-1]).torques
            torque = torques[:m].copy() if m > 1 else float(torques[0])
            state = np.asarray(step(state, torque, constants)).ravel()
        return made

    def _each(self, value: float) -> float | np.ndarray:
        """The same value for each unit; a plain number where there is one, as solvers of one torque take it."""
        return np.full(self.units, value) if self.units > 1 else value

    def readhesion(self) -> list[HorizonProblem]:
        """A second of it: wheels at 0.3 m/s of slip, more torque wanted than the rail carries."""
        return self.problems(SPREAD[: self.axles], 10.0, 900.0, 1000.0, 0.3, 100)

    def drops(self, number: int) -> list[tuple[HorizonProblem, HorizonProblem]]:
        """Pairs of problems between which the peaks fall from about 0.18 to 0.12, the unit having settled before.

        Bounds as in `MpcController`.
        """
        rng, context, pairs = np.random.default_rng(1), self.context, []
        carried = torque_per_coefficient(group_of(context)[0])
        for _ in range(number):
            speed, target = rng.uniform(4.0, 25.0), rng.uniform(900.0, 1200.0)
            low = SPREAD[: self.axles]
            high = 0.18 / 0.12 * low
            high_bound, low_bound = (min(target, 1.1 * p.min() * carried) for p in (high, low))
            before = self.problems(high, speed, target, high_bound, 0.01, 60)[-1]
            after = before._replace(
                parameters=parameters(context, low),
                slip_limit=CURVE.limit(low, before.state[0])[1],
                upper=self._each(low_bound),
            )
            pairs.append((before, after))
        return pairs


CASES = [
    Case("one axle, one torque", 1),
    Case("four axles, one torque", 4),
    Case(
        "four axles, four torques",
        4,
        4,
        partial(RealTimeIteration, evenness=EVENNESS),
        ("Opti with ipopt", "fatrop"),
    ),
]


"""Anything with the attributes of `Case` may join."""


pytestmark = pytest.mark.skipif(
    "not config.getoption('benchmark_enable')", reason="compiles for minutes: run with make bench"
)


PEER_PROBLEMS, BLOCKS = 50, 10


"""Solvers take turns after each block of problems."""


ROUNDS = 5


"""Repetitions of a real-time iteration's block, from the same guess."""


SAME_TORQUE = 1e-4


"""Greatest difference of a torque of a converged solution, over the torque scale."""


MOST_STEPS = 100


"""Steps after which an iteration is taken not to converge."""


OWN = "own"


@pytest.fixture(scope="module", params=CASES, ids=lambda case: case.name)
def case(request):
    return request.param


@pytest.fixture(scope="module")
def problems(case):
    return case.readhesion()


def _timed(solve, problems):
    """Times [ms] and solutions."""
    taken, solutions = [], []
    for problem in problems:
        started = time.perf_counter()
        solutions.append(solve(problem))
        taken.append(time.perf_counter() - started)
    assert {solution.status for solution in solutions} == {"ok"}
    return np.array(taken) * 1e3, solutions


def _stepping(solver):
    def step(problem):
        solver.shift()
        return solver.solve(problem)

    return step


@pytest.fixture(scope="module")
def measured(case, problems):
    """Times [ms] and solutions by solver, taken in turns: a machine that slows down slows all of them."""
    settings, context = MpcSettings(horizon=HORIZON), case.context
    peers = {}
    for name in case.peers:
        if name in CONVERGING and not missing(name):
            peers[name] = PEERS[name](context, settings)
            peers[name].restart(600.0)
    converging = {name: _stepping(peer) for name, peer in peers.items()}
    # one step of it is what is timed
    iterations = {OWN: case.iteration(context, replace(settings, iterations=1, tolerance=0.0))}
    iterations[OWN].restart(600.0)
    # not counted: converging solvers have nothing to start from, first calls load the compiled functions
    for solve in (*converging.values(), *map(_stepping, iterations.values())):
        _timed(solve, problems[:1])
    results = {key: ([], []) for key in (*converging, *iterations)}
    for block in np.array_split(np.arange(1, PEER_PROBLEMS + 1), BLOCKS):
        part = [problems[k] for k in block]
        for name, solve in converging.items():
            for kept, new in zip(results[name], _timed(solve, part), strict=True):
                kept.extend(new)
        for key, solver in iterations.items():
            guess = solver.torques.copy()
            for _ in range(ROUNDS):
                solver.torques[:] = guess
                times, solutions = _timed(_stepping(solver), part)
                results[key][0].extend(times)
            results[key][1].extend(solutions)
    return results


def _report(benchmark, name, times):
    median, p99 = np.quantile(times, [0.5, 0.99])
    benchmark.extra_info |= {f"{name}_median_ms": float(median), f"{name}_p99_ms": float(p99)}
    return f"{name}: median {median:.3f} ms, p99 {p99:.3f} ms; "


def test_real_time_iteration_against_ipopt(benchmark, case, problems, measured):
    times, solutions = measured[OWN]
    settings = MpcSettings(horizon=HORIZON, iterations=1, tolerance=0.0)
    # of the torques after the step; at its begin the end of the horizon is out, where the shifted guess is repeated
    solver, residuals = case.iteration(case.context, settings), []
    for problem, solution in zip(problems[1 : PEER_PROBLEMS + 1], solutions, strict=True):
        solver.torques[:] = solution.torques
        residuals.append(solver.solve(problem).residual)
    quantiles = np.quantile(residuals, [0.5, 0.9, 0.99, 1.0])
    for name, value in zip(("median", "p90", "p99", "worst"), quantiles, strict=True):
        benchmark.extra_info[f"residual_{name}"] = float(value)
    text = _report(benchmark, "real_time", times) + _report(
        benchmark, "ipopt", measured["Opti with ipopt"][0]
    )
    ratio = float(np.median(measured["Opti with ipopt"][0]) / np.median(times))
    benchmark.extra_info["ratio_of_medians"] = ratio
    solver.restart(600.0)
    step = _stepping(solver)
    benchmark(lambda: [step(problem) for problem in problems[:10]])
    levels = ", ".join(f"{value:.1e}" for value in quantiles)
    print(f"\n{text}ratio {ratio:.0f}; residual median, p90, p99, worst: {levels}")
    if (
        benchmark.enabled
    ):  # times are judged by `make bench` alone: beside other work they say little
        assert ratio >= case.least_speed_up


@pytest.mark.parametrize("name", [name for name in CONVERGING if name != "Opti with ipopt"])
def test_converging_peer(benchmark, case, problems, measured, name):
    if name not in case.peers:
        pytest.skip(f"{name}: the adapter takes problems of one torque")
    if missing(name):
        pytest.skip(missing(name))
    times, solutions = measured[name]
    solver = PEERS[name](case.context, MpcSettings(horizon=HORIZON))
    solver.restart(600.0)
    benchmark.pedantic(solver.solve, args=(problems[0],), rounds=3)
    print(
        "\n"
        + _report(benchmark, name, times)
        + _report(benchmark, "ipopt", measured["Opti with ipopt"][0])
    )
    torques, other = (
        np.array([s.torques for s in found])
        for found in (solutions, measured["Opti with ipopt"][1])
    )
    error = np.abs(torques - other).max() / solver.period.guess.scale[0]
    benchmark.extra_info["torque_beside_ipopt_worst"] = float(error)
    assert error < SAME_TORQUE


@pytest.mark.skipif(missing("acados SQP_RTI") != "", reason=missing("acados SQP_RTI"))
def test_acados(benchmark, case, problems):
    if "acados SQP_RTI" not in case.peers:
        pytest.skip("acados does not take this case")
    solver = PEERS["acados SQP_RTI"](case.context, MpcSettings(horizon=HORIZON))
    solver.restart(600.0)
    step = _stepping(solver)
    times, within = [], []
    for problem in problems[: PEER_PROBLEMS + 1]:
        times.extend(_timed(step, [problem])[0])
        within.append(1e3 * solver.own_time)
    benchmark.pedantic(step, args=(problems[PEER_PROBLEMS],), rounds=5)
    print("\n" + _report(benchmark, "acados", times[1:]) + _report(benchmark, "within", within[1:]))


def test_steps_to_convergence_after_a_drop_of_adhesion(benchmark, case):
    settings = MpcSettings(horizon=HORIZON, iterations=MOST_STEPS, step_time=1e-5, tolerance=1e-4)
    solver, steps, first, reached = case.iteration(case.context, settings), [], [], 0
    one = case.iteration(case.context, replace(settings, iterations=1))
    for before, after in case.drops(20):
        for each in (solver, one):
            each.restart(before.before)
            for _ in range(MOST_STEPS):
                if each.solve(before).residual <= settings.tolerance:
                    break
            each.shift()
        solution = solver.solve(after)
        steps.append(solution.iterations)
        reached += solution.residual <= settings.tolerance
        one.solve(after)
        first.append(one.solve(after).residual)  # after the first step
    benchmark.extra_info |= {
        "steps_median": float(np.median(steps)),
        "steps_worst": int(max(steps)),
        "share_converged": reached / len(steps),
        "residual_after_one_step_median": float(np.median(first)),
        "residual_after_one_step_worst": float(np.max(first)),
    }
    benchmark.pedantic(solver.solve, args=(after,), rounds=5)
    print(
        f"\nsteps to {settings.tolerance:.0e}: median {np.median(steps):.0f}, worst {max(steps)}, reached by "
        f"{reached} of {len(steps)}; residual after one step: median {np.median(first):.1e}, worst {max(first):.1e}"
    )


SEED, EVENTS = 2026, 3


SAME_USE = 0.005


"""Difference of the adhesion used that a solver may have in an event from the own iteration, both converged or neither."""


EXACT = 1e-6


"""Error of a quadratic program's solution up to which the iteration must run as the own; that of others is only told."""


LEAST_SPEED_UP = 20.0


"""Of the compiled step, with belief and search, over a solver that converges, in medians of CPU time."""


@pytest.fixture(scope="module")
def found():
    """Runs of the ways so far, by name."""
    return {}


@pytest.mark.parametrize("way", closed_loop.ways(), ids=lambda way: way.name)
def test_in_the_closed_loop(benchmark, found, way):
    if way.missing:
        pytest.skip(way.missing)
    events = [drawn_event(SEED, k) for k in range(EVENTS)]
    runs = benchmark.pedantic(lambda: [closed_loop.run(way, event) for event in events], rounds=1)
    found[way.name] = runs
    row = closed_loop.table(runs).iloc[0]
    benchmark.extra_info |= {name: float(value) for name, value in row.items()}
    print("\n" + closed_loop.text(runs))
    assert row["failures"] == 0
    reference = closed_loop.OWN_CONVERGED if way.converges else closed_loop.COMPILED
    different = closed_loop.differences([*found[reference], *runs], reference)[way.name]
    benchmark.extra_info["difference of the adhesion used"] = different
    if way.converges or way.name == closed_loop.OWN or row["step_error"] < EXACT:
        assert different < SAME_USE
    if way.converges and way.name != closed_loop.OWN_CONVERGED:
        times, own = (
            np.concatenate([one.asked.times for one in found[name]])
            for name in (way.name, closed_loop.COMPILED)
        )
        assert np.median(times) > LEAST_SPEED_UP * np.median(own)
