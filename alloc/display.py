"""How records show themselves to a person: in one line, and in a notebook as a small table with units and meanings.

Only what is shown changes. Equality, hashes and pickles are those of the record, and keys of results are made of
`alloc.event`, which leaves nothing out.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from html import escape
from numbers import Number
from typing import Any, NamedTuple, TypeVar

import numpy as np

Kind = TypeVar("Kind", bound=type)

LONGEST = 118
"""Characters of a line."""
LONGEST_TEXT = 60
"""Characters of a text within a line."""
FEW = 4
"""Numbers that are written one by one; of more, their range is."""
MOST_ROWS = 60
"""Largest number of rows of a table; a record may contain a mapping of thousands."""


class _Field(NamedTuple):
    """A field of a record: name, value, unit, meaning, and whether the value is what it is by default."""

    name: str
    value: Any
    unit: str
    meaning: str
    as_by_default: bool


def displayed(kind: Kind) -> Kind:
    """Class decorator of a record (dataclass, named tuple, class of keys): short line, and a table in notebooks.

    A dataclass that is made with `repr=False` writes its line itself. Put it above `@dataclass`.
    """
    made: Any = kind
    params = vars(kind).get("__dataclass_params__")
    if params is None or params.repr:
        made.__repr__ = line_of
    made.__str__ = object.__str__  # which is the line; pydantic has another
    made._repr_html_ = _table_of_record
    return kind


def line_of(record: Any) -> str:
    """One line: kind and name, then the fields that are not as by default, as many as fit."""
    heading, own, as_by_default = _heading(record), [], True
    for one in _fields(record):
        as_by_default &= one.as_by_default
        if not one.as_by_default and one.name != "name":
            own.append(f"{one.name} {brief(one.value)}{_after(one)}")
    if as_by_default:
        return f"<{heading}: as by default>"
    line = f"<{heading}"
    for k, part in enumerate(own):
        longer = f"{line}{', ' if k else ': '}{part}"
        if len(longer) > LONGEST:
            return f"{cut(longer, LONGEST)}>"
        line = longer
    return f"{line}>"


def table(heading: str, rows: Sequence[Sequence[str]]) -> str:
    """HTML of a table of texts, which are escaped; the first of each row names it."""
    body = "".join(
        f'<tr><th style="text-align: left">{escape(first)}</th>'
        + "".join(f'<td style="text-align: left">{escape(one)}</td>' for one in others)
        + "</tr>"
        for first, *others in rows
    )
    return f"<table><caption>{escape(heading)}</caption><tbody>{body}</tbody></table>"


def brief(value: Any) -> str:
    """A value in a few words: of many numbers how many and their range, of records how many of what kind."""
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return str(value)
    if isinstance(value, Number) and not isinstance(value, complex):
        return f"{float(value):.4g}"  # type: ignore[arg-type]
    if isinstance(value, str):
        return cut(value) if value else "–"
    if value is None:
        return "none"
    if isinstance(value, np.ndarray):
        return _many_numbers(value)
    if isinstance(value, Mapping):
        return cut(", ".join(map(str, value))) if value else "–"
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        return _sequence(value)
    if hasattr(value, "_repr_html_") and hasattr(value, "shape"):  # a table of a library
        return f"{type(value).__name__} of {' × '.join(map(str, value.shape))}"
    if hasattr(value, "sizes"):  # a data set
        return f"{type(value).__name__} of " + " × ".join(
            f"{n} {name}" for name, n in value.sizes.items()
        )
    if _is_record(value):
        return _heading(value)
    return str(getattr(value, "__qualname__", None) or _heading(value))


def cut(text: str, most: int = LONGEST_TEXT) -> str:
    """The text in one line, with at most this many characters."""
    text = " ".join(text.split())
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _is_record(value: Any) -> bool:
    """Whether a value is a dataclass, a named tuple or keys of a file, and no class of them."""
    known = is_dataclass(value) or hasattr(value, "_fields") or hasattr(value, "model_fields_set")
    return known and not isinstance(value, type)


def _heading(record: Any) -> str:
    """Kind of a record, and its name where it has one."""
    name = getattr(record, "name", None)
    kind = type(record).__name__
    return f"{kind} {cut(name)!r}" if isinstance(name, str) and name else kind


def _after(one: _Field) -> str:
    """A number's unit behind it."""
    return f" {one.unit}" if one.unit and one.value is not None else ""


