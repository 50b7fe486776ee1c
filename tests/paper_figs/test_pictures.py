"""Figures look as they did when somebody last looked at them."""

import pytest
from matplotlib.testing.compare import calculate_rms

from paper_figs import comparison
from paper_figs.style import STYLE_FILE
from tests.paper_figs.pictures import DPI, TABLES, picture, pixels
from tests.studies.comparison_tables import comparison_table

TOLERANCE = 1.0
"""Root mean square over all pixels, of 255; a mark that moves by its own width gives more."""


@pytest.mark.parametrize("name", TABLES)
@pytest.mark.mpl_image_compare(
    baseline_dir="pictures", style=str(STYLE_FILE), tolerance=TOLERANCE, savefig_kwargs={"dpi": DPI}
)
def test_picture(name):
    return picture(name)


def test_a_mean_that_moves_is_seen():
    table = comparison_table()
    before = pixels(picture("rule-comparison", table))
    assert calculate_rms(before, pixels(picture("rule-comparison"))) == 0.0
    moved = table.assign(effort_ratio=table["effort_ratio"] + 0.02 * (table["rule"] == "greedy"))
    assert calculate_rms(before, pixels(picture("rule-comparison", moved))) > TOLERANCE


def test_a_colour_that_changes_is_seen(monkeypatch):
    before = pixels(picture("rule-comparison"))
    monkeypatch.setattr(
        comparison, "rule_look", lambda rule: {"color": "red", "marker": "o", "linestyle": "none"}
    )
    assert calculate_rms(before, pixels(picture("rule-comparison"))) > TOLERANCE


def test_a_side_that_is_not_tinted_is_seen(monkeypatch):
    before = pixels(picture("rule-comparison"))
    monkeypatch.setattr(comparison, "tint_better", lambda axes, better: None)
    assert calculate_rms(before, pixels(picture("rule-comparison"))) > TOLERANCE


def test_a_row_that_is_left_out_is_seen():
    table = comparison_table()
    fewer = table[(table["rule"] != "cooperative") | (table["scenario"] != "two")]
    before, after = (pixels(picture("utilisation-damage", one)) for one in (table, fewer))
    assert calculate_rms(before, after) > TOLERANCE
