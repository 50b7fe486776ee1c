"""Every figure that needs no study draws, says what its axes show, stays on its page, and has a sentence for a caption."""

import re
from importlib import import_module
from itertools import combinations

import matplotlib as mpl
import numpy as np
import pandas as pd
import pytest
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.figure import Figure
from matplotlib.font_manager import findfont, get_font
from matplotlib.text import Text

import paper_figs
from alloc.onboard.controllers import CONTROLLERS
from alloc.rules import RULES
from paper_figs.figure_data import tabulate_figure
from paper_figs.style import NARROW, WIDE, Drawing
from studies import StudyError
from studies.runner.catalogue import STUDIES

FIGURES = paper_figs.all_figures()
STYLE = paper_figs.__path__[0] + "/readhesion.mplstyle"
COUNTED = ("axle", "unit", "event", "rule", "controller", "car", "bogie", "stop", "test", "station")
"""Quantities without a unit, at the beginning of a label."""
PADDING = 0.05
"""Empty border [in] of a legend, which may lie outside the page."""


def beside(one: Axes, other: Axes, side: str) -> bool:
    """Whether axes stand in one column (side x) or in one row (side y), where one label is enough."""
    ends = f"interval{side}"
    a, b = (getattr(axes.get_position(), ends) for axes in (one, other))
    return bool(np.abs(a - b).max() < 0.03)


@pytest.mark.parametrize("name", [name for name, one in FIGURES.items() if not one.study])
def test_figure(name):
    with mpl.rc_context(fname=STYLE):
        drawn = FIGURES[name].draw()
        canvas = FigureCanvasAgg(drawn)
        canvas.draw()
    assert drawn.get_figwidth() in (NARROW, WIDE)
    seen = drawn.get_tightbbox(canvas.get_renderer())
    assert min(seen.x0, seen.y0) > -PADDING
    assert (seen.max < drawn.get_size_inches() + PADDING).all()
    for side in ("x", "y"):
        shown = {axes: getattr(axes, f"get_{side}label")() for axes in drawn.axes if axes.axison}
        for label in filter(None, shown.values()):
            assert re.search(r"\[[^\]]+\]", label) or label.startswith(COUNTED), label
        for axes in shown:
            named = any(label for other, label in shown.items() if beside(axes, other, side))
            assert named or hasattr(axes, "_colorbar"), f"no {side} label: {axes}"
    data = tabulate_figure(drawn)
    assert data.equals(tabulate_figure(drawn))  # a reader changes nothing
    assert data.empty == (not any(axes.axison for axes in drawn.axes))
    assert data.empty or data[["x_axis", "y_axis"]].notna().all(axis=None)
    letters = set("".join(text.get_text() for text in drawn.findobj(Text))) - {"\n"}
    assert {*map(ord, letters)} <= {
        *get_font(findfont("STIXGeneral")).get_charmap()
    }  # of latex.mplstyle


def made_figure():
    """A line and a level, bars, an area, coloured points, an image: of each a number that is known."""
    drawn = Figure(figsize=(4.0, 2.0), layout="constrained")
    (left, right), (_, low) = drawn.subplots(2, 2, sharex="col")
    left.plot([1, 2], [3, 4], color="red")
    left.axhline(5.0)
    left.set(ylabel="force [N]")
    low.plot([0, 1], [6, 7], color="red", label="known")
    low.bar(["a", "b"], [8, 9], bottom=1)
    low.set(xlabel="time [s]")
    shades = right.imshow([[10, 11], [12, 13]], extent=(0, 4, 0, 4), origin="lower")
    drawn.colorbar(shades, ax=right, label="slip [m/s]")
    return drawn


