"""Files whose names end with their checksum: written whole, never changed, and set aside where they are broken.

Writers on several machines need no lock and no list of checksums: equal names mean equal content.
"""

import errno
import hashlib
import os
import warnings
from collections.abc import Callable
from pathlib import Path

from alloc.sources import writing
from studies.files.study_error import StudyError

DIGITS = 16
"""Digits of SHA-256 in a name."""


class StoreWarning(UserWarning):
    """A file of a store was broken or contradicts another one; the message says which and what follows."""


class Gone(Exception):
    """Another process has replaced or set aside the file meanwhile."""


def write_checked(beginning: Path, suffix: str, write: Callable[[Path], object]) -> Path:
    """Make the file `beginning` + "-" + checksum + `suffix` by `write(file to fill)`; returns its path.

    It appears as a whole, and is on the disk by then. A `write` that raises leaves nothing behind.
    """
    with writing(beginning.with_name(f"{beginning.name}{suffix}")) as aside:
        write(aside)
        with open(aside, "rb+") as file:
            digest = hashlib.file_digest(file, "sha256").hexdigest()
            os.fsync(file.fileno())
        path = beginning.with_name(f"{beginning.name}-{digest[:DIGITS]}{suffix}")
        os.replace(aside, path)
    return path


def read_checked(path: Path) -> bytes:
    """Content of a file; one that has changed since it was written is set aside. Raises `Gone` if nothing is left."""
    content = read_present(path)
    if hashlib.sha256(content).hexdigest()[:DIGITS] != path.stem[-DIGITS:]:
        set_aside(path, "it is not as it was written")
        raise Gone
    return content


def read_present(path: Path) -> bytes:
    """Content of a file; raises `Gone` where there is none."""
    try:
        return path.read_bytes()
    except OSError as error:
        if error.errno in (errno.ENOENT, errno.ESTALE):  # the latter over a network
            raise Gone from None
        raise StudyError(f"file {str(path)!r} cannot be read: {error.strerror}") from None


def set_aside(path: Path, reason: str) -> None:
    """Rename a broken file and warn; where another process has done so nothing is left to do."""
    places = (path.with_name(f"{path.name}.broken-{k}") for k in range(1, 10**6))
    place = next(place for place in places if not place.exists())
    try:
        path.rename(place)
    except FileNotFoundError:
        return
    except OSError:  # a folder for reading alone
        now = "it is passed over"
    else:
        now = f"it is now {place.name!r}, its content is computed again"
    warnings.warn(
        f"{str(path)!r} is broken ({reason}); {now}",
        StoreWarning,
        stacklevel=2,
    )
