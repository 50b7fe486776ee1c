"""Keys of files as a JSON schema, from the classes that read them: for editors, the reference page and new files.

Types, choices and bounds are pydantic's. To a key come its meaning, unit, default and source; the words that JSON schema
does not have begin with x-. A key that feeds a record of parameters has the record's default.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import MISSING, fields
from typing import Any

from pydantic import BaseModel

from alloc.records import Meaning, meanings, meant
from alloc.units import Unit, unit_of

DIALECT = "https://json-schema.org/draft/2020-12/schema"
Schema = dict[str, Any]


def schema_of(kind: type[BaseModel], title: str) -> Schema:
    """Schema of a file that `kind` reads."""
    return {"$schema": DIALECT, "title": title} | plain(kind.model_json_schema())


def describe(schema: Schema, kind: type[BaseModel], record: type | None) -> None:
    """Add to the keys in the schema of `kind` what is known of them; `record`: the parameters that they feed."""
    defaults = _defaults(record) if record else {}
    keys = {key.removesuffix(unit_of(key).ending): key for key in schema.get("properties", {})}
    schema["description"] = meant(schema.get("description", "")).text
    for key, said in schema.get("properties", {}).items():
        unit = unit_of(key)
        name = key.removesuffix(unit.ending)
        default = said.pop("default", None)
        if key in schema.get("required", ()):
            default = None
        elif default is None and name in defaults:
            default = in_unit(defaults[name], unit.factor if unit.ending else 1.0)
        meaning = meaning_of(key, kind, record) or meant(said.pop("description", ""))
        meaning = meaning.with_names(keys)
        add(said, meaning, unit.symbol if unit.ending else meaning.unit, default)
        bound_numbers(said, unit)


def meaning_of(key: str, kind: type, record: type | None) -> Meaning | None:
    """What is said of a key in its class, else in the record of parameters that it feeds; None where nothing is."""
    name = key.removesuffix(unit_of(key).ending)
    return meanings(kind).get(key) or (meanings(record).get(name) if record else None)


def add(said: Schema, meaning: Meaning, unit: str, default: Any) -> None:
    """Add meaning, unit and default to what is `said` of a key; a number without unit has the unit 1."""
    unit = unit or ("1" if _number(said) else "")
    said.pop("title", None)
    facts = {"x-unit": unit, "x-left-out": meaning.left_out, "x-source": meaning.source}
    said |= {name: fact for name, fact in facts.items() if fact}
    if isinstance(default, bool | int | float | str | list | tuple):
        said["default"] = list(default) if isinstance(default, tuple) else default
    parts = [meaning.text, f"Unit: {unit}." if unit not in ("", "1") else ""]
    parts += [f"Left out: {meaning.left_out}" if meaning.left_out else ""]
    parts += [f"Source: {meaning.source}" if meaning.source else ""]
    if any(parts):
        said["description"] = " ".join(part for part in parts if part)
        said["x-meaning"] = meaning.text


def in_unit(value: Any, factor: float) -> Any:
    """A value in SI units as a file states it; None for a value that no file can state."""
    if isinstance(value, tuple):
        return tuple(in_unit(one, factor) for one in value)
    if isinstance(value, bool) or not isinstance(value, int | float):
        return value if isinstance(value, bool | str) else None
    if isinstance(value, int) and factor == 1.0:
        return value
    return float(f"{value / factor:.12g}") if math.isfinite(value) else None


def bound_numbers(said: Schema, unit: Unit) -> None:
    """Bound every number of a key that has no bounds of its own, generously."""
    if said.get("type") in ("number", "integer"):
        if not {"minimum", "exclusiveMinimum"} & said.keys():
            said["minimum"] = -unit.most
        if not {"maximum", "exclusiveMaximum"} & said.keys():
            said["maximum"] = unit.most
    for part in _parts(said):
        bound_numbers(part, unit)


def plain(schema: Any) -> Any:
    """The schema without what no TOML file can hold (null), and without titles that repeat the key.

    A list of a fixed number of like items is said in words that every draft of JSON schema has.
    """
    if isinstance(schema, list):
        return [plain(one) for one in schema]
    if not isinstance(schema, Mapping):
        return schema
    found = {
        key: plain(value)
        for key, value in schema.items()
        if key != "title" or not isinstance(value, str)
    }
    items = found.pop("prefixItems", None)
    if items:
        found["items"] = items[0]
    for word in ("anyOf", "oneOf"):
        found = _without_null(found, word)
    return found


def _without_null(schema: Schema, word: str) -> Schema:
    choices = schema.get(word)
    if not isinstance(choices, list) or {"type": "null"} not in choices:
        return schema
    left = [one for one in choices if one != {"type": "null"}]
    rest = {key: value for key, value in schema.items() if key != word}
    return rest | ({word: left} if len(left) > 1 else left[0])


def _defaults(record: type) -> dict[str, Any]:
    found = {}
    for item in fields(record):
        if item.default is not MISSING:
            found[item.name] = item.default
    return found


def _parts(said: Schema) -> list[Schema]:
    found = [*said.get("anyOf", ()), *said.get("oneOf", ()), *said.get("prefixItems", ())]
    items = said.get("items")
    return [*found, items] if isinstance(items, dict) else found


def _number(said: Schema) -> bool:
    return said.get("type") in ("number", "integer") or any(map(_number, _parts(said)))


class Names:
    """Names that a text may be, asked for when the schema is made: plug-ins bring more. `pattern`: or any such text."""

    def __init__(self, names: Callable[[], Any], pattern: str | None = None) -> None:
        self._names, self._pattern = names, pattern

    def __get_pydantic_json_schema__(self, core: Any, handler: Any) -> Schema:
        known: Schema = {"enum": list(self._names())}
        if self._pattern is None:
            return known
        return {"anyOf": [known, {"type": "string", "pattern": self._pattern}]}
