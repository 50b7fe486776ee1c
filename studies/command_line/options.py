"""Values of command-line options, read and checked before anything is run."""

import os
import shlex
from collections.abc import Sequence
from contextlib import AbstractContextManager
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Literal

from cyclopts import Parameter, Token

from studies.files.study_error import StudyError

if TYPE_CHECKING:
    from studies.core.study import Study
    from studies.core.workers import Workers


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


def split_numbers(option: str, values: Sequence[str]) -> list[float]:
    """Numbers given one by one, with commas or with spaces."""
    parts = " ".join(values).replace(",", " ").split()
    if not parts:
        raise StudyError(f"{option} was given without a number")
    try:
        return [float(part) for part in parts]
    except ValueError:
        raise StudyError(f"{option} {' '.join(values)}: give numbers, such as 0.05") from None


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
        from studies.core.workers import cluster, workers

        if self.executor == "local":
            if self.scheduler is not None:
                raise StudyError("--scheduler is for --executor dask")
            return workers(process_count(self.jobs))
        if self.scheduler is None or self.jobs is not None:
            raise StudyError("--executor dask: give the --scheduler, and no --jobs: it has workers")
        return cluster(self.scheduler)


EVERYTHING = Work()


@Parameter(name="*")
@dataclass(frozen=True)
class StudyOptions:
    """What a sweep is made of, where it says so: settings of the studies whose `options` name them."""

    adhesion: Names = None
    """wsp-acceptance: adhesion coefficients of uniform rail, one by one or with commas [default: the sweep's table]."""
    curve: Names = None
    """wsp-acceptance: adhesion curves, of piecewise, polach and slip-ratio [default: all]."""
    speed_kmh: float | None = None
    """wsp-acceptance: speed from which the train brakes [default: 100]."""
    train: str | None = None
    """wsp-acceptance: name of a train or path of its file; motors rest [default: that of JP4209318, 1 to 8 cars]."""
    law: str | None = None
    """wsp-acceptance: law of the slide protection [default: fuzzy]."""
    source: str | None = None
    """sanders: speed that slip is measured from, estimate or truth [default: estimate]."""
    errors: str | None = None
    """line-position: path of a file with the errors of odometer, signals and map [default: typical ones]."""
    controllers: Names = None
    """headroom: readhesion controllers, one by one or with commas [default: cut-and-ramp, perturb-observe]."""

    def settings(self, study: "Study") -> dict[str, object]:
        """What was given, by name; raises `StudyError` where `study` has no such option, or a value is none."""
        given = {name: value for name, value in vars(self).items() if value is not None}
        for name in given.keys() - set(study.options):
            option = name.replace("_", "-")
            raise StudyError(f"--{option} is no option of the sweep {study.name!r}")
        values: dict[str, object] = {**given}
        for name in ("curve", "controllers"):
            if name in given:
                values[name] = split_names(getattr(self, name))
        if self.adhesion is not None:
            values["adhesion"] = split_numbers("--adhesion", self.adhesion)
        return values


AS_IT_IS = StudyOptions()
