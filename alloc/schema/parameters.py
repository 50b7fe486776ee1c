"""Records: parameters in frozen dataclasses, each declared once with its unit, bounds and meaning.

A record's class derives from `Parameters`, which checks all bounds in one place. Keys of files follow from the fields, what
pages say of them from the docstring below each.
"""

import ast
import math
import re
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from functools import cache
from inspect import getfile
from itertools import chain, pairwise
from linecache import getlines
from numbers import Real
from operator import attrgetter
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

    def find_fault(self, value: Any) -> str | None:
        """What `value` must be; None where it lies within."""
        real = isinstance(value, Real) and not isinstance(value, bool)
        number = float(value) if real else math.nan
        finite = self.infinite or math.isfinite(number)
        if finite and self.above < number <= self.most and self.least <= number:
            return None
        reason = "must be a number" if self.infinite else "must be a finite number"
        if self.above > -math.inf:
            reason += f", greater than {self.above:g}"
        elif self.least > -math.inf:
            reason += f", {self.least:g} or greater"
        return reason + (f", {self.most:g} at most" if self.most < math.inf else "")


ANY = Bounds()
"""Of a number that declares none: finite."""


class Fault(NamedTuple):
    """What is wrong with a record. A message states its fields, a file the keys that feed them."""

    record: Any
    reason: str
    """A sentence in which a field of the record, or of a record within, stands in backticks: "`off` must be below `on`"."""

    def word_reason(self, state: Callable[[str, Any], str]) -> str:
        """The reason with what `state` makes of each field and its value."""

        def state_field(mark: re.Match[str]) -> str:
            value = attrgetter(mark[1])(self.record)
            return state(mark[0][1:-1], value[int(mark[2])] if mark[2] else value)

        return re.sub(r"`([\w.]+)(?:\[(\d+)\])?`", state_field, self.reason)

    def __str__(self) -> str:
        return self.word_reason("{} = {!r}".format)


def quantity(
    default: Any, unit: str, *, least: float = 0.0, later: bool = False, **bounds: Any
) -> Any:
    """A number of a record, or several, kept in SI units as its `Bounds` are; MISSING as `default`: there is none.

    `unit`: the unit of the key in files, "1" for a pure number. `later`: it came after hashes of events were stored, so
    it counts in a hash where it is not its default.
    """
    metadata = {"unit": unit, "bounds": Bounds(least=least, **bounds), "later": later}
    return field(default=default, metadata=metadata)


@dataclass(frozen=True)
class Parameters:
    """Base of all records: what its fields declare is checked when it is made, then what its `_find_faults` find.

    A number lies within its bounds, a whole number is whole, a `Literal` is one of its choices; None is left alone.
    """

    error: ClassVar[type[InputError]] = InputError

    def __post_init__(self) -> None:
        for reason in chain(declared_faults(self), self._find_faults()):
            raise self.make_error(reason)

    def make_error(self, reason: str) -> InputError:
        """The error of a `Fault` of this record."""
        fault = Fault(self, reason)
        error = self.error(f"{self.owner}: {fault}")
        error.fault = fault
        return error

    @property
    def owner(self) -> str:
        """How messages call this record."""
        return re.sub(r"(?<=[a-z])(?=[A-Z])", " ", type(self).__name__).lower()

    def _find_faults(self) -> Iterator[str]:
        """Reasons of faults where values do not fit together; the declared bounds are kept, and no reason came before."""
        yield from ()


class PlantParameters(Parameters):
    """A record of train, rail or line."""

    error = PlantError


def declared_faults(record: Any) -> Iterator[str]:
    """Reasons of faults of single fields of a record, by their declarations."""
    for item in fields(record):
        value, kinds = getattr(record, item.name), (item.type, *get_args(item.type))
        if value is None and type(None) in kinds:
            continue
        literals = [kind for kind in kinds if get_origin(kind) is Literal]
        choices = [choice for literal in literals for choice in get_args(literal)]
        if choices and value not in choices:
            yield f"`{item.name}` must be one of {', '.join(choices)}"
        if item.type is bool and not isinstance(value, bool):
            yield f"`{item.name}` must be true or false"
        bounds = item.metadata.get("bounds", ANY if item.type in (float, int) else None)
        if bounds is None:
            continue
        is_tuple = isinstance(value, tuple)
        for k, number in enumerate(value if is_tuple else (value,)):
            fault = bounds.find_fault(number)
            if item.type is int and not isinstance(number, int):
                fault = "must be a whole number"
            if fault:
                yield f"`{item.name}{f'[{k}]' if is_tuple else ''}` {fault}"


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

        def rename_fields(text: str) -> str:
            return re.sub(r"`(\w+)`", lambda mark: f"`{names.get(mark[1], mark[1])}`", text)

        return self._replace(text=rename_fields(self.text), left_out=rename_fields(self.left_out))


@cache
def _read_classes(file: str) -> dict[str, ast.ClassDef]:
    """The classes at the top of a file, which is read once; `inspect.getsource` reads it for each of them."""
    nodes = ast.parse("".join(getlines(file))).body
    return {node.name: node for node in nodes if isinstance(node, ast.ClassDef)}


@cache
def meanings(kind: type) -> dict[str, Meaning]:
    """Meaning of every field of a class, its bases' included. The source is the field's own, else that of its class."""
    by_field: dict[str, Meaning] = {}
    for base in reversed(kind.__mro__):
        if base.__module__ in ("builtins", "pydantic.main"):
            continue
        of_class = parse_meaning(base.__dict__.get("__doc__") or "").source
        try:
            source = _read_classes(getfile(base)).get(base.__name__)
        except (TypeError, OSError):  # it has no source
            continue
        for item, below in pairwise(source.body if source else ()):
            if (
                isinstance(item, ast.AnnAssign)
                and isinstance(below, ast.Expr)
                and isinstance(below.value, ast.Constant)
            ):
                meaning = parse_meaning(str(below.value.value))
                name = item.target.id  # type: ignore[union-attr]
                by_field[name] = meaning._replace(source=meaning.source or of_class)
    return by_field


def parse_meaning(docstring: str) -> Meaning:
    """Content of a docstring: its text, and the marked parts."""
    text, *parts = PARTS.split(" ".join(docstring.split()))
    marked = {mark: part.strip() for mark, part in zip(parts[::2], parts[1::2], strict=True)}
    return Meaning(text.strip(), marked.get("Left out", ""), marked.get("Source", ""))
