"""This software and the publications that it names: `citations.bib` has each by what docstrings call it, and as BibTeX.

A file names its source in a docstring or a comment; `find_uses` finds which of `CITATIONS` texts name.
"""

import re
from collections.abc import Mapping
from importlib.metadata import version
from pathlib import Path

from studies.runner.provenance import find_commit


class Citation:
    """A publication, by an entry of the file: one field a line, in braces, and no other braces."""

    def __init__(self, entry: str) -> None:
        self.fields = dict(re.findall(r"  (\w+) = \{(.*)\},\n", entry))
        self.marks = self.fields["marks"].split(" | ")
        """What docstrings and comments call it; any of them names it, as whole words."""
        self.bibtex = re.sub(r"  marks = .*\n", "", entry).strip()

    @property
    def reference(self) -> str:
        """Authors or holder, title, and where it was published, in one line."""
        by = self.fields.get("holder") or self.fields.get("author", "").replace(" and ", ", ")
        names = ["journal", "booktitle", "institution", "number", "volume", "pages", "year"]
        names += ["version", "license"]
        where = ", ".join(self.fields[name] for name in names if name in self.fields)
        parts = (part.rstrip(".") for part in (by, self.fields["title"], where) if part)
        return f"{'. '.join(parts)}."

    @property
    def address(self) -> str:
        """Where it can be found; empty where no lasting address is known."""
        if "doi" in self.fields:
            return f"https://doi.org/{self.fields['doi']}"
        return f"https://arxiv.org/abs/{self.fields['eprint']}" if "eprint" in self.fields else ""

    @property
    def text(self) -> str:
        """Reference and address in one line."""
        return f"{self.reference} {self.address}".strip()


_TEXT = Path(__file__).with_suffix(".bib").read_text("utf-8")
_NAMES = [version("readhesion"), *(f"commit {commit}" for commit in [find_commit()] if commit)]
_TEXT = _TEXT.replace("VERSION", ", ".join(_NAMES))
CITATIONS = tuple(map(Citation, re.split(r"^(?=@)", _TEXT, flags=re.MULTILINE)[1:]))
"""In the order of the file."""


def find_uses(texts: Mapping[str, str]) -> dict[Citation, list[str]]:
    """Which of the things in `texts`, each with what is written about it, names which publication."""
    plain = {thing: " ".join(text.split()) for thing, text in texts.items()}  # names may be broken
    uses = {}
    for citation in CITATIONS:
        mark = re.compile(rf"(?<!\w)({'|'.join(map(re.escape, citation.marks))})(?!\w)")
        if things := [thing for thing, text in plain.items() if mark.search(text)]:
            uses[citation] = things
    return uses
