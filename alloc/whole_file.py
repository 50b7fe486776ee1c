"""Files that other processes see whole or not at all, and that are not used once they are damaged."""

import hashlib
import os
import uuid
import warnings
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

ASIDE = ".part"
"""In the name of a file that is being written."""
SEAL = 32
"""Bytes of the digest behind what `sealed` has sealed."""


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Make or replace `path` by `write(file to fill)`: other processes see all of it or nothing.

    The file beside it has a name of its own, so writers do not meet; a `write` that raises leaves nothing behind. Raises
    `OSError` with the name of `path`.
    """
    with writing(path) as aside:
        write(aside)
        os.replace(aside, path)


@contextmanager
def writing(path: Path) -> Iterator[Path]:
    """A file beside `path` to be filled; it is gone afterwards. An `OSError`, as of a full disk, gets the name of `path`."""
    aside = path.with_name(f".{uuid.uuid4().hex}{ASIDE}{path.suffix}")
    try:
        yield aside
    except OSError as error:  # libraries do not say which file
        reason = os.strerror(error.errno) if error.errno else " ".join(str(error).split())
        raise OSError(error.errno, reason, str(path)) from error
    finally:
        aside.unlink(missing_ok=True)


def sealed(content: bytes) -> bytes:
    """`content` and its digest; pickle, marshal and loaders of libraries ignore what stands behind the end."""
    return content + hashlib.sha256(content).digest()


def set_aside_damaged(path: Path, content: bytes | None = None) -> None:
    """Rename `path`, with a warning, if it is not as it was written: `content`, or whatever was sealed."""
    with suppress(FileNotFoundError):  # as another process may set it aside too
        found = path.read_bytes()
        digest = hashlib.sha256(memoryview(found)[:-SEAL]).digest()
        if found.endswith(digest) if content is None else found == content:
            return
        aside = path.with_name(f"damaged-{path.name}")
        os.replace(path, aside)
        warnings.warn(
            f"{str(path)!r} is damaged and made again; what it was is now {aside.name!r}",
            RuntimeWarning,
            stacklevel=2,
        )
