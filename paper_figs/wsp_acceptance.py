"""Slide protection on every level and curve: the table of the sweep `wsp-acceptance` as a figure."""

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, LogNorm, Normalize
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from paper_figs.palette import DARK, VERMILION
from paper_figs.registry import figure
from paper_figs.source import study
from paper_figs.style import PAGE, bare_rows, name_rows, new_panels
from studies.wsp_acceptance.events import CURVES
from studies.wsp_acceptance.statements import LEAST_USED, MOST_DAMAGE, POINTS, THREE
from studies.wsp_acceptance.stop_cases import (
    BELIEF,
    DRAWN,
    GRADIENT,
    JUMP,
    LEVELS,
    PATCHED,
    SHOES,
    UNIFORM,
)

SHADES = LinearSegmentedColormap.from_list("light", ["#ffffff", "#8cc1e0"])
"""From good to bad; light enough for black numbers."""
NAMES = {"piecewise": "piecewise", "polach": "Polach, wet", "slip-ratio": "slip ratio"}

Rows = Callable[[pd.DataFrame], "pd.Series[bool]"]


def _of_cars(cars: int, table: pd.DataFrame) -> "pd.Series[bool]":
    return (table["part"] == UNIFORM) & (table["cars"] == cars)


AROUND: dict[str, Rows] = {
    **{f"{cars} car{'s' * (cars > 1)}": partial(_of_cars, cars) for cars in (1, 2, 5, 8)},
    "shoes": lambda t: t["part"] == SHOES,
    "30 ‰ up": lambda t: (t["part"] == GRADIENT) & (t["grade_permille"] > 0.0),
    "30 ‰ down": lambda t: (t["part"] == GRADIENT) & (t["grade_permille"] < 0.0),
    "jumps": lambda t: t["part"] == JUMP,
    "patches": lambda t: t["part"] == PATCHED,
    "friction ± 15 %,\n30 ‰ up, down": lambda t: t["part"] == BELIEF,
    "drawn": lambda t: t["part"] == DRAWN,
}  # fmt: skip
"""Name of a row below the table, and its stops."""


class Panel(NamedTuple):
    """What a panel shows: title, a cell's value and text, where it misses its aim, and how dark a value is."""

    title: str
    value: Callable[[pd.DataFrame], float]
    text: Callable[[pd.DataFrame], str]
    missed: Callable[[pd.DataFrame], bool]
    norm: Normalize


def _short(rows: pd.DataFrame) -> float:
    """Most points by which the adhesion used falls short of that with the true speed."""
    return 100.0 * float((rows["true_speed_adhesion_used"] - rows["adhesion_used"]).max())


def _used_too_little(rows: pd.DataFrame) -> bool:
    least = next(share for start, share in LEAST_USED.items() if rows["adhesion"].max() >= start)
    in_table = rows["adhesion"].max() <= LEVELS[-1]
    return (in_table and rows["adhesion_used"].min() < least) or _short(rows) > 100.0 * POINTS


def _megajoules(rows: pd.DataFrame) -> float:
    return float(rows["damage_kj"].max()) / 1e3


def _per_car(rows: pd.DataFrame) -> float:
    return float((rows["damage_kj"] / rows["cars"]).max()) / 1e3


def _locked(rows: pd.DataFrame) -> float:
    return float(rows["locked_axle_s"].max())


def _plain(value: float) -> str:
    """A number of at most three digits, more only before the point; none is 0."""
    return "0" if value == 0.0 else f"{value:.1f}" if abs(value) < 100.0 else f"{value:.0f}"


def _both(rows: pd.DataFrame) -> str:
    return f"{rows['adhesion_used'].min():.3f}\n({rows['true_speed_adhesion_used'].min():.3f})"


