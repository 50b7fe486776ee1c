"""Files that are written whole."""

import os
import uuid
from collections.abc import Callable
from pathlib import Path


def write_whole(path: Path, write: Callable[[Path], object]) -> None:
    """Make or replace `path` by `write(file to fill)`: other processes see all of it or nothing.

    The file beside it has a name of its own, so writers do not meet; a `write` that raises leaves nothing behind. Raises
    `OSError` with the name of `path`, such as for a full disk.
    """
    aside = path.with_name(f".{uuid.uuid4().hex}.part{path.suffix}")
    try:
        write(aside)
        os.replace(aside, path)
    except OSError as error:  # libraries do not say which file
        reason = os.strerror(error.errno) if error.errno else " ".join(str(error).split())
        raise OSError(error.errno, reason, str(path)) from error
    finally:
        aside.unlink(missing_ok=True)
