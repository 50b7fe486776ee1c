"""The quadratic programs of the readhesion MPC as a test set of qpbenchmark.

In: scenarios. Out: `readhesion_mpc.parquet` with the programs, and `readhesion_mpc.py`, which qpbenchmark runs. Each is what
a unit, or all units of a train as one, solved in a control period of a run: changes of torque over the horizon, scaled,
between bounds. The warm start is that nothing changes: 0, a feasible point. qpbenchmark itself starts every solver cold.
"""

from collections.abc import Callable, Sequence
from functools import partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
import pandas as pd

from alloc.onboard.host import HostedController, UnitContext, each_unit
from alloc.plant.model import Floats
from alloc.simulation import simulate
from alloc.sources import write_whole
from mpc.group import GroupController
from mpc.model import Units
from mpc.period import FAILURES, HorizonProblem, HorizonSolution, RealTimeIteration
from mpc.settings import MpcSettings
from mpc.solver import ENDED
from mpc.unit import MpcController
from studies.scenario.scenario import Scenario

NAME = "readhesion_mpc"
RULE, SEED = "greedy", 0
PER_RUN = {"unit": 40, "train": 5}
"""Programs of a run, evenly spread over all that were solved; those of a train of 16 units have 320 variables."""
COLUMNS = ("P", "q", "G", "h", "A", "b", "lb", "ub", "name")
"""Of a test set as `qpbenchmark.ParquetTestSet` reads it: matrices row by row, None for what a program lacks."""


class Program(NamedTuple):
    """Minimise 1/2 x' P x + q' x with lb <= x <= ub, and where it was solved."""

    P: Floats
    q: Floats
    lb: Floats
    ub: Floats
    x: Floats
    """The answer of the MPC's own solver."""


class RecordingIteration(RealTimeIteration):
    """The MPC's iteration step by step, which keeps the program of every step."""

    def __init__(
        self, units: Units, settings: MpcSettings, evenness: float = 0.0, *, kept: list[Program]
    ) -> None:
        super().__init__(units, settings, evenness)
        self._kept = kept

    def solve(self, problem: HorizonProblem) -> HorizonSolution:
        """As the loop's solver, one step at a time."""
        self.take(problem)
        done, residual, end = 0, np.inf, ENDED
        while done < self.most and residual > self.period.rules.tolerance and end <= ENDED:
            cost, residual, _, end = self._iterate(1, self._period)
            quadratic, guess = self.period.quadratic, self.period.guess
            found = quadratic.hessian, quadratic.gradient, guess.lower, guess.upper, guess.step
            if end <= ENDED:
                self._kept.append(Program(*(values.copy() for values in found)))
            done += 1
        status = FAILURES.get(end, "ok")
        return HorizonSolution(self.torques.copy(), cost, residual, done, status)


def programs(scenario: Scenario) -> dict[str, list[Program]]:
    """The programs of a scenario's runs, in their order: of units alone, and of all units as one."""
    found = dict[str, list[Program]]()
    for kind in PER_RUN:
        kept = found[kind] = []
        solver = partial(RecordingIteration, kept=kept)

        def alone(one: UnitContext, solver: Callable = solver) -> MpcController:
            return MpcController(one, one.settings, solver)

        def joint(contexts: Sequence[UnitContext], solver: Callable = solver) -> GroupController:
            return GroupController(contexts, contexts[0].settings, solver)

        factory = each_unit(alone) if kind == "unit" else joint
        simulate(scenario.event(SEED), RULE, HostedController("mpc", "records its programs", factory))  # fmt: skip
    return found


def write_test_set(scenarios: Sequence[Scenario], folder: Path) -> int:
    """Write the test set of these scenarios into a folder; returns the number of programs."""
    rows = []
    for scenario in scenarios:
        for kind, every in programs(scenario).items():
            for k in np.unique(np.linspace(0, len(every) - 1, PER_RUN[kind]).round().astype(int)):
                one = every[k]
                name = f"{scenario.name}, {kind}, {k}"
                rows.append((one.P.ravel(), one.q, None, None, None, None, one.lb, one.ub, name))
    table = pd.DataFrame(rows, columns=list(COLUMNS))
    write_whole(folder / f"{NAME}.parquet", lambda aside: table.to_parquet(aside, index=False))
    write_whole(folder / f"{NAME}.py", lambda aside: aside.write_text(_TEST_SET, "utf-8"))
    return len(table)


_TEST_SET = f'''"""Quadratic programs of a railway readhesion MPC. Written by readhesion.

Run: python {NAME}.py --results-path results.csv run
"""

from pathlib import Path

import qpbenchmark
from qpbenchmark.benchmark import main


class {NAME.title().replace("_", "")}(qpbenchmark.ParquetTestSet):
    """Programs with dense Hessians and bounds alone, of one unit and of all units of a train."""

    title = "Readhesion MPC"
    description = "Condensed QPs of MPC readhesion control of trains: torques over a horizon between bounds"
    sparse_only = False

    def __init__(self):
        super().__init__(Path(__file__).with_suffix(".parquet"))


if __name__ == "__main__":
    main(test_set_path=__file__)
'''
