"""A new scenario file: the keys of one that runs, and all others commented out, each with its meaning and its default."""

import textwrap
from collections.abc import Iterator, Mapping
from typing import Any

from studies.files.json_schema import Schema
from studies.files.key_tables import FileKey, Table, in_toml, kind_of, tables_of
from studies.scenario.file_kinds import schema_of_kind

WIDTH = 100
HEAD = """\
# {name}: a slip event as `readhesion simulate` and `readhesion compare` run it. It has the keys of {like}.
# A line that begins with "#" and a key shows the default of that key: delete the "#" to change it, and that of its table's
# line in brackets. What begins with "# " is a remark. docs/keys.md has the source of every value.
# For completion in an editor: `readhesion schema --out scenario.schema.json`, and a first line
# "#:schema ./scenario.schema.json".
"""


def commented_scenario(name: str, like: str, keys: Mapping[str, Any]) -> str:
    """Text of a file with these `keys`, those of the scenario `like`, and all others commented out."""
    schema = schema_of_kind("scenario")
    lines = [*HEAD.format(name=name, like=like).splitlines(), ""]
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
