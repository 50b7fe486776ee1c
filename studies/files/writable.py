"""Files that will be written, checked before minutes are spent on their content."""

import tempfile
from pathlib import Path

from studies.files.study_error import StudyError


def check_writable(path: Path) -> None:
    """Raise `StudyError` if a file cannot be written, before minutes are spent on its content."""
    existed = path.exists()
    try:
        with open(path, "ab"):
            pass
        if not existed:
            path.unlink()
    except OSError as error:
        raise StudyError(f"file {str(path)!r} cannot be written: {error.strerror}") from None


def check_folder(folder: Path) -> None:
    """Make a folder for results; raises `StudyError` if it cannot be made or written."""
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):
            pass
    except OSError as error:
        raise StudyError(
            f"output folder {str(folder)!r} cannot be written: {error.strerror}; choose another with --out"
        ) from None
