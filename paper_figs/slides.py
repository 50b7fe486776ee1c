"""Slide protection: the demonstration of JP4209318 and its tables, and what surrounds them."""

from collections.abc import Sequence
from typing import Literal

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator

from paper_figs.counts import remark
from paper_figs.palette import BLUE, DARK, GREY, ORANGE, VERMILION
from paper_figs.registry import figure
from paper_figs.source import study
from paper_figs.style import (
    BAND,
    NOTE,
    PAGE,
    Look,
    controller_look,
    handle,
    legend_below,
    new_panels,
    plain_ticks,
)
from studies.core.ensemble_range import PERCENTILES
from studies.slides.electric import CONTROLLERS, PART
from studies.slides.targets import HOLD_OUT, TABLE_3, TABLE_4, front, logarithm

HERE, PRINTED, SOURCE_EDGE = BLUE, GREY, VERMILION
"""Colours of this project's numbers and of the source's, as marks and as hollow ones."""
MARKERS = {"low": "v", "medium": "o", "high": "^"}
"""Of the sensitivity's settings."""
BAND_WORDS = "fuzzy, fronts of 90 % of the ensemble"
SETTING, OF_SOURCE = 5.0, 4.6
"""Sizes of the marks of a setting here and in the source [points]: they stand side by side."""
DAMAGES = (200, 300, 500, 700, 1000, 1500, 2000, 3000, 5000, 10000)
"""Ticks of wheel damage [kJ]."""
FILLS: dict[str, tuple[Literal["full", "none"], str]] = {
    "1C4M": ("full", "one inverter a car"),
    "1C1M": ("none", "one inverter an axle"),
}
"""Inverters' grouping, fill of its marks and label."""


@figure("slide-tables", "braking distances and Q beside the source's numbers (JP4209318 Tables 3, 4)",
        study("slide-protection"))  # fmt: skip
def slide_tables(table: pd.DataFrame) -> Figure:
    """Left: distance by number of cars, with what fits to one and three predict of two. Right: by sensitivity.

    Whiskers: 90 % of the ensemble.
    """
    drawn, (length, distance, damage) = new_panels(PAGE, 3.3, 1, 3)
    remark(length, _of_members(table))
    here = [_of_sets(table, "distance", cars, "medium") for cars in TABLE_3]
    _points(length, [f"{cars}" for cars in TABLE_3], list(TABLE_3.values()), here, ".1f")
    predicted = table.loc[table["part"] == "held out", HOLD_OUT].to_numpy(dtype=float)
    if predicted.size:
        low, high = np.percentile(predicted, PERCENTILES)
        middle = float(np.median(predicted))
        length.errorbar(
            [1.0], [middle], [[middle - low], [high - middle]], fmt="D", color=VERMILION, markersize=4, capsize=3,
            label=f"predicted by {predicted.size} fits to 1 and 3 cars",
        )  # fmt: skip
    length.plot(
        [1.0], [logarithm(2)], "x", color="black", label="by a logarithm through 1 and 3 cars"
    )
    settings, printed = list(TABLE_4), list(zip(*TABLE_4.values(), strict=True))
    for axes, values, measure, text in (
        (distance, printed[0], "distance", ".1f"),
        (damage, printed[1], "damage", ".0f"),
    ):
        own = [_of_sets(table, measure, 3, setting) for setting in settings]
        _points(axes, settings, values, own, text)
    length.set(ylabel="braking distance [m]", xlabel="cars", title="(a) Table 3")
    distance.set(ylabel="braking distance [m]", xlabel="sensitivity", title="(b) Table 4")
    damage.set(
        ylabel="wheel damage Q [kJ]", xlabel="sensitivity", title="(c) Table 4", ylim=(0, 2100)
    )
    legend_below(drawn, 3, length)
    return drawn


def _of_sets(table: pd.DataFrame, measure: str, cars: int, setting: str) -> np.ndarray:
    """A measure of a table's stop: of the set in use, then of the members."""
    chosen = (table["part"] == "tables") & (table["cars"] == cars) & (table["setting"] == setting)
    rows = table[chosen].sort_values("member", na_position="first")
    return rows[measure].to_numpy(dtype=float)


def _whisker(values: np.ndarray) -> np.ndarray:
    """How far 90 % of the members reach below and above the set in use, (2,); 0 where there are none."""
    if values.size < 2:
        return np.zeros(2)
    low, high = np.nanpercentile(values[1:], PERCENTILES)
    return np.array([max(values[0] - low, 0.0), max(high - values[0], 0.0)])


def _points(
    axes: Axes, names: Sequence[str], printed: Sequence[float], here: Sequence[np.ndarray], text: str
) -> None:  # fmt: skip
    """Marks without a foot, for the axis does not begin at 0."""
    place = np.arange(len(names), dtype=float)
    own, reach = [float(values[0]) for values in here], np.array([_whisker(v) for v in here]).T
    axes.plot(
        place - 0.15,
        printed,
        "_",
        color=PRINTED,
        markersize=14,
        markeredgewidth=2.5,
        label="printed in the source",
    )
    axes.errorbar(
        place + 0.15,
        own,
        reach,
        fmt="o",
        color=HERE,
        markersize=4,
        capsize=3,
        label="here; 90 % of the ensemble",
    )
    for x, y in zip(place, own, strict=True):
        axes.annotate(
            f"{y:{text}}",
            (x + 0.15, y),
            xytext=(6, 0),
            textcoords="offset points",
            va="center",
            fontsize=NOTE,
        )
    axes.set_xticks(place, names)
    axes.set_xlim(-0.5, len(names) - 0.2)


