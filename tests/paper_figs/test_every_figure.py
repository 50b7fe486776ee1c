"""Every figure, laid out once: it can be read as printed, and it looks as it did when somebody last looked at it."""

import io
import re

import matplotlib as mpl
import pandas as pd
import pytest
from matplotlib.figure import Figure
from matplotlib.testing.compare import calculate_rms

from paper_figs import rules
from paper_figs.drawing import FIGURES
from paper_figs.drawn_data import drawn_data
from paper_figs.style import COLUMN, NOTE, STYLE_FILE, Width, new_figure
from studies.files.study_error import StudyError
from tests.docs.pages import PAGES
from tests.paper_figs.pictures import DPI, TABLES, from_tables, pixels, without_letters
from tests.paper_figs.small_figures import DRAWN
from tests.paper_figs.text_boxes import cut_off, overlapping, words_of
from tests.studies.comparison_tables import comparison_table

TOLERANCE = 1.0
"""Root mean square over all pixels, of 255; a mark that moves by its own width gives more."""
BODY = 7.0
"""Size of type [points] of a figure as printed."""
UNIT = re.compile(r"\[(–|%|s|m|km|m/s|m/s²|m/s³|km/h|km/h/s|N m|kN|kPa|kJ|‰)\]$")
COUNTED = {
    "unit", "car (1 = foremost)", "axle from the front", "stations", "adhesion curve",
    "first half ahead of car", "second half ahead of car",
}  # fmt: skip
"""Labels of axes that count things, which have no unit."""
STORED = {
    name: pytest.mark.mpl_image_compare(
        baseline_dir="pictures", filename=f"{name}.png", style=str(STYLE_FILE),
        tolerance=TOLERANCE, savefig_kwargs={"dpi": DPI},
    )
    for name in TABLES
}  # fmt: skip


@pytest.mark.parametrize(
    "name", [pytest.param(name, marks=STORED.get(name, ())) for name in FIGURES]
)
def test_figure(name):
    figure = from_tables(name) if name in TABLES else DRAWN[name]()
    with mpl.rc_context(fname=STYLE_FILE):  # as files are written
        words = words_of(figure)
        whole = figure.get_tightbbox()
    fits_its_page(figure, whole)
    says_quantity_and_unit(figure)
    sizes = {round(one.size, 2) for one in words}
    assert sizes <= {NOTE, BODY}
    assert BODY in sizes
    assert overlapping(words) == []
    assert cut_off(figure, words) == []
    its_numbers_are_written(figure)
    return without_letters(figure) if name in TABLES else None


def fits_its_page(figure, whole):
    width, height = figure.get_size_inches()
    assert width in {one.value for one in Width}
    assert height <= 10.0
    assert min(whole.x0, whole.y0) >= -0.01
    assert whole.x1 <= width + 0.01
    assert whole.y1 <= height + 0.01


def says_quantity_and_unit(figure):
    labels = [
        label
        for axes in figure.axes
        if axes.get_visible()
        for label in (axes.get_xlabel(), axes.get_ylabel())
        if label
    ]
    assert len(labels) >= 2
    assert [one for one in labels if not (UNIT.search(one) or one in COUNTED)] == []


def its_numbers_are_written(figure):
    table = pd.read_csv(io.StringIO(drawn_data(figure).to_csv(index=False)), low_memory=False)
    assert len(table) >= 8
    assert table["panel"].nunique() >= 1
    assert table.drop(columns=["panel", "kind"]).notna().any(axis="columns").all()


def test_small_runs_draw_every_figure():
    assert set(DRAWN) == set(FIGURES)


def test_every_figure_serves_a_page():
    pages = "\n".join(text for page, text in PAGES.items() if page != "CHANGELOG.md")
    shown = re.findall(r"(?:readhesion figures\s|gallery/|FIGURES\[\")([\w\s-]+)", pages)
    named = {name for one in shown for name in one.split()}
    assert set(FIGURES) - named == set()


@pytest.mark.parametrize("width", [5.0, 3.5, 7.1])
def test_no_other_width_can_be_asked_for(width):
    with pytest.raises(StudyError, match="take COLUMN"):
        new_figure(width, 2.0)


def test_text_that_overlaps_is_found():
    with mpl.rc_context(fname=STYLE_FILE):
        figure = Figure(figsize=(COLUMN.value, 2.0))
        axes = figure.subplots()
        axes.text(0.4, 0.5, "one")
        assert overlapping(words_of(figure)) == []
        axes.text(0.42, 0.5, "other")
        assert overlapping(words_of(figure)) == [("one", "other")]
        axes.text(0.99, 0.2, "beyond the page, far to its right").set_in_layout(False)
        assert cut_off(figure, words_of(figure)) == ["beyond the page, far to its right"]


def test_what_changes_in_a_picture_is_seen(monkeypatch):
    """A mean that moves, a row left out, a side not tinted, another colour."""
    table = comparison_table()
    before = pixels(from_tables("rule-comparison"))
    assert calculate_rms(before, pixels(FIGURES["rule-comparison"](table))) == 0.0
    moved = table.assign(effort_ratio=table["effort_ratio"] + 0.02 * (table["rule"] == "greedy"))
    fewer = table[(table["rule"] != "cooperative") | (table["scenario"] != "two")]
    for other in (moved, fewer):
        assert calculate_rms(before, pixels(FIGURES["rule-comparison"](other))) > TOLERANCE
    for name, changed in (
        ("tint_better", lambda axes, better: None),
        ("rule_look", lambda rule: {"color": "red", "marker": "o", "linestyle": "none"}),
    ):
        with monkeypatch.context() as patched:
            patched.setattr(rules, name, changed)
            after = pixels(FIGURES["rule-comparison"](table))
        assert calculate_rms(before, after) > TOLERANCE, name
