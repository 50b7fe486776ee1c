"""How cost grows: parts of the plant's right side and of an instant, axles, units, and a Dask cluster.

    python tests/scaling.py [right-side | instant | cluster]        make scaling

Stored in docs/tables as scaling-right-side.md and so on. Wants an idle machine, and for the cluster Linux.
"""

import inspect
import os
import subprocess
import sys
import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numba
import numpy as np
import pandas as pd

from alloc import backends
from alloc.evaluation.metrics import evaluate
from alloc.plant import dynamics
from alloc.run.simulation import ADVANCE, Simulation
from alloc.schema.tables import look_up
from studies.compare import choose_grid, make_study
from studies.files.scenario_files import load_scenario
from studies.runner.catalogue import find_study
from studies.runner.rows import markdown_table
from studies.runner.study import run_study

TABLES = Path(__file__).parents[1] / "docs" / "tables"
AXLES, REPEATS, CALLS = (8, 32, 64, 128), 40, 500
BEGUN = 400
"""Control instants after which a right side is timed; wheels have begun to slip."""
jit = numba.njit(error_model="numpy")


def find_shortest(function: Any, *arguments: Any) -> float:
    """Time of a call [ns], the shortest of `REPEATS` means over `CALLS` from a compiled loop."""

    @jit
    def call_often(count, arguments):
        for _ in range(count):
            function(*arguments)

    call_often(1, arguments)
    times = []
    for _ in range(REPEATS):
        start = time.perf_counter()
        call_often(CALLS, arguments)
        times.append(time.perf_counter() - start)
    return 1e9 * min(times) / CALLS