def _over_damage(axes: Axes) -> None:
    axes.set(xlabel="wheel damage Q [kJ]", ylabel="braking distance [m]", xscale="log")
    plain_ticks(axes.xaxis, FixedLocator(DAMAGES))


def _members_front(axes: Axes, table: pd.DataFrame) -> None:
    """Where the fronts of 90 % of the members lie, over those Q that half of them reach."""
    grid = np.geomspace(DAMAGES[0], DAMAGES[-1], 120)
    fronts = []
    for _, rows in table[(table["part"] == "pareto") & table["member"].notna()].groupby("member"):
        own = front(rows).sort_values("damage")
        reach = np.interp(grid, own["damage"], own["distance"], left=np.nan, right=np.nan)
        fronts.append(reach)
    if not fronts:
        return
    values = np.array(fronts)
    common = np.isfinite(values).mean(axis=0) >= 0.5
    low, high = np.nanpercentile(values[:, common], PERCENTILES, axis=0)
    look: Look = {"color": HERE, "alpha": BAND, "linewidth": 0.0, "label": BAND_WORDS}
    axes.fill_between(grid[common], low, high, **look)


def _of_members(table: pd.DataFrame) -> str:
    """How large the ensemble is."""
    count = table["member"].nunique()
    return f"Ensemble: n = {count} members." if count else "No ensemble."


def _band_handle() -> Line2D:
    return handle(BAND_WORDS, color=HERE, alpha=BAND, linewidth=6)


@figure("slide-pareto", "distance against Q over the sensitivity of slide protection, and thresholds",
        study("slide-protection"))  # fmt: skip
def slide_pareto(table: pd.DataFrame) -> Figure:
    """Three cars. Small: every sensitivity tried; line: those that none beats in both; large: the three settings.

    Band: where the fronts of 90 % of the ensemble lie, over those Q that at least half of its members reach.
    """
    drawn, axes = new_panels(PAGE, 4.0)
    _members_front(axes, table)
    remark(axes, _of_members(table))
    table = table[table["member"].isna()]
    every = table[table["part"] == "pareto"]
    own, plain = front(every), table[table["part"] == "threshold"].sort_values("damage")
    settings = table[(table["part"] == "tables") & (table["cars"] == 3)]
    for rows, form, label, look in (
        (every, ".", "fuzzy, by sensitivity", {"color": HERE, "markersize": 3.5}),
        (own, "-", "its front", {"color": HERE, "linewidth": 1.0}),
        (plain, "s", "threshold, by hold and release", {"color": ORANGE, "markersize": 4.5}),
    ):
        axes.plot(rows["damage"], rows["distance"], form, label=label, **look)
    for setting, marker in MARKERS.items():
        chosen = settings[settings["setting"] == setting]
        look = {
            "color": HERE,
            "markersize": SETTING,
            "markeredgecolor": "black",
            "markeredgewidth": 0.6,
        }
        axes.plot(chosen["damage"], chosen["distance"], marker, label=f"fuzzy, {setting}", **look)
        distance, damage = TABLE_4[setting]
        look = {"markersize": OF_SOURCE, "markeredgecolor": SOURCE_EDGE, "markeredgewidth": 1.0}
        label = f"source, {setting}"
        axes.plot([damage], [distance], marker, color="none", label=label, **look)
    _over_damage(axes)
    axes.legend(loc="upper right")
    return drawn


@figure("slide-electric", "distance against Q: electric brake by controller beside slide protection",
        study("slide-protection"))  # fmt: skip
def slide_electric(table: pd.DataFrame) -> Figure:
    """Three cars; line: fuzzy slide protection over its sensitivity; filled: an inverter per car, hollow: per axle.

    Band and crosses: where 90 % of the ensemble lies.
    """
    drawn, axes = new_panels(PAGE, 4.0)
    remark(axes, _of_members(table))
    _members_front(axes, table)
    every = table[table["part"] == PART]
    table = table[table["member"].isna()]
    own = front(table[table["part"] == "pareto"])
    label = "valves, fuzzy, by sensitivity"
    look: Look = {"color": GREY, "markersize": 4, "label": label}
    handles = axes.plot(own["damage"], own["distance"], ".-", **look)
    handles.append(_band_handle())
    for controller in CONTROLLERS:
        look = controller_look(controller) | {"markersize": 7}
        for group, (fill, _) in FILLS.items():
            rows = every[(every["controller"] == controller) & (every["group"] == group)]
            rows = rows.sort_values("member", na_position="first")
            q, metres = rows["damage"].to_numpy(), rows["distance"].to_numpy()
            across, up = _whisker(q)[:, None], _whisker(metres)[:, None]
            thin: Look = {"ecolor": look["color"], "elinewidth": 0.7, "alpha": 0.6, "fmt": "none"}
            axes.errorbar(q[:1], metres[:1], up, across, **thin)
            axes.plot(q[:1], metres[:1], fillstyle=fill, **look)
        handles.append(handle(controller, **look))
    look = {"linestyle": "none", "marker": "o", "color": DARK}
    handles += [handle(label, fillstyle=fill, **look) for fill, label in FILLS.values()]
    _over_damage(axes)
    axes.legend(handles=handles, loc="best")
    return drawn
