"""What the program costs: two checkouts side by side, in turn, by their public functions and commands.

    python tests/performance.py BASE [NEW]        make bench BASE=../other-checkout

CPU is user and system time, of commands that of all their processes. What is warm is called in two processes that live on
and are asked in turn, a command is run of one checkout and then of the other: so both see the same load. Medians of rounds;
the ratio is the median of the rounds' ratios. Lines are kept in docs/tables/performance-table.csv and .md.
"""

import argparse
import ctypes
import json
import os
import resource
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from functools import partial
from importlib.util import find_spec
from pathlib import Path
from statistics import median
from tempfile import TemporaryDirectory
from typing import Any

import pandas as pd

from studies.runner.rows import markdown_table

ROOT = Path(__file__).parents[1]
TABLE = ROOT / "docs" / "tables" / "performance-table.csv"
SERVE = "--serve"
"""Asks a process of this script to be a warm one."""
SUBREAPER = 36
"""Of prctl(2): processes whose parent has ended become children of this one, so that it can wait for them."""
FONTS = str(Path.home() / ".cache" / "matplotlib")
"""Matplotlib's own cache is no matter of an empty one."""
EVENT = "wet-patch"
ENOUGH = 0.3
"""CPU seconds for which a warm task is called again and again in a round."""


def make_tasks() -> dict[str, Callable[[], object]]:
    """What is called in a warm process, by name."""
    import readhesion

    event = readhesion.load_scenario(EVENT).event(0)
    share, control = readhesion.RULES["cooperative"], readhesion.CONTROLLERS["cut-and-ramp"]
    own_rule = replace(share, name="own", share=share.share.py_func)
    own_controller = replace(control, name="own", control=control.control.py_func)
    run = readhesion.simulate(event)
    tasks: dict[str, Callable[[], object]] = {
        "run, compiled": lambda: readhesion.simulate(event, share, control),
        "run, rule qp": lambda: readhesion.simulate(event, "qp", control),
        "run, rule in Python": lambda: readhesion.simulate(event, own_rule, control),
        "run, controller in Python": lambda: readhesion.simulate(event, share, own_controller),
        "evaluate": lambda: readhesion.evaluate(run),
    }
    if find_spec("gymnasium"):
        from studies.gymnasium_environment import ReadhesionEnvironment

        environment = ReadhesionEnvironment(EVENT)

        def play() -> None:
            _, info = environment.reset(options={"event_seed": 0})
            ended = False
            while not ended:
                *_, ended, info = environment.step(info["others"])

        tasks["episode of gymnasium"] = play
    return tasks


def serve_tasks() -> None:
    """Answer names of tasks with CPU seconds a call, until there is no further."""
    tasks = make_tasks()
    for task in tasks.values():
        task()
    print(json.dumps([*tasks]), flush=True)
    for line in sys.stdin:
        task, calls, start = tasks[line.strip()], 0, time.process_time()
        while calls == 0 or time.process_time() - start < ENOUGH:
            task()
            calls += 1
        print((time.process_time() - start) / calls, flush=True)


COMPILE = """
import readhesion
event = readhesion.load_scenario("wet-patch").changed(duration_s=0.2).event(0)
for name, rule in readhesion.RULES.items():
    if hasattr(rule.share, "py_func"):
        run = readhesion.simulate(event, name, "none")
for name in readhesion.CONTROLLERS:
    run = readhesion.simulate(event, "alone", name)
readhesion.evaluate(run)
"""
"""All that is compiled: every compiled rule and every controller for a few periods, and the metrics."""
FILES = {
    "own.py": """
from dataclasses import replace
from alloc.rules import RULES
rule = RULES["cooperative"]
RULES.register("own", replace(rule, name="own", share=rule.share.py_func))
""",
    "memory.py": """
import resource
from alloc.evaluation.metrics import metric
@metric("memory", "1")
def measure_memory(run):
    "Most memory of the process until now, in pages of the system's count."
    return resource.getrusage(resource.RUSAGE_SELF).ru_maxrss
""",
}
"""Plug-ins beside which commands are run: a rule in Python; the memory of workers."""
Words = tuple[str, ...]
COMPARE: Words = ("-m", "readhesion", "compare", "--seeds", "1", "--scenario", EVENT)
RANK: Words = ("-m", "readhesion", "rank", "--events", "40", "--jobs", "1")
MEMORY: Words = (*COMPARE, "--plugin", "memory.py", "--jobs", "2", "--json")
COMMANDS: dict[str, tuple[Words, bool]] = {
    "all code, compiled from an empty cache": (("-c", COMPILE), True),
    "compare, 2 events": ((*COMPARE, "wet-stop", "--jobs", "1"), False),
    "compare, 2 events, empty cache, 2 processes": ((*COMPARE, "wet-stop", "--jobs", "2"), True),
    "rank, 40 events": ((*RANK, "cooperative"), False),
    "rank, 40 events, rule in Python": ((*RANK, "own.py"), False),
    "simulate": (("-m", "readhesion", "simulate", EVENT), False),
    "memory of a worker [MB]": (MEMORY, False),
}
"""What Python is asked for, and whether the cache of compiled code is empty."""
LONG: dict[str, tuple[Words, bool]] = {
    "whole compare, empty cache, 2 processes": (("-m", "readhesion", "compare", "--jobs", "2"), True),
    "tests": (("-m", "pytest", "-q", "-n", "2"), False),
}  # fmt: skip
"""The same, measured once, and where it is named."""


