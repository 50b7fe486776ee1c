"""Slip events as files and as populations, and what is asked of rules and controllers over many of them."""

from alloc.schema.errors import InputError


class StudyError(InputError):
    """What a user can mend: a file, an option, a part; the message is one line that names it and says what to do."""


class WorkerLost(RuntimeError):
    """A worker ended before its work did; what was computed is kept."""


class SourcesChanged(WorkerLost):
    """A process has loaded other sources than rows would be known by: a fault of the place, and no result of a cell."""
