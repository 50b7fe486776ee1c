"""Stores of several folders united in one: what jobs on many machines computed apart."""

import re
import shutil
from collections.abc import Iterator, Sequence
from contextlib import suppress
from pathlib import Path
from typing import NamedTuple
from warnings import warn

import numpy as np
import pandas as pd
import pyarrow.compute as pc

from alloc.sources import write_whole
from studies.core.checked_file import DIGITS, Gone, StoreWarning, read_checked
from studies.core.claims import FOLDER
from studies.core.parts import NAME, Parts
from studies.core.single_table import TABLE, take_over
from studies.core.store import ROWS, RUNS, Store
from studies.files.study_error import StudyError

MEASURED = ("wall_time", "solve_time", "rule_time", "controller_time", "controller_median", "controller_p99",
            "computing")  # fmt: skip
"""Columns, by their beginning, that are times of computing: another computation of the same has others."""
AT_ONCE = 20_000
"""Cells compared at once."""
CHECKED_RUN = re.compile(rf".*-[0-9a-f]{{{DIGITS}}}\.nc")


class Counts(NamedTuple):
    """Content of a folder in all its stores after a union."""

    cells: int
    runs: int


def unite(folders: Sequence[Path], out: Path) -> Counts:
    """Copy the tables and recorded runs of `folders`, and of all folders in them, to `out`.

    If rows of a cell differ, except for computing times, a `StoreWarning` is given; the rows that were added later count.
    Raises `StudyError` for a folder without a table.
    """
    found = {folder: sorted(_stores(folder)) for folder in folders}
    for folder, stores in found.items():
        # a folder without a file may be of a share without events
        if not stores and (not any(found.values()) or any(map(Path.is_file, folder.rglob("*")))):
            raise StudyError(
                f"folder {str(folder)!r} holds no table of a study; give an --out of before"
            )
    targets: dict[Path, Store] = {}
    for folder, stores in found.items():
        for place in stores:
            inside = place.relative_to(folder)
            target = targets.setdefault(inside, Store(out / inside))
            if target.folder.resolve() != place.resolve():
                _take(place, target)
    runs = sum(len(list((store.folder / RUNS).rglob("*.nc"))) for store in targets.values())
    return Counts(sum(len(store.cells()) for store in targets.values()), runs)


def _stores(folder: Path) -> Iterator[Path]:
    """Folders with a table: `folder` itself, or those in it."""
    yield from {path.parent for path in folder.rglob(TABLE)} | {
        path.parent for path in folder.rglob(ROWS) if any(map(NAME.fullmatch, (one.name for one in path.glob("*"))))
    }  # fmt: skip


def _take(place: Path, target: Store) -> None:
    source = Parts(place / ROWS)
    if (place / TABLE).exists():
        take_over(place, source)
    _compare(source, target.parts)
    while True:
        with suppress(Gone):  # else its owner works on, and has joined files meanwhile
            for name in source.index().names:
                _copy(place / ROWS / name, target.path / name)
            break
    for path in (place / RUNS).rglob("*.nc"):
        if CHECKED_RUN.fullmatch(path.name):
            with suppress(Gone):
                _copy(path, target.folder / path.relative_to(place))
    for path in (place / FOLDER).glob("*.json"):
        kept = target.folder / path.relative_to(place)
        kept.parent.mkdir(exist_ok=True)
        if not kept.exists():
            shutil.copyfile(path, kept)


def _copy(source: Path, target: Path) -> None:
    content = read_checked(source)
    if not target.exists():
        target.parent.mkdir(parents=True, exist_ok=True)
        write_whole(target, lambda aside: aside.write_bytes(content))


def _compare(source: Parts, target: Parts) -> None:
    """Warn where rows of a cell differ that both hold."""
    mine, other = target.index(), source.index()
    both = other.cell.filter(pc.is_in(other.cell, mine.cell)).unique().to_pylist()
    differing, first = 0, ""
    for start in range(0, len(both), AT_ONCE):
        cells = both[start : start + AT_ONCE]
        bad, words = _differences(target.rows_of(cells), source.rows_of(cells))
        differing, first = differing + bad, first or words
    if differing:
        warn(
            f"{differing} cells have other rows in {str(source.folder)!r} than in {str(target.folder)!r}: {first}; "
            "the rows that were added later count",
            StoreWarning,
            stacklevel=4,
        )


def _differences(mine: pd.DataFrame, other: pd.DataFrame) -> tuple[int, str]:
    """Cells whose rows differ, and the first of them in words; both tables hold the same cells in the same order."""
    counts = mine["cell"].value_counts() - other["cell"].value_counts()
    uneven = sorted(counts.index[counts != 0])
    one, two = (
        rows[~rows["cell"].isin(uneven)].reset_index(drop=True).astype(object)
        for rows in (mine, other)
    )
    two = two.reindex(columns=[*one, *two.columns.difference(one.columns)])
    one = one.reindex(columns=two.columns)
    compared = [name for name in two if not str(name).startswith(MEASURED)]
    differ = ~((one == two) | (one.isna() & two.isna()))[compared]
    bad = np.flatnonzero(differ.any(axis=1))
    if uneven:
        words = f"cell {uneven[0]} has other numbers of rows"
    elif len(bad):
        row = one.iloc[bad[0]]
        name = next(name for name in compared if differ[name][bad[0]])
        known = [
            str(row[part]) for part in ("scenario", "rule", "controller", "seed") if part in row
        ]
        words = f"cell {row['cell']} {'/'.join(known)} has {name} = {two[name][bad[0]]}, not {row[name]}"
    else:
        words = ""
    return len(uneven) + one["cell"][bad].nunique(), words
