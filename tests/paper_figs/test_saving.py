"""Beside a figure stand its caption and its numbers; the files say where they come from, and a draft that it is one."""

import hashlib
import io
from dataclasses import replace

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from PIL import Image

import studies.core.gallery as loader
from paper_figs.drawing import (
    FIGURES,
    NOTHING,
    Source,
    draw_comparison,
    draw_one,
    of_comparison,
    of_study,
    save_figure,
    say_where_nothing_is_drawn,
)
from paper_figs.drawn_data import drawn_data
from paper_figs.saving import Origin
from paper_figs.style import COLUMN, PAGE, STYLE_FILE, Width, new_figure, new_panels, rule_look
from studies.command_line.figures import figures
from studies.core.collection import find_study
from studies.core.gallery import Asked, Saved
from studies.core.store import Store
from studies.core.study import Study
from tests.paper_figs.text_boxes import cut_off, overlapping, words_of
from tests.studies.comparison_tables import RULES, SCENARIOS, comparison_table
from tests.studies.headroom_tables import headroom_table
from tests.studies.ladder_tables import ladder_table

LADDER = find_study("ladder")


@pytest.fixture
def few(tmp_path, monkeypatch):
    """Results that hold six events of every study, whose tables are made up."""
    tables = {"ladder": ladder_table, "headroom": headroom_table}
    monkeypatch.setattr(Study, "run", lambda self, *_: tables[self.name]())
    monkeypatch.setattr(Study, "held", lambda self, folder: 6)
    return Source(Store(tmp_path))


def csv_of(figure):
    return pd.read_csv(io.StringIO(drawn_data(figure).to_csv(index=False)), low_memory=False)


def test_caption_and_data_stand_beside_and_the_hash_is_theirs(few, tmp_path):
    drawn, legend = FIGURES["ladder"].drawn(few)
    pdf, png, caption, data = save_figure(drawn, tmp_path / "ladder", legend)
    digest = hashlib.sha256(data.read_bytes()).hexdigest()
    told = Image.open(png).text
    assert told["Data hash"] == f"sha256 {digest}"
    assert told["Title"].startswith("ladder: ")
    assert "readhesion sweep ladder" in told["Source"]
    assert "seed 0" in told["Source"]
    assert "readhesion 0." in told["Software"]
    assert told["Status"] == "draft: 6 of 30 events; in full: readhesion sweep ladder"
    assert digest.encode() in pdf.read_bytes()
    words = caption.read_text()
    assert words.startswith("Readhesion controllers from none to MPC")
    assert all(part in words for part in (digest, told["Source"], told["Status"], told["Software"]))


def test_marks_are_written_with_their_ends_and_their_names():
    figure, axes = new_panels(COLUMN, 2.0)
    axes.errorbar([1.5], [0.0], xerr=[[0.5], [0.25]], **rule_look("greedy"))
    axes.plot([0.0, 1.0], [2.0, 3.0], label="line")
    axes.axvline(4.0)
    axes.bar([1.0], [5.0], width=0.5, bottom=1.0)
    axes.set_yticks([0, 1], ["first", "second"])
    table = drawn_data(figure)
    mean = table[table["kind"] == "mean"].iloc[0]
    assert tuple(mean[["series", "x", "x_low", "x_high", "place"]]) == ("greedy", 1.5, 1.0, 1.75, "first")  # fmt: skip
    line = table[table["series"] == "line"]
    np.testing.assert_array_equal(line[["x", "y"]], [[0.0, 2.0], [1.0, 3.0]])
    assert table[table["kind"] == "bound"]["x"].tolist() == [4.0]
    bar = table[table["kind"] == "bar"].iloc[0]
    assert tuple(bar[["x_low", "x_high", "y_low", "y_high"]]) == (0.75, 1.25, 1.0, 6.0)


@pytest.mark.parametrize("name", ["ladder", "headroom"])  # a title above; legends of two subfigures
def test_a_draft_says_so_and_nothing_covers_it(few, name):
    drawn = FIGURES[name].make(few)
    with mpl.rc_context(fname=STYLE_FILE):
        words = words_of(drawn)
    (mark,) = (one for one in words if one.text.startswith("draft: "))
    assert (
        f"of {find_study(name).default_events} events; in full: readhesion sweep {name}"
        in mark.text
    )
    assert overlapping(words) == []
    assert cut_off(drawn, words) == []
    assert drawn.get_size_inches()[0] in {one.value for one in Width}
    below = [axes.get_position().y0 for axes in drawn.axes]
    assert min(below) * 72.0 * drawn.get_size_inches()[1] > mark.box.y1


def test_what_shows_all_is_no_draft(few, monkeypatch):
    monkeypatch.setattr(Study, "held", lambda self, folder: self.default_events)
    drawn, legend = FIGURES["ladder"].drawn(few)
    assert legend.draft == ""
    assert not any("draft" in text.get_text() for text in drawn.texts)


