"""README and pages: their size, their links, their language, and what states the version."""

import csv
import re
import subprocess
import tomllib
from contextlib import suppress
from functools import reduce
from importlib import import_module
from importlib.metadata import version

import yaml

from paper_figs.drawing import FIGURES
from studies.command_line.main import app, run
from studies.core.study import all_studies
from tests.docs.pages import PAGES, ROOT, anchors, blocks, links, sentences, without_code

MOST_BYTES = 6000
"""Of the README."""
MOST_WORDS = 20
"""Of a sentence, on the mean."""


def test_readme_is_short_and_says_the_commands_first():
    readme = PAGES["README.md"]
    assert len(readme.encode()) <= MOST_BYTES
    assert readme.count("![") == 1
    of_readme = [one for one in blocks() if one.page == "README.md"]
    assert [one.language for one in of_readme] == ["sh", "python", "text"]
    assert [line.split()[:2] for line in of_readme[0].code.splitlines()] == [
        ["make", "compare"],
        ["make", "test"],
    ]
    assert len(of_readme[1].code.splitlines()) <= 10


def test_links_lead_somewhere():
    for page, link in ((page, link) for page, text in PAGES.items() for link in links(text)):
        path, _, anchor = link.partition("#")
        target = (ROOT / page).parent / path if path else ROOT / page
        assert target.exists(), f"{page} links to {link}"
        if anchor:
            assert anchor in anchors(target.read_text(encoding="utf-8")), f"{page} links to {link}"


NAMED = re.compile(
    r"`((?:alloc|mpc|studies|paper_figs)(?:\.\w+)+|(?:\w+/)+[\w-]+\.(?:py|toml|csv|bib))`"
)
"""A part of the library or a file of the repository, which the site makes a link."""
MADE = ("build/", "results/", "figures/", "shares/", "docs/results/NAME")
"""Beginnings of files that commands make."""


def test_files_and_parts_that_pages_name_are_there():
    for page, text in PAGES.items():
        if page == "CHANGELOG.md":
            continue  # tells of what was there
        for name in NAMED.findall(without_code(text)):
            if "/" in name:
                assert name.startswith(MADE) or (ROOT / name).is_file(), f"{page} names {name}"
            else:
                named(name)


def named(name):
    """What a dotted name stands for; `LookupError` where it is nothing."""
    parts = name.split(".")
    for k in range(len(parts), 0, -1):
        module = ".".join(parts[:k])
        with suppress(ModuleNotFoundError):
            return reduce(getattr, parts[k:], import_module(module))
    raise LookupError(name)


def test_values_of_tables_are_those_of_the_code():
    """Rows of a value and the dotted name of what has it."""
    rows = re.findall(
        r"\| (-?[\d.]+)[^|]* \| `((?:alloc|mpc)(?:\.\w+)+)` \|", "\n".join(PAGES.values())
    )
    assert len(rows) >= 8
    assert [(name, value) for value, name in rows if named(name) != float(value)] == []


def test_every_page_stands_in_the_contents():
    listed = {
        line
        for one in blocks("{toctree}")
        if one.page == "docs/index.md"
        for line in one.code.split()
    }
    pages = {
        page.removeprefix("docs/").removesuffix(".md") for page in PAGES if page.startswith("docs/")
    }
    assert pages - {"index"} <= listed


def test_every_page_has_one_title():
    for page, text in PAGES.items():
        titles = [line for line in without_code(text).split("\n") if line.startswith("# ")]
        assert len(titles) == 1 or "{include} ../" in text, page


def test_sentences_are_short_on_the_mean():
    for page, text in PAGES.items():
        words = [len(one.split()) for one in sentences(text)]
        mean = sum(words) / max(len(words), 1)
        assert mean <= MOST_WORDS, f"{page}: {mean:.1f} words in a sentence on the mean"


def test_sentences_end_before_code_and_links_and_not_at_numbers():
    text = "One short sentence.\n`code` begins one, as\n[a link](x.md) of 2.5 m does.\n\n| no | row |\n"
    assert [len(one.split()) for one in sentences(text)] == [3, 10]


def test_one_version_is_stated():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]
    cited = yaml.safe_load((ROOT / "CITATION.cff").read_text())
    assert str(cited["version"]) == project["version"]
    heading = re.search(r"^## (.*)$", PAGES["CHANGELOG.md"], re.MULTILINE)[1]
    released = re.fullmatch(r"(\d+\.\d+\.\d+) \((\d{4}-\d\d-\d\d)\)", heading)
    if released:
        assert released[1] == project["version"]
        assert str(cited["date-released"]) == released[2]
    else:
        assert heading == f"Unreleased ({project['version']})"
    assert cited["license"] == project["license"]
    for key in ("cff-version", "message", "title", "authors"):
        assert cited[key], key


def test_the_command_tells_the_version(capsys):
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    assert version("readhesion") == stated, "installed as another version; run `make setup`"
    assert run(["--version"]) == 0
    assert capsys.readouterr().out.split() == [stated]


def test_a_release_is_tagged_with_its_version():
    """Tags of the present commit; a tree without git, or a clone without tags, has none."""
    stated = tomllib.loads((ROOT / "pyproject.toml").read_text())["project"]["version"]
    asked = ["git", "tag", "--points-at", "HEAD", "v[0-9]*"]
    try:
        told = subprocess.run(asked, cwd=ROOT, capture_output=True, text=True, check=False).stdout
    except OSError:
        told = ""
    assert set(told.split()) <= {f"v{stated}"}


def test_every_command_has_an_example():
    commands = [name for name in app if not name.startswith("-")]
    examples = "\n".join(block.code for block in blocks("sh"))
    assert len(commands) > 5
    assert not [name for name in commands if f"readhesion {name}" not in examples]


def test_every_place_that_the_tables_of_sources_name_is_there():
    """A module's attribute, a figure, a sweep, a page or a file of tests; - where nothing is built, which the row says."""
    for table in sorted((ROOT / "docs/sources").glob("*.csv")):
        with table.open(newline="", encoding="utf-8") as file:
            rows = list(csv.DictReader(file))
        assert rows
        for row in rows:
            assert None not in row, row
            assert all(row.values()), row
            kind, _, name = row["where"].rpartition(" ")
            if kind in ("figure", "sweep"):
                assert name in {"figure": FIGURES, "sweep": all_studies()}[kind], row
            elif kind == "page":
                assert (ROOT / "docs" / name).is_file(), row
            elif name.startswith("tests/"):
                assert (ROOT / name).is_file(), row
            elif name != "-":
                module, _, attribute = name.rpartition(".")
                assert hasattr(import_module(module), attribute), row
