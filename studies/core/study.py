"""A study: one question, asked over many events; its cells make a table, and the table makes statements."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import cache
from importlib import import_module
from inspect import signature
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple, get_type_hints

import pandas as pd

import studies
from alloc.display import displayed
from studies.core.cell import Cell, OnRow, key_of
from studies.core.claims import Claim, freeze
from studies.core.run import ALL, Jobs, Shard, run_cells, workers
from studies.core.statement import Statement
from studies.core.store import Store
from studies.files.study_error import StudyError, unknown

BLOCK = 5000
"""Number of events whose cells are in memory at once, 15 kB each."""
Cells = Callable[..., Sequence[Cell]]
"""Function that makes the cells of a study, called with seed, number of events and the study's settings by name. More
events, in multiples of the study's `step`, add cells and do not change any."""
Stage = Callable[..., Sequence[Cell]]
"""Function that makes cells from earlier results: called as `Cells`, with the rows so far as third argument."""


@displayed
@dataclass(frozen=True)
class Study:
    """One question over many events: the events, the measurements, the statements."""

    name: str
    question: str
    """One line."""
    default_events: int
    """Default number of events."""
    cells: Cells
    judge: Callable[[pd.DataFrame], list[Statement]]
    """Statements from the table's successful rows, by thresholds that are set beforehand."""
    finish: Callable[[pd.DataFrame, int, int], pd.DataFrame] | None = None
    """The table from rows, seed and events: joins the drawn values."""
    later: tuple[Stage, ...] = ()
    """Further stages, in their order."""
    whole: bool = False
    """Whether statements need every row, and each one ok."""
    step: int = 1
    """Smallest number of events that adds cells to those of fewer events and does not change any."""
    shown: Mapping[str, str] = field(default_factory=dict)
    """Columns that `readhesion sweep` prints of every row, each with its heading. With `--json` it gives all of them."""
    claims: Sequence[Claim] | Callable[..., Sequence[Claim]] = ()
    """What is claimed, or what gives it, called with those of the settings that it takes. What decides it is stored beside
    the rows before the first event of a seed is drawn."""

    def run(
        self,
        folder: str | Path,
        events: int,
        seed: int = 0,
        jobs: Jobs = 1,
        on_row: OnRow | None = None,
        shard: Shard = ALL,
        **settings: object,
    ) -> pd.DataFrame:
        """The table of this number of events drawn from `seed`; cells that `folder` already has are not run again.

        `shard`: a share of the events, whose rows are returned unfinished; stages that need the rows of all events are left
        out. `settings` are the study's own, such as a shorter duration; their rows are kept separate from those without.
        """
        blocks = self._blocks(seed, events, shard, settings)
        blocks = chain([next(blocks)], blocks)  # what cannot be asked for leaves no folder behind
        store = Store(folder)
        if claims := self.claimed(**settings):
            freeze(store.folder, seed, claims)
        tables: list[pd.DataFrame] = []
        with workers(jobs) as others:  # the same for all blocks and stages
            for cells, block in blocks:
                tables.append(run_cells(cells, store, others, on_row=_in_all(on_row, block)))
            table = tables[0] if len(tables) == 1 else pd.concat(tables, ignore_index=True)
            if shard != ALL:
                return table
            for stage in self.later:
                cells = [*cells, *stage(seed, events, table, **settings)]
                table = run_cells(cells, store, others, on_row=on_row)
        return table if self.finish is None else self.finish(table, seed, events)

    def claimed(self, **settings: object) -> Sequence[Claim]:
        """What is claimed under these settings."""
        if not callable(self.claims):
            return self.claims
        taken = signature(self.claims).parameters
        return self.claims(**{name: one for name, one in settings.items() if name in taken})

    def _blocks(
        self, seed: int, events: int, shard: Shard, settings: Mapping[str, object]
    ) -> Iterator[tuple[Sequence[Cell], "Block"]]:
        """Cells of the first events, then of the next, for all would not fit into memory."""
        if not isinstance(self.cells, EachEvent) or self.later:
            yield shard.of_cells(self.cells(seed, events, **settings)), Block(0, 1, 1)
            return
        numbers = shard.of(range(events))
        for start in range(0, max(len(numbers), 1), BLOCK):
            some = numbers[start : start + BLOCK]
            yield self.cells(seed, some, **settings), Block(start, max(len(some), 1), len(numbers))

    @property
    def settings(self) -> dict[str, Any]:
        """The study's own settings by name, with their types: arguments of its cells after seed and events."""
        made = self.cells.of_one if isinstance(self.cells, EachEvent) else self.cells
        hints = get_type_hints(made)
        return {name: hints.get(name, str) for name in list(signature(made).parameters)[2:]}

    def kind_of(self, setting: str) -> Any:
        """Type of a setting; raises `StudyError` with the nearest one where the study has none of this name."""
        if setting not in self.settings:
            raise unknown(f"option of the sweep {self.name}", setting, self.settings)
        return self.settings[setting]

    def statements(self, table: pd.DataFrame) -> list[Statement]:
        """Statements from the table; raises `StudyError` where it lacks what the statements need."""
        bad = table["status"] != "ok" if "status" in table else pd.Series(dtype=bool)
        if self.whole and bad.any():
            reason = table.loc[bad, "reason"].iloc[0]
            raise StudyError(
                f"study {self.name!r}: {int(bad.sum())} rows are not ok, the first by {reason}; mend that and run it again"
            )
        return self.judge(table)

    def held(self, folder: str | Path, seed: int = 0, **settings: object) -> int:
        """Number of events, counted from the first, whose rows `folder` has in full under the present code and `settings`.

        It is a multiple of `step`; events that add no cell do not count.
        """
        store = Store(folder)
        done = store.cells().keys()

        def holds(cells: Sequence[Cell]) -> bool:
            return bool(cells) and all(key_of(cell).digest in done for cell in cells)

        if not done:
            return 0
        if isinstance(self.cells, EachEvent) and not self.later:
            held = 0
            while holds(self.cells(seed, range(held, held + 1), **settings)):
                held += 1
            return held - held % self.step
        first = len(self.cells(seed, self.step, **settings))

        def holds_steps(steps: int) -> bool:
            events = steps * self.step
            cells = self.cells(seed, events, **settings)
            if steps > 1 and len(cells) == first:
                return False
            for stage in self.later:
                if not holds(cells):
                    return False
                keys = [key_of(cell) for cell in cells]
                cells = [*cells, *stage(seed, events, store.rows_of(keys), **settings)]
            return holds(cells)

        low, high = 0, 1
        while holds_steps(high):
            low, high = high, 2 * high
        while high - low > 1:
            middle = (low + high) // 2
            low, high = (middle, high) if holds_steps(middle) else (low, middle)
        return low * self.step


