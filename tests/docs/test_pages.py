"""README and pages: Python runs, commands parse, links and places in the code exist, README's numbers are stored."""

import csv
import io
import os
import re
import shlex
import subprocess
import sys
from contextlib import chdir, redirect_stdout
from itertools import pairwise
from pathlib import Path
from pydoc import locate

import pytest

from paper_figs import all_figures
from studies.command.command_line import app, run
from studies.runner.catalogue import STUDIES

ROOT = Path(__file__).parents[2]
FILES = [*sorted(ROOT.glob("*.md")), *sorted((ROOT / "docs").rglob("*.md"))]
PAGES = {path.relative_to(ROOT).as_posix(): path.read_text("utf-8") for path in FILES}
BLOCK = re.compile(r"^```(\w+)\n(.*?)^```", re.MULTILINE | re.DOTALL)
"""A block of code: its language and its text."""
NAMED = re.compile(r"# ([\w-]+\.(?:py|toml))\n")
"""First line of a block that is a file of this name."""
INLINE = re.compile(r"`(readhesion [^`A-Z. ]+ [^`A-Z.]+)`")
"""A command in a sentence, without words that stand for others."""
FIRST = "docs/getting-started.md"
"""Page whose commands are all run; of others those that name a file of the page."""


def commands(page):
    """Commands of shell blocks, without comments; a line may go on in the next."""
    shell = "\n".join(text for language, text in BLOCK.findall(PAGES[page]) if language == "sh")
    lines = shell.replace("\\\n", " ").splitlines()
    words = [shlex.split(line.removesuffix("&"), comments=True) for line in lines]
    return [one for one in words if one and one[0] in ("readhesion", "pytest")]


def printed(words, folder):
    """What a command prints; that of the project runs in this process, for starting another takes longer than it does."""
    if words[0] == "readhesion":
        with chdir(folder), redirect_stdout(io.StringIO()) as output:
            assert run(words[1:]) == 0, words
        return output.getvalue()
    paths = {"PATH": f"{Path(sys.executable).parent}{os.pathsep}{os.environ['PATH']}"}
    environment = os.environ | paths | {"PYTHONPATH": str(ROOT)}
    done = subprocess.run(words, cwd=folder, env=environment, capture_output=True, text=True)
    assert done.returncode == 0, f"{words}:\n{done.stdout[-1000:]}{done.stderr[-2000:]}"
    return done.stdout


@pytest.mark.parametrize("page", [FIRST, *(one for one in PAGES if "```python" in PAGES[one])])
def test_blocks_run_and_print_what_stands_below_them(page, tmp_path):
    blocks = BLOCK.findall(PAGES[page])
    files = {name[1]: text for _, text in blocks if (name := NAMED.match(text))}
    files["page.py"] = "\n".join(text for language, text in blocks if language == "python")
    for name, text in files.items():
        (tmp_path / name).write_text(text, "utf-8")
    own = [words for words in commands(page) if page == FIRST or files.keys() & words]
    program = [sys.executable, "page.py"]
    said = "".join(printed(words, tmp_path) for words in [program, *own])
    for (before, _), (language, text) in pairwise(blocks):
        if language == "text" and (before == "python" or (before == "sh" and own)):
            assert [line for line in text.splitlines() if line not in said] == []


@pytest.mark.parametrize("page", PAGES)
def test_commands_are_those_of_the_command_line(page):
    for words in commands(page) + [shlex.split(one) for one in INLINE.findall(PAGES[page])]:
        while "--plugin" in words:
            del words[(k := words.index("--plugin")) : k + 2]
        if words[0] == "readhesion":
            command, bound, *_ = app.parse_args(words[1:], exit_on_error=False, print_error=False)
            if command.__name__ == "sweep" and not words[2].endswith(".py"):
                assert words[2].replace("-", "_") in STUDIES
            if command.__name__ == "figures":
                assert set(bound.args) <= set(all_figures())


@pytest.mark.parametrize("command", [one for one in app if not one.startswith("-")])
def test_every_option_is_on_the_page_of_commands(command):
    for one in app[command].assemble_argument_collection():
        assert one.index is not None or one.name in PAGES["docs/commands.md"]


@pytest.mark.parametrize(
    "page", sorted(set(PAGES) - {"docs/paper/paper.md"})
)  # no page of the site
def test_no_line_begins_as_markup_of_the_site_alone(page):
    """MyST takes it for a comment, a break, a target, front matter or a role, and the text is lost."""
    text = re.sub(r"^ *(```+|~~~+).*?^ *\1", "", PAGES[page], flags=re.MULTILINE | re.DOTALL)
    begin = r"^[ >]*(?:(?:[-*+]|\d+[.)]) +)?(?:%|\+\+\+|\([^()]*\)=|\{[\w:-]+\}`).*$"
    assert not re.findall(rf"\A---\n|{begin}", text, re.MULTILINE)