def measure_command(words: Words, checkout: Path, empty: bool) -> float:
    """CPU seconds of Python asked for `words`, and of all processes that come of it; or most memory of a worker [MB]."""
    before = count_cpu()
    with TemporaryDirectory() as folder:
        places = {"XDG_CACHE_HOME": folder} if empty else {}
        for file, text in FILES.items():
            Path(folder, file).write_text(text, "utf-8")
        place = checkout if "pytest" in words else folder
        command = [sys.executable, *words]
        variables = environment(checkout) | places
        result = subprocess.run(command, cwd=place, env=variables, capture_output=True, text=True)
        if result.returncode:
            sys.exit(f"{checkout}: {words[:4]}: {(result.stderr or result.stdout)[-2000:]}")
        with suppress(ChildProcessError):
            while True:  # workers whose parent ended before them
                os.wait()
    if words == MEMORY:
        rows = json.loads(result.stdout)["rows"]
        return max(row["metrics"]["memory"]["mean"] for row in rows) / 1024.0
    return count_cpu() - before


def count_cpu() -> float:
    """CPU seconds of all processes that were waited for."""
    usage = resource.getrusage(resource.RUSAGE_CHILDREN)
    return usage.ru_utime + usage.ru_stime


def environment(checkout: Path) -> dict[str, str]:
    """Variables of a process that uses a checkout; it keeps byte-code, as an installed program has it."""
    usual = {key: x for key, x in os.environ.items() if key != "PYTHONDONTWRITEBYTECODE"}
    places = {"PYTHONPATH": str(checkout), "MPLCONFIGDIR": FONTS}
    return usual | places | {"OPENBLAS_NUM_THREADS": "1"}


Measure = Callable[[Path], float]


def measure_task(name: str, measure: Measure, checkouts: Sequence[Path], rounds: int) -> None:
    """Measure a task in both checkouts in turn, print its line, and keep it."""
    figures = []
    for k in range(rounds):
        order = checkouts if k % 2 else checkouts[::-1]
        costs = {checkout: measure(checkout) for checkout in order}
        figures.append([costs[checkout] for checkout in checkouts])
    base, new = (median(costs) for costs in zip(*figures, strict=True))
    ratio = median(costs[1] / costs[0] for costs in figures)
    table = pd.read_csv(TABLE, index_col=0, dtype=str) if TABLE.exists() else pd.DataFrame()
    line = {"base": f"{base:.3g}", "new": f"{new:.3g}", "ratio": f"{ratio:.2f}"}
    table = pd.concat([table.drop(index=name, errors="ignore"), pd.DataFrame(line, [name])])
    table.rename_axis("task").to_csv(TABLE)
    TABLE.with_suffix(".md").write_text(markdown_table(table.reset_index(names="task")), "utf-8")
    print(f"{name:46}", *(f"{text:>9}" for text in line.values()), flush=True)


def measure_tasks(checkouts: Sequence[Path], only: str, rounds: int) -> None:
    """First commands, then what is called in processes that are warm."""
    for checkout in checkouts:
        measure_command(("-c", COMPILE), checkout, False)
    for name, (words, empty) in {**COMMANDS, **LONG}.items():
        if only in name if only else name in COMMANDS:
            measure = partial(measure_command, words, empty=empty)
            measure_task(name, measure, checkouts, 1 if name in LONG else rounds)
    pipes: Any = {"stdin": subprocess.PIPE, "stdout": subprocess.PIPE, "text": True}
    words = [sys.executable, "-P", __file__, SERVE]
    servers = {
        checkout: subprocess.Popen(words, env=environment(checkout), **pipes)
        for checkout in checkouts
    }
    names = [json.loads(server.stdout.readline()) for server in servers.values()]
    for name in names[0]:
        if only in name and name in names[1]:

            def ask(checkout: Path, name: str = name) -> float:
                server = servers[checkout]
                server.stdin.write(f"{name}\n")
                server.stdin.flush()
                return float(server.stdout.readline())

            measure_task(name, ask, checkouts, rounds)
    for server in servers.values():
        server.communicate()


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument("base", type=Path, help="checkout that costs are compared with")
    parser.add_argument("new", type=Path, nargs="?", default=ROOT, help="another [default: this]")
    parser.add_argument("--only", default="", help="tasks with this in their names, long ones too")
    parser.add_argument("--rounds", type=int, default=5)
    options = parser.parse_args()
    checkouts = [options.base.resolve(), options.new.resolve()]
    if sys.platform == "linux":
        ctypes.CDLL(None).prctl(SUBREAPER, 1, 0, 0, 0)
    print(f"{'CPU [s]':46}", *(f"{text:>9}" for text in ("base", "new", "ratio")))
    measure_tasks(checkouts, options.only, options.rounds)


if __name__ == "__main__":
    serve_tasks() if sys.argv[1:] == [SERVE] else main()
