"""What will be written, checked before minutes are spent on its content."""

import os
import tempfile
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from typing import TYPE_CHECKING, Any

from studies.files.study_error import StudyError

if TYPE_CHECKING:
    import pandas as pd

RUN, LOG = (".nc", ".mat"), (".csv", ".parquet", ".mat")
FIGURE, PAGE = (".pdf", ".png", ".svg"), (".html",)
"""Endings of files by what they hold."""
MOVING_FIGURE = (*FIGURE, ".gif")
"""The same where a figure may move."""
FORMULA = ("=", "+", "-", "@", "\t", "\r")
"""What a cell begins with that spreadsheets compute (OWASP, CSV injection)."""


def check_file(path: Path | None, endings: Sequence[str]) -> None:
    """Raise `StudyError` if a file has none of these `endings` or cannot be written; nothing is left behind."""
    if path is None:
        return
    if path.suffix.lower() not in endings:
        raise StudyError(
            f"file {str(path)!r}: ending {path.suffix!r} must be {' or '.join(endings)}"
        )
    try:
        existed = path.exists()
        with open(path, "ab"):
            pass
        if not existed:
            path.unlink()
    except OSError as error:
        raise StudyError(f"file {str(path)!r} cannot be written: {error.strerror}") from None


def check_place(
    path: Path, what: str = "output", option: str = "--out", of_results: bool = False
) -> None:
    """Raise `StudyError` if a folder is none, or cannot be made where it is wanted; nothing is made.

    One `of_results` may be there for reading alone: it is checked again if something is to be added.
    """
    try:
        if of_results and path.is_dir():
            return
        place = path.absolute()
        while not place.exists():
            place = place.parent
        if place.is_dir() and os.access(place, os.W_OK | os.X_OK):
            return
        reason = "No permission" if place.is_dir() else f"{str(place)!r} is a file"
    except OSError as error:
        reason = str(error.strerror)
    raise StudyError(
        f"{what} folder {str(path)!r} cannot be written: {reason}; choose another with {option}"
    )


def make_folder(folder: Path) -> None:
    """Make a folder for results; raises `StudyError` if it cannot be made or written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise StudyError(
            f"output folder {str(folder)!r} cannot be written: {error.strerror}; choose another with --out"
        ) from None


def as_csv(table: "pd.DataFrame", **options: Any) -> str:
    """A table as CSV with the library's `options`; an apostrophe stands before names that spreadsheets would compute."""
    found = table.rename(columns=_not_computed)
    for k, kind in enumerate(found.dtypes):
        if kind.kind == "O":
            found.isetitem(k, [_not_computed(value) for value in found.iloc[:, k]])
    text: str = found.to_csv(index=False, **options)
    return text


def _not_computed(value: Any) -> Any:
    """A text that begins like a formula with an apostrophe before it; numbers as they are, also those in a text."""
    if not isinstance(value, str) or not value.startswith(FORMULA):
        return value
    with suppress(ValueError):
        float(value)
        return value
    return f"'{value}"
