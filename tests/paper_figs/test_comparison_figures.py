"""The figure of a comparison: paired differences, the better side tinted."""

import pytest
from matplotlib.colors import to_hex

from alloc.onboard.host import CONTROLLERS
from paper_figs.drawn_data import drawn_data
from paper_figs.rules import NO_PAIRS, rule_comparison
from paper_figs.style import BETTER
from studies.comparison.summary import REFERENCE, summarise
from tests.studies.comparison_tables import comparison_table


def test_the_comparison_shows_the_paired_differences_of_the_table(drawn, source):
    lines = summarise(source.table)
    data = drawn_data(drawn["rule-comparison"])
    for place, metric in enumerate(("effort_ratio", "damage")):
        panels = list(dict.fromkeys(data["panel"]))[2 * place : 2 * place + 2]
        shown = data[data["panel"].isin(panels) & data["kind"].isin(["mean", "point"])]
        factor = 1.0 if metric == "damage" else 100.0
        meant = {
            (line.rule, factor * line.differences[metric].value)
            for line in lines
            if line.differences
        }
        assert {
            (rule, round(x, 9)) for rule, x in zip(shown["series"], shown["x"], strict=True)
        } == {(rule, round(x, 9)) for rule, x in meant}


@pytest.mark.parametrize(("metric", "better"), [("effort_ratio", 1), ("damage", -1)])
def test_the_better_side_is_tinted(metric, better):
    axes = drawn_from(comparison_table())[metric]
    (side,) = [patch for patch in axes.patches if to_hex(patch.get_facecolor()) == BETTER]
    ends = (side.get_x(), side.get_x() + side.get_width())
    low, high = axes.get_xlim()
    assert ends == pytest.approx((0.0, high) if better > 0 else (low, 0.0))


def drawn_from(table):
    """The first panel of each metric of the rules compared."""
    axes = rule_comparison(table).axes
    return {"effort_ratio": axes[0], "damage": axes[2]}


def test_a_comparison_without_the_reference_says_so():
    table = comparison_table()
    axes = rule_comparison(table[table["rule"] != REFERENCE]).axes[0]
    assert [text.get_text() for text in axes.texts] == [NO_PAIRS]


@pytest.mark.parametrize("count", [1, 5])
def test_any_number_of_controllers_is_drawn(count):
    names = list(CONTROLLERS)[:count]
    drawn = rule_comparison(comparison_table(tuple(names)))
    shown = [axes.get_title("center") for axes in drawn.axes if axes.get_visible()]
    assert sorted(shown) == sorted(2 * names)
