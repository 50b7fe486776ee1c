"""Cells of a study: each is a piece of work that yields rows of its table, and is done once."""

import hashlib
import inspect
import json
import time
import traceback
from collections.abc import Callable, Hashable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, NamedTuple, Protocol

import xarray as xr

from alloc.event import canonical
from alloc.sources import code_hash
from studies.core.plugins import load_plugins
from studies.files.study_error import StudyError

ROOT = Path(__file__).parents[2]
"""Folder of the packages; reasons name sources from there."""
INNERMOST = 3
"""Number of lines of a traceback in a reason."""

Row = dict[str, Any]
Shared = dict[str, Any]
"""Objects that the cells of a group store for later cells of the group."""
OnRow = Callable[[str, int, int], None]
"""Arguments of a progress report: label of the finished cell, number of finished cells, number of all cells."""


class Cell(Protocol):
    """A piece of work. It is sent to other processes, so it contains plain values and functions of modules."""

    @property
    def label(self) -> str:
        """Name for people and files, unique in a study; its parts are divided by "/"."""

    @property
    def identity(self) -> Mapping[str, Any]:
        """Values that determine the rows, apart from the code; they are columns of every row."""

    @property
    def sources(self) -> tuple[str, ...]:
        """Modules that determine the rows, with all that they import."""

    @property
    def group(self) -> Hashable:
        """Cells of the same group, unless it is None, share what they prepare; one worker does them."""

    def work(self, shared: "Shared") -> "Yield":
        """Do the work. `shared` contains what earlier cells of this group stored there."""


class Yield(NamedTuple):
    """Result of a cell's work."""

    rows: Sequence[Row]
    run: xr.Dataset | None = None
    """The recorded run behind them, where there is one."""


class Key(NamedTuple):
    """Identity of a cell under the present code."""

    label: str
    digest: str
    code: str


def key_of(cell: Cell) -> Key:
    """Identity of `cell` under the present code."""
    code = code_hash(*cell.sources)
    text = json.dumps([dict(cell.identity), code], sort_keys=True, default=canonical)
    return Key(cell.label, hashlib.sha256(text.encode()).hexdigest()[:16], code)


@dataclass(frozen=True)
class Task:
    """A cell that calls a function of a module; the return values are the rows."""

    label: str
    function: Callable[..., Row | Sequence[Row]]
    arguments: tuple[Any, ...] = ()
    columns: tuple[tuple[str, Any], ...] = ()
    """Columns that distinguish the rows of this cell from others of the study."""

    @property
    def identity(self) -> Mapping[str, Any]:
        """Label, columns and arguments."""
        return {"label": self.label, **dict(self.columns), "arguments": canonical(self.arguments)}

    @property
    def sources(self) -> tuple[str, ...]:
        """The function's module; a script's module by its file, since `__main__` is another module in a worker."""
        module = self.function.__module__
        return (inspect.getfile(self.function) if module == "__main__" else module,)

    @property
    def group(self) -> None:
        """None: a task prepares nothing for another."""
        return None

    def work(self, shared: Shared) -> Yield:
        """Call the function."""
        found = self.function(*self.arguments)
        rows = [found] if isinstance(found, Mapping) else found
        return Yield([dict(self.columns) | dict(row) for row in rows])


class Outcome(NamedTuple):
    """Identity, rows of the table and, if requested, the recorded run."""

    key: Key
    rows: list[Row]
    run: xr.Dataset | None


def in_one_line(error: Exception) -> str:
    """Type and message of an error, and the innermost lines of its traceback, the line that raised it first."""
    frames = reversed(traceback.extract_tb(error.__traceback__)[-INNERMOST:])
    places = [f"{_short(frame.filename)}:{frame.lineno} in {frame.name}" for frame in frames]
    message = " ".join(str(error).split()) or "no message"
    return f"{type(error).__name__}: {message} (at {', from '.join(places)})"


def _short(file: str) -> str:
    """A source's path from the folder that holds the project, or its name where it lies elsewhere."""
    path = Path(file)
    return path.relative_to(ROOT).as_posix() if path.is_relative_to(ROOT) else path.name


def run_cell(cell: Cell, key: Key, keep: bool = False, shared: Shared | None = None) -> Outcome:
    """Do a cell's work. Any error in it becomes a row with status "failed" and the reason.

    Work that ends well but must not count may say so: its rows then have a status of their own, see `run_status`. `key`:
    that of the caller. A worker that started after the sources changed has loaded other code. Its result would count as one
    of the caller's code, so the worker refuses.
    """
    load_plugins()
    started = time.perf_counter()
    kept = {"cell": key.digest, "code_hash": key.code}
    run = None
    rows: list[Row]
    try:
        if code_hash(*cell.sources) != key.code:
            raise StudyError("the sources changed while the study ran; run it again")
        found, run = cell.work({} if shared is None else shared)
        rows = [kept | row | {"status": row.get("status", "ok")} for row in found]
    except Exception as error:  # a study of a hundred cells goes on without this one
        known = {name: value for name, value in cell.identity.items() if name != "arguments"}
        rows = [kept | known | {"status": "failed", "reason": in_one_line(error)}]
    seconds = time.perf_counter() - started
    times: Row = {"wall_time": seconds / max(len(rows), 1)}
    rows = [{"reason": ""} | row | times for row in rows]
    return Outcome(key, rows, run if keep else None)
