"""Ratios of times that a change must not make worse, and their history in `docs/results/benchmarks.md`.

A ratio is processor time over that of a yardstick: a fixed compiled loop of floating-point work in the same process. Both
are called in turn, many short rounds, and the least of each counts: so both met the same machine, and its quietest moment.
The median of quotients was tried: beside other work it scatters by 25 %. A ratio is compared with the last one of the same
processor.
"""

import platform
import time
from collections.abc import Callable, Mapping
from datetime import date
from importlib.metadata import version
from pathlib import Path

import numpy as np
import pandas as pd

from alloc.compilation import jit

PAGE = Path(__file__).parents[2] / "docs" / "results" / "benchmarks.md"
COLUMNS = ["date", "processor", "versions", "way", "microseconds", "ratio"]
GROWTH = 1.2
"""A ratio may grow by this factor from one entry to the next."""
SECONDS = 2e-3
"""A way is called so often in a round that it takes at least this long [s]; the clock and the cache count little."""


@jit
def yardstick(values: np.ndarray, steps: int) -> None:
    """Steps of explicit Euler for x' = -x / (1 + x^2), each number by itself: vectors, divisions, no memory to wait for."""
    for _ in range(steps):
        for k in range(values.size):
            values[k] -= 1e-3 * values[k] / (1.0 + values[k] * values[k])


def _measure() -> None:
    yardstick(np.ones(64), 10_000)


def _taken(call: Callable[[], object], times: int = 1) -> float:
    began = time.process_time()
    for _ in range(times):
        call()
    return (time.process_time() - began) / times


def ratios(ways: Mapping[str, Callable[[], object]], rounds: int) -> pd.DataFrame:
    """Of each way, taken in turn with the yardstick, the least processor time [us] and its `ratio` to the yardstick's."""
    _measure()
    often, least = {}, dict.fromkeys(ways, float("inf"))
    for name, way in ways.items():
        way()
        often[name] = 1 + int(SECONDS / max(_taken(way), 1e-7))
    unit = float("inf")
    for _ in range(rounds):
        for name, way in ways.items():
            unit = min(unit, _taken(_measure))
            least[name] = min(least[name], _taken(way, often[name]))
    rows = [(name, 1e6 * seconds, seconds / unit) for name, seconds in least.items()]
    return pd.DataFrame(rows, columns=["way", "microseconds", "ratio"])


def processor() -> str:
    """Name of this machine's processor."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def entries(found: pd.DataFrame) -> pd.DataFrame:
    """The page's rows of today for what `ratios` found."""
    packages = " ".join(f"{name} {version(name)}" for name in ("numpy", "numba"))
    versions = f"Python {platform.python_version()} {packages}"
    rounded = {
        "microseconds": found["microseconds"].round(2),
        "ratio": [float(f"{one:.4g}") for one in found["ratio"]],
    }
    today = {"date": date.today().isoformat(), "processor": processor(), "versions": versions}
    return found.assign(**rounded, **today)[COLUMNS]


def stored() -> pd.DataFrame:
    """The table of the page as it stands."""
    lines = [line for line in PAGE.read_text().splitlines() if line.startswith("|")][2:]
    rows = [[cell.strip() for cell in line.strip("|").split("|")] for line in lines]
    return pd.DataFrame(rows, columns=COLUMNS).astype({"microseconds": float, "ratio": float})


def grown(now: pd.DataFrame, before: pd.DataFrame) -> list[str]:
    """What became slower by more than `GROWTH`, in words; none for ways or processors without an entry."""
    mine = before[before["processor"] == processor()]
    last = mine.groupby("way")["ratio"].last()
    return [
        f"{row.way}: {row.ratio:.4g} of the yardstick, {last[row.way]:.4g} before"
        for row in now.itertuples()
        if row.way in last.index and row.ratio > GROWTH * last[row.way]
    ]


def keep(now: pd.DataFrame) -> None:
    """Add rows to the end of the page."""
    with PAGE.open("a") as page:
        for row in now.to_numpy().tolist():
            page.write(f"| {' | '.join(map(str, row))} |\n")
