"""Values of command-line options, read and checked before anything is run."""

import os
import shlex
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from types import UnionType
from typing import TYPE_CHECKING, Annotated, Literal, get_args, get_origin

from cyclopts import Parameter, Token
from rich.console import Console
from rich.progress import BarColumn, MofNCompleteColumn, Progress, TextColumn, TimeElapsedColumn

from studies.files.study_error import StudyError

if TYPE_CHECKING:
    import pandas as pd

    from studies.core.run import Workers
    from studies.core.study import Study


def _whole(_: type, tokens: Sequence[Token]) -> int:
    """A whole number; the library's own conversion would round 1.5."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{tokens[0].value!r} is not a whole number") from None


def _path(_: type, tokens: Sequence[Token]) -> Path:
    """A path; nothing at all would be the present folder."""
    if not tokens[0].value.strip():
        raise ValueError("no name is given")
    return Path(tokens[0].value)


ALL_FAILED = 1
"""Exit code where every run failed."""

Whole = Annotated[int, Parameter(converter=_whole, n_tokens=1)]
"""Option of a whole number."""

FilePath = Annotated[Path, Parameter(converter=_path, n_tokens=1)]
"""Option of a file or folder."""

MOST_SEEDS, MOST_EVENTS, GREATEST_SEED = 1000, 1_000_000, 2**31 - 1
PROCESSES_PER_CORE = 16


Names = Annotated[list[str] | None, Parameter(consume_multiple=True, negative_iterable=())]
"""Option of several names, one by one or with commas."""


Format = Annotated[Literal["csv", "markdown", "latex"] | None, Parameter("--format")]
"""Option of a table as text to paste, see `studies.comparison.table.as_text`."""


def split_names(values: Sequence[str] | None) -> list[str] | None:
    """Names given one by one or with commas."""
    if values is None:
        return None
    names = [part.strip() for value in values for part in value.split(",")]
    if not any(names):
        raise StudyError("an option for names was given without one; `readhesion list` has them")
    return names


def command_of(name: str, *words: str, **options: Sequence[str] | None) -> str:
    """A command as a person would type it; options that were not given are left out; those of all commands come first."""
    from studies.core.plugins import plugin_files
    from studies.files.limits import factor

    more = [] if factor() == 1.0 else ["--limits", f"{factor():g}"]
    plugins = [word for file in plugin_files() for word in ("--plugin", file)]
    begin = ["readhesion", *plugins, *more, name]
    told = [word for key, values in options.items() if values for word in (_option(key), *values)]
    return shlex.join([*begin, *words, *told])


def said(value: object, default: object = None) -> list[str] | None:
    """The words of an option's value for `command_of`; None where it is the `default`."""
    return None if value == default else [f"{value:g}" if isinstance(value, float) else str(value)]


def _option(field: str) -> str:
    return f"--{field.replace('_', '-')}"


def check_whole(option: str, value: int, least: int, most: int) -> None:
    """Raise `StudyError` unless a whole number is one from `least` to `most`."""
    if not least <= value <= most:
        raise StudyError(f"{option} {value}: give a whole number from {least} to {most}")


def process_count(jobs: int | None) -> int:
    """Number of processes: `jobs`, or one per core that this process may use."""
    cores = (
        len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1
    )
    if jobs is None:
        return cores
    check_whole("--jobs", jobs, 1, PROCESSES_PER_CORE * cores)
    return jobs


@Parameter(name="*")
@dataclass(frozen=True)
class Work:
    """How much of a study is done, and by whom."""

    jobs: Whole | None = None
    """Number of processes [default: one per core]."""
    shard: str | None = None
    """k/n: run part k of n of the events, in the k-th of n jobs; `readhesion merge` unites the parts."""
    executor: Literal["local", "dask"] = "local"
    """What runs the work: processes of this machine, or the workers of a Dask cluster."""
    scheduler: str | None = None
    """Address of the Dask scheduler, such as tcp://node7:8786, or the file that the scheduler wrote."""

    def workers(self) -> "AbstractContextManager[Workers | None]":
        """The workers, for the whole command; raises `StudyError` where there are none or the options do not fit."""
        from studies.core.run import cluster, workers

        if self.executor == "local":
            if self.scheduler is not None:
                raise StudyError("--scheduler is for --executor dask")
            return workers(process_count(self.jobs))
        if self.scheduler is None or self.jobs is not None:
            raise StudyError("--executor dask: give the --scheduler, and no --jobs: it has workers")
        return cluster(self.scheduler)


EVERYTHING = Work()


Settings = Annotated[list[str], Parameter(consume_multiple=True, negative_iterable=())]
"""Words after each option of a single sweep, by the option's name."""


def settings_of(study: "Study", given: Mapping[str, Sequence[str]]) -> dict[str, object]:
    """Settings of a study from the options that it has by the signature of its cells; values are read by their types.

    Raises `StudyError` where the study has no such option, or a value is none.
    """
    from pydantic import TypeAdapter, ValidationError  # slow to import

    found: dict[str, object] = {}
    for option, words in given.items():
        name = option.replace("-", "_")
        kind, parts = study.kind_of(name), split_names(words)
        if isinstance(kind, UnionType):  # or None
            kind = get_args(kind)[0]
        several = get_origin(kind) in (Sequence, list, tuple)
        try:
            found[name] = TypeAdapter(kind).validate_python(parts if several else " ".join(words))
        except ValidationError as error:
            what = error.errors()[0]["msg"]
            raise StudyError(f"--{option} {' '.join(words)}: {what[0].lower()}{what[1:]}") from None
    return found


# What a person at a terminal sees: console and progress bar.

PLAIN_WIDTH = 170
"""Width of tables that do not go to a terminal."""


class _Terminal(Console):
    """A console whose reader may leave early, as `head` does."""

    def on_broken_pipe(self) -> None:
        """Let the command end by the error, see `studies.command_line.main.run`."""
        raise


def console() -> Console:
    """Where tables are printed: as wide as the terminal, or `PLAIN_WIDTH` where there is none."""
    found = _Terminal()
    return found if found.is_terminal else _Terminal(width=PLAIN_WIDTH)


def counted(table: "pd.DataFrame", what: str) -> str:
    """How many rows a table has, called `what`, and how many have another status than "ok"."""
    counts = Counter(table.get("status", ()))
    bad = [f", [red]{n} {status}[/red]" for status, n in counts.items() if status != "ok"]
    return "".join([f"{len(table)} {what}", *bad])


def of_shard(work: "Work") -> str:
    """Which share of the events was run, and what makes a whole of them; nothing where it is the whole."""
    return f" of shard {work.shard}; `readhesion merge` unites the shards" if work.shard else ""


class progress:
    """Progress bar on stderr; gives the function that is told of each finished row."""

    def __enter__(self) -> Callable[[str, int, int], None]:
        terminal = _Terminal(stderr=True)
        self.bar = Progress(
            TextColumn("[progress.description]{task.description}"),
            BarColumn(),
            MofNCompleteColumn(),
            TimeElapsedColumn(),
            console=terminal,
            transient=True,
            disable=not terminal.is_terminal,
        )
        self.bar.start()
        self.task = self.bar.add_task("starting", total=None)

        def on_row(label: str, done: int, total: int) -> None:
            self.bar.update(self.task, description=label, completed=done, total=total)

        return on_row

    def __exit__(self, *_: object) -> None:
        self.bar.stop()
