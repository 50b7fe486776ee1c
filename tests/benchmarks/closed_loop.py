"""Solvers of the horizon's problem, each as the controller of a unit in the closed loop.

Belief, search, limits, model, horizon and weights are the same for all: those of `mpc.unit`. Only the solver
differs. Of each event this tells failures, the share of adhesion used where it is short, wheel damage, iterations and time
per period. A run is simulated as if every solver answered in time: what it answers and how fast it is are two questions.

`make bench` runs it; `python -m tests.benchmarks.closed_loop --help` has more events, shipped ones too.
"""

import argparse
import time
from collections.abc import Callable, Iterable, Sequence
from dataclasses import dataclass, field, replace
from functools import partial
from typing import Any

import numpy as np
import pandas as pd

from alloc.errors import InputError
from alloc.event import DriverCommand, Event
from alloc.metrics import METRICS
from alloc.onboard.host import HostedController, TorqueDecision, UnitContext, UnitSense, each_unit
from alloc.onboard.parameters import Braking, Onboard, Sensors
from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve, SlipRatioCurve
from alloc.plant.model import build, level_for
from alloc.plant.rail import Patch, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Train
from alloc.simulation import simulate
from mpc.model import Units
from mpc.period import HorizonProblem, HorizonSolution, RealTimeIteration
from mpc.settings import MpcSettings
from mpc.unit import STATUSES, Iteration, MpcController
from studies.scenario.scenario import load_scenario
from tests.benchmarks.peers import CONVERGING, PEERS, QpsolversIteration, Solved, missing
from tests.benchmarks.peers import iterations as qp_iterations
from tests.mpc.exported import InNumba

DURATION, DROP = 4.0, 1.0


"""Of an event, and instant from which adhesion is low [s]; torque is up within half a second."""


REFERENCE_SPEED = 15.0 / 3.6


"""Speed at which rails of every curve offer the drawn level [m/s]."""


CURVES = (PiecewiseCurve(), POLACH_WET, SlipRatioCurve())


def two_cars() -> Train:
    """The first trailer and the first motor car of the commuter set: one unit of four axles, with free axles beside it."""
    whole = find_set("commuter-8car")
    share = 2.0 / len(whole.cars)
    return replace(
        whole,
        name="commuter, two cars",
        cars=whole.cars[:2],
        resistance=tuple(share * value for value in whole.resistance),
    )


def drawn_event(seed: int, k: int) -> Event:
    """Event `k`: curves take turns, every fourth event is a stop; level, drop, speed and noise are drawn."""
    rng = np.random.default_rng([seed, k])
    curve, braking = CURVES[k % len(CURVES)], k % 4 == 3
    level, factor = rng.uniform(0.13, 0.17), rng.uniform(0.5, 0.75)
    noise = rng.uniform(0.0, 0.02) / 3.6
    speed = rng.uniform(15.0, 30.0) if braking else rng.uniform(4.0, 10.0)
    train = two_cars()
    if curve is POLACH_WET:
        level = level_for(POLACH_WET, level, REFERENCE_SPEED, train)
    low = Patch(factor, begin=DROP, until=DURATION + 1.0, fade=0.1)
    # the motors brake the whole train: the model of the MPC knows of no air brake
    onboard = Onboard(
        sensors=Sensors(speed_noise=noise, seed=seed + k), braking=Braking(blended=False)
    )
    return Event(
        f"drop-{seed}-{k}",
        build(train, Rail(level, patches=(low,), curve=curve)),
        DriverCommand((0.1,), (-0.8 if braking else 0.8,)),
        onboard,
        duration=DURATION,
        initial_speed=speed,
    )


SETTINGS = MpcSettings()


CONVERGED = replace(SETTINGS, iterations=1000, tolerance=1e-6, step_time=1e-6)


"""With which the own iteration goes on to the optimum, as the converging peers do."""


ONE_STEP = replace(SETTINGS, iterations=1)


"""With which it takes one step, as acados' does."""


COMPILED, OWN, OWN_CONVERGED = "compiled step", "own iteration", "own iteration converged"


@dataclass
class Asked:
    """What a solver was asked in a run, and how long it took."""

    times: list[float] = field(default_factory=list)
    """CPU time [s], a solve each; of the compiled step the whole period, with belief and search."""
    iterations: list[int] = field(default_factory=list)
    programs: list[Solved] = field(default_factory=list)
    """Quadratic programs of a solver of `qpsolvers`."""


