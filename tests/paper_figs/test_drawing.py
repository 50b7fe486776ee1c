"""How figures are registered, made from results, saved with caption and numbers, and marked as drafts."""

import hashlib
import importlib
import io
import pkgutil
import tomllib
from dataclasses import replace
from functools import partial
from importlib.metadata import EntryPoint
from pathlib import Path

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from PIL import Image

import paper_figs
import studies.core.gallery as loader
from paper_figs.drawing import (
    FIGURES,
    NOTHING,
    Source,
    comparison,
    draw_comparison,
    draw_one,
    draw_run,
    figure,
    made,
    of_comparison,
    of_study,
    save_figure,
    say_where_nothing_is_drawn,
)
from paper_figs.drawn_data import drawn_data
from paper_figs.patent import CLAIM_TABLE, FEW_CLAIMS, FEW_EVENTS
from paper_figs.readhesion_paper import case_runs
from paper_figs.saving import MovingFigure, Origin
from paper_figs.style import COLUMN, PAGE, STYLE_FILE, Width, new_figure, new_panels, rule_look
from studies.command_line.write_report import figures
from studies.core.gallery import GROUP, Asked, Gallery, Saved, gallery
from studies.core.job import Job, simulate_job
from studies.core.plugins import VARIABLE, use_plugins
from studies.core.store import Store
from studies.core.study import Study, find_study
from studies.files.study_error import StudyError
from studies.readhesion_paper.study import MOST_MEMBERS
from studies.scenario.scenario import load_scenario
from studies.slides.jp4209318 import CALIBRATED as DEMONSTRATION
from studies.slides.jp4209318 import brake, brake_event
from tests.paper_figs import small_figures
from tests.paper_figs.text_boxes import cut_off, overlapping, words_of
from tests.studies.brake_tables import brake_table
from tests.studies.headroom_tables import headroom_table
from tests.studies.ladder_tables import ladder_table
from tests.studies.made_tables import RULES, SCENARIOS, comparison_table, falling, sweep_table
from tests.studies.made_tables import synthetic as learning_table

PYPROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
PLUGIN = """
from paper_figs.drawing import figure
from paper_figs.drawing import made
from paper_figs.style import COLUMN, new_panels


@figure("plugged", "squares of the first numbers", made(range, 4))
def plugged(numbers):
    drawn, axes = new_panels(COLUMN, 2.0)
    axes.plot(numbers, [k**2 for k in numbers])
    return drawn
"""


@pytest.fixture(autouse=True)
def own_register(monkeypatch):
    """Figures that a test registers are gone after it."""
    parts = {name: FIGURES[name] for name in FIGURES}  # loads all of them first
    monkeypatch.setattr(FIGURES, "_parts", parts)
    monkeypatch.setattr(FIGURES, "_origins", dict(FIGURES._origins))


@pytest.fixture
def installed(monkeypatch):
    """The entry point that pyproject.toml states."""
    ((name, value),) = PYPROJECT["project"]["entry-points"][GROUP].items()
    points = {GROUP: [EntryPoint(name, value, GROUP)]}
    monkeypatch.setattr(loader, "offered", lambda group: points.get(group, []))
    return points


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


ASKED = Asked("readhesion compare --scenario my/own.toml", whole=False)


def test_what_is_installed_draws_and_else_it_is_said(installed, tmp_path):
    own = gallery()
    assert all(callable(getattr(own, name)) for name in vars(Gallery) if not name.startswith("_"))
    assert own.descriptions() == {name: one.description for name, one in FIGURES.items()}
    with pytest.raises(StudyError, match="did you mean 'slip-event'"):
        own.draw_figures(["slipevent"], tmp_path, tmp_path)
    installed.clear()
    with pytest.raises(StudyError, match="nothing is installed that draws figures"):
        gallery()


def test_a_plugin_file_registers_a_figure(installed, tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, "")
    file = tmp_path / "squares.py"
    file.write_text(PLUGIN)
    use_plugins([file])
    assert gallery().descriptions()["plugged"] == "squares of the first numbers"
    told = []
    (saved,) = gallery().draw_figures(
        ["plugged"], tmp_path / "out", tmp_path / "results", 1, lambda *row: told.append(row)
    )
    assert told == [("figure plugged", 1, 1)]
    assert saved.seconds > 0.0
    assert [path.suffix for path in saved.files] == [".pdf", ".png", ".txt", ".csv"]
    assert saved.files[3].read_text().splitlines()[-1] == "1,line,,,,,3,9"
    assert saved.draft == ""
    gallery().draw_one("plugged", tmp_path / "own.png", [1, 2])
    assert (tmp_path / "own.png").read_bytes().startswith(b"\x89PNG")


