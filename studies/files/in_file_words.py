"""Messages about parameter records in the words of a file: its keys, and its units, in place of fields and SI values."""

import ast
import re
from collections.abc import Iterator
from typing import Any, get_args

from pydantic import BaseModel

from alloc.units import Unit, unit_of

STATED = re.compile(r"((?:\w+\.)*\w+)(\[\d+\])? = (\([^)]*\)|-?[\w.+-]+)")
"""A field and its value, as errors of records state them; `part.field` for a field of a record inside."""
NEAR = 1e-9
"""Share of a value by which conversion to SI may move it."""


def in_file_words(message: str, keys: BaseModel) -> str:
    """`message` with the keys of a file, and the values as they stand there, for fields of the records made of `keys`.

    A field is found by its name without the unit and by its value. Where several keys fit, or none does, the words stay;
    a field beside one that was found is one of the same table, also where the file leaves it out.
    """
    table: list[tuple[str, BaseModel]] = []

    def replaced(found: re.Match[str]) -> str:
        field, _, text = found.groups()
        value = _value(text)
        if value is None:
            return found.group()
        places = [*_places(keys, "", field, value)]
        if len(places) == 1:
            (path, key, k, given, record) = places[0]
            table.append((path, record))
            number = f"[{k + 1}]" if k is not None else ""
            shown = given if k is None else given[k]
            return f"{_joined(path, key)}{number} = {_plain(shown)!r}"
        if isinstance(value, float | int):
            for path, record in table:
                for key, unit in _keys_of(type(record), field):
                    return f"{_joined(path, key)} = {value / unit.factor:.6g}"
        return found.group()

    STATED.sub(replaced, message)  # the field that was given may stand behind one that was not
    told = STATED.sub(replaced, message)
    _, parted, rest = told.partition(": ")
    # the path of the key says whose it is
    return rest if parted and table and rest.startswith(_joined(table[0][0], "")) else told


def _places(
    keys: BaseModel, path: str, field: str, value: Any
) -> Iterator[tuple[str, str, int | None, Any, BaseModel]]:
    """Every key below `keys` that stands for `field` and has this SI value.

    Yields the table's path, the key within it, the place in a list, the value in the file, and the table's record.
    """
    for key, unit in _keys_of(type(keys), field):
        given = _at(keys, key)
        if _same(given, value, unit):
            yield path, key, None, given, keys
        elif isinstance(given, tuple):
            places = [k for k, one in enumerate(given) if _same(one, value, unit)]
            yield from ((path, key, k, given, keys) for k in places[:1])
    for key in type(keys).model_fields:
        given = getattr(keys, key)
        inside = _joined(path, key)
        if isinstance(given, BaseModel):
            yield from _places(given, inside, field, value)
        elif isinstance(given, tuple):
            for k, one in enumerate(given):
                if isinstance(one, BaseModel):
                    yield from _places(one, f"{inside}[{k + 1}]", field, value)
        elif isinstance(given, dict):
            for name, one in given.items():
                if isinstance(one, BaseModel):
                    yield from _places(one, _joined(inside, name), field, value)


def _keys_of(table: type[BaseModel], field: str) -> Iterator[tuple[str, Unit]]:
    """Keys of a table that stand for `field`, which may name tables inside it, each with its unit.

    A key stands for the field of its name without the unit, and for that which its table says.
    """
    part, dotted, name = field.partition(".")
    if dotted:
        inner = _table_in(table, part)
        yield from (
            (_joined(part, key), unit) for key, unit in (_keys_of(inner, name) if inner else ())
        )
        return
    others = getattr(table, "fields_of_keys", {})
    for key in table.model_fields:
        unit = unit_of(key)
        bare = key.removesuffix(unit.ending) if unit.ending else key
        if field in (bare, others.get(key, key)):
            yield key, unit


def _table_in(table: type[BaseModel], key: str) -> type[BaseModel] | None:
    """The table that a key holds, also one that may be left out; None for any other key."""
    stated = table.model_fields[key].annotation if key in table.model_fields else None
    for kind in (stated, *get_args(stated)):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def _at(keys: BaseModel, key: str) -> Any:
    """What a file gives for a key, or for one of a table inside; None where the table is left out."""
    found: Any = keys
    for part in key.split("."):
        found = getattr(found, part, None)
    return found


def _same(given: Any, value: Any, unit: Unit) -> bool:
    """Whether a value of a file is this SI value."""
    if isinstance(given, tuple) and isinstance(value, tuple):
        return len(given) == len(value) and all(
            _same(a, b, unit) for a, b in zip(given, value, strict=True)
        )
    if isinstance(given, bool) or not isinstance(given, float | int):
        return False
    if isinstance(value, bool) or not isinstance(value, float | int):
        return False
    return abs(given * unit.factor - value) <= NEAR * abs(value)


def _value(text: str) -> Any:
    """The number, or the numbers, that a message states; None for anything else."""
    try:
        return ast.literal_eval(text.rstrip("."))
    except (ValueError, SyntaxError):
        return None


def _plain(value: Any) -> Any:
    """A value as a file states it: several in a list."""
    return list(value) if isinstance(value, tuple) else value


def _joined(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key
