"""Errors, each of one line that names the thing and says what to do."""

import linecache
import os
import re
from collections.abc import Iterator
from contextlib import contextmanager
from difflib import get_close_matches
from inspect import unwrap
from pathlib import Path
from traceback import walk_tb
from typing import Any


class InputError(ValueError):
    """The input is impossible; the message names it and says what to do."""

    fault: Any = None
    """The `alloc.schema.parameters.Fault` of a record."""
    part, misspelt = "", False
    """What the message is `blamed_on`; whether its code has a name that does not exist, or cannot be compiled."""


class PlantError(InputError):
    """A parameter of train, rail or line is impossible."""


class OnboardError(InputError):
    """A parameter of the computers on board is impossible."""


class SimulationError(InputError):
    """A run cannot be made as asked."""


class AllocationError(InputError):
    """A rule got an impossible problem; the message names the field, its value and what to do."""


class EstimationError(InputError):
    """Data or a parameter of an estimation is impossible."""


class UnsoundRun(ArithmeticError):
    """A run or a metric of it broke a law that all keep: a fault of the program, and its numbers count for nothing."""


NOT_USERS = (
    *(str(Path(__file__).parents[2] / name) + os.sep for name in ("alloc", "mpc", "studies")),
    str(Path(os.__file__).parent),
    "<frozen",
    "<string>",
)
"""How names of files begin that are this project's, or Python's and its libraries'."""


@contextmanager
def blamed_on(part: str, function: Any = None) -> Iterator[None]:
    """Raise what goes wrong within as an `InputError` of one line: `part`, file and line, reason, and the nearest name.

    The line is the user's last that the error came through; without one, of `function` that with the missing name, or the
    first.
    """
    try:
        yield
    except (Exception, SystemExit) as error:
        if getattr(error, "part", ""):
            raise
        plain = unwrap(getattr(function, "func", function))
        code = getattr(plain, "__code__", None) or getattr(type(plain).__call__, "__code__", None)
        start = [(code.co_filename, code.co_firstlineno)] if code else []
        before, frames = (
            [(frame.f_code.co_filename, line) for frame, line in walk_tb(trace)]
            for trace in (getattr(error.__context__, "__traceback__", None), error.__traceback__)
        )
        places = [*before, *start, *frames]
        compiles = any(f"{os.sep}numba{os.sep}" in path for path, _ in frames)
        users = [at for at in places if not (at[0].startswith(NOT_USERS) or "-packages" in at[0])]
        file, line = users[-1] if users else ("", 0)
        text, missing = " ".join(str(error).split()) or "no message", None
        if "NoneType" not in text and (compiles or isinstance(error, NameError | AttributeError)):
            missing = re.search(r"(?:attribute|name) '?(\w+)|^'(\w+)'$", text)
        if missing:
            from alloc.schema.tables import Table

            name, lines = missing[1] or missing[2], linecache.getlines(file)
            if start and users[-1:] == start:  # where the function begins: the name is below
                searched = (*range(line, len(lines) + 1), *range(1, line))
                named_in = (k for k in searched if re.search(rf"\b{name}\b", lines[k - 1]))
                line = next(named_in, line)
            names = {*dir(getattr(error, "obj", None)), *re.findall(r"\w+", "".join(lines))}
            names.update(*(table.columns for table in Table.every))
            nearest = get_close_matches(name, names - {name}, 1, 0.7)
            text += f"; did you mean {nearest[0]!r}?" if nearest else ""
        elif compiles:
            text = f"{text:.300}; without the decorator Python serves it"
        kind: Any = type(error) if isinstance(error, InputError) else InputError
        fault = "fault" if kind is type(error) else type(error).__name__
        place = f": {fault} in line {line}" if users else ""
        if users and file not in part:
            place = f" of {file}{place}"
        if not users and kind is not type(error):
            text = f"{fault}: {text}"
        named = kind(f"{part}{place}: {text}")
        named.fault, named.part = getattr(error, "fault", None), part
        named.misspelt = compiles or missing is not None
        raise named from error
