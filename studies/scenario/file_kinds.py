"""Kinds of files in the project's own format, their schemas, and the reference page of their keys."""

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from pydantic import BaseModel

from studies.files.json_schema import FileKey, Schema, Table, in_toml, kind_of, schema_of, tables_of
from studies.scenario.line_file import LineFileKeys
from studies.scenario.scenario import Scenario
from studies.scenario.train_file import TrainKeys

FILE_KINDS: dict[str, type[BaseModel]] = {
    "scenario": Scenario,
    "train": TrainKeys,
    "line": LineFileKeys,
}
"""What a file may describe, and what reads it."""

HEAD = """# Keys

Every key of the project's own files. `readhesion schema --reference` writes this page from the classes that read the files,
and with `--plugin FILE` it has the parts of that file too. Nothing here is written by hand.

A key's ending is its unit: `speed_kmh` is in km/h. A pure number has the unit 1. A key that is left out has its default;
where that is no plain value, the column says in words what holds. "Assumed" marks a value that no source prints.

A value's column says what is checked of a key alone. What keys ask of each other, as an order or a sign, is checked when the
file is read.

`readhesion schema` prints the same as a JSON schema, and `readhesion new-scenario NAME` writes a file with all keys. An
editor that reads schemas (taplo, or a plug-in with it) completes and checks a file whose first line is `#:schema PATH`.
"""


def schema_of_kind(kind: str) -> Schema:
    """JSON schema of a kind of file, with the parts of plug-ins."""
    return schema_of(FILE_KINDS[kind], f"readhesion {kind}")


def reference_page() -> str:
    """All keys of all kinds of files, in Markdown."""
    lines = [HEAD]
    for kind in FILE_KINDS:
        schema = schema_of_kind(kind)
        lines += [f"## Keys of a {kind} file", ""]
        places: dict[str | None, list[str]] = {}
        for place, name in places_of(schema):
            places.setdefault(name, []).append(place)
        for name, where in places.items():
            for table in tables_of(schema, name):
                lines += _section(table, where)
    return "\n".join(lines).rstrip() + "\n"


def places_of(
    schema: Schema, name: str | None = None, place: str = ""
) -> Iterator[tuple[str, str | None]]:
    """Place in a file, such as "[[rail.patches]]", and name of every table of its schema, in the schema's order."""
    yield place, name
    path = place.strip("[]")
    found = {key.name: key for table in tables_of(schema, name) for key in table.keys}
    for key in found.values():
        if key.table is not None:
            inner = f"{path}.{key.name}" if path else key.name
            inner += ".X" if key.named else ""
            inner = f"[[{inner}]]" if key.several else f"[{inner}]"
            yield from places_of(schema, key.table, inner)


def _section(table: Table, places: list[str]) -> Iterator[str]:
    title = ", ".join(f"`{place}`" for place in places if place) or "Top of the file"
    kinds = " or ".join(f'`kind = "{kind}"`' for kind in table.kinds)
    yield from (f"### {title}" + (f", {kinds}" if kinds else ""), "", table.about.strip(), "")
    yield "| key | value | unit | default | meaning | source |"
    yield "|---|---|---|---|---|---|"
    for key in table.keys:
        source = key.source.removesuffix(".")
        cells = (f"`{key.name}`", kind_of(key.said), key.unit, _default(key), key.meaning, source)
        yield "| " + " | ".join(_cell(cell) for cell in cells) + " |"
    yield ""


def _default(key: FileKey) -> str:
    if key.required:
        return "required"
    if key.default is not None and key.default != "[]":
        return f"`{key.default}`"
    return key.left_out.removesuffix(".") or (
        "none" if key.several else "as in its table" if key.table else ""
    )


def _cell(text: str) -> str:
    return " ".join(text.split()).replace("|", "\\|")


# A new scenario file: the keys of one that runs, and all others commented out, each with its meaning and its default.

WIDTH = 100
SCENARIO_HEAD = """\
# {name}: a slip event as `readhesion simulate` and `readhesion compare` run it. It has the keys of {like}.
# A line that begins with "#" and a key shows the default of that key: delete the "#" to change it, and that of its table's
# line in brackets. What begins with "# " is a remark. docs/keys.md has the source of every value.
# For completion in an editor: `readhesion schema --out scenario.schema.json`, and a first line
# "#:schema ./scenario.schema.json".
"""


def commented_scenario(name: str, like: str, keys: Mapping[str, Any]) -> str:
    """Text of a file with these `keys`, those of the scenario `like`, and all others commented out."""
    schema = schema_of_kind("scenario")
    lines = [*SCENARIO_HEAD.format(name=name, like=like).splitlines(), ""]
    lines += _Writer(schema).table(None, keys, "")
    return "\n".join(lines) + "\n"


class _Writer:
    """Writes tables, each kind of them in full where it is met first."""

    def __init__(self, schema: Schema) -> None:
        self._schema = schema
        self._shown: dict[str, str] = {}

    def table(self, name: str | None, given: Mapping[str, Any] | None, path: str) -> Iterator[str]:
        """The keys of a table, those that are `given` as they are; None: all of it is commented out."""
        first, *others = self._kinds(name, given)
        for key in first.keys:
            if key.table is None:
                yield from _plain_key(key, given)
        for other in others:
            yield f"# Keys with kind = {' or '.join(map(in_toml, other.kinds))}:"
            for key in other.keys:
                if key.name != "kind":
                    yield from _plain_key(key, None)
        for key in first.keys:
            if key.table is not None:
                yield from self._inner(key, given, f"{path}.{key.name}" if path else key.name)

    def _kinds(self, name: str | None, given: Mapping[str, Any] | None) -> list[Table]:
        """The table once for each of its kinds, that of what is given first."""
        kinds = tables_of(self._schema, name)
        chosen = (given or {}).get("kind", (kinds[0].kinds or ("",))[0])
        return sorted(
            kinds, key=lambda one: chosen not in (*one.kinds, "" if not one.kinds else None)
        )

    def _inner(self, key: FileKey, given: Mapping[str, Any] | None, path: str) -> Iterator[str]:
        inside = (given or {}).get(key.name)
        header = f"[[{path}]]" if key.several else f"[{path}]"
        yield ""
        yield from _remark(_about(key))
        if inside is None:
            yield f"#{header}"
            earlier = self._shown.setdefault(str(key.table), path)
            if earlier == path:
                yield from self.table(key.table, None, path)
            else:
                yield f"# It has the same keys as [{earlier}]."
            return
        self._shown.setdefault(str(key.table), path)
        for number, one in enumerate(inside if key.several else [inside]):
            yield from ([""] if number else [])
            yield header
            if number == 0:
                yield from self.table(key.table, one, path)
            else:
                yield from (f"{name} = {in_toml(value)}" for name, value in one.items())


def _plain_key(key: FileKey, given: Mapping[str, Any] | None) -> Iterator[str]:
    yield from _remark(_about(key))
    if given is not None and key.name in given:
        yield f"{key.name} = {in_toml(given[key.name])}"
    else:
        yield f"#{key.name} = {key.default or ''}".rstrip()


def _about(key: FileKey) -> str:
    unit = f" [{key.unit}]" if key.unit not in ("", "1") else ""
    choice = f" One of {kind_of(key.said)}." if "enum" in key.said else ""
    left_out = f" Left out: {key.left_out}" if key.left_out else ""
    required = " Required." if key.required else ""
    return f"{key.meaning.removesuffix('.')}{unit}.{choice}{left_out}{required}"


def _remark(text: str) -> list[str]:
    return [f"# {line}" for line in textwrap.wrap(text, WIDTH, break_on_hyphens=False)]
