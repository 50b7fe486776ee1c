"""How the time of a run grows with the axles of a train, and that of an allocation rule with the units.

`docs/numbers.toml` takes the table of docs/developing.md from here. Times are of the processor, the least of several.
"""

import math
import time
from collections.abc import Callable
from dataclasses import replace

import pandas as pd

from alloc.event import DriverCommand, Event
from alloc.onboard.parameters import Onboard
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Train
from alloc.rules import find_rule
from alloc.simulation import simulate
from tests.benchmarks.test_rules_benchmark import sequence

AXLES = (1, 8, 32, 64, 128, 256)
UNITS = (2, 16, 128, 1024, 4096)
RULES = ("greedy", "exact", "cooperative", "qp", "qp-daqp", "qp-cvxpy")
SIMULATED = 5.0
"""Length of a run [s]."""
LONGEST = 0.1
"""A rule that has taken this long [s] for a call is not asked by more units."""
PROBLEMS = 2
"""Different problems, so that no rule answers from memory."""


def of_axles(count: int) -> Train:
    """The commuter set with so many axles, its cars in their order again and again; one axle by itself."""
    if count == 1:
        return find_set("one-axle")
    whole = find_set("commuter-8car")
    cars = tuple(whole.cars[k % len(whole.cars)] for k in range(count // 4))
    share = len(cars) / len(whole.cars)
    resistance = tuple(share * value for value in whole.resistance)
    return replace(whole, name=f"{count} axles", cars=cars, resistance=resistance)


def least(call: Callable[[], object], rounds: int) -> float:
    """Least processor time [s] of a call, after one that does not count; of one alone where that took `LONGEST`."""
    taken = []
    for _ in range(rounds + 1):
        began = time.process_time()
        call()
        taken.append(time.process_time() - began)
        if taken[-1] > LONGEST:
            break
    return min(taken[1:] or taken)


def run_time(axles: int) -> float:
    """Processor time of a recorded run [ms per simulated s]: a start on a rail that loses 40 % of its adhesion."""
    train, low = of_axles(axles), Patch(0.6, begin=1.0, until=SIMULATED + 1.0, fade=0.1)
    model = build(train, Rail(0.15, patches=(low,)))
    event = Event(
        train.name, model, DriverCommand((0.1,), (0.8,)), Onboard(), duration=SIMULATED, initial_speed=8.0
    )  # fmt: skip
    return 1e3 * least(lambda: simulate(event, "exact", "cut-and-ramp"), 3) / SIMULATED


def call_time(rule: str, units: int) -> float:
    """Processor time of a call from Python [us]; nan where fewer units took too long."""
    problems, answer = sequence(units)[:PROBLEMS], find_rule(rule)
    for problem in problems:  # what a problem derives from itself is not the rule's time
        _ = problem.box, problem.attainable, problem.torque_limit, problem.in_force
        _ = problem.obtained, problem.available, problem.within_reach
    return 1e6 * least(lambda: [answer(problem) for problem in problems], 3) / PROBLEMS


def measured() -> pd.DataFrame:
    """A row per number of axles (`time` in ms per simulated s), and per rule and number of units (in us a call)."""
    rows = [{"what": "run", "size": size, "time": run_time(size)} for size in AXLES]
    for rule in RULES:
        taken = 0.0
        call_time(rule, 2)  # imports the solver
        for size in UNITS:
            taken = call_time(rule, size) if taken < 1e6 * LONGEST else math.nan
            rows.append({"what": rule, "size": size, "time": taken})
    return pd.DataFrame(rows)


if __name__ == "__main__":
    print(measured().to_string())
