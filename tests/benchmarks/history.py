"""Ratios of times that a change must not make worse, and their history in `docs/results/benchmarks.md`.

Every way is timed in turn with a yardstick, many short rounds, and the least of each counts: so both met the same machine,
and its quietest moment. A ratio is compared with the last one of the same processor.
"""

import platform
import time
from collections.abc import Callable, Mapping
from datetime import date
from importlib.metadata import version
from pathlib import Path

import pandas as pd

PAGE = Path(__file__).parents[2] / "docs" / "results" / "benchmarks.md"
COLUMNS = ["date", "processor", "versions", "way", "microseconds", "ratio"]
GROWTH = 1.2
"""A ratio may grow by this factor from one entry to the next."""


def least_times(ways: Mapping[str, Callable[[], object]], rounds: int) -> dict[str, float]:
    """Least time [s] of each way, called in turn `rounds` times after a call that does not count."""
    least = dict.fromkeys(ways, float("inf"))
    for way in ways.values():
        way()
    for _ in range(rounds):
        for name, way in ways.items():
            began = time.perf_counter()
            way()
            least[name] = min(least[name], time.perf_counter() - began)
    return least


def processor() -> str:
    """Name of this machine's processor."""
    path = Path("/proc/cpuinfo")
    lines = path.read_text().splitlines() if path.exists() else []
    names = [line.partition(":")[2].strip() for line in lines if line.startswith("model name")]
    return names[0] if names else platform.processor() or platform.machine()


def entries(times: Mapping[str, float], yardstick: str) -> pd.DataFrame:
    """The page's rows of today for these times [s]."""
    packages = " ".join(f"{name} {version(name)}" for name in ("numpy", "numba"))
    versions = f"Python {platform.python_version()} {packages}"
    today = [date.today().isoformat(), processor(), versions]
    rows = [
        [*today, name, round(1e6 * seconds, 2), float(f"{seconds / times[yardstick]:.4g}")]
        for name, seconds in times.items()
    ]
    return pd.DataFrame(rows, columns=COLUMNS)


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