LOCKED = "locked wheels [axle s]"
TABLE = (
    Panel("(a) used (with true speed) [–]", _short, _both, _used_too_little, Normalize(0.0, 40.0)),
    Panel(f"(b) {LOCKED}", _locked, lambda r: _plain(_locked(r)), lambda r: _locked(r) > 0.0, LogNorm(0.3, 3e4)),
    Panel("(c) wheel damage Q [MJ]", _megajoules, lambda r: f"{_megajoules(r):.2f}",
             lambda r: _megajoules(r) > MOST_DAMAGE / 1e3, LogNorm(2.0, 60.0)),
)  # fmt: skip
WORST = (
    Panel("(d) short of true speed [points]", _short,
             lambda r: "–" if np.isnan(_short(r)) else _plain(_short(r)),
             lambda r: _short(r) > 100.0 * POINTS, Normalize(0.0, 40.0)),
    Panel(f"(e) {LOCKED}", _locked, lambda r: _plain(_locked(r)), lambda r: _locked(r) > 0.0, LogNorm(0.3, 3e4)),
    Panel("(f) Q per car [MJ]", _per_car, lambda r: f"{_per_car(r):.2f}", lambda _: False, LogNorm(0.7, 60.0)),
)  # fmt: skip


@figure("wsp-acceptance", "slide protection by adhesion level and curve: used, locked, wheel damage",
        study("wsp-acceptance"))  # fmt: skip
def wsp_acceptance(table: pd.DataFrame) -> Figure:
    """Above: three cars, level by curve. Below: the worst of each kind of stop. Framed, with bold numbers: aim missed."""
    table = table[table["status"] == "ok"]
    three = table[(table["part"] == UNIFORM) & (table["train"] == THREE)]
    levels = sorted(set(three["adhesion"]))
    drawn, panels = new_panels(
        PAGE, 7.2, 2, 3, sharey="row", height_ratios=[1.6 * len(levels), 1.2 * len(AROUND)]
    )
    by_level = {f"{level:g}": three[three["adhesion"] == level] for level in levels}
    around = {name: table[rows(table)] for name, rows in AROUND.items()}
    for axes, quantity in zip(panels[0], TABLE, strict=True):
        _fill(axes, quantity, by_level)
    for axes, quantity in zip(panels[1], WORST, strict=True):
        _fill(axes, quantity, around)
    panels[0, 0].set_ylabel("adhesion, three cars [–]")
    panels[1, 0].set_ylabel("kind of stop, the worst of each")
    panels[1, 1].set_xlabel("adhesion curve")
    drawn.supxlabel("framed, with bold numbers: an aim is missed")
    return drawn


def _fill(axes: Axes, quantity: Panel, rows: dict[str, pd.DataFrame]) -> None:
    """A cell per row and curve: its number on a shade, framed where it misses its aim."""
    name_rows(axes, list(rows))
    bare_rows(axes)
    axes.set_xticks(range(len(CURVES)), [NAMES[curve] for curve in CURVES])
    axes.set_xlim(-0.5, len(CURVES) - 0.5)
    axes.grid(visible=False)
    axes.tick_params(axis="x", length=0)
    axes.set_title(quantity.title)
    for y, own in enumerate(rows.values()):
        for x, curve in enumerate(CURVES):
            stops = own[own["curve"] == curve]
            if len(stops):
                _cell(axes, x, y, quantity, stops)


def _cell(axes: Axes, x: int, y: int, quantity: Panel, stops: pd.DataFrame) -> None:
    value, missed = quantity.value(stops), quantity.missed(stops)
    share = 0.0 if np.isnan(value) else float(np.clip(quantity.norm(max(value, 1e-9)), 0.0, 1.0))
    frame = {"edgecolor": VERMILION, "linewidth": 1.0} if missed else {"edgecolor": "none"}
    axes.add_patch(Rectangle((x - 0.46, y - 0.42), 0.92, 0.84, facecolor=SHADES(share), **frame))
    weight = "bold" if missed else "normal"
    axes.text(
        x, y, quantity.text(stops), ha="center", va="center", color=DARK, weight=weight
    )  # fmt: skip