def test_a_figure_is_drawn_from_what_it_needs_under_a_name_of_its_own(tmp_path):
    @figure("pair", "two needs and their order", made(pow, 2, 3), lambda source: source.jobs)
    def pair(power, jobs):
        drawn, axes = new_panels(COLUMN, 2.0)
        axes.set_title(f"{power} {jobs}")
        return drawn

    drawn = FIGURES["pair"].make(Source(Store(tmp_path), jobs=5))
    assert drawn.axes[0]._left_title.get_text() == "8 5"
    assert not pair.of_comparison
    assert figure("rows", "rows of a comparison", comparison)(pair.function).of_comparison
    with pytest.raises(StudyError, match="figure 'mine' needs 'comparison', which gives no data"):
        figure("mine", "a name in place of its data", "comparison")
    with pytest.raises(StudyError, match=r"'ladder' exists already, from paper_figs\.controllers"):
        figure("ladder", "another ladder")(lambda: None)


def test_tables_of_figures_are_the_sweeps_and_what_they_lack_is_run(tmp_path, monkeypatch):
    asked, tables = [], {"learning": partial(learning_table, falling, trains=1), "readhesion": sweep_table,
                         "brake-force": brake_table, "claims": lambda: None}  # fmt: skip

    def run(self, folder, *arguments):
        asked.append((folder.relative_to(tmp_path / "sweeps").as_posix(), *arguments[:3]))
        return tables[self.name]()

    monkeypatch.setattr(Study, "run", run)
    source = Source(Store(tmp_path), None, 2)
    CLAIM_TABLE(source)
    for name in ("learning", "margin-sweep", "width-sweep"):
        assert len(FIGURES[name].make(source).axes) >= 3
    monkeypatch.setattr(Study, "held", lambda self, folder: 300)
    CLAIM_TABLE(source)
    FIGURES["brake-cut-out"].make(source)
    assert asked == [
        ("claims", FEW_CLAIMS, 0, 2), ("learning", FEW_EVENTS, 0, 2), *[("readhesion", MOST_MEMBERS, 0, 2)] * 2,
        ("claims", 300, 0, 2), ("brake-force", 300, 0, 2),
    ]  # fmt: skip
    calls = []
    monkeypatch.setattr("paper_figs.readhesion_paper.run_cases", lambda *a, **k: calls.append(a))
    case_runs.cache_clear()
    case_runs()
    case_runs()
    case_runs.cache_clear()
    assert len(calls) == 1  # runs are made once


def test_a_share_in_percent_is_a_hundred_times_the_metric_and_all_else_the_metric_itself():
    """Of every panel of the figures and every column of the printed tables."""
    modules = [f"paper_figs.{one.name}" for one in pkgutil.iter_modules(paper_figs.__path__)]
    found = 0
    for name in (*modules, "studies.comparison.table"):
        for shown in vars(importlib.import_module(name)).values():
            for one in shown if isinstance(shown, tuple) else ():
                words = (
                    [word for word in one if isinstance(word, str)]
                    if isinstance(one, tuple)
                    else []
                )
                words += [one.heading] if hasattr(one, "heading") else []
                if words and hasattr(one, "factor"):
                    share = any("%" in word or "points" in word for word in words)
                    assert one.factor == (100.0 if share else 1.0), (name, one)
                    found += 1
    assert found > 45


def test_equal_figures_are_equal_files_and_a_folder_that_cannot_be_written_is_refused(tmp_path):
    """Of lines, of images, and of a figure that moves."""
    for name in ("adhesion-curve", "slip-event", "slip-replay"):
        drawn = small_figures.DRAWN[name]()
        pdf, png, *beside = save_figure(drawn, tmp_path / name)
        assert pdf.read_bytes().startswith(b"%PDF")
        assert png.read_bytes().startswith(b"\x89PNG")
        pdf_again, _, *again = save_figure(drawn, tmp_path / "again" / name)
        for one, other in zip([pdf, *beside], [pdf_again, *again], strict=True):
            assert one.read_bytes() == other.read_bytes(), name
    (tmp_path / "file").write_text("")
    with pytest.raises(StudyError, match="cannot be written"):
        save_figure(drawn, tmp_path / "file" / "figure")


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


