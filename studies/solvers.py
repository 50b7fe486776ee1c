"""Solvers on trial: the patent's allocation problem for every QP solver within reach, beside the exact level in fractions.

    minimise  1/2 sum m (x - plan)^2    subject to  sum m x = ask,  lower <= x <= upper

It is handed over as it stands, not scaled. A solver works in a process of its own: a hang or a crash is a row too.
``solvers.csv`` has the tolerances as each solver names them, and its distribution.
"""

import multiprocessing
import os
import signal
from bisect import bisect_right
from collections.abc import Callable, Iterator
from contextlib import suppress
from fractions import Fraction
from importlib.metadata import version
from itertools import product
from pathlib import Path
from timeit import default_timer, repeat
from typing import Any

import numpy as np
import pandas as pd

from alloc.rules.exact import level_between
from studies import StudyError
from studies.core import NARROW, Cell, Row, Study, in_one_line

PLAN, SIZES, LIMIT = 0.17, (2, 3, 4, 6, 8, 12, 16, 32, 64, 128, 512), 60.0
"""Coefficient of the plan; numbers of units; seconds after which a solver hangs."""
SETTINGS = {"default": 1e-3, "tight": 1e-5}
"""Distance over the plan up to which "solved" is true: the loosest default tolerance of all (OSQP), and the root of the
tight one, as the objective goes with the square of a distance."""
SOLVERS = pd.read_csv(Path(__file__).with_name("solvers.csv"), index_col=0, keep_default_na=False)
TOLERANCE, ITERATIONS = 1e-10, 20000
"""What is tight: the least that HiGHS accepts; for solvers that would stop before, iterations."""
Program = tuple[Any, float, Any, Any]
"""Masses (n,), the ask, lower and upper bounds (n,)."""
Adapter = Callable[[str, Program, Row], Iterator[tuple[Any, str]]]
"""Of a solver, a program and options; yields when it has built, and again x, or None, with the verdict."""
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

    def total(level: Fraction) -> Any:
        return sum(m * min(max(level, low), high) for m, low, high in units)

    k = bisect_right(ends, ask, key=total)
    if k == 0 or total(ends[-1]) < ask:
        return np.full(len(units), np.nan)
    start, end = ends[k - 1], ends[min(k, len(ends) - 1)]
    level = start + (ask - total(start)) * (end - start) / (total(end) - total(start) or 1)
    return np.array([float(min(max(level, low), high)) for _, low, high in units])


def by_casadi(solver: str, program: Program, options: Row) -> Iterator[tuple[Any, str]]:
    """A plugin of `conic`, which raises where it fails, or ipopt by `nlpsol`, which does not."""
    import casadi

    mass, ask, lower, upper = program
    h, a, x = casadi.diag(casadi.DM(mass)), casadi.DM(mass).T, casadi.SX.sym("x", mass.size)
    values: Row = {"lbx": lower, "ubx": upper}
    if solver == "ipopt":
        problem = {"x": x, "f": a @ (x - PLAN) ** 2 / 2.0, "g": a @ x}
        function = casadi.nlpsol("f", solver, problem, {solver: options})
        values |= {"lbg": ask, "ubg": ask}
    else:
        nested = options if solver in ("ipqp", "qpoases", "qrqp") else {solver: options}
        function = casadi.conic("f", solver, {"h": h.sparsity(), "a": a.sparsity()}, nested)
        values |= {"h": h, "g": -PLAN * mass, "a": a, "lba": ask, "uba": ask}
    yield None, "built"
    result = None
    with suppress(RuntimeError):
        result = function(**values)["x"].full()
    stats = function.stats()
    status = f"{stats['unified_return_status']} {stats.get('return_status', '')}"
    yield result, "solved" if stats["success"] else status


