"""Slip events as files and as populations, and what is asked of rules and controllers over many of them."""

from alloc.schema.errors import InputError


class StudyError(InputError):
    """What a user can mend: a file, an option, a part; the message is one line that names it and says what to do."""


class PartFailed(RuntimeError):
    """A part failed in so many events that the others tell nothing of it."""


class WorkerLost(RuntimeError):
    """A worker ended before its work did; what was computed is kept."""


class SourcesChanged(WorkerLost):
    """A process has loaded other sources than rows would be known by: a fault of the place, and no result of a cell."""


RARELY = 50_000, 20, 20
"""Thresholds of `gc` in processes of this project: what they import and compile is kept, so there is no garbage to find, and
looking for it takes a fifth of a short command and of compiling. Memory is the same."""
