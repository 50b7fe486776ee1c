"""Keys of files as a JSON schema, from the classes that read them: for editors, the reference page and new files.

Types, choices and bounds are pydantic's. To a key come its meaning, unit, default and source; the words that JSON schema
does not have begin with x-. A key that feeds a record of parameters has the record's default.
"""

import json
import math
from collections.abc import Callable, Iterator, Mapping
from dataclasses import MISSING, dataclass, fields
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


# The tables of a file and their keys, walked through in the order of its schema.


@dataclass(frozen=True)
class FileKey:
    """A key as the schema describes it."""

    name: str
    said: Schema
    required: bool

    @property
    def unit(self) -> str:
        """Unit of its numbers, "1" for pure ones; nothing where it has none."""
        return str(self.said.get("x-unit", ""))

    @property
    def meaning(self) -> str:
        """Meaning of the key."""
        return str(self.said.get("x-meaning", ""))

    @property
    def source(self) -> str:
        """Where meaning and value come from."""
        return str(self.said.get("x-source", ""))

    @property
    def left_out(self) -> str:
        """What applies where it is left out, if that is no plain value."""
        return str(self.said.get("x-left-out", ""))

    @property
    def default(self) -> str | None:
        """Its default as TOML, None if it has none."""
        return in_toml(self.said["default"]) if "default" in self.said else None

    @property
    def table(self) -> str | None:
        """Name of the table that the key contains, one or several of; None if it contains none."""
        return _table_of(self.said)

    @property
    def several(self) -> bool:
        """Whether it contains several tables in a row."""
        return self.said.get("type") == "array"

    @property
    def named(self) -> bool:
        """Whether it contains tables under names that the user chooses."""
        return isinstance(self.said.get("additionalProperties"), dict)


@dataclass(frozen=True)
class Table:
    """A table of a file; one with a choice of kinds is there once for each."""

    about: str
    keys: tuple[FileKey, ...]
    kinds: tuple[str, ...] = ()
    """Values of the key `kind` with which it has these keys."""


def tables_of(schema: Schema, name: str | None = None) -> list[Table]:
    """The table called `name` in the schema, None: the file itself; several where its keys depend on its kind."""
    told = schema
    while name is not None:  # a table may stand for another
        told = schema["$defs"][name]
        name = _table_of(told)
    made: list[Table] = []
    for one in told.get("oneOf", [told]):
        keys = tuple(_keys(one))
        kind = one["properties"].get("kind", {}).get("const") if "oneOf" in told else None
        if kind is None:
            made.append(Table(told.get("description", ""), keys))
            continue
        same = next((k for k, table in enumerate(made) if _like(table, keys)), None)
        if same is None:
            made.append(Table(one.get("description", ""), keys, (kind,)))
        else:
            made[same] = Table(made[same].about, made[same].keys, (*made[same].kinds, kind))
    return made


def in_toml(value: Any) -> str:
    """A value as TOML says it."""
    if isinstance(value, list | tuple):
        return f"[{', '.join(map(in_toml, value))}]"
    if isinstance(value, dict):
        return f"{{ {', '.join(f'{key} = {in_toml(one)}' for key, one in value.items())} }}"
    if isinstance(value, float) and abs(value) >= 1e6:
        return f"{value:g}" if float(f"{value:g}") == value else repr(value)
    return json.dumps(value, ensure_ascii=False).replace("\x7f", "\\u007f")


def kind_of(said: Schema) -> str:
    """What a value must be, in words."""
    if "enum" in said or "const" in said:
        return ", ".join(in_toml(one) for one in said.get("enum", [said.get("const")]))
    for word in ("anyOf", "oneOf"):
        if word in said:
            return " or ".join(kind_of(one) for one in said[word])
    if "$ref" in said:
        return "table"
    if said.get("type") == "array":
        if "$ref" in said["items"]:
            return "tables"
        of = {"number": "numbers", "integer": "whole numbers", "boolean": "true or false"}
        least, most = said.get("minItems"), said.get("maxItems")
        number = f"{least} " if least is not None and least == most else ""
        return f"list of {number}{of.get(said['items'].get('type', ''), 'values')}"
    if said.get("additionalProperties") == {"type": "string"}:
        return "texts by name"
    words = {"integer": "whole number", "boolean": "true or false", "string": "text"}
    if said.get("pattern", "").startswith(r"\."):
        return "path of a file"
    return words.get(said.get("type", ""), said.get("type", "").replace("object", "tables by name"))


def _keys(schema: Schema) -> Iterator[FileKey]:
    required = schema.get("required", ())
    for name, said in schema.get("properties", {}).items():
        yield FileKey(name, said, name in required)


def _like(table: Table, keys: tuple[FileKey, ...]) -> bool:
    def without_kind(some: tuple[FileKey, ...]) -> list[tuple[str, Schema]]:
        return [(key.name, key.said) for key in some if key.name != "kind"]

    return without_kind(table.keys) == without_kind(keys)


def _table_of(said: Schema) -> str | None:
    inner = said.get("additionalProperties")
    for part in (said, said.get("items"), inner):
        if isinstance(part, dict) and "$ref" in part:
            return str(part["$ref"]).rpartition("/")[2]
    return None
