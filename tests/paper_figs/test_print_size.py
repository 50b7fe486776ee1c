"""A figure is printed as it is: its width fits a column or a page, and its text can be read."""

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure

from paper_figs.registry import FIGURES
from paper_figs.style import COLUMN, NOTE, PAGE, STYLE_FILE, Width, new_figure
from studies.files.study_error import StudyError
from tests.paper_figs.text_boxes import cut_off, overlapping, words_of

BODY = 7.0
"""Size of type [points] of a figure as printed."""


@pytest.fixture(scope="module")
def words(drawn):
    with mpl.rc_context(fname=STYLE_FILE):
        return {name: words_of(figure) for name, figure in drawn.items()}


@pytest.mark.parametrize("name", FIGURES)
def test_a_figure_fits_a_column_or_a_page(drawn, name):
    width, height = drawn[name].get_size_inches()
    assert width in {one.value for one in Width}
    assert height <= 10.0


@pytest.mark.parametrize("name", FIGURES)
def test_type_has_its_size_and_none_is_too_small(words, name):
    sizes = {round(one.size, 2) for one in words[name]}
    assert sizes <= {NOTE, BODY}
    assert BODY in sizes


@pytest.mark.parametrize("name", FIGURES)
def test_no_text_covers_another_or_is_cut_off(drawn, words, name):
    assert overlapping(words[name]) == []
    assert cut_off(drawn[name], words[name]) == []


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
    assert PAGE.value > COLUMN.value
