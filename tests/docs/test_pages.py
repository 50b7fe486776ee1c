"""README and pages: their Python runs, their commands parse, their links lead somewhere, README's numbers are stored."""

import os
import re
import shlex
import subprocess
import sys
from itertools import pairwise
from pathlib import Path

import pytest

from paper_figs import all_figures
from studies.catalogue import STUDIES
from studies.cli import app

ROOT = Path(__file__).parents[2]
PAGES = {path.relative_to(ROOT).as_posix(): path.read_text("utf-8")
         for path in [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]}  # fmt: skip
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
"""A block of code: its language and its text."""
NAMED = re.compile(r"# ([\w-]+\.(?:py|toml))\n")
"""First line of a block that is a file of this name."""
INLINE = re.compile(r"`(readhesion [^`A-Z.]+)`")
"""A command in a sentence, without words that stand for others."""
LINK = re.compile(r"\]\(([^)\s]+)\)")
RUN = ("docs/getting-started.md", "docs/own-event.md", "docs/own-parts.md")
"""Pages whose commands are run: they are about the files of the page."""


def commands(text, languages=("sh",)):
    """Lines of shell blocks, those that go on in the next joined, comments left out."""
    found = [block for language, block in BLOCK.findall(text) if language in languages]
    lines = "\n".join(found).replace("\\\n", " ").splitlines()
    return [words for line in lines if (words := shlex.split(line, comments=True))]


def run(words, folder):
    """What a program prints."""
    beside = str(Path(sys.executable).parent)
    environment = os.environ | {"PATH": beside + os.pathsep + os.environ["PATH"], "PYTHONPATH": str(ROOT)}  # fmt: skip
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{shlex.join(words)}:\n{done.stdout[-1000:]}{done.stderr[-2000:]}"
    return done.stdout


@pytest.mark.parametrize("page", [one for one, text in PAGES.items() if "```python" in text])
def test_blocks_run_and_print_what_stands_below_them(page, tmp_path):
    blocks = BLOCK.findall(PAGES[page])
    for _, block in blocks:
        if name := NAMED.match(block):
            (tmp_path / name[1]).write_text(block, "utf-8")
    code = "\n".join(block for language, block in blocks if language == "python")
    (tmp_path / "page.py").write_text(code, "utf-8")
    printed = run([sys.executable, "page.py"], tmp_path)
    for words in commands(PAGES[page]) if page in RUN else ():
        if words[0] in ("readhesion", "pytest"):
            printed += run(words, tmp_path)
    runs = ("python", "sh") if page in RUN else ("python",)
    for (before, _), (language, block) in pairwise(blocks):
        if language == "text" and before in runs:
            assert [line for line in block.splitlines() if line not in printed] == []


@pytest.mark.parametrize("page", PAGES)
def test_commands_are_those_of_the_command_line(page):
    inline = [shlex.split(one) for one in INLINE.findall(PAGES[page])]
    for words in [one for one in commands(PAGES[page]) if one[0] == "readhesion"] + inline:
        while "--plugin" in words:
            k = words.index("--plugin")
            del words[k : k + 2]
        rest = [one for one in words[1:] if one != "&"]
        app.parse_args(rest, exit_on_error=False, print_error=False)
        names = [one for one in rest[1:] if not one.startswith("-") and "." not in one]
        if rest[:1] == ["sweep"] and names and names[0] == rest[1]:
            assert names[0].replace("-", "_") in STUDIES
        if rest[:1] == ["figures"]:
            assert {one for one in names if rest[rest.index(one) - 1][0] != "-"} <= set(all_figures())  # fmt: skip


def anchors(text):
    """Of the headings of a page, as GitHub makes them."""
    plain = BLOCK.sub("", text)
    titles = [re.sub(r"[^\w\- ]", "", one.lower()) for one in re.findall(r"^#+ (.*)$", plain, re.MULTILINE)]  # fmt: skip
    return {one.strip().replace(" ", "-") for one in titles}


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    for target in LINK.findall(BLOCK.sub("", PAGES[page])):
        name, _, anchor = target.partition("#")
        path = (ROOT / page).parent / name if name else ROOT / page
        if not name.startswith(("http:", "https:")):
            assert path.exists(), target
            assert not anchor or anchor in anchors(path.read_text("utf-8")), target


SHIPPED = "compare-table"
NUMBERS = (
    ("cut-and-ramp uses {} %", SHIPPED, ("cut-and-ramp", "alone"), ("used",), 100, 1),
    ("perturb-observe {} %, and the MPC", SHIPPED, ("perturb-observe", "alone"), ("used",), 100, 1),
    ("and the MPC {} %", SHIPPED, ("mpc", "alone"), ("used",), 100, 1),
)
"""Words of the README; table in docs/tables; first cells of its row; columns; factor and digits of the numbers."""


@pytest.mark.parametrize("number", NUMBERS)
def test_numbers_of_the_readme_are_stored(number):
    words, name, row, columns, factor, digits = number
    lines = (ROOT / "docs" / "tables" / f"{name}.md").read_text("utf-8").splitlines()
    head, _, *body = [[cell.strip() for cell in line.strip("| ").split("|")] for line in lines]
    (own,) = [cells for cells in body if tuple(cells[: len(row)]) == row]
    texts = [own[head.index(column)] for column in columns]
    found = [float(one) for text in texts for one in re.findall(r"-?\d+\.?\d*", text.replace("−", "-"))]  # fmt: skip
    said = words.format(*(f"{factor * one:.{digits}f}" for one in found))
    assert said in " ".join(PAGES["README.md"].split())
