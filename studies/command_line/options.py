"""Values of command-line options, read and checked before anything is run."""

import os
from collections.abc import Sequence
from typing import Annotated

from cyclopts import Parameter, Token

from studies.files.study_error import StudyError


def _whole(_: type, tokens: Sequence[Token]) -> int:
    """A whole number; the library's own conversion would round 1.5."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{tokens[0].value!r} is not a whole number") from None


ALL_FAILED = 1
"""Exit code where every run failed."""

Whole = Annotated[int, Parameter(converter=_whole, n_tokens=1)]
"""Option of a whole number."""

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


def process_count(jobs: int | None) -> int:
    """Number of processes: `jobs`, or one per core that this process may use."""
    if jobs is None:
        return (
            len(os.sched_getaffinity(0))
            if hasattr(os, "sched_getaffinity")
            else os.cpu_count() or 1
        )
    if jobs < 1:
        raise StudyError(f"--jobs {jobs}: give the number of processes, 1 or more")
    return jobs