def test_data_of_a_figure(tmp_path):
    (tmp_path / "wide.mplstyle").write_text("savefig.dpi: 50\n")
    drawing, style = Drawing(made_figure, "What is known."), str(tmp_path / "wide.mplstyle")
    (path,) = paper_figs.draw({"made": drawing}, tmp_path, tmp_path, "png", style, 6.0)
    assert mpl.image.imread(path).shape[:2] == (150, 300)
    data = pd.read_csv(path.with_suffix(".csv"), keep_default_na=False, na_values="")
    points = {
        (panel, kind): part[["x", "y", "value"]].fillna(-1).to_numpy().tolist()
        for (panel, kind), part in data.groupby(["panel", "kind"])
    }
    assert points[1, "line"] == [[1, 3, -1], [2, 4, -1], [-1, 5, -1]]
    assert points[2, "image"] == [[1, 1, 10], [3, 1, 11], [1, 3, 12], [3, 3, 13]]
    assert points[4, "bar"] == [[0, 9, -1], [1, 10, -1]]
    assert set(data.loc[data["x"] == 2, "label"]) == {"known"}  # by its look, in the other panel
    assert set(data.loc[data["panel"] == 2, "x_axis"]) == {"time [s]"}
    assert set(data["value_axis"].dropna()) == {"slip [m/s]"}
    assert data.loc[data["kind"] == "bar", "x_name"].tolist() == ["a", "b"]


def test_what_cannot_be_drawn_is_named_after_the_others_and_what_is_too_narrow(tmp_path):
    def refuse():
        raise StudyError("rows are missing")

    figures = {
        name: Drawing(one, "A caption.") for name, one in (("bad", refuse), ("made", made_figure))
    }
    drawn = paper_figs.draw(figures, tmp_path, tmp_path, "png", width=2.0)
    with pytest.warns(UserWarning, match=r"figure 'made' is made for 4 in; at 2 in"):
        assert next(drawn).is_file()
    with pytest.raises(StudyError, match="figure 'bad': rows are missing"):
        next(drawn)


@pytest.mark.parametrize("name", FIGURES)
def test_caption_is_a_sentence(name):
    caption = FIGURES[name].caption
    assert re.fullmatch(r"[A-Z][^\n]{40,400}\.", caption), caption
    assert FIGURES[name].study in ("", "compare", *STUDIES)


def test_names_differ():
    modules = [import_module(f"paper_figs.{name}") for name in paper_figs.MODULES]
    assert sum(len(module.FIGURES) for module in modules) == len(FIGURES)


def test_the_sizes_of_limits_are_sorted_and_lie_in_their_intervals():
    """The page says so, and the figure draws the rows as they stand."""
    sizes = list(import_module("paper_figs.limits_sizes").read_sizes().values())
    assert [value for value, *_ in sizes] == sorted(value for value, *_ in sizes)
    assert all(low <= value <= high for value, low, high in (one for one in sizes if len(one) > 1))


def test_figures_of_a_comparison():
    """They draw what there is: a rule that fails in an event, a controller without some rules."""
    random = np.random.default_rng(1)
    rows = pd.DataFrame(
        {"scenario": event, "seed": 0, "rule": rule, "controller": law, "status": "ok"}
        for event in "abcdef"
        for rule in ("alone", "greedy", "oracle", "wear")
        for law in ("cut-and-ramp", "perturb-observe")
    )
    for number in ("bound_use", "damage", "slip_time", "over_delivery", "rule_gap"):
        rows[number] = random.uniform(0.0, 0.009, len(rows))
    rows.loc[3, "status"] = "failed"
    rows = rows.drop(index=[5, 7])
    for name in ("rules", "rule-events"):
        with mpl.rc_context(fname=STYLE):
            FigureCanvasAgg(FIGURES[name].draw(rows)).draw()
        with pytest.raises(StudyError, match="rows of 'alone' are missing"):
            FIGURES[name].draw(rows[rows["rule"] != "alone"])
        with pytest.raises(StudyError, match="rule 'mine' of this comparison is not registered"):
            FIGURES[name].draw(rows.replace({"rule": {"wear": "mine"}}))


@pytest.mark.parametrize("parts", [RULES, CONTROLLERS], ids=["rules", "controllers"])
def test_colours_differ_for_all_readers(parts):
    colours = pytest.importorskip("colorspacious")
    names = parts.shipped() or list(parts)
    rgb = np.array([mpl.colors.to_rgb(parts[name].colour) for name in names])
    seen = [rgb]
    for kind in ("deuteranomaly", "protanomaly", "tritanomaly"):
        reader = {"name": "sRGB1+CVD", "cvd_type": kind, "severity": 100}
        seen.append(colours.cspace_convert(rgb, reader, "sRGB1").clip(0.0, 1.0))
    for one in seen:
        place = colours.cspace_convert(one, "sRGB1", "CAM02-UCS")
        for a, b in combinations(range(len(names)), 2):
            assert np.linalg.norm(place[a] - place[b]) > 8.0, (names[a], names[b])
