"""Records: parameters in frozen dataclasses, each declared once with its unit, bounds and meaning.

A record's class derives from `Parameters`, which checks all bounds in one place. Keys of files follow from the fields, what
pages say of them from the docstring below each.
"""

import ast
import math
import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from inspect import getfile
from itertools import pairwise
from linecache import getlines
from numbers import Real
from typing import Any, ClassVar, Literal, NamedTuple, get_args, get_origin

from alloc.schema.errors import InputError, PlantError

NOT_IN_FILES = {"unit": None}
"""Metadata of a field that no scenario file sets."""


class Bounds(NamedTuple):
    """Where a number may lie, in SI units."""

    above: float = -math.inf
    least: float = -math.inf
    most: float = math.inf
    infinite: bool = False

    def fault(self, value: Any) -> str | None:
        """What `value` must be; None where it lies within."""
        real = isinstance(value, Real) and not isinstance(value, bool)
        number = float(value) if real else math.nan
        finite = self.infinite or math.isfinite(number)
        if finite and self.above < number <= self.most and self.least <= number:
            return None
        said = "must be a number" if self.infinite else "must be a finite number"
        if self.above > -math.inf:
            said += f", greater than {self.above:g}"
        elif self.least > -math.inf:
            said += f", {self.least:g} or greater"
        return said + (f", {self.most:g} at most" if self.most < math.inf else "")


ANY = Bounds()
"""Of a number that declares none: finite."""


def quantity(
    default: Any, unit: str, *, least: float = 0.0, later: bool = False, **others: Any
) -> Any:
    """A number of a record, or several, kept in SI units as its `Bounds` are; MISSING as `default`: there is none.

    `unit`: that of the key in files, "1" for a pure number. `later`: it came after hashes of events were stored, so
    it counts in a hash where it is not its default.
    """
    bounds = Bounds(least=least, **others)
    return field(default=default, metadata={"unit": unit, "bounds": bounds, "later": later})


@dataclass(frozen=True)
class Parameters:
    """Base of all records: what its fields declare is checked when it is made, then what its `_faults` find.

    A number lies within its bounds, a whole number is whole, a `Literal` is one of its choices; None is left alone.
    """

    error: ClassVar[type[InputError]] = InputError

    def __post_init__(self) -> None:
        for found in (declared_faults(self), self._faults()):
            for fault in found:
                told = self.error(f"{self.owner}: {fault}")
                told.fault = fault
                raise told

    @property
    def owner(self) -> str:
        """How messages call this record."""
        return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(self).__name__).lower()

    def _faults(self) -> Iterator[str]:
        """What does not fit together, the declared bounds being kept; each is looked for where there is none before it."""
        yield from ()


class PlantParameters(Parameters):
    """A record of train, rail or line."""

    error = PlantError


def declared_faults(record: Any) -> Iterator[str]:
    """What is wrong with single fields of a record by their declarations, in words that name the field."""
    for item in fields(record):
        value, kinds = getattr(record, item.name), (item.type, *get_args(item.type))
        if value is None and type(None) in kinds:
            continue
        choices = [one for kind in kinds if get_origin(kind) is Literal for one in get_args(kind)]
        if choices and value not in choices:
            yield f"{item.name} = {value!r} must be one of {', '.join(choices)}"
        if item.type is bool and not isinstance(value, bool):
            yield f"{item.name} = {value!r} must be true or false"
        bounds = item.metadata.get("bounds", ANY if item.type in (float, int) else None)
        if bounds is None or isinstance(value, str):
            continue
        several = isinstance(value, tuple)
        for k, one in enumerate(value if several else (value,)):
            fault = bounds.fault(one)
            if item.type is int and not isinstance(one, int):
                fault = "must be a whole number"
            if fault:
                yield f"{item.name}{f'[{k}]' if several else ''} = {one!r} {fault}"


# The meaning of a field or a key: the docstring below it. At its end "Left out:" says what applies without the key,
# "Source:" where meaning and value come from.

PARTS = re.compile(r"(?:^|(?<=\s))(Left out|Source): ")


class Meaning(NamedTuple):
    """What is said of a key; empty where nothing is."""

    text: str = ""
    left_out: str = ""
    """What applies where the key is left out, if that is no plain number."""
    source: str = ""

    def with_names(self, names: Mapping[str, str]) -> "Meaning":
        """The same with other names for what stands in backticks."""

        def renamed(text: str) -> str:
            return re.sub(r"`(\w+)`", lambda found: f"`{names.get(found[1], found[1])}`", text)

        return self._replace(text=renamed(self.text), left_out=renamed(self.left_out))


@cache
def _classes(file: str) -> dict[str, ast.ClassDef]:
    """The classes of a file, which is read once; `inspect.getsource` reads it for each of them."""
    nodes = ast.walk(ast.parse("".join(getlines(file))))
    return {one.name: one for one in nodes if isinstance(one, ast.ClassDef)}


@cache
def meanings(kind: type) -> dict[str, Meaning]:
    """Meaning of every field of a class, its bases' included. The source is the field's own, else that of its class."""
    found: dict[str, Meaning] = {}
    for base in reversed(kind.__mro__):
        if base.__module__ in ("builtins", "pydantic.main"):
            continue
        of_class = meant(base.__dict__.get("__doc__") or "").source
        try:
            stated = _classes(getfile(base)).get(base.__name__)
        except (TypeError, OSError):  # it has no source
            continue
        for one, said in pairwise(stated.body if stated else ()):  # a field, and the string below
            if (
                isinstance(one, ast.AnnAssign)
                and isinstance(said, ast.Expr)
                and isinstance(said.value, ast.Constant)
            ):
                meaning = meant(str(said.value.value))
                found[one.target.id] = meaning._replace(source=meaning.source or of_class)  # type: ignore[union-attr]
    return found


def meant(docstring: str) -> Meaning:
    """Content of a docstring: its text, and the marked parts."""
    text, *parts = PARTS.split(" ".join(docstring.split()))
    said = {mark: part.strip() for mark, part in zip(parts[::2], parts[1::2], strict=True)}
    return Meaning(text.strip(), said.get("Left out", ""), said.get("Source", ""))