@dataclass(frozen=True)
class Way:
    """A solver in the closed loop."""

    name: str
    controller: Callable[[UnitContext, Asked], "MpcController | CompiledStep"]
    converges: bool = False
    """Whether it goes on to the optimum in every period."""
    missing: str = ""
    """Why it cannot be run here."""


class CompiledStep:
    """The compiled period of a unit, timed; a `HostController`."""

    def __init__(self, context: UnitContext, asked: Asked) -> None:
        self._step, self._asked = InNumba(context, SETTINGS), asked

    def decide(self, sense: UnitSense) -> TorqueDecision:
        """Torque command for the coming control period."""
        begun = time.process_time()
        answer = self._step.decide(sense)
        taken = time.process_time() - begun
        if sense.target != 0.0:
            self._asked.times.append(taken)
            self._asked.iterations.append(round(float(answer.solve_time) / SETTINGS.step_time))
        return TorqueDecision(
            float(answer.torque), bool(answer.usable), STATUSES[answer.status],
            float(answer.solve_time), float(answer.residual),
        )  # fmt: skip


class Timed:
    """A solver whose solves are timed; in all else it is that solver."""

    def __init__(self, solver: RealTimeIteration, asked: Asked) -> None:
        self._timed, self._asked = solver, asked
        if isinstance(solver, QpsolversIteration):
            solver.solved = asked.programs

    def __getattr__(self, name: str) -> Any:
        return getattr(self._timed, name)

    def solve(self, problem: HorizonProblem) -> HorizonSolution:
        """As the solver."""
        begun = time.process_time()
        solution = self._timed.solve(problem)
        self._asked.times.append(time.process_time() - begun)
        self._asked.iterations.append(solution.iterations)
        return solution


def with_solver(
    iteration: Iteration, settings: MpcSettings = SETTINGS
) -> Callable[[UnitContext, Asked], MpcController]:
    """What makes a unit's controller in Python, with the solver that `iteration` makes, each solve of it timed."""

    def make(context: UnitContext, asked: Asked) -> MpcController:
        def timed(units: Units, given: MpcSettings) -> Any:
            return Timed(iteration(units, given), asked)

        return MpcController(context, settings, timed)

    return make


def ways() -> list[Way]:
    """Every solver that there is an adapter for, the own first, then peers, then the QP solvers in the iteration."""
    own = [
        Way(COMPILED, CompiledStep),
        Way(OWN, with_solver(RealTimeIteration)),
        Way("own iteration, one step", with_solver(RealTimeIteration, ONE_STEP)),
        Way(OWN_CONVERGED, with_solver(RealTimeIteration, CONVERGED), converges=True),
    ]
    peers = [
        Way(name, with_solver(iteration), name in CONVERGING, missing(name))
        for name, iteration in PEERS.items()
    ]
    programs = [
        Way(f"QP by {name}", with_solver(iteration)) for name, iteration in qp_iterations().items()
    ]
    return [*own, *peers, *programs]


@dataclass(frozen=True)
class Run:
    """A way in an event."""

    way: str
    event: str
    calls: int
    failures: int
    used: float
    """Share of the adhesion that units used while they were short of it; nan where they never were."""
    damage: float
    """[kJ]"""
    step_error: float
    """Greatest error of a quadratic program's solution, over the torque scale; nan where others solve none."""
    asked: Asked


def run(way: Way, event: Event) -> Run:
    """`event` with every unit under the controller of this way."""
    asked = Asked()
    each = each_unit(partial(way.controller, asked=asked))
    recorded = simulate(event, "alone", HostedController("mpc", way.name, each))
    used, damage = (
        METRICS.find(name).function(recorded) for name in ("utilisation_short", "damage")
    )
    return Run(
        way.name,
        event.name,
        int(recorded.attrs["controller_calls"]),
        int(recorded.attrs["controller_failures"]),
        used,
        damage,
        max((program.error for program in asked.programs), default=np.nan),
        replace(asked, programs=[]),
    )


