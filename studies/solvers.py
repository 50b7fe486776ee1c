"""Solvers on trial: the patent's allocation problem for every QP solver within reach, beside the exact level in fractions.

    minimise  1/2 sum m (x - plan)^2    subject to  sum m x = ask,  lower <= x <= upper

A solver works in a process of its own: a hang or a crash is a row too. `studies.solver_adapters` asks it.
"""

import multiprocessing
import os
import signal
from bisect import bisect_right
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from contextlib import suppress
from fractions import Fraction
from importlib.metadata import version
from itertools import product
from timeit import default_timer, repeat
from typing import Any

import numpy as np
import pandas as pd

from alloc.rules.exact import level_between
from studies.runner.study import Cell, Row, Study
from studies.runner.workers import begin_worker, describe_error
from studies.solver_adapters import ADAPTERS, PLAN, SOLVERS, Adapter, Program, find_solvers

SIZES, LIMIT = (2, 3, 4, 6, 8, 12, 16, 32, 64, 128, 512), 60.0
"""Numbers of units; seconds after which a solver hangs."""
SETTINGS = {"default": 1e-3, "tight": 1e-5}
"""Distance over the plan up to which "solved" is true: the loosest default tolerance of all (OSQP), and the root of the
tight one, as the objective goes with the square of a distance."""
TOLERANCE, ITERATIONS = 1e-10, 20000
"""What is tight: the least that HiGHS accepts; for solvers that would stop before, iterations."""
FAMILIES: dict[str, Callable[[np.random.Generator, int], Row]] = {
    "plain": lambda rng, n: {"mass": rng.uniform(0.5, 2.0, n)},
    "growing": lambda rng, n: {"cap": np.sort(rng.uniform(0.2, 1.8, n))},
    "ties": lambda rng, n: {"cap": rng.choice([0.6, 0.9, 1.2], n)},
    "pinned": lambda rng, n: {"cap": np.sort(rng.uniform(0.2, 1.8, n)), "pinned": 0.3},
    "zero caps": lambda rng, n: {"cap": rng.uniform(0.2, 1.8, n) * (np.arange(n) % 3 > 0)},
    "masses to 1000:1": lambda rng, n: {"mass": 10.0 ** rng.uniform(0.0, 3.0, n)},
    "near ties": lambda rng, n: {"room": 10.0 ** rng.uniform(-10.0, -7.0)},
    "infeasible": lambda rng, n: {"room": -1.0 / (1.0 + 10.0 ** rng.uniform(-2.0, 2.0))},
}
"""What differs from equal masses, caps in any order, `room` of their mean above the plan, and no share of units `pinned`
between bounds that meet."""


def draw(family: str, n: int, event: int, seed: int, **_: Any) -> Program:
    """A problem of a family."""
    rng = np.random.default_rng([seed, event, n, *family.encode()])
    drawn = FAMILIES[family](rng, n)
    mass, cap = drawn.get("mass", np.ones(n)), drawn.get("cap", rng.uniform(0.2, 1.8, n))
    room, pinned = drawn.get("room", rng.uniform(0.05, 0.5)), drawn.get("pinned", 0.0)
    upper = cap * ((1.0 + room) * PLAN * mass.sum() / (mass @ cap))
    return mass, PLAN * float(mass.sum()), upper * (np.arange(n) < pinned * n), upper


def exact_limits(program: Program) -> Any:
    """The optimum (n,), by fractions of a program's very doubles; nan where there is none."""
    mass, (ask,), *bounds = ([*map(Fraction, np.ravel(part).tolist())] for part in program)
    units, ends = [*zip(mass, *bounds, strict=True)], sorted({*bounds[0], *bounds[1]})

    def limits_at(level: Fraction) -> list[Fraction]:
        return [min(max(level, low), high) for _, low, high in units]

    def total_at(level: Fraction) -> Any:
        return sum(m * x for m, x in zip(mass, limits_at(level), strict=True))

    k = bisect_right(ends, ask, key=total_at)
    if k == 0 or total_at(ends[-1]) < ask:
        return np.full(len(units), np.nan)
    start, end = ends[k - 1], ends[min(k, len(ends) - 1)]
    share = (ask - total_at(start)) / (total_at(end) - total_at(start) or 1)
    return np.array(limits_at(start + share * (end - start)), dtype=float)