def nothing_is_covered(drawn):
    """Words of a draft: none overlaps another or the page's edge; gives that of the draft."""
    with mpl.rc_context(fname=STYLE_FILE):
        words = words_of(drawn)
    (mark,) = (one for one in words if one.text.startswith("draft: "))
    assert overlapping(words) == []
    assert cut_off(drawn, words) == []
    return mark


def test_a_draft_says_so_and_nothing_covers_it(few, monkeypatch):
    for name in ("ladder", "headroom"):  # a title above; legends of two subfigures
        drawn = FIGURES[name].make(few)
        mark = nothing_is_covered(drawn)
        events = find_study(name).default_events
        assert f"of {events} events; in full: readhesion sweep {name}" in mark.text
        assert drawn.get_size_inches()[0] in {one.value for one in Width}
        below = [axes.get_position().y0 for axes in drawn.axes]
        assert min(below) * 72.0 * drawn.get_size_inches()[1] > mark.box.y1
    monkeypatch.setattr(Study, "held", lambda self, folder: self.default_events)
    drawn, legend = FIGURES["ladder"].drawn(few)  # what shows all is no draft
    assert legend.draft == ""
    assert not any("draft" in text.get_text() for text in drawn.texts)
    # a draft is named once where two needs say the same
    origin = Origin("readhesion sweep one", "1 of 2 events", (0,), True)
    legend = replace(legend, origins=(origin, origin))
    assert legend.draft == "draft: 1 of 2 events; in full: readhesion sweep one"


def test_origins_name_the_study_or_the_comparisons_own_parts():
    assert not of_study(LADDER, 30).draft
    assert of_study(LADDER, 29).draft
    assert of_study(LADDER, None).shown == "a few of 30 events"
    assert of_study(LADDER, 40).shown == "40 of 40 events"
    table = pd.DataFrame({"scenario": ["wet-start", "wet-patch"], "seed": [0, 1]})
    table = table.assign(rule="alone", controller="mpc", status="ok")
    found = of_comparison(table)
    assert found.draft
    assert found.shown == "2 events, 2 of 5 seeds each"
    assert found.command == "readhesion compare --scenario wet-start wet-patch --rules alone --controllers mpc"  # fmt: skip
    assert not of_comparison(pd.concat([table, table.assign(seed=[2, 3])] * 2).assign(seed=[*range(8)])).draft  # fmt: skip


def test_a_comparison_is_drawn_with_its_figures_and_names_the_command_as_it_was_given(tmp_path):
    table = comparison_table(seeds=2)
    assert of_comparison(table, ASKED) == Origin(
        ASKED.command, "3 events, 2 of 5 seeds each", (0, 1), True
    )
    # an event that leaves nothing to the seed is complete with one
    assert not of_comparison(table, ASKED._replace(whole=True)).draft
    names = draw_comparison(table, Store(tmp_path), tmp_path, ASKED)
    assert names == [name for name, entry in FIGURES.items() if entry.of_comparison]
    assert {path.stem for path in tmp_path.glob("*.*")} == set(names)
    assert f"in full: {ASKED.command}\n" in (tmp_path / "rule-comparison.txt").read_text()
    assert draw_comparison(table.assign(status="failed"), Store(tmp_path), tmp_path) == []


def test_few_events_and_one_seed_are_drawn_too(tmp_path):
    """The legend stands between the panels and the line of the draft, however few panels there are."""
    table, one_seed = comparison_table(seeds=2), comparison_table(seeds=1)
    for events in (1, 2, 3):
        shown = table[table["scenario"].isin(SCENARIOS[:events])]
        drawn = FIGURES["rule-comparison"].make(Source(Store(tmp_path), shown, asked=ASKED))
        nothing_is_covered(drawn)
        (legend,) = drawn.legends
        high = legend.get_window_extent().y1
        assert all(axes.get_tightbbox().y0 >= high for axes in drawn.axes if axes.get_visible())
        shown = one_seed[one_seed["scenario"].isin(SCENARIOS[:events])]
        drawn = FIGURES["rule-comparison"](shown)
        told = csv_of(drawn)
        assert set(told["series"].dropna()) == {
            rule + end for rule in set(RULES) - {"alone"} for end in ("", ", an event")
        }
        assert set(told["kind"]) == {"point", "bound"}  # one seed has no interval
        assert not any(text.get_text() == NOTHING for axes in drawn.axes for text in axes.texts)


