"""How the time of a run grows with the axles of a train, that of a rule with the units, and that of a study with its events.

`docs/numbers.toml` takes tables of docs/developing.md from here. Times are of the processor, of runs and calls the least of
several. A study begins in a process of its own, whose peak memory counts. `draw` makes the figure from what is stored.
"""

import json
import logging
import math
import multiprocessing
import re
import resource
import tempfile
import time
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from dataclasses import replace
from functools import cache
from pathlib import Path

import pandas as pd
from matplotlib import rc_context

from alloc.event import DriverCommand, Event
from alloc.onboard.parameters import Onboard
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Train
from alloc.rules import find_rule
from alloc.simulation import simulate
from paper_figs.style import PAGE, new_panels, rule_look
from studies.core.job import Job
from studies.core.run import cluster
from studies.core.study import EachEvent, Study
from studies.scenario.scenario import Scenario, load_scenario
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
EVENTS = (1, 10, 100, 1000)
ON_CLUSTER = (40, 400)
"""Numbers of events with Dask; times are of those that the second has more, so no start of a worker counts."""
SHARING = ("alone", "uniform", "preset", "sharing", "erp", "greedy", "exact", "cooperative")
"""Rules that meet each event there."""


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
    call()
    taken: list[float] = []
    while len(taken) < rounds and max(taken, default=0.0) <= LONGEST:
        began = time.process_time()
        call()
        taken.append(time.process_time() - began)
    return min(taken)


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


def _cells(seed: int, k: int, rules: tuple[str, ...]) -> list[Job]:
    return [Job(_event(), rule, "cut-and-ramp", k) for rule in rules]


@cache
def _event() -> Scenario:
    return load_scenario("wet-patch").changed(duration_s=SIMULATED)


GROWTH = Study("growth", "how long so many events take", 1, EachEvent(_cells), lambda _: [])


def _done(events: int, workers: int) -> tuple[float, float, float]:
    """A study here or with `workers` of Dask: processor time [s] of this process and of others, peak memory [MB] of this."""
    began = time.process_time()
    with tempfile.TemporaryDirectory() as folder:
        if workers:
            from distributed import LocalCluster

            place = {"dashboard_address": "127.0.0.1:0", "silence_logs": logging.CRITICAL}
            with (
                LocalCluster(n_workers=workers, threads_per_worker=1, **place) as made,
                cluster(made.scheduler_address) as others,
            ):
                GROWTH.run(folder, events, 0, others, rules=SHARING)
        else:
            GROWTH.run(folder, events, rules=SHARING[-1:])
    others_time = sum(resource.getrusage(resource.RUSAGE_CHILDREN)[:2])
    peak = resource.getrusage(resource.RUSAGE_SELF).ru_maxrss / 1024.0
    return time.process_time() - began, others_time, peak


def done(events: int, workers: int = 0) -> tuple[float, float, float]:
    """`_done` in a process of its own."""
    with ProcessPoolExecutor(1, multiprocessing.get_context("spawn")) as own:
        return own.submit(_done, events, workers).result()


def of_events() -> list[dict[str, object]]:
    """Per number of events in one process the time [ms] of an event and the memory [MB]."""
    found = {size: done(size) for size in EVENTS}
    return [
        {"what": "event", "size": n, "time": 1e3 * own / n, "memory": peak}
        for n, (own, _, peak) in found.items()
    ]


def on_cluster() -> list[dict[str, object]]:
    """With 1 and 2 workers of Dask: time [ms] of an event in the workers, and in command and scheduler; memory [MB]."""
    rows: list[dict[str, object]] = []
    few, many = ON_CLUSTER
    for workers in (1, 2):
        (own, theirs, small), (own_more, theirs_more, large) = (
            done(few, workers),
            done(many, workers),
        )
        per_event = 1e3 / (many - few)
        rows.append({
            "what": "workers", "size": workers, "time": per_event * (theirs_more - theirs),
            "parent": per_event * (own_more - own), "memory": small, "memory_more": large,
        })  # fmt: skip
    return rows


def draw(path: Path) -> None:
    """Time over axles, units and events, and memory over events, from what is stored."""
    values = json.loads((Path(__file__).parents[2] / "docs/results/scale.json").read_text())[
        "values"
    ]
    series: dict[tuple[str, str], list[tuple[int, float]]] = {}
    for cell, (value,) in values.items():
        column, what, size = re.fullmatch(
            r"scale \| mean \| (\w+) \| what=(.*); size=(\d+)", cell
        ).groups()
        series.setdefault((column, what), []).append((int(size), value))
    whole = [(size, 1e-3 * size * each) for size, each in series["time", "event"]]
    panels: tuple[tuple[str, str, dict[str, list[tuple[int, float]]], float], ...] = (
        ("axles of the train", "run, ms per simulated s", {"run": series["time", "run"]}, 1e2),
        ("units", "call of a rule, µs", {rule: series["time", rule] for rule in RULES}, 1e8),
        ("events", "study, s", {"event": whole}, 1e2),
        ("events", "peak memory, MB", {"event": series["memory", "event"]}, 1e3),
    )
    with rc_context({"font.size": 7}):
        figure, axes = new_panels(PAGE, 4.2, 2, 2)
        for axis, (size, quantity, shown, most) in zip(axes.flat, panels, strict=True):
            for what, points in shown.items():
                look = rule_look(what) | {"linestyle": "-", "label": what, "markersize": 4}
                axis.loglog(*zip(*sorted(points), strict=True), **look)
            axis.set(xlabel=f"number of {size}", ylabel=quantity, ylim=(0.5, most))
            if len(shown) > 1:
                axis.legend(ncols=3, loc="upper left", frameon=False)
        figure.savefig(path, dpi=150)


def measured() -> pd.DataFrame:
    """A row per number of axles (`time` in ms per simulated s), per rule and units (in us a call), per events, of Dask."""
    rows = [*of_events(), *on_cluster()]
    rows += [{"what": "run", "size": size, "time": run_time(size)} for size in AXLES]
    for rule in RULES:
        taken = 0.0
        call_time(rule, 2)  # imports the solver
        for size in UNITS:
            taken = call_time(rule, size) if taken < 1e6 * LONGEST else math.nan
            rows.append({"what": rule, "size": size, "time": taken})
    return pd.DataFrame(rows)


if __name__ == "__main__":
    print(measured().to_string())
    draw(Path("docs/static/growth.png"))