def try_problem(adapter: Adapter, solver: str, task: Row, limit: float) -> Row:
    """What a solver says and gives, beside the optimum; times [s]. An alarm ends the process after `limit` [s]."""
    signal.setitimer(signal.ITIMER_REAL, limit)
    program = mass, ask, lower, upper = draw(**task)
    tight = task["setting"] == "tight" and solver.lower() in SOLVERS.index
    names = SOLVERS.loc[solver.lower(), "tolerances"].split() if tight else ()
    options = {name: ITERATIONS if "iter" in name else TOLERANCE for name in names}
    row, x, start = dict(task), None, default_timer()
    try:
        (*_, built), (x, row["verdict"], end) = (
            (*step, default_timer()) for step in adapter(solver, program, options)
        )
        row |= {"build": built - start, "time": end - built}
    except Exception as error:
        row["verdict"] = describe_error(error)[:99]
    x = np.ravel(np.array(x, float))
    missed = abs(np.sum(mass * x) / ask - 1.0), np.max([lower - x, x - upper]) / PLAN
    row |= {"numbers": bool(np.isfinite(x).all()), "violation": max(missed)}
    row["distance"] = np.max(np.abs(x - exact_limits(program))) / PLAN
    exact = repeat(lambda: level_between(lower, upper, mass, ask / mass.sum()), number=1, repeat=9)
    return row | {"exact": min(exact)}


def begin_quietly() -> None:
    """Begin a process that ends with its parent, and whose solvers print to nowhere."""
    begin_worker()
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)


def try_solver(adapter: Adapter, solver: str, tasks: list[Row], limit: float = LIMIT) -> list[Row]:
    """A row of each task; after a hang or a crash, of those of other families and settings."""
    rows, left, apart = list[Row](), [*tasks], multiprocessing.get_context("forkserver")
    while left:
        with ProcessPoolExecutor(1, apart, begin_quietly) as pool, suppress(BrokenProcessPool):
            while left:
                started = default_timer()
                rows.append(pool.submit(try_problem, adapter, solver, left[0], limit).result())
                del left[0]
        if left:
            end = "hangs" if default_timer() - started >= limit else "crashes"
            rows.append(left[0] | {"verdict": end, "numbers": False})
            lost = {key: left[0][key] for key in ("setting", "family")}
            left = [task for task in left if not lost.items() <= task.items()]
    return rows


def cells(events: int, seed: int) -> list[Cell]:
    """Every solver of the list that a library says it has, over each event."""
    cells = []
    for event, (library, name) in product(range(events), find_solvers()):
        package = SOLVERS.loc[name.lower(), "package"] if library != "casadi" else ""
        label = f"{name} {package and version(package)}".strip()
        by = f"{library} {version(library)}"
        args = library, name, f"{label} {by}", event, seed
        cells.append(Cell(f"{library}/{name}/{event}", args, {"solver": label, "by": by}))
    return cells


def run(library: str, solver: str, versions: str, event: int, seed: int) -> list[Row]:
    """All families at all sizes, and again with tight tolerances where the solver has any."""
    settings = [*SETTINGS] if SOLVERS.loc[solver.lower(), "tolerances"] else ["default"]
    tasks = product(settings, FAMILIES, SIZES, [event], [seed])
    keys = ("setting", "family", "n", "event", "seed")
    rows = [dict(zip(keys, task, strict=True)) for task in tasks]
    return try_solver(ADAPTERS[library], solver, rows)


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """By solver and setting: worst numbers where it says solved, shares of verdicts, times over the exact level's.

    Failed are shares of feasible problems, unknown and numbers of infeasible ones; docs/solvers.md explains the columns.
    """
    lines = list[Row]()
    for key, part in rows.groupby(["solver", "by", "setting"], sort=False):
        solved, feasible = part["verdict"] == "solved", part["family"] != "infeasible"
        refused, named = ~solved[~feasible], part["verdict"].str.contains("infeas", case=False)
        shares = {
            "wrong [%]": solved & ~(part["distance"] <= SETTINGS[key[2]]),
            "failed [%]": ~solved[feasible],
            "unknown [%]": refused & ~named[~feasible],
            "numbers [%]": refused & part.loc[~feasible, "numbers"],
        }
        line: Row = dict(zip(("solver", "by", "setting"), key, strict=True))
        line |= {name: f"{part.loc[solved, name].max():.0e}" for name in ("distance", "violation")}
        line |= {name: round(100.0 * share.mean()) for name, share in shares.items()}
        line |= {name: f"{(part[name] / part['exact']).median():.0f}" for name in ("build", "time")}
        ends = sorted({"hangs", "crashes"} & {*part["verdict"]})
        lines.append(line | {"ends": ", ".join(ends)})
    shown = pd.DataFrame(lines)
    return shown.loc[:, (shown != "").any()]


QUESTION = "How far from the exact level are QP solvers, and is what they say true?"
STUDY = Study("solvers", QUESTION, cells, run, table, events=1, seed=5)
