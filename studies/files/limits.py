"""How large files from elsewhere may be: a small file that unfolds to gigabytes is refused before they are taken.

One factor raises all limits, for a file that is meant: `readhesion --limits 4 ...`, or the environment variable.
"""

import os
from typing import Any, NamedTuple

from studies.files.study_error import StudyError

VARIABLE = "READHESION_LIMITS"
"""Environment variable that contains the factor, so that worker processes know it too."""
MOST_FACTOR = 1000.0
DEEPEST = 20
"""Lists and mappings in one another, more than any line or train needs. No factor: libraries would exhaust the stack."""


class Limits(NamedTuple):
    """Most of each that is read."""

    file_bytes: int = 1_000_000
    """Of a scenario, train or line, with what aliases repeat: twice the size of a line of twenty thousand sections. Reading
    YAML of this size takes ten seconds."""
    values: int = 120_000_000
    """Of a log or recorded run, rows times columns, 1 GB as floats: four hours of 64 channels at 100 Hz have 92 million."""
    text_bytes: int = 4_000_000_000
    """Of a log as text, after decompression."""


def factor() -> float:
    """Factor of all limits; raises `StudyError` where what is given is none."""
    given = os.environ.get(VARIABLE) or "1"
    try:
        found = float(given)
    except ValueError:
        found = 0.0
    if not 0.0 < found <= MOST_FACTOR:
        raise StudyError(f"--limits {given}: give a factor above 0, up to {MOST_FACTOR:g}")
    return found


def limits() -> Limits:
    """The limits that hold."""
    by = factor()
    return Limits(*(int(by * usual) for usual in Limits()))


def too_large(owner: str, limit: str, unit: str) -> StudyError:
    """Error for a file `owner` that exceeds the `limit` of that name, in words with its number and the option."""
    most = getattr(limits(), limit)
    return StudyError(
        f"{owner} has more than {most} {unit}; give a smaller one, or raise the limit: readhesion --limits "
        f"{2.0 * factor():g} doubles it"
    )


def check_values(owner: str, count: float) -> None:
    """Raise `StudyError` where a table or run has more values than are read."""
    if count > limits().values:
        raise too_large(owner, "values", "values (rows times columns; a text counts as several)")


def check_parquet(owner: str, metadata: Any) -> None:
    """Raise `StudyError` by the `metadata` of a parquet file alone: equal rows take no room in a file, but in memory."""
    columns = [
        metadata.row_group(k).column(n)
        for k in range(metadata.num_row_groups)
        for n in range(metadata.num_columns)
    ]
    check_values(
        owner, sum(max(one.num_values, one.total_uncompressed_size // 8) for one in columns)
    )


# Text files that people write: scenarios, trains, lines. They are small, and anything else is refused before it is
# read.


def small_text(path: str, what: str, hint: str = "") -> str:
    """Content of a UTF-8 file, with or without byte order mark; raises `StudyError` naming `what` kind of file it is.

    `hint`: what to do where it does not exist. No more is read than `Limits.file_bytes`.
    """
    owner, most = f"{what} file {path!r}", limits().file_bytes
    try:
        with open(path, "rb") as file:
            content = file.read(most + 1)
        text = content.decode("utf-8-sig")
    except FileNotFoundError:
        raise StudyError(f"{owner} does not exist{hint and '; '}{hint}") from None
    except UnicodeDecodeError as error:
        raise StudyError(f"{owner} is no text in UTF-8: {error}") from None
    except (OSError, ValueError) as error:  # a name may hold what no name can
        raise StudyError(
            f"{owner} cannot be read: {getattr(error, 'strerror', None) or error}"
        ) from None
    if len(content) > most:
        raise too_large(owner, "file_bytes", "bytes")
    return text
