"""How records show themselves to a person: in one line, and in a notebook as a small table with units and meanings.

Only what is shown changes. Equality, hashes and pickles are those of the record, and keys of results are made of
`alloc.old.event`, which leaves nothing out.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import MISSING, fields, is_dataclass
from html import escape
from numbers import Real
from typing import Any, TypeVar

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


def displayed(kind: Kind) -> Kind:
    """Class decorator of a record (dataclass, named tuple, class of keys): short line, and a table in notebooks.

    A dataclass that is made with `repr=False` writes its line itself. Put it above `@dataclass`.
    """
    made: Any = kind
    if not _writes_its_line(kind):
        made.__repr__ = line_of
    made.__str__ = object.__str__  # which is the line; pydantic has another
    made._repr_html_ = _table_of_record
    return kind


def line_of(record: Any) -> str:
    """One line: kind and name, then the fields that are not as by default, as many as fit."""
    changed = [
        (name, f"{name} {brief(value)}{f' {unit}' if unit and value is not None else ''}")
        for name, value, unit, _, default in _fields(record)
        if not _same(value, default)
    ]
    own = ", ".join(text for name, text in changed if name != "name")
    said = own if changed else "as by default"
    return f"{cut(': '.join(filter(None, (f'<{_heading(record)}', said))), LONGEST)}>"


def table(heading: str, rows: Sequence[Sequence[str]]) -> str:
    """HTML of a table of texts, which are escaped; the first of each row names it."""
    left = 'style="text-align: left"'
    body = "".join(
        f"<tr><th {left}>{escape(first)}</th>"
        + "".join(f"<td {left}>{escape(one)}</td>" for one in others)
        + "</tr>"
        for first, *others in rows
    )
    return f"<table><caption>{escape(heading)}</caption><tbody>{body}</tbody></table>"


def brief(value: Any) -> str:
    """A value in a few words: of many numbers how many and their range, of records how many of what kind."""
    if value is None:
        return "none"
    if isinstance(value, bool | np.bool_):
        return "yes" if value else "no"
    if isinstance(value, int | np.integer):
        return str(value)
    if isinstance(value, Real):
        return f"{float(value):.4g}"
    if isinstance(value, np.ndarray):
        return _numbers(value)
    if isinstance(value, str | Mapping):
        return cut(value if isinstance(value, str) else ", ".join(map(str, value))) or "–"
    if isinstance(value, tuple | list) and not hasattr(value, "_fields"):
        kinds = sorted({type(one).__name__ for one in value})
        if all(isinstance(one, Real) for one in value):
            return _numbers(np.asarray(value))
        many = f"{len(value)} × {' or '.join(kinds)}"
        return cut(", ".join(value)) if kinds == ["str"] else many
    sizes = [f"{n} {name}" for name, n in getattr(value, "sizes", {}).items()]  # of a data set
    if hasattr(value, "_repr_html_") and hasattr(value, "shape"):  # a table of a library
        sizes = [str(n) for n in value.shape]
    if sizes:
        return f"{type(value).__name__} of {' × '.join(sizes)}"
    return _heading(value) if _is_record(value) else getattr(value, "__qualname__", _heading(value))


def cut(text: str, most: int = LONGEST_TEXT) -> str:
    """The text in one line, with at most this many characters."""
    text = " ".join(text.split())
    return text if len(text) <= most else f"{text[: most - 1]}…"


def _writes_its_line(kind: type) -> bool:
    params = vars(kind).get("__dataclass_params__")
    return params is not None and not params.repr


def _is_record(value: Any) -> bool:
    """Whether a value is a dataclass, a named tuple or keys of a file, and no class of them."""
    known = is_dataclass(value) or hasattr(value, "_fields") or hasattr(value, "model_fields_set")
    return known and not isinstance(value, type)


def _heading(record: Any) -> str:
    """Kind of a record, and its name where it has one."""
    name = getattr(record, "name", None)
    kind = type(record).__name__
    return f"{kind} {cut(name)!r}" if isinstance(name, str) and name else kind


def _numbers(values: Any) -> str:
    if values.ndim <= 1 and values.size <= FEW:
        return ", ".join(brief(one) for one in values.ravel().tolist()) or "–"
    count = f"{' × '.join(map(str, values.shape))} values"
    if values.dtype == bool:
        return f"{count}, {int(values.sum())} yes"
    if values.dtype.kind not in "fiu":
        return count
    known = values[~np.isnan(values)]
    said = f"{known.min():.4g} to {known.max():.4g}" if known.size else "none is known"
    return f"{count}, {said}"


def _table_of_record(record: Any) -> str:
    """The record's line, or its heading, above a row per field: name, value, unit, meaning."""
    heading = repr(record)[1:-1] if _writes_its_line(type(record)) else _heading(record)
    rows: list[tuple[str, ...]] = []
    for name, value, unit, meaning, _ in _fields(record):
        if isinstance(value, Mapping) and value:
            rows += [(f"{name}: {key}", _cell(one), unit, "") for key, one in value.items()]
        elif name != "name":  # which stands in the heading
            rows.append((name, _cell(value), unit, meaning))
    left = len(rows) - MOST_ROWS
    return table(heading, rows[:MOST_ROWS] + [(f"{left} more", "", "", "")] * (left > 0))


def _cell(value: Any) -> str:
    """A value in a table: a text as it stands, a record with its line."""
    if isinstance(value, str):
        return value
    if not _is_record(value):
        return brief(value)
    return (repr(value) if _writes_its_line(type(value)) else line_of(value))[1:-1]


def _fields(record: Any) -> Iterator[tuple[str, Any, str, str, Any]]:
    """Of the fields that are set name, value, unit, meaning and default; a record that is only half made has fewer."""
    from alloc.old.records import Meaning, meanings

    if is_dataclass(record):
        defaults: dict[str, Any] = {
            one.name: one.default if one.default_factory is MISSING else one.default_factory()
            for one in fields(record)
            if one.repr
        }
    elif hasattr(record, "_fields"):
        defaults = {name: record._field_defaults.get(name, MISSING) for name in record._fields}
    else:
        given = record.model_fields_set
        known = type(record).model_fields
        defaults = {name: MISSING if name in given else getattr(record, name) for name in known}
    kind: type = type(record)
    for name, default in defaults.items():
        value = getattr(record, name, MISSING)
        if value is not MISSING:
            said = meanings(kind).get(name, Meaning())
            yield name, value, said.unit, said.text, default


def _same(value: Any, default: Any) -> bool:
    """Whether a value is the default; of arrays and the like, whether it is the very object."""
    if value is default:
        return True
    try:
        same = type(value) is type(default) and (
            value == default or (value != value and default != default)
        )
    except ValueError:  # records that hold arrays
        return False
    return same is True
