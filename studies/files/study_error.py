"""Error of a study that is asked for something impossible: one line, naming the thing and the remedy."""

from collections.abc import Iterable
from difflib import get_close_matches

from alloc.errors import InputError


class StudyError(InputError):
    """A study cannot be made as asked; the message is one line that names the thing and what to do."""


class FileWarning(UserWarning):
    """An entry that a file lacks or has in vain, and how it was treated: one line that names file and key."""


def nearest(name: str, known: Iterable[str]) -> str | None:
    """The known name that `name` most resembles, None if there is none."""
    lowered = {one.lower(): one for one in known}
    found = get_close_matches(name.lower(), list(lowered), 1, cutoff=0.5)
    return lowered[found[0]] if found else None


def unknown(kind: str, name: str, known: Iterable[str]) -> StudyError:
    """Error for an unknown name of a `kind` of thing, with the nearest known one."""
    known = list(known)
    near = nearest(name, known)
    hint = f"did you mean {near!r}?" if near else f"known: {', '.join(known) or 'none'}"
    return StudyError(f"unknown {kind} {name!r}; {hint}")
