"""A study: one question, asked over many events; its cells make a table, and the table makes statements."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import pandas as pd

from studies.core.cell import Cell, OnRow, key_of
from studies.core.runner import run_cells
from studies.core.statement import Statement
from studies.core.store import Store
from studies.core.workers import Jobs, workers
from studies.files.study_error import StudyError

Cells = Callable[..., Sequence[Cell]]
"""Cells of a study: called with seed, number of events and the study's settings by name. More events, by the study's
`step`, add cells and change none."""
Stage = Callable[..., Sequence[Cell]]
"""Cells that depend on what came before: called as `Cells`, with the rows so far as third argument."""


@dataclass(frozen=True)
class Study:
    """One question over many events: what is met, what is measured, what is said."""

    name: str
    question: str
    """One line."""
    default_events: int
    """Events where none are asked for."""
    cells: Cells
    judge: Callable[[pd.DataFrame], list[Statement]]
    """Statements from the table's rows that succeeded, by thresholds that are set beforehand."""
    finish: Callable[[pd.DataFrame, int, int], pd.DataFrame] | None = None
    """The table from rows, seed and events: what was drawn is joined here."""
    later: tuple[Stage, ...] = ()
    """Further stages, in their order."""
    whole: bool = False
    """Whether statements need every row, and each one ok."""
    step: int = 1
    """Events in the least number that adds cells to those of fewer and changes none."""

    def run(
        self,
        folder: str | Path,
        events: int,
        seed: int = 0,
        jobs: Jobs = 1,
        on_row: OnRow | None = None,
        **settings: object,
    ) -> pd.DataFrame:
        """The table of so many events drawn from `seed`; cells that `folder` holds are not run again.

        `settings` are the study's own, such as a shorter duration; their rows stand apart from those without.
        """
        store = Store(folder)
        cells = self.cells(seed, events, **settings)
        with workers(jobs) as others:  # the same for all stages
            table = run_cells(cells, store, others, on_row=on_row)
            for stage in self.later:
                cells = [*cells, *stage(seed, events, table, **settings)]
                table = run_cells(cells, store, others, on_row=on_row)
        return table if self.finish is None else self.finish(table, seed, events)

    def statements(self, table: pd.DataFrame) -> list[Statement]:
        """What the table says; raises `StudyError` where it lacks what the statements need."""
        bad = table["status"] != "ok" if "status" in table else pd.Series(dtype=bool)
        if self.whole and bad.any():
            reason = table.loc[bad, "reason"].iloc[0]
            raise StudyError(
                f"study {self.name!r}: {int(bad.sum())} rows are not ok, the first by {reason}; mend that and run it again"
            )
        return self.judge(table)

    def held(self, folder: str | Path, seed: int = 0, **settings: object) -> int:
        """Number of events, counted from the first, that `folder` holds in full under the present code and `settings`.

        It is a multiple of `step`; events that add no cell do not count.
        """
        store = Store(folder)
        done = store.cells().keys()
        first = self.cells(seed, self.step, **settings)

        def holds(steps: int) -> bool:
            events = steps * self.step
            cells = self.cells(seed, events, **settings)
            if steps > 1 and len(cells) == len(first):
                return False
            for stage in (*self.later, None):
                keys = [key_of(cell) for cell in cells]
                if not done >= {key.digest for key in keys}:
                    return False
                if stage is not None:
                    cells = [*cells, *stage(seed, events, store.rows_of(keys), **settings)]
            return True

        if not done or not holds(1):
            return 0
        low, high = 1, 2
        while holds(high):
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if holds(middle) else (low, middle)
        return low * self.step


def each_event(cells: Callable[..., Sequence[Cell]]) -> Cells:
    """Cells of all events from a function that gives those of one, called with seed, number k and settings."""
    return partial(_each_event, cells)


def _each_event(
    cells: Callable[..., Sequence[Cell]], seed: int, events: int, **settings: object
) -> list[Cell]:
    return [cell for k in range(events) for cell in cells(seed, k, **settings)]
