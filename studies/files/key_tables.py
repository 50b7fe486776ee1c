"""The tables of a file and their keys, walked through in the order of its schema."""

import json
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Any

from studies.files.json_schema import Schema


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
