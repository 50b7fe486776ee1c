"""Pages of the documentation as text, and what stands in them: code blocks, links, headings, sentences."""

import re
from pathlib import Path
from typing import NamedTuple

ROOT = Path(__file__).parents[2]


def _without_settings(text: str) -> str:
    """The text without the settings that a notebook begins with."""
    return re.sub(r"\A---\n.*?^---\n", "", text, flags=re.DOTALL | re.MULTILINE)


PAGES = {
    path.relative_to(ROOT).as_posix(): _without_settings(path.read_text(encoding="utf-8"))
    for path in [
        *sorted(ROOT.glob("*.md")),
        *sorted((ROOT / "docs").glob("*.md")),
        *sorted((ROOT / "docs/notebooks").glob("*.md")),
        *sorted((ROOT / "docs/sources").glob("*.md")),
    ]
}
"""Path -> text of README, changelog and pages."""


class Block(NamedTuple):
    """A fenced block of code."""

    page: str
    language: str
    code: str
    shown: str = ""
    """The block of text that follows at once: what it prints."""


def blocks(*languages: str) -> list[Block]:
    """Blocks in these languages, of all pages in their order."""
    fence = re.compile(
        r"^```([^\n]*)\n(.*?)^```$(?=(?:\n\n```text\n(.*?)^```$)?)", re.DOTALL | re.MULTILINE
    )
    found = [
        Block(page, *match.groups(default=""))
        for page, text in PAGES.items()
        for match in fence.finditer(text)
    ]
    return [one for one in found if not languages or one.language in languages]


def without_code(text: str) -> str:
    """The text without blocks of code."""
    return re.sub(r"^```.*?^```$", "", text, flags=re.DOTALL | re.MULTILINE)


def links(text: str) -> list[str]:
    """Targets of links and pictures that are no address of the net."""
    found = re.findall(r"\]\(([^)\s]+)\)", without_code(text))
    return [one for one in found if not one.startswith(("http://", "https://"))]


def anchors(text: str) -> set[str]:
    """Anchors of the headings, as the repository's view and the site make them."""
    titles = re.findall(r"^#+ (.*)$", without_code(text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles}


def sentences(text: str) -> list[str]:
    """Sentences of the running text and of lists; tables, headings and code are left out."""
    lines = [one for one in without_code(text).split("\n") if not one.startswith(("|", "#", "!"))]
    plain = re.sub(r"\]\([^)]*\)", "", "\n".join(lines)).replace("[", "")
    plain = re.sub(r"`[^`]*`", "Name", plain)
    found = []
    for paragraph in re.split(r"\n\s*\n|\n(?=\s*- )|\n(?=\d+\. )", plain):
        parts = re.split(r"(?<=[.!?])\**\s+(?=[A-Z(\"*])", " ".join(paragraph.split()))
        found += [one for one in parts if len(one.split()) > 2]
    return found
