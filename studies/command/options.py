"""Options of the command `readhesion` that several commands have, and how their values are read."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter, Token
from cyclopts.validators import Number

from studies import StudyError


def _whole_number(least: int, most: int) -> Parameter:
    """A whole number within these; the library would round 1.5."""

    def read_number(_: type, tokens: Sequence[Token]) -> int:
        text = tokens[0].value
        if not text.removeprefix("-").isdecimal():
            raise ValueError(f"{text!r} is not a whole number")
        if not least <= int(text) <= most:
            raise ValueError(f"{text}: give a whole number from {least} to {most}")
        return int(text)

    return Parameter(converter=read_number, n_tokens=1)


def _read_names(_: type, tokens: Sequence[Token]) -> list[str]:
    """Several names, one by one or with commas."""
    names = [part.strip() for token in tokens for part in token.value.split(",")]
    if not any(names):
        raise ValueError("it has no name; `readhesion list` has them")
    return list(dict.fromkeys(filter(None, names)))


def check_file(path: Path | None, *endings: str) -> None:
    """Raise `StudyError` where a file cannot be written; minutes would be spent in vain."""
    if path is None:
        return
    if path.suffix.lower() not in endings:
        raise StudyError(f"file {str(path)!r}: its ending must be {' or '.join(endings)}")
    folder = path.absolute().parent
    if path.is_dir() or not os.access(folder, os.W_OK):
        reason = "" if folder.is_dir() else f": there is no folder {str(folder)!r}"
        raise StudyError(f"file {str(path)!r} cannot be written{reason}")


Seed = Annotated[int, _whole_number(0, 2**31 - 1)]
Count = Annotated[int, _whole_number(1, 1_000_000)]
Jobs = Annotated[int, _whole_number(1, 16 * (os.cpu_count() or 1))]
Width = Annotated[float, Parameter(validator=Number(gt=0.5, lt=50.0))]
Names = Annotated[
    list[str] | None,
    Parameter(consume_multiple=1, negative_iterable=(), converter=_read_names),
]
Flag = Annotated[bool, Parameter(negative=())]
Json = Annotated[Flag, Parameter("--json")]


@Parameter(name="*")
@dataclass(frozen=True)
class Work:
    """Who works."""

    jobs: Jobs | None = None
    """Processes [default: one per core]."""
    scheduler: str | None = None
    """Address of a Dask scheduler, or the file that it wrote; its workers do the work."""
    retry_failed: Flag = False
    """Run again what failed."""
    dry_run: Flag = False
    """Say what is to be run and about how long it takes; run nothing."""


@Parameter(name="*")
@dataclass(frozen=True)
class Sweep(Work):
    """Who works, and what becomes of it."""

    out: Path = Path("results")
    """Folder for rows, tables and figure."""
    kind: Annotated[Literal["md", "tex"], Parameter("--format")] = "md"
    """Format of tables: with tex they are written for LaTeX (booktabs) as well."""
    as_json: Json = False
    """Print JSON instead."""


WORK, SWEEP = Work(), Sweep()
