"""Text files that people write: scenarios, trains, lines. They are small, and anything else is refused before it is read."""

from studies.files.limits import limits, too_large
from studies.files.study_error import StudyError


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