def by_qpsolvers(solver: str, program: Program, options: Row) -> Iterator[tuple[Any, str]]:
    """`solve_problem`, which has one word for all that fails."""
    import qpsolvers
    from scipy import sparse

    mass, ask, *bounds = program
    P, A = sparse.diags(mass, format="csc"), sparse.csc_matrix(mass[None])
    if solver not in qpsolvers.sparse_solvers:
        P, A = P.toarray(), A.toarray()
    problem = qpsolvers.Problem(P, -PLAN * mass, None, None, A, np.array([ask]), *bounds)
    yield None, "built"
    solution = qpsolvers.solve_problem(problem, solver, **options)
    yield solution.x, "solved" if solution.found else "not found"


def by_cvxpy(solver: str, program: Program, options: Row) -> Iterator[tuple[Any, str]]:
    """A problem that has been canonised when it is built."""
    import cvxpy as cp

    mass, ask, lower, upper = program
    x = cp.Variable(mass.size)
    bounds = [mass @ x == ask, lower <= x, x <= upper]
    problem = cp.Problem(cp.Minimize(mass @ (x - PLAN) ** 2 / 2.0), bounds)
    problem.get_problem_data(solver, solver_opts=options)
    yield None, "built"
    problem.solve(solver=solver, **options)
    yield x.value, "solved" if problem.status == "optimal" else problem.status


ADAPTERS: dict[str, Adapter] = {"casadi": by_casadi, "qpsolvers": by_qpsolvers, "cvxpy": by_cvxpy}


def trial(adapter: Adapter, solver: str, task: Row) -> Row:
    """What a solver says of a problem and gives for it, beside the optimum; times [s]."""
    program = mass, ask, lower, upper = draw(**task)
    tight = task["setting"] == "tight" and solver.lower() in SOLVERS.index
    names = SOLVERS.loc[solver.lower(), "tolerances"].split() if tight else ()
    options = {name: ITERATIONS if "iter" in name else TOLERANCE for name in names}
    row, x, start = dict(task), None, default_timer()
    try:
        steps = [(*step, default_timer()) for step in adapter(solver, program, options)]
        (*_, built), (x, row["verdict"], end) = steps
        row |= {"build": built - start, "time": end - built}
    except Exception as error:
        row["verdict"] = in_one_line(error)[:99]
    x = np.ravel(np.array(x, float))
    row["numbers"] = bool(np.isfinite(x).all())
    row["distance"] = np.max(np.abs(x - exact_limits(program))) / PLAN
    row["violation"] = max(abs(np.sum(mass * x) / ask - 1.0), np.max([lower - x, x - upper]) / PLAN)
    exact = repeat(lambda: level_between(lower, upper, mass, ask / mass.sum()), number=1, repeat=9)
    row["exact"] = min(exact)
    return row


def work(pipe: Any, adapter: Adapter, solver: str, tasks: list[Row], limit: float) -> None:
    """Send a row of each task, from a process that an alarm kills where one takes longer than `limit` [s]."""
    for stream in (1, 2):
        os.dup2(os.open(os.devnull, os.O_WRONLY), stream)  # solvers print
    for task in tasks:
        signal.setitimer(signal.ITIMER_REAL, limit)
        pipe.send(trial(adapter, solver, task))


def tried(adapter: Adapter, solver: str, tasks: list[Row], limit: float = LIMIT) -> list[Row]:
    """A row of each task; after a hang or a crash, of those of other families and settings."""
    rows, left, apart = list[Row](), [*tasks], multiprocessing.get_context("forkserver")
    apart.set_forkserver_preload(["studies.solvers"])
    while left:
        here, there = apart.Pipe(duplex=False)
        child = apart.Process(target=work, args=(there, adapter, solver, left, limit))
        child.start()
        there.close()
        try:
            while left:
                rows.append(here.recv())
                del left[0]
        except EOFError:
            child.join()
            end = "hangs" if child.exitcode == -signal.SIGALRM else "crashes"
            rows.append(left[0] | {"verdict": end, "numbers": False})
            keys = [(task["setting"], task["family"]) for task in left]
            left = [task for task, key in zip(left, keys, strict=True) if key != keys[0]]
        finally:
            child.kill()
            child.join()
    return rows


