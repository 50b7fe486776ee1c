"""The meaning of a field or a key, from one place: the docstring below it, in a record or in a class of keys.

Such a docstring states the meaning. Where useful, "Left out:" says what applies without the key, and "Source:" gives the
source of meaning and value; both come at the end. A unit in brackets is that of the field; a key may use another unit.
"""

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cache

from docstring_parser.attrdoc import AttributeDocstrings

UNIT = re.compile(r"(?:^| )\[((?:[A-Za-z(]|1/)[^\]]*)\]")
NAME = re.compile(r"`(\w+)`")
PARTS = re.compile(r"(?:^|(?<=\s))(Left out|Source): ")


@dataclass(frozen=True)
class Meaning:
    """What is said of a key; empty where nothing is."""

    text: str = ""
    unit: str = ""
    """That of the field; the key's own where its name has no ending."""
    left_out: str = ""
    """What applies where the key is left out, if that is no plain number."""
    source: str = ""

    def with_names(self, names: Mapping[str, str]) -> "Meaning":
        """The same with other names for what stands in backticks."""

        def renamed(text: str) -> str:
            return NAME.sub(lambda found: f"`{names.get(found[1], found[1])}`", text)

        return replace(self, text=renamed(self.text), left_out=renamed(self.left_out))


@cache
def meanings(kind: type) -> dict[str, Meaning]:
    """Meaning of every field of a class, its bases' included. The source is the field's own, else that of its class."""
    found: dict[str, Meaning] = {}
    for base in reversed(kind.__mro__):
        if base.__module__ in ("builtins", "pydantic.main"):
            continue
        of_class = meant(base.__dict__.get("__doc__") or "").source
        own = {name: meant(text) for name, (text, *_) in _docstrings(base).items()}
        found |= {name: replace(one, source=one.source or of_class) for name, one in own.items()}
    return found


def meant(docstring: str) -> Meaning:
    """Content of a docstring: its text, and the marked parts."""
    text, *parts = PARTS.split(" ".join(docstring.split()))
    said = {mark: part.strip() for mark, part in zip(parts[::2], parts[1::2], strict=True)}
    unit = UNIT.search(text)
    return Meaning(
        UNIT.sub("", text).strip(),
        unit.group(1) if unit else "",
        said.get("Left out", ""),
        said.get("Source", ""),
    )


def _docstrings(kind: type) -> dict[str, tuple[str, str | None, str | None]]:
    try:
        return AttributeDocstrings().get_attr_docs(kind)
    except TypeError:  # made at run time: it has no source
        return {}
