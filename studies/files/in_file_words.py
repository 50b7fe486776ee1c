"""Messages about parameter records in the words of a file: its keys, and its units, in place of fields and SI values."""

import ast
import re
from collections.abc import Iterator
from typing import Any

from pydantic import BaseModel

from studies.files.units import Unit, unit_of

STATED = re.compile(r"(\w+)(\[\d+\])? = (\([^)]*\)|-?[\w.+-]+)")
"""A field and its value, as errors of records state them."""
NEAR = 1e-9
"""Share of a value by which conversion to SI may move it."""


def in_file_words(message: str, keys: BaseModel) -> str:
    """`message` with the keys of a file, and the values as they stand there, for fields of the records made of `keys`.

    A field is found by its name without the unit and by its value. Where several keys fit, or none does, the words stay;
    a field beside one that was found is one of the same table.
    """
    table: list[tuple[str, BaseModel]] = []

    def replaced(found: re.Match[str]) -> str:
        field, _, text = found.groups()
        value = _value(text)
        if value is None:
            return found.group()
        places = [*_places(keys, "", field, value)]
        if len(places) == 1:
            (path, key, k, record) = places[0]
            table.append((path, record))
            given = getattr(record, key)
            number = f"[{k + 1}]" if k is not None else ""
            shown = given if k is None else given[k]
            return f"{_joined(path, key)}{number} = {_plain(shown)!r}"
        for path, record in table:
            for key in type(record).model_fields:
                unit = unit_of(key)
                if field in _fields(record, key, unit) and isinstance(value, float | int):
                    return f"{_joined(path, key)} = {value / unit.factor:.6g}"
        return found.group()

    told = STATED.sub(replaced, message)
    _, parted, rest = told.partition(": ")
    # the path of the key says whose it is
    return rest if parted and table and rest.startswith(_joined(table[0][0], "")) else told


def _places(
    keys: BaseModel, path: str, field: str, value: Any
) -> Iterator[tuple[str, str, int | None, BaseModel]]:
    """Table, key, place in a list and record of every key below `keys` that stands for `field` and has this SI value."""
    for key in type(keys).model_fields:
        given, unit = getattr(keys, key), unit_of(key)
        if field in _fields(keys, key, unit):
            if _same(given, value, unit):
                yield path, key, None, keys
            elif isinstance(given, tuple):
                places = [k for k, one in enumerate(given) if _same(one, value, unit)]
                yield from ((path, key, k, keys) for k in places[:1])
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


def _fields(keys: BaseModel, key: str, unit: Unit) -> tuple[str, ...]:
    """Fields that a key may stand for: its name without the unit, and that which its table says."""
    other = getattr(type(keys), "fields_of_keys", {}).get(key, key)
    return (key.removesuffix(unit.ending) if unit.ending else key), other


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
