"""Publications: each is named by some file, each entry is whole, and a text names what it says and nothing else."""

import re
from pathlib import Path

import pytest

from alloc.citations import CITATIONS, cited_in, read_bibtex, uses

ROOT = Path(__file__).parents[1]
TEXT = "\n".join(
    path.read_text()
    for layer in ("alloc", "mpc", "studies")
    for path in (ROOT / layer).rglob("*")
    if path.suffix in (".py", ".toml")
)


def test_an_entry_is_whole_and_some_file_names_it():
    for one in CITATIONS:
        assert one in cited_in(TEXT), one.key
        assert re.match(rf"@\w+{{{one.key},\n(  \w+ = {{[^{{}}]+}},\n)+}}$", one.bibtex), one.key
        assert one.fields["title"] in one.words, one.key


def test_keys_and_marks_are_one_publications_own():
    keys = [one.key for one in CITATIONS]
    marks = [mark for one in CITATIONS for mark in one.marks]
    assert len(set(keys)) == len(keys)
    assert len(set(marks)) == len(marks)


def test_a_name_counts_as_a_whole_word_also_over_two_lines():
    assert [one.key for one in cited_in("after the readhesion\n    paper, (3)")] == [
        "tsukinokizawa"
    ]
    assert cited_in("XJP5484215 and JP54842155 and Polachs") == []
    assert [one.key for one in cited_in("Polach's law")] == ["polach2005"]


def test_uses_keep_the_order_of_the_publications_and_name_their_users():
    found = uses({"rule b": "Polach", "rule a": "JP5484215, Polach"})
    assert [(one.key, who) for one, who in found.items()] == [
        ("JP5484215", ["rule a"]), ("polach2005", ["rule b", "rule a"]),
    ]  # fmt: skip


@pytest.mark.parametrize(
    "text",
    [
        "@misc{a,\n  title = {One},\n}\n",
        "@misc{a,\n  marks = {A},\n  title = {One},\n  title = {Two},\n}\n",
        "@misc{a,\n  marks = {A}, title = {One},\n}\n",
        "@misc{a,\n  marks = {A},\n  title = {The {TGV}},\n}\n",
        "@misc{a,\n  marks = {A},\n  title = {One},\n",
    ],
)
def test_an_entry_that_is_not_regular_is_refused_by_its_first_line(text):
    good = "% a remark\n@misc{b,\n  marks = {B | Bs},\n  title = {B},\n}\n\n"
    assert [one.marks for one in read_bibtex(good)] == [("B", "Bs")]
    with pytest.raises(ValueError, match=r"BibTeX entry '@misc\{a,'"):
        list(read_bibtex(good + text))