class EachEvent:
    """Cells of many events from a function that gives those of one, called with seed, number k and settings."""

    def __init__(self, cells: Callable[..., Sequence[Cell]]) -> None:
        self.of_one = cells

    def __call__(self, seed: int, events: int | Sequence[int], **settings: object) -> list[Cell]:
        """Cells of the first so many events, or of those with these numbers."""
        numbers = range(events) if isinstance(events, int) else events
        return [cell for k in numbers for cell in self.of_one(seed, k, **settings)]


class Block(NamedTuple):
    """Part of many events, by their number: those before, these, and all."""

    before: int
    events: int
    all: int


def _in_all(on_row: OnRow | None, block: Block) -> OnRow | None:
    """Progress in a block as progress in all, whose events are taken to have as many cells each."""
    if on_row is None:
        return None

    def tell(label: str, done: int, cells: int) -> None:
        before, every = (cells * events // block.events for events in (block.before, block.all))
        on_row(label, before + done, every)

    return tell


# The studies by name: every `Study` of a module named `study`, or after the study, in a folder of its topic.


@cache
def all_studies() -> dict[str, Study]:
    """Every study by name, in alphabetical order."""
    found: dict[str, Study] = {}
    for module in _modules("*/study.py", "*/*_study.py"):
        found |= _studies_of(module)
    return dict(sorted(found.items()))


def _modules(*patterns: str) -> list[str]:
    """Names of the modules in folders of studies whose files are so called."""
    return [
        ".".join(("studies", *path.relative_to(root).with_suffix("").parts))
        for root in map(Path, studies.__path__)
        for pattern in patterns
        for path in root.glob(pattern)
    ]


@cache
def _studies_of(module: str) -> dict[str, Study]:
    values = vars(import_module(module)).values()
    return {one.name: one for one in values if isinstance(one, Study)}


def find_study(name: str) -> Study:
    """The study called `name`; raises `StudyError` with the nearest name for one that does not exist."""
    own = name.replace("-", "_")
    if own.isidentifier():  # importing the others takes a second
        for module in _modules(f"{own}/study.py", f"*/{own}_study.py"):
            if name in (known := _studies_of(module)):
                return known[name]
    if name not in all_studies():
        raise unknown("sweep", name, all_studies())
    return all_studies()[name]


def study_folder(out: str | Path, name: str) -> Path:
    """Folder of a study's table under the results' folder `out`."""
    return Path(out) / "sweeps" / name
