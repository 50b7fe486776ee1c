"""What is said of a log: remarks, of which those of one kind are one line, and faults that end the analysis."""

from collections.abc import Sequence
from dataclasses import dataclass

from alloc.display import displayed
from studies.files.study_error import StudyError

MOST = 10
"""Lines of remarks on a log."""
NAMED = 4
"""Columns that a line names."""
KINDS = {
    "withheld": "no Q",
    "guess": "guessed, for want of a mapping file",
    "read": "as read",
    "time": "time",
    "delay": "delay of the train's speed",
    "sampling": "sampling",
    "gap": "gaps",
    "missing": "missing",
    "stuck": "stuck",
    "sign": "sign",
    "radius": "wheel radius",
    "balance": "momentum",
    "estimate": "estimated speed",
    "unknown": "columns not used",
    "faulty": "implausible",
}
"""Kinds of remarks in the order in which they are shown, and their heading."""


@displayed
@dataclass(frozen=True)
class Remark:
    """Remark on a log that does not prevent its analysis; times in s, rows from 1 below the header."""

    kind: str
    column: str
    text: str
    row: int | None = None
    time: float | None = None


@dataclass(frozen=True)
class RemarkGroup:
    """Remarks of one kind, as one line."""

    kind: str
    count: int
    columns: tuple[str, ...]
    text: str
    """That of the first, and how many say the like."""


class Faulty(StudyError):
    """A log that cannot be analysed."""


def faulty(source: str, column: str, row: int | None, reason: str) -> Faulty:
    """The error for a log: one line with file, column and row."""
    where = "" if row is None else f", row {row}"
    return Faulty(f"log {source!r}: column {column!r}{where}: {reason}")


def grouped(remarks: Sequence[Remark], most: int = MOST) -> list[RemarkGroup]:
    """The remarks by kind, `most` lines at most; the last line stands for all that have no place."""
    by_kind: dict[str, list[Remark]] = {}
    for remark in remarks:
        by_kind.setdefault(remark.kind, []).append(remark)
    known = [kind for kind in KINDS if kind in by_kind]
    order = known + [kind for kind in by_kind if kind not in KINDS]
    groups = [_group(kind, by_kind[kind]) for kind in order]
    if len(groups) <= most:
        return groups
    rest = groups[most - 1 :]
    text = ", ".join(f"{group.count} {group.kind}" for group in rest)
    count = sum(group.count for group in rest)
    return [*groups[: most - 1], RemarkGroup("others", count, (), f"{text}; --json has all")]


def _group(kind: str, remarks: list[Remark]) -> RemarkGroup:
    columns = tuple(dict.fromkeys(remark.column for remark in remarks))
    text = remarks[0].text
    if len(remarks) > 1:
        texts = list(dict.fromkeys(remark.text for remark in remarks))
        text = "; ".join(texts[:NAMED]) if kind in ("guess", "delay", "time") else texts[0]
        more = len(texts) - (NAMED if kind in ("guess", "delay", "time") else 1)
        if more > 0:
            text += f"; and {more} more"
    return RemarkGroup(kind, len(remarks), columns, text)