def start_run(axles: int, inverter_group: str = "1C4M") -> Simulation:
    """A run onto a wet patch of so many axles; wheels begin to slip after 4 s."""
    event = load_scenario("wet-patch").event(0)
    cars = (event.train.cars * 4)[: axles // 4]
    group = {"inverter_group": inverter_group}
    cars = tuple(replace(car, motors=car.motors and replace(car.motors, **group)) for car in cars)
    belief = replace(event.onboard.belief, increments=None)
    event = replace(event, train=replace(event.train, cars=cars))
    event = replace(event, rail=replace(event.rail, increments=(0.0,) * axles))
    return Simulation(
        replace(event, onboard=replace(event.onboard, belief=belief)),
        "cooperative",
        "perturb-observe",
    )


# the right side: what its source without a part saves is the part's cost

PARTS = {
    "adhesion by speed": ("a = wheelsets[i]\n        if bodies > 1", "    if changes_rail"),
    "patches": ("if changes_rail", "\n    # the wheelsets"),
    "adhesion curve": ("mu = law.piecewise", "        force = mu"),
    "wheelsets, with curve and sums": ("a, turning = wheelsets[i], y", "    if plant.parallel"),
    "cylinders": ("b, p = cylinders[g]", "    if pressed"),
    "cars": ("c, body = cars[k]", "    if plant.body_mass"),
    "motors": ("u = drives[j]", "\n    works = friction"),
}
"""What is left out of the source, from these words to those; a loop stays, with nothing in it."""
FLOORS = {
    "adhesion by speed": "max(x[0, i] * 0.01 + x[1, i] + x[2, i], 1e-3)",
    "adhesion curve": "law.piecewise_coefficient(0.03 * x[0, i], x[1, i], 5.0, 40.0, 0.05, 0.9, 1.0)",
    "wheelsets, with curve and sums": "(x[2, i] * x[3, i] - x[4, i] * (x[0, i] * x[1, i])) / x[5, i]",
    "cylinders": "law.pressure_rate(x[0, i], x[1, i], x[2, i], x[3, i], x[4, i])",
    "cars": "x[5, i] - law.resistance(x[0, i], x[1, i], x[2, i], x[3, i]) - law.gradient_force(x[4, i], x[6, i])",
    "motors": "law.torque_rate(x[0, i], x[1, i], look_up(x, 0, x[2, i]), look_up(x, 1, x[3, i]), x[4, i])",
}
"""The same arithmetic over columns, and nothing else."""
EACH = {"cylinders": 2, "cars": 4, "motors": 8}
"""Axles for each of what a part loops over; of others 1."""


def compile_text(text: str, name: str) -> Any:
    """A function of some source, with the names of the plant."""
    scope = dict(vars(dynamics)) | {"law": backends.compiled, "look_up": look_up}
    exec(text, scope)
    return jit(scope[name])


def leave_out(part: str) -> Any:
    """The right side without a part; the whole where it has no such part."""
    text = inspect.getsource(dynamics.derivative.py_func).partition("\n")[2]
    if part in PARTS:
        begin, behind = (text.index(words) for words in PARTS[part])
        text = f"{text[:begin]}pass\n{text[behind:]}" if begin < behind else ""
    return compile_text(text, "derivative")


def right_side() -> pd.DataFrame:
    """Cost of each part [ns] by number of axles, and its floor at 32."""
    variants = {part: leave_out(part) for part in ("whole", *PARTS)}
    columns: dict[str, Any] = {"part": [*PARTS, "whole"]}
    for axles in AXLES:
        run = start_run(axles)
        for _ in range(BEGUN):
            run.run_to(ADVANCE)
        w = run.world
        arrays = w.state, w.stages[0], w.wheelsets, w.cars, w.drives, w.cylinders, w.patches, w.line
        arrays += w.effort, w.retard, w.curve, w.scatter, w.plant[0]
        costs = {part: find_shortest(side, 4.0, *arrays) for part, side in variants.items()}
        columns[f"{axles} axles"] = [costs["whole"] - costs[part] for part in PARTS] + [
            costs["whole"]
        ]
    floors = []
    for part in PARTS:
        x, y = (
            np.random.default_rng(0).uniform(0.1, 0.5, (7, 32 // EACH.get(part, 1))),
            np.empty(32),
        )
        text = (
            f"def floor(x, y):\n    for i in range(x.shape[1]):\n        y[i] = {FLOORS.get(part)}"
        )
        floors.append(
            find_shortest(compile_text(text, "floor"), x, y) if part in FLOORS else np.nan
        )
    return pd.DataFrame(columns | {"floor at 32": [*floors, np.nansum(floors)]}).round(0)


@jit
def repeat_period(begin, t, state, *arguments):
    """A control period from the same state."""
    state[:] = begin
    dynamics.advance_period(t, state, *arguments)


def instant() -> pd.DataFrame:
    """Cost of a control instant [us], its parts, and what a run costs beside its loop [ms], by axles and units."""
    lines = []
    for axles, group in (*((n, "1C4M") for n in AXLES), (64, "1C2M"), (64, "1C1M")):
        loops, rest = [], []
        for _ in range(REPEATS // 4):
            run = start_run(axles, group)
            start = time.perf_counter()
            run.run_to_end()
            loops.append(1e6 * (time.perf_counter() - start) / run.ticks)
            start = time.perf_counter()
            evaluate(recorded := run.recorded())
            rest.append(1e3 * (time.perf_counter() - start))
        run = start_run(axles, group)
        for _ in range(BEGUN):
            run.run_to(ADVANCE)
        w, plant, begin = run.world, run.world.plant[0], run.world.state.copy()
        rows = w.wheelsets, w.cars, w.drives, w.cylinders, w.patches, w.line
        rows += w.effort, w.retard, w.curve, w.scatter
        side = find_shortest(dynamics.derivative, 4.0, w.state, w.stages[0], *rows, plant) / 1e3
        last = w.state, w.stages, *rows, w.rail, plant, run.recording.cylinders
        period = find_shortest(repeat_period, begin, 4.0, *last) / 1e3
        sides = 4 * round(plant.period / dynamics.find_rates(*rows[:4], w.curve, 0.22, plant))
        line = {"axles": axles, "units": w.units.size, "right sides": sides * side}
        line |= {"steps": period - sides * side, "board, record": min(loops) - period}
        line |= {"instant": min(loops), "bytes": recorded.nbytes // run.ticks}
        lines.append(line | {"dataset, metrics [ms]": min(rest)})
    return pd.DataFrame(lines).round(1)


# a cluster on this machine

STUB = """
from alloc.evaluation.metrics import METRICS
from studies.files.scenario_files import load_scenario
from studies.runner.study import Cell, Study

def run(scenario, rule, controller, seed):
    return {name: (seed + 1) / 7.0 for name in METRICS} | {"rule_gap": 0.0}

def cells(events, seed):
    event = load_scenario("wet-patch")
    names = {"scenario": event.name, "rule": "alone", "controller": "none"}
    parts = event, "alone", "none"
    return [Cell(f"{event.name}/{k}", (*parts, k), names | {"seed": k}) for k in range(events)]

STUDY = Study("stub", "how many rows a scheduler can hand out", cells, run, lambda rows: rows)
"""
"""A study whose rows cost nothing, and are as wide as those of runs."""
ROWS = 100_000


@contextmanager
def start_cluster(folder: str, workers: int) -> Iterator[tuple[str, list[int]]]:
    """The file of a Dask scheduler with workers of one thread; its process, and theirs."""
    file, processes = f"{folder}/scheduler-{workers}.json", []
    for kind, *options in (
        ["scheduler", "--port", "0"],
        *[["worker", "--nthreads", "1", "--no-nanny"]] * workers,
    ):
        words = (
            sys.executable,
            "-m",
            "dask",
            kind,
            *options,
            "--scheduler-file",
            file,
            "--no-dashboard",
        )
        processes.append(subprocess.Popen([*words], stderr=subprocess.DEVNULL, cwd=folder))
    while not os.path.exists(file):
        time.sleep(0.1)
    try:
        yield file, [process.pid for process in processes]
    finally:
        for process in processes[::-1]:
            process.terminate()
            process.wait()


def count_cpu(process: int) -> float:
    """CPU seconds of a process, as Linux has them."""
    times = Path(f"/proc/{process}/stat").read_text().rpartition(")")[2].split()[11:13]
    return sum(map(int, times)) / os.sysconf("SC_CLK_TCK")


def cluster() -> pd.DataFrame:
    """Rows a second of a comparison by one and two workers, and of a study that computes nothing; who takes CPU."""
    names = "wet-patch", "wet-stop", "wet-start", "wet-front", "failed-unit", "uneven-load"
    scenarios = [load_scenario(name) for name in names]
    lines = []
    with TemporaryDirectory() as folder:
        Path(folder, "stub.py").write_text(STUB, "utf-8")
        stub, compared = (
            find_study(f"{folder}/stub.py"),
            make_study(choose_grid(scenarios, seeds=1)),
        )
        for study, workers, events in ((compared, 1, None), (compared, 2, None), (stub, 2, ROWS)):
            with start_cluster(folder, workers) as (file, processes):
                for warm in (True, False):
                    place = f"{folder}/{study.name}-{workers}-{warm}"
                    before, start = list(map(count_cpu, processes)), time.perf_counter()
                    own = time.process_time()
                    rows = run_study(
                        study, place, 16 if warm and events else events, scheduler=file
                    )
                    spent, own = time.perf_counter() - start, time.process_time() - own
                took = [
                    after - b for after, b in zip(map(count_cpu, processes), before, strict=True)
                ]
            per, size = 1e6 / len(rows), Path(place, "rows.jsonl").stat().st_size
            line = {"study": study.name, "workers": workers, "rows": len(rows), "seconds": spent}
            line |= {"rows a second": len(rows) / spent, "this program [us a row]": own * per}
            line |= {
                "scheduler [us a row]": took[0] * per,
                "workers [us a row]": sum(took[1:]) * per,
            }
            lines.append(line | {"bytes a row": size / len(rows)})
    return pd.DataFrame(lines).round(1)


TABLES_MADE = {"right-side": right_side, "instant": instant, "cluster": cluster}


def main() -> None:
    """Measure what is named, or all, print the tables, and keep them."""
    for name in sys.argv[1:] or TABLES_MADE:
        text = markdown_table(
            TABLES_MADE[name]()
            .astype(object)
            .map(lambda x: f"{x:g}" if isinstance(x, float) else x)
        )
        (TABLES / f"scaling-{name}.md").write_text(text, "utf-8")
        print(text, flush=True)


if __name__ == "__main__":
    main()