def _sequence(values: Any) -> str:
    if not values:
        return "–"
    if all(isinstance(one, Number) for one in values):
        return _many_numbers(np.asarray(values))
    kinds = sorted({type(one).__name__ for one in values})
    if kinds == ["str"]:
        return cut(", ".join(values))
    return f"{len(values)} × {' or '.join(kinds)}"


def _many_numbers(values: Any) -> str:
    if values.ndim <= 1 and values.size <= FEW:
        return ", ".join(brief(one) for one in values.ravel().tolist()) or "–"
    count = f"{' × '.join(map(str, values.shape))} values"
    if values.dtype == bool:
        return f"{count}, {int(values.sum())} yes"
    if values.dtype.kind not in "fiu":
        return count
    known = values[~np.isnan(values)]
    return (
        f"{count}, {known.min():.4g} to {known.max():.4g}"
        if known.size
        else f"{count}, none is known"
    )


def _table_of_record(record: Any) -> str:
    """The record's line, or its heading, above a row per field: name, value, unit, meaning."""
    own_line = repr(record)
    written = type(record).__repr__ is not line_of and own_line.startswith("<")
    return table(own_line[1:-1] if written else _heading(record), _rows(record))


def _rows(record: Any) -> list[tuple[str, ...]]:
    rows: list[tuple[str, ...]] = []
    for one in _fields(record):
        if one.name == "name":
            continue  # stands in the heading
        if isinstance(one.value, Mapping) and one.value:
            rows += [
                (f"{one.name}: {key}", _cell(value), one.unit, "")
                for key, value in one.value.items()
            ]
        else:
            rows.append((one.name, _cell(one.value), one.unit, one.meaning))
    left = len(rows) - MOST_ROWS
    return rows if left <= 0 else [*rows[:MOST_ROWS], (f"{left} more", "", "", "")]


def _cell(value: Any) -> str:
    """A value in a table: a text as it stands, a record with its line."""
    if isinstance(value, str):
        return value
    if not _is_record(value):
        return brief(value)
    params = getattr(type(value), "__dataclass_params__", None)
    return (line_of(value) if params is None or params.repr else repr(value))[1:-1]


def _fields(record: Any) -> Iterator[_Field]:
    """Fields that are set; a record that is only half made has fewer."""
    from alloc.records import Meaning, meanings

    kind: type = type(record)
    said = meanings(kind)
    for name, default in _defaults(record).items():
        value = getattr(record, name, MISSING)
        if value is not MISSING:
            meaning = said.get(name, Meaning())
            yield _Field(name, value, meaning.unit, meaning.text, _same(value, default))


def _defaults(record: Any) -> dict[str, Any]:
    """Default of every field that a person is to see; MISSING: it has none."""
    if is_dataclass(record):
        return {
            one.name: one.default if one.default_factory is MISSING else one.default_factory()
            for one in fields(record)
            if one.repr
        }
    if hasattr(record, "_fields"):
        return {name: record._field_defaults.get(name, MISSING) for name in record._fields}
    return {
        name: MISSING if name in record.model_fields_set else getattr(record, name)
        for name in type(record).model_fields
    }


def _same(value: Any, default: Any) -> bool:
    """Whether a value is the default; of arrays and the like, whether it is the very object."""
    if value is default:
        return True
    if isinstance(value, float) and isinstance(default, float) and value != value:
        return default != default
    try:
        same = type(value) is type(default) and value == default
    except ValueError:  # records that hold arrays
        return False
    return isinstance(same, bool) and same