def test_origin_of_a_study_and_of_a_few_rows_instead():
    assert not of_study(LADDER, 30).draft
    assert of_study(LADDER, 29).draft
    assert of_study(LADDER, None).shown == "a few of 30 events"
    assert of_study(LADDER, 40).shown == "40 of 40 events"


def test_origin_of_a_comparison_names_its_own_parts():
    table = pd.DataFrame({"scenario": ["wet-start", "wet-patch"], "seed": [0, 1]})
    table = table.assign(rule="alone", controller="mpc", status="ok")
    found = of_comparison(table)
    assert found.draft
    assert found.shown == "2 events, 2 of 5 seeds each"
    assert found.command == "readhesion compare --scenario wet-start wet-patch --rules alone --controllers mpc"  # fmt: skip
    assert not of_comparison(pd.concat([table, table.assign(seed=[2, 3])] * 2).assign(seed=[*range(8)])).draft  # fmt: skip


ASKED = Asked("readhesion compare --scenario my/own.toml", whole=False)


def test_a_comparison_names_the_command_as_it_was_given(tmp_path):
    table = comparison_table(seeds=2)
    assert of_comparison(table, ASKED) == Origin(
        ASKED.command, "3 events, 2 of 5 seeds each", (0, 1), True
    )
    # an event that leaves nothing to the seed is complete with one
    assert not of_comparison(table, ASKED._replace(whole=True)).draft
    draw_comparison(table, Store(tmp_path), tmp_path, ASKED)
    assert f"in full: {ASKED.command}\n" in (tmp_path / "rule-comparison.txt").read_text()


@pytest.mark.parametrize("events", [1, 2, 3])
def test_few_events_as_a_draft_cover_nothing(events, tmp_path):
    """Its legend stands between the panels and the line of the draft, however few panels there are."""
    table = comparison_table(seeds=2)
    table = table[table["scenario"].isin(SCENARIOS[:events])]
    drawn = FIGURES["rule-comparison"].make(Source(Store(tmp_path), table, asked=ASKED))
    with mpl.rc_context(fname=STYLE_FILE):
        words = words_of(drawn)
    assert any(one.text.startswith("draft: ") for one in words)
    assert overlapping(words) == []
    assert cut_off(drawn, words) == []
    (legend,) = drawn.legends
    high = legend.get_window_extent().y1
    assert all(axes.get_tightbbox().y0 >= high for axes in drawn.axes if axes.get_visible())


@pytest.mark.parametrize("events", [1, 3])
def test_one_seed_has_its_numbers_beside_and_no_panel_is_said_to_be_empty(events):
    table = comparison_table(seeds=1)
    drawn = FIGURES["rule-comparison"](table[table["scenario"].isin(SCENARIOS[:events])])
    told = csv_of(drawn)
    assert set(told["series"].dropna()) == set(RULES) - {"alone"}
    assert set(told["kind"]) == {"point", "bound"}  # one seed has no interval
    assert not any(text.get_text() == NOTHING for axes in drawn.axes for text in axes.texts)


def test_an_empty_panel_says_why():
    figure = new_figure(PAGE, 2.0)
    full, bare, _ = figure.subplots(1, 3)
    full.plot([0, 1], [0, 1])
    bare.axvline(0.5)
    bare.plot([], [])
    say_where_nothing_is_drawn(figure)
    assert [[text.get_text() for text in axes.texts] for axes in figure.axes] == [[], [NOTHING], [NOTHING]]  # fmt: skip


def test_a_figure_asked_for_alone_writes_nothing_beside(tmp_path):
    draw_one("allocation-bars", tmp_path / "log.png")
    assert [path.name for path in tmp_path.iterdir()] == ["log.png"]
    assert Image.open(tmp_path / "log.png").text["Status"] == "complete"


def test_a_draft_is_named_once_where_two_needs_say_the_same():
    origin = Origin("readhesion sweep one", "1 of 2 events", (0,), True)
    legend = replace(FIGURES["ladder"].legend, origins=(origin, origin))
    assert legend.draft == "draft: 1 of 2 events; in full: readhesion sweep one"


def test_the_terminal_names_the_drafts_and_what_gives_the_rest(monkeypatch, capsys, tmp_path):
    class Drawing:
        def draw_figures(self, names, out, results, jobs, on_row):
            draft = "draft: 6 of 30 events; in full: readhesion sweep ladder"
            return [
                Saved("ladder", (out / "ladder.png",), draft),
                Saved("sanders", (out / "sanders.png",), ""),
            ]

    monkeypatch.setattr(loader, "gallery", Drawing)
    figures(out=tmp_path / "figures", results=tmp_path)
    out, err = capsys.readouterr()
    assert [line.rsplit("/")[-1] for line in out.splitlines()] == ["ladder.png", "sanders.png"]
    assert "ladder is a draft: 6 of 30 events; in full: readhesion sweep ladder" in err
    assert f"add --out {tmp_path}" in err
    assert "sanders" not in err
