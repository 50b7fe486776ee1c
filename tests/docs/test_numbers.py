"""Numbers of README and docs are those that stored results hold."""

import json
import re
from dataclasses import replace

import pytest

from tests.docs.pages import PAGES
from tests.numbers import (
    TABLES,
    Number,
    cells_of,
    drifts,
    expanded,
    manifest,
    numbers,
    rewritten,
    sources,
    stored,
    tables,
    unnamed,
)

NUMBERS = numbers()
VALUES = stored()


def test_pages_say_what_is_stored():
    assert not [
        drift
        for number in NUMBERS
        for page in number.pages
        for drift in drifts(number, page, PAGES[page], VALUES)
    ]


def test_tables_are_those_that_are_made_of_what_is_stored():
    other = [
        one.name for one in tables() if one.path.read_text(encoding="utf-8") != one.made(VALUES)
    ]
    assert not other, "`python -m tests.numbers write` makes them again"
    assert sorted(TABLES.iterdir()) == sorted(one.path for one in tables())


def test_every_table_stands_on_one_page():
    included = re.findall(
        r"^```\{include\} tables/(\S+)\.md$", "\n".join(PAGES.values()), re.MULTILINE
    )
    assert sorted(included) == sorted(one.name for one in tables())


def test_tables_have_a_cell_for_each_heading():
    for table in tables():
        lines = [one for one in table.made(VALUES).splitlines() if one.startswith("|")]
        assert len({len(re.findall(r"(?<!\\)\|", line)) for line in lines}) == 1, table.name


def test_alternatives_of_a_cell_stand_in_order():
    assert expanded("a | <b; c>, less | d=<1; 2>") == [
        "a | b, less | d=1",
        "a | c, less | d=1",
        "a | b, less | d=2",
        "a | c, less | d=2",
    ]


def test_stored_values_are_those_of_the_present_results_and_what_the_manifest_names():
    """A hash of `results_hash.json` that guards a study has changed: the study is to be computed again.

    Or the manifest says what has changed since, and every table says it.
    """
    old, other = [], []
    for name, source in sources().items():
        content = json.loads(source.path.read_text())
        is_old = (content["guard"], content["command"]) != (source.guard_digest(), source.command)
        if is_old != bool(source.before):
            old.append(f"make results STUDY={name}")
        if sorted(VALUES[name]) != sorted(cells_of(name)):
            other.append(name)
    assert not old
    assert not other


def test_no_number_of_a_covered_page_comes_from_nowhere():
    for page, given in manifest()["given"].items():
        named = [one for one in NUMBERS if page in one.pages]
        assert not unnamed(PAGES[page], named, given), page


SENTENCE = Number(
    ("page.md",),
    "uses {:.1f} % [{:.1f}, {:.1f}], {}.",
    ("a | b | c | value, low, high * 100", "a | b | words"),
)
FOUND = {"a": {SENTENCE.cells[0]: [98.84, 98.7, 99.0], SENTENCE.cells[1]: ["does not hold"]}}
PAGE = "It uses 98.8 %\n  [98.7, 99.0], does not hold.\n"


def test_a_number_that_moved_is_seen_and_written():
    assert not list(drifts(SENTENCE, "page.md", PAGE, FOUND))
    for k, moved in enumerate((98.86, 98.6, 99.1)):
        values = [98.84, 98.7, 99.0]
        values[k] = moved
        other = {"a": FOUND["a"] | {SENTENCE.cells[0]: values}}
        (words,) = drifts(SENTENCE, "page.md", PAGE, other)
        assert f"{moved:.1f}" in words
        written = rewritten(SENTENCE, PAGE, other)
        assert written == PAGE.replace(f"{[98.84, 98.7, 99.0][k]:.1f}", f"{moved:.1f}")
        assert not list(drifts(SENTENCE, "page.md", written, other))


def test_a_verdict_that_moved_and_a_text_that_is_gone_are_seen():
    other = {"a": FOUND["a"] | {SENTENCE.cells[1]: ["holds, fragile"]}}
    assert "holds, fragile" in next(drifts(SENTENCE, "page.md", PAGE, other))
    assert "no text" in next(drifts(SENTENCE, "page.md", PAGE.replace("uses", "used"), FOUND))


def test_too_few_values_for_the_slots_are_an_error():
    with pytest.raises(ValueError, match="slots"):
        replace(SENTENCE, cells=SENTENCE.cells[:1]).filled(FOUND)


def test_what_is_rounded_to_zero_has_no_minus():
    small = Number(("page.md",), "{:+.1f} and {:.0f}", ("a | b",))
    assert small.filled({"a": {"a | b": [-0.04, -0.3]}}) == ["+0.0", "0"]
    assert small.filled({"a": {"a | b": [-0.06, -0.7]}}) == ["-0.1", "-1"]


def test_a_number_that_nobody_named_is_found():
    assert unnamed("Nine of 12 [see](page9.md)", [], []) == ["12"]
    assert not unnamed(PAGE, [SENTENCE], [])
    assert not unnamed("since JP5484215", [], ["JP5484215"])
    assert unnamed("```sh\nmake 5\n```\n7", [], []) == ["7"]


def test_patterns_of_what_is_given_are_needed():
    for page, patterns in manifest()["given"].items():
        assert not [one for one in patterns if not re.search(one, PAGES[page])]