def table(runs: Iterable[Run]) -> pd.DataFrame:
    """A row per way: share of adhesion `used` and damage [kJ] as means over the events, iterations and times [ms] of all
    periods. `step_error` is the worst of a quadratic program's steps, over the torque scale.
    """
    rows = []
    found = list(runs)
    for name in dict.fromkeys(one.way for one in found):
        mine = [one for one in found if one.way == name]
        times = 1e3 * np.concatenate([one.asked.times for one in mine])
        steps = np.concatenate([one.asked.iterations for one in mine])
        rows.append(
            {
                "solver": name,
                "failures": sum(one.failures for one in mine),
                "periods": sum(one.calls for one in mine),
                "used": pd.Series([one.used for one in mine]).mean(),  # nan left out
                "damage": np.mean([one.damage for one in mine]),
                "iterations": np.median(steps),
                "iterations_most": steps.max(),
                "time": np.median(times),
                "time_p99": np.quantile(times, 0.99),
                "step_error": pd.Series([one.step_error for one in mine]).max(),
            }
        )
    return pd.DataFrame(rows).set_index("solver")


def differences(runs: Sequence[Run], reference: str = OWN_CONVERGED) -> dict[str, float]:
    """Greatest difference of the adhesion used in an event from that of `reference`, by way; nan without shortage."""
    used = {(one.way, one.event): one.used for one in runs}
    return {
        name: float(
            pd.Series(
                [abs(one.used - used[reference, one.event]) for one in runs if one.way == name]
            ).max()
        )
        for name in dict.fromkeys(one.way for one in runs)
    }


def text(runs: Iterable[Run]) -> str:
    """The table in plain text."""
    return str(table(runs).to_string(float_format="%.4g", na_rep="-"))


def run_ways(chosen: Iterable[Way], events: Sequence[Event]) -> list[Run]:
    """Every event under every way that is not missing; a line of progress each."""
    runs = []
    for way in chosen:
        if way.missing:
            print(f"{way.name}: left out, {way.missing}")
            continue
        runs += [run(way, event) for event in events]
        print(f"{way.name}: done", flush=True)
    return runs


def asked_ways(parts: Sequence[str]) -> list[Way]:
    """Ways whose names have one of these parts; all without parts."""
    return [way for way in ways() if not parts or any(part in way.name for part in parts)]


def measured(events: int, seed: int, solver: Sequence[str] = ()) -> pd.DataFrame:
    """Rows of `table` for drawn events, and each way's greatest difference of the share used in an event, `apart`.

    What `docs/numbers.toml` takes the numbers of docs/mpc.md from.
    """
    runs = run_ways(asked_ways(solver), [drawn_event(seed, k) for k in range(events)])
    return table(runs).assign(apart=differences(runs)).reset_index()


def _events(parser: argparse.ArgumentParser, asked: argparse.Namespace) -> list[Event]:
    """Drawn and shipped events that are asked for."""
    if asked.seed < 0:
        parser.error(f"--seed {asked.seed}: must be 0 or greater")
    try:
        shipped = [load_scenario(name).event() for name in asked.scenario]
        drawn = [drawn_event(asked.seed, k) for k in range(asked.events)]
        events = drawn + [replace(event, duration=asked.seconds) for event in shipped]
    except (InputError, ValueError) as error:
        parser.error(str(error))
    if not events:
        parser.error("no event is left: ask for --events of 1 or more, or for a --scenario")
    return events


def main(arguments: Sequence[str] | None = None) -> None:
    """Print the table of the events asked for, as the page docs/mpc.md has it."""
    parser = argparse.ArgumentParser(
        "closed_loop", description="Solvers as controllers in the closed loop."
    )
    parser.add_argument("--events", type=int, default=3, help="number of drawn events")
    parser.add_argument("--seed", type=int, default=2026, help="of the drawn events")
    parser.add_argument("--scenario", action="append", default=[], help="a shipped event, as well")
    parser.add_argument("--seconds", type=float, default=8.0, help="length of a shipped event")
    parser.add_argument("--solver", nargs="+", default=[], help="parts of names; default: all")
    asked = parser.parse_args(arguments)
    events, chosen = _events(parser, asked), asked_ways(asked.solver)
    if not chosen:
        parser.error(f"no solver is called so; there are {', '.join(w.name for w in ways())}")
    runs = run_ways(chosen, events)
    print(text(runs))
    for event in events:
        print(f"\n{event.name}\n{text([one for one in runs if one.event == event.name])}")


if __name__ == "__main__":
    main()
