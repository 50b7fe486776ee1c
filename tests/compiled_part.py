"""Parts of the compiled loop, to be called by tests: by themselves they are compiled into their callers only."""

import numba


def from_python(part):
    """The same part as a function that Python can call."""

    @numba.njit
    def call(*arguments):
        return part(*arguments)

    return call