def test_panels_have_letters_unless_the_figure_has_its_own_or_too_many():
    def titles(count, *own):
        @figure(f"of {count} {own}", "panels with titles at their sides", made(str))
        def lettered(_):
            drawn, axes = new_panels(PAGE, 2.0, 1, count, squeeze=False)
            for words, side, one in zip(own, ("left", "center", "right"), axes[0], strict=False):
                one.set_title(words, loc=side)
            axes[0, 0].figure.colorbar(mpl.cm.ScalarMappable(), ax=axes[0, 0])
            return drawn

        shown = [one for one in lettered("").axes if one.get_label() != "<colorbar>"]
        return ["".join(map(one.get_title, ("left", "center", "right"))) for one in shown]

    assert titles(1, "alone") == ["alone"]
    assert titles(4, "one", "two", "three") == ["(a) one", "(b) two", "(c) three", "(d)"]
    assert titles(2, "(a) its own") == ["(a) its own", ""]
    assert titles(10, "one") == ["one", *[""] * 9]


def test_an_empty_panel_says_why():
    figure = new_figure(PAGE, 2.0)
    full, bare, _ = figure.subplots(1, 3)
    full.plot([0, 1], [0, 1])
    bare.axvline(0.5)
    bare.plot([], [])
    say_where_nothing_is_drawn(figure)
    assert [[text.get_text() for text in axes.texts] for axes in figure.axes] == [[], [NOTHING], [NOTHING]]  # fmt: skip


def test_the_terminal_names_the_drafts_and_what_gives_the_rest(monkeypatch, capsys, tmp_path):
    class Drawing:
        def draw_figures(self, names, out, results, jobs, on_row):
            draft = "draft: 6 of 30 events; in full: readhesion sweep ladder"
            return [
                Saved("ladder", (out / "ladder.png",), draft, 2.0),
                Saved("sanders", (out / "sanders.png",), "", 3.5),
            ]

    monkeypatch.setattr(loader, "gallery", Drawing)
    figures(out=tmp_path / "figures", results=tmp_path)
    out, err = capsys.readouterr()
    assert [line.rsplit("/")[-1] for line in out.splitlines()] == ["ladder.png", "sanders.png"]
    assert "ladder is a draft: 6 of 30 events; in full: readhesion sweep ladder" in err
    assert f"add --out {tmp_path}" in err
    assert "drawn in 5.5 s: sanders 3.5 s, ladder 2.0 s" in err  # the slowest first
    assert "sanders is a draft" not in err


def test_a_figure_of_one_run_names_the_command_that_made_it_and_stands_alone(tmp_path):
    (run, *_), path = small_figures.runs(), tmp_path / "run.png"
    job = Job(load_scenario("very-low-adhesion"), "alone", "cut-and-ramp", 4)
    for command, words in (
        ("", "simulate very-low-adhesion --rule alone"),
        ("readhesion simulate my/own.toml", "my/own.toml"),
    ):
        draw_run(run, path, job, command)
        source = Image.open(path).text["Source"]
        assert words in source
        assert "seed 4" in source
    draw_run(run, tmp_path / "run.svg")
    assert "<svg" in (tmp_path / "run.svg").read_text()
    draw_one("allocation-bars", tmp_path / "log.png")
    assert Image.open(tmp_path / "log.png").text["Status"] == "complete"
    assert {one.name for one in tmp_path.iterdir()} == {"run.png", "run.svg", "log.png"}
    with pytest.raises(StudyError, match="'xyz' is not supported"):
        draw_run(run, tmp_path / "run.xyz")


def test_a_run_of_any_event_is_shown_as_it_happens(tmp_path, monkeypatch):
    """Train, rule, controller and seed are those of the job, and the file's ending says that the figure moves."""
    scenario = load_scenario("long-train").changed(duration_s=2.0)
    job = Job(scenario, "exact", "none", 3)
    run, shown = simulate_job(job), []
    monkeypatch.setattr(
        MovingFigure, "save_motion", lambda self, path, _: shown.append(self) or path.touch()
    )
    draw_run(run, tmp_path / "run.gif", job)
    (figure,) = shown
    line = figure.axes[0]
    cars = [patch for patch in line.patches if patch.get_y() > 0.0]
    assert len(cars) == len(scenario.event(3).model.train.cars)
    assert line.get_title(loc="left").startswith("exact, none: ")
    with pytest.raises(StudyError, match="not known of what event"):
        draw_run(run, tmp_path / "run.gif")
    with pytest.raises(StudyError, match="no motor"):
        draw_run(
            brake(replace(brake_event(DEMONSTRATION, 1), duration=1.0)), tmp_path / "run.gif", job
        )
    with pytest.raises(StudyError, match="does not move"):
        draw_one("allocation-bars", tmp_path / "bars.gif")
