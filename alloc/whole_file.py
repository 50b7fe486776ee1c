"""Files that other processes see whole or not at all."""

import os
import uuid
from collections.abc import Callable
from pathlib import Path

ASIDE = ".part"
"""In the name of a file that is being written."""


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Make or replace `path` by `write(file to fill)`: other processes see all of it or nothing.

    The file beside it has a name of its own, so writers do not meet; a `write` that raises leaves nothing behind.
    """
    aside = path.with_name(f".{uuid.uuid4().hex}{ASIDE}{path.suffix}")
    try:
        write(aside)
        os.replace(aside, path)
    finally:
        aside.unlink(missing_ok=True)
