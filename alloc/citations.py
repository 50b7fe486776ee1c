"""The publications that the code names: `citations.bib` has each by what docstrings call it, and as BibTeX.

A file names its source in a docstring or a comment; `cited_in` finds which of `CITATIONS` a text names.
"""

import re
from collections.abc import Iterator, Mapping
from dataclasses import dataclass, field
from pathlib import Path


@dataclass(frozen=True)
class Citation:
    """A publication."""

    key: str
    """Of its BibTeX entry."""
    kind: str
    """Of its BibTeX entry, such as "article"."""
    marks: tuple[str, ...]
    """What docstrings and comments call it; any of them names it, as whole words."""
    fields: Mapping[str, str] = field(hash=False)
    """Those of its BibTeX entry, in the order in which they are written."""

    @property
    def bibtex(self) -> str:
        """Its BibTeX entry."""
        lines = [f"  {name} = {{{value}}}," for name, value in self.fields.items()]
        return "\n".join([f"@{self.kind}{{{self.key},", *lines, "}"])

    @property
    def words(self) -> str:
        """Authors or holder, title, and where it was published, in one line."""
        by = self.fields.get("holder") or self.fields.get("author", "").replace(" and ", ", ")
        names = ("journal", "booktitle", "institution", "number", "volume", "pages", "year")
        where = ", ".join(self.fields[name] for name in names if name in self.fields)
        parts = (part.rstrip(".") for part in (by, self.fields["title"], where) if part)
        return f"{'. '.join(parts)}."

    @property
    def address(self) -> str:
        """Where it can be found; empty where no lasting address is known."""
        if "doi" in self.fields:
            return f"https://doi.org/{self.fields['doi']}"
        return f"https://arxiv.org/abs/{self.fields['eprint']}" if "eprint" in self.fields else ""


def read_bibtex(text: str) -> Iterator[Citation]:
    """The entries of a file with one field a line, in braces, and no other braces; raises `ValueError` for others."""
    for entry in re.split(r"^(?=@)", text, flags=re.MULTILINE)[1:]:
        whole = re.fullmatch(r"@(\w+)\{([^,\s]+),\n((?:  \w+ = \{[^{}]*\},\n)+)\}\s*", entry)
        fields = re.findall(r"  (\w+) = \{(.*)\},\n", whole[3]) if whole else []
        found = dict(fields)
        if whole is None or len(found) < len(fields) or not {"marks", "title"} <= found.keys():
            raise ValueError(
                f"BibTeX entry {entry.splitlines()[0]!r}: write each field once, marks and title too, a line each"
            )
        yield Citation(whole[2], whole[1], tuple(found.pop("marks").split(" | ")), found)


CITATIONS = tuple(read_bibtex(Path(__file__).with_suffix(".bib").read_text("utf-8")))
"""In the order of the file."""


def cited_in(text: str) -> list[Citation]:
    """The publications that a text names, in the order of `CITATIONS`."""
    plain = " ".join(text.split())  # a name may be broken over two lines

    def names(mark: str) -> bool:
        return re.search(rf"(?<!\w){re.escape(mark)}(?!\w)", plain) is not None

    return [one for one in CITATIONS if any(map(names, one.marks))]


def uses(texts: Mapping[str, str]) -> dict[Citation, list[str]]:
    """Which of the things in `texts`, each with what is written about it, names which publication."""
    named = {thing: cited_in(text) for thing, text in texts.items()}
    found = {one: [thing for thing in named if one in named[thing]] for one in CITATIONS}
    return {one: things for one, things in found.items() if things}