def cells(events: int, seed: int) -> list[Cell]:
    """Every solver of the list that a library says it has, over each event."""
    import casadi
    import cvxpy

    try:
        import qpsolvers
    except ImportError:
        raise StudyError("qpsolvers is not installed: pip install -e '.[solvers]'") from None
    plugins = [name for name in SOLVERS.index if name == "ipopt" or casadi.has_conic(name)]
    installed, several = (plugins, qpsolvers.available_solvers, cvxpy.installed_solvers()), []
    for event, (library, names) in product(range(events), zip(ADAPTERS, installed, strict=True)):
        for name in (name for name in names if name.lower() in SOLVERS.index):
            package, by = SOLVERS.loc[name.lower(), "package"], f"{library} {version(library)}"
            label = name if library == "casadi" else f"{name} {version(package)}"
            args = (library, name, f"{label} {by}", event, seed)
            several.append(Cell(f"{library}/{name}/{event}", args, {"solver": label, "by": by}))
    return several


def run(library: str, solver: str, versions: str, event: int, seed: int) -> list[Row]:
    """All families at all sizes, and again with tight tolerances where the solver has any."""
    settings = [*SETTINGS] if SOLVERS.loc[solver.lower(), "tolerances"] else ["default"]
    tasks = product(settings, FAMILIES, SIZES, [event], [seed])
    keys = ("setting", "family", "n", "event", "seed")
    return tried(ADAPTERS[library], solver, [dict(zip(keys, task, strict=True)) for task in tasks])


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


COLOURS = {"casadi": "#d55e00", "qpsolvers": "#0072b2", "cvxpy": "#009e73"}


def figure(rows: pd.DataFrame) -> Any:
    """Worst distance of each solver, from default to tight tolerances, and time; hollow where it was wrong."""
    from matplotlib.figure import Figure  # two seconds that no solver needs

    lines = table(rows).astype({"distance": float, "time": float})
    groups = [part for _, part in lines.groupby(["by", "solver"])]
    groups.sort(key=lambda part: tuple(-part["distance"].iloc[[-1, 0]]))
    drawn = Figure(figsize=(NARROW, 5.2), layout="constrained")
    left, right = drawn.subplots(1, 2, sharey=True, width_ratios=(3, 2))
    for y, part in enumerate(groups):
        library, solver = (part[name].iloc[0].split()[0] for name in ("by", "solver"))
        look, colour = {"arrowstyle": "->", "shrinkA": 0.0, "shrinkB": 0.0}, COLOURS[library]
        start, end = part["distance"].iloc[[0, -1]]
        left.annotate("", (end, y), (start, y), arrowprops=look | {"color": colour})
        place = {"transform": left.get_yaxis_transform(), "ha": "right", "va": "center"}
        left.text(-0.05, y, solver.lower(), color=colour, **place)
        for axes, name in ((left, "distance"), (right, "time")):
            filling = np.where(part["wrong [%]"] > 0, "white", colour)
            axes.scatter(part[name], [y] * len(part), 12.0, filling, edgecolors=colour, zorder=3)
    left.set(
        xscale="log", xlabel="worst distance over\nthe plan [1]", yticks=[], ylim=(-1, len(groups))
    )
    right.set(xscale="log", xlabel="time over the\nexact level's [1]")
    for name, colour in COLOURS.items():
        left.scatter([], [], 12.0, colour, label=name)
    left.scatter([], [], 12.0, "white", edgecolors="black", label="says solved, is not")
    drawn.legend(loc="outside upper center", ncols=2)
    return drawn


QUESTION = "How far from the exact level are QP solvers, and is what they say true?"
STUDY = Study("solvers", QUESTION, cells, run, table, figure, events=1, seed=5)