def anchors(text):
    """Of the headings of a page, as GitHub makes them."""
    titles = re.findall(r"^#+ (.*)$", BLOCK.sub("", text), re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", one.lower()).strip().replace(" ", "-") for one in titles}


@pytest.mark.parametrize("page", PAGES)
def test_links_lead_somewhere(page):
    for target in re.findall(r"\]\(([^)\s]+)\)", BLOCK.sub("", PAGES[page])):
        name, _, anchor = target.partition("#")
        path = (ROOT / page).parent / name if name else ROOT / page
        if not name.startswith(("http:", "https:")):
            assert path.exists(), target
            assert not anchor or anchor in anchors(path.read_text("utf-8")), target


@pytest.mark.parametrize("page", sorted(set(PAGES) - {"CHANGELOG.md"}))
def test_code_that_a_page_names_exists(page):
    for name in re.findall(r"`((?:alloc|mpc|studies|paper_figs)\.[\w.]+)`", PAGES[page]):
        assert locate(name) is not None, name


PRINTED = {
    "jp4209318": (5, 29, 4, 1), "jp5484215": (17, 18, 0, 3), "jph07322414": (10, 8, 0, 7),
    "readhesion-paper": (23, 11, 2, 0), "rtri": (7, 9, 2, 0),
}  # fmt: skip
"""Source -> how many figures, equations, tables and claims it has."""
NUMBERED = (r"Figs?\. ", r"\(", "Tables? ", r"cl\. ")


@pytest.mark.parametrize("source", PRINTED)
def test_the_table_of_a_source_has_all_and_its_places_exist(source):
    known = {"figure": all_figures(), "sweep": STUDIES, "page": os.listdir(ROOT / "docs")}
    with (ROOT / f"docs/sources/{source}.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(file))
    for row in rows:
        kind, _, name = row["where"].partition(" ")
        if name:
            assert name in known[kind], row
        elif "/" in kind:
            assert (ROOT / kind).exists(), row
        else:
            assert kind == "-" or locate(kind) is not None, row
    items = "; ".join(row["item"] for row in rows).replace(") to (", " to ")
    for kind, count in zip(NUMBERED, PRINTED[source], strict=True):
        found = set()
        for several in re.findall(rf"{kind}((?:\d+(?: to |, )?)+)", items):
            for low, high in re.findall(r"(\d+)(?: to (\d+))?", several):
                found |= set(range(int(low), int(high or low) + 1))
        assert found >= set(range(1, count + 1)), kind


def test_the_paper_is_short_and_its_sources_are_listed():
    text = PAGES["docs/paper/paper.md"]
    entries = (ROOT / "docs/paper/paper.bib").read_text("utf-8")
    assert len(text.split()) <= 1000
    assert set(re.findall(r"@(\w+)", text)) == set(
        re.findall(r"^@\w+\{(\w+)", entries, re.MULTILINE)
    )


def test_the_page_of_figures_has_all_of_each_source():
    rows = dict(re.findall(r"^\| `(\w+)` \| (.*) \|$", PAGES["docs/figures.md"], re.MULTILINE))
    for source in {one.source for one in all_figures().values()} - {""}:
        own = {name for name, one in all_figures().items() if one.source == source}
        assert set(re.findall(r"`([\w-]+)`", rows[source])) == own


RULES_TABLE, LAWS_TABLE, CLAIMS = "benchmark-table", "benchmark-controllers", "claims-statements"
USED, GAIN, MEDIAN, WORST = "used", "gain over alone [points]=", "median gain", "worst"
CONTROLLED = (USED, "over perturb-observe [points]=", MEDIAN, WORST, "Q [kJ]")
RULED, ROOM, MEAN = (
    (USED, GAIN, MEDIAN, WORST, "Q over alone"),
    "headroom above 1 point=",
    "mean [95 %]=",
)
NUMBERS = {
    "from one benchmark: {} events": (RULES_TABLE, "mpc alone", ("events",)),
    "again; no sharing | {} | {} over perturb-observe | {} | {} | {} |": (LAWS_TABLE, "cut-and-ramp", CONTROLLED),
    "best slip; no sharing | {} | | | | {} |": (LAWS_TABLE, "perturb-observe", (USED, "Q [kJ]")),
    "a prediction; no sharing | {} | {} over perturb-observe | {} | {} | {} |": (LAWS_TABLE, "mpc", CONTROLLED),
    "for what some lack | {} | {} over no sharing | {} | {} | {} |": (RULES_TABLE, "mpc spread", RULED),
    "shown that they can | {} | {} over no sharing | {} | {} | {} |": (RULES_TABLE, "mpc cooperative", RULED),
    "below the demand | {} | {} over no sharing | {} | {} | {} |": (RULES_TABLE, "mpc exact", RULED),
    "`cooperative` gains {} points under the MPC": (RULES_TABLE, "mpc cooperative", (ROOM,)),
    "the MPC, {} under perturb-observe": (RULES_TABLE, "perturb-observe cooperative", (ROOM,)),
    "and lose: {} points under perturb-observe": (RULES_TABLE, "perturb-observe exact", (GAIN,)),
    "(`uniform`) gains {} under the MPC": (RULES_TABLE, "mpc uniform", (GAIN,)),
    "its worst event: {} points": (RULES_TABLE, "mpc uniform", (WORST,)),
    "reaches {} % under cut-and-ramp": (CLAIMS, "a: greedy-printed under cut-and-ramp", (MEAN,)),
    "`cooperative` {} % under perturb-observe ([all": (CLAIMS, "a: cooperative under perturb-observe", (MEAN,)),
}  # fmt: skip
"""Words of the README -> table, first cells of its row, beginnings of columns whose numbers it has; "=": with interval."""


@pytest.mark.parametrize("words", NUMBERS)
def test_numbers_of_the_readme_are_stored(words):
    name, row, columns = NUMBERS[words]
    lines = (ROOT / "docs" / "tables" / f"{name}.md").read_text("utf-8").splitlines()
    head, _, *rows = [[cell.strip() for cell in line.split("|")[1:-1]] for line in lines]
    (own,) = [cells for cells in rows if " ".join(cells).startswith(f"{row} ")]
    numbers = []
    for column in columns:
        at = next(k for k, key in enumerate(head) if key.startswith(column.removesuffix("=")))
        numbers.append(own[at] if column.endswith("=") else own[at].partition(" [")[0])
    assert words.format(*numbers) in " ".join(PAGES["README.md"].split())
