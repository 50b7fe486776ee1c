"""Files that will be written, checked before minutes are spent on their content."""

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
