"""Kinds of files in the project's own format, their schemas, and the reference page of their keys."""

from collections.abc import Iterator

from pydantic import BaseModel

from studies.files.json_schema import Schema, schema_of
from studies.files.key_tables import FileKey, Table, kind_of, tables_of
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
