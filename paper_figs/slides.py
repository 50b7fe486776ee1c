"""Slide protection: the demonstration of JP4209318 and its tables, and what surrounds them."""

from collections.abc import Sequence
from itertools import cycle
from typing import Literal

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.ticker import FixedLocator

from paper_figs.palette import BLUE, DARK, GREEN, GREY, ORANGE, SKY, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made, study
from paper_figs.style import Look, controller_look, handle, legend_below, new_panels, plain_ticks
from studies.slides.electric import CONTROLLERS, PART
from studies.slides.jp4209318 import CALIBRATED, Undisclosed, brake, brake_event
from studies.slides.targets import TABLE_3, TABLE_4, front

SPEEDS = {10.0: BLUE, 50.0: GREEN, 100.0: VERMILION}
"""Speed [km/h] and its colour."""
AXLES: dict[int, Literal["-", "--"]] = {1: "-", 12: "--"}
"""Axle from the front and its line."""
AXLE_COLOURS = (VERMILION, ORANGE, BLUE, SKY)
"""Axles of a car from its front: those of a bogie are kin."""
BOGIE_COLOURS = {"front": VERMILION, "rear": BLUE}
ACTIONS = {1: ("hold", 0.35), 2: ("release", 1.0)}
"""Valves' action, its name and the opacity that it is drawn with."""
HERE, PRINTED = BLUE, GREY
"""Colours of this project's numbers and of the source's."""
MARKERS = {"low": "v", "medium": "o", "high": "^"}
"""Of the sensitivity's settings."""
DAMAGES = (200, 300, 500, 700, 1000, 1500, 2000, 3000, 5000, 10000)
"""Ticks of wheel damage [kJ]."""
FILLS: dict[str, tuple[Literal["full", "none"], str]] = {
    "1C4M": ("full", "one inverter a car"),
    "1C1M": ("none", "one inverter an axle"),
}
"""Inverters' grouping, fill of its marks and label."""


@figure("slide-adhesion", "adhesion over slip ratio, speed and axle position (JP4209318 Fig. 2)",
        made(lambda: CALIBRATED))  # fmt: skip
def slide_adhesion(undisclosed: Undisclosed) -> Figure:
    """Left: over slip ratio. Middle: over speed; the upper end of each band is on fully conditioned rail. Right: by axle."""
    curve, raised = undisclosed.rail().curve, 1.0 + undisclosed.conditioning
    drawn, (by_slip, by_speed, by_axle) = new_panels(7.1, 3.0, 1, 3, sharey=True)
    ratio = np.linspace(0.0, 0.12, 241)
    for kmh, colour in SPEEDS.items():
        peaks, speed = undisclosed.peaks(np.array([kmh]))[:, 0], kmh / 3.6
        for axle, line in AXLES.items():
            mu = curve.coefficient(-ratio * speed, peaks[axle - 1], speed)
            by_slip.plot(100.0 * ratio, -mu, line, color=colour)
        axles, look = np.arange(1, peaks.size + 1), {"color": colour, "markersize": 3.5}
        by_axle.plot(axles, peaks, "o-", **look)
        by_axle.plot(axles[1:], peaks[1:] * raised, "o", markerfacecolor="white", **look)
    speeds = np.linspace(0.0, 100.0, 101)
    peaks = undisclosed.peaks(speeds)
    for axle, line in AXLES.items():
        by_speed.plot(speeds, peaks[axle - 1], line, color="black")
    by_speed.fill_between(speeds, peaks[11], peaks[11] * raised, color="black", alpha=0.12, lw=0)
    by_slip.set(xlabel="slip ratio [%]", ylabel="adhesion coefficient [–]", title="(a) over slip")
    by_slip.set(xlim=(0.0, 12.0), ylim=(0.0, 0.16), xticks=[0, 3, 6, 9, 12])
    by_speed.set(xlabel="train speed [km/h]", title="(b) over speed")
    by_axle.set(xlabel="axle from the front", title="(c) along the train", xticks=[1, 4, 8, 12])
    grey: Look = {"color": DARK}
    mark = grey | {"linestyle": "none", "marker": "o"}
    handles = [
        *(handle(f"{kmh:.0f} km/h", color=colour) for kmh, colour in SPEEDS.items()),
        handle("not conditioned", **mark),
        *(handle(f"axle {axle}", linestyle=line, **grey) for axle, line in AXLES.items()),
        handle("up to fully conditioned", linewidth=6, alpha=0.3, **grey),
        handle("fully conditioned", markerfacecolor="white", **mark),
    ]
    drawn.legend(handles=handles, loc="outside lower center", ncols=4)
    return drawn


@figure("slide-control", "three cars under slide protection: speeds, pressures, valves (JP4209318 Fig. 3)",
        made(lambda: brake(brake_event(CALIBRATED))))  # fmt: skip
def slide_control(run: xr.Dataset) -> Figure:
    """A column per car, the foremost one left: speeds, pressures of its two bogies, and what their valves do."""
    moving = np.flatnonzero(run["speed"].values > 0.1)
    if moving.size:  # a second after the stop is enough
        run = run.sel(time=slice(None, run["time"].values[moving[-1]] + 1.0))
    cars = run.sizes["car"]
    shape = {"sharex": True, "sharey": "row", "squeeze": False, "height_ratios": [5, 3, 1.2]}
    drawn, panels = new_panels(max(7.1, 2.0 * cars), 4.6, 3, cars, **shape)
    for car, column in enumerate(panels.T):
        _draw_car(run, car, column)
        column[0].set_title(f"car {car + 1}")
        column[2].set_xlabel("time [s]")
    speed, pressure, valves = panels[:, 0]
    speed.set(ylabel="speed [km/h]", ylim=(0.0, None))
    pressure.set(ylabel="pressure [kPa]", ylim=(0.0, None))
    valves.set(yticks=[0, 1], yticklabels=["rear", "front"], ylim=(-0.5, 1.5))
    drawn.align_ylabels([speed, pressure, valves])
    drawn.legend(handles=_handles(), loc="outside lower center", ncols=5)
    return drawn


def _draw_car(run: xr.Dataset, car: int, column: np.ndarray) -> None:
    speeds, pressures, valves = column
    time = run["time"].values
    own = np.flatnonzero(run["axle_car"].values == car)
    for axle, colour in zip(own, cycle(AXLE_COLOURS), strict=False):
        speeds.plot(time, 3.6 * run["rim_speed"].values[:, axle], color=colour, linewidth=0.7)
    speeds.plot(time, 3.6 * run["speed"].values, color="black", linewidth=1.0)
    groups = np.unique(run["axle_group"].values[own])
    bogies = zip(groups[groups >= 0], BOGIE_COLOURS.values(), strict=False)
    # the first two bogies: a third one, of long locomotives, has no row
    for k, (group, colour) in enumerate(bogies):
        pressures.plot(time, run["cylinder_pressure"].values[:, group] / 1e3, color=colour)
        valve = run["valve"].values[:, group]
        for action, (_, opacity) in ACTIONS.items():
            valves.fill_between(
                time, 0.6 - k, 1.4 - k, where=valve == action, step="post", color=colour,
                alpha=opacity, linewidth=0.0,
            )  # fmt: skip


def _handles() -> list[Line2D]:
    axles = [handle(f"axle {k + 1}", color=colour) for k, colour in enumerate(AXLE_COLOURS)]
    bogies = [handle(f"{k} bogie", color=c, linewidth=2.5) for k, c in BOGIE_COLOURS.items()]
    valves = [
        handle(f"valves {name}", color=DARK, alpha=opacity, linewidth=6)
        for name, opacity in ACTIONS.values()
    ]
    # read by columns: one bogie's axles and itself, the other's, the rest
    rest = [handle("train", color="black"), handle(" ", linestyle="none")]
    return [*axles, *bogies, *valves, *rest]


@figure("slide-tables", "braking distances and Q beside the source's numbers (JP4209318 Tables 3, 4)",
        study("slide-protection"))  # fmt: skip
def slide_tables(table: pd.DataFrame) -> Figure:
    """Left: distance by number of cars, with what a fit to one and three predicts of two. Right: by sensitivity."""
    rows = table[table["part"] == "tables"].set_index(["cars", "setting"])
    distances, damages = rows["distance"].to_dict(), rows["damage"].to_dict()
    drawn, (length, distance, damage) = new_panels(7.1, 3.0, 1, 3)
    here = [distances[cars, "medium"] for cars in TABLE_3]
    _bars(length, [f"{cars}" for cars in TABLE_3], list(TABLE_3.values()), here, ".1f")
    predicted = float(table.loc[table["part"] == "held out", "distance 2"].iloc[0])
    label = "predicted by a fit to 1 and 3 cars"
    length.plot([1.0], [predicted], "D", color=VERMILION, markersize=5, label=label)
    settings, printed = list(TABLE_4), list(zip(*TABLE_4.values(), strict=True))
    for axes, values, own, text in (
        (distance, printed[0], distances, ".1f"),
        (damage, printed[1], damages, ".0f"),
    ):
        _bars(axes, settings, values, [own[3, setting] for setting in settings], text)
    for axes, title, counted in (
        (length, "(a) Table 3", "cars"),
        (distance, "(b) Table 4", "sensitivity"),
    ):
        axes.set(ylabel="braking distance [m]", xlabel=counted, title=title, ylim=(0, 545))
    damage.set(ylabel="wheel damage Q [kJ]", xlabel="sensitivity", title="(c) Table 4")
    damage.set_ylim(0, 2000)
    legend_below(drawn, 3, length)
    return drawn


def _bars(
    axes: Axes, names: Sequence[str], printed: Sequence[float], here: Sequence[float], text: str
) -> None:
    place, width = np.arange(len(names), dtype=float), 0.38
    for offset, values, colour, label in (
        (-0.5 * width, printed, PRINTED, "printed in the source"),
        (0.5 * width, here, HERE, "calibrated here"),
    ):
        bars = axes.bar(place + offset, values, width, color=colour, label=label)
        words = [f"{value:{text}}" for value in values]
        axes.bar_label(bars, words, rotation=90, padding=3, fontsize=6.5)
    axes.set_xticks(place, names)


def _over_damage(axes: Axes) -> None:
    axes.set(xlabel="wheel damage Q [kJ]", ylabel="braking distance [m]", xscale="log")
    plain_ticks(axes.xaxis, FixedLocator(DAMAGES))


@figure("slide-pareto", "distance against Q over the sensitivity of slide protection, and thresholds",
        study("slide-protection"))  # fmt: skip
def slide_pareto(table: pd.DataFrame) -> Figure:
    """Three cars. Small: every sensitivity tried; line: those that none beats in both; large: the three settings."""
    every = table[table["part"] == "pareto"]
    own, plain = front(every), table[table["part"] == "threshold"].sort_values("damage")
    settings = table[(table["part"] == "tables") & (table["cars"] == 3)]
    drawn, axes = new_panels(5.2, 3.8)
    for rows, form, label, look in (
        (every, ".", "fuzzy, by sensitivity", {"color": HERE, "markersize": 3.5}),
        (own, "-", "its front", {"color": HERE, "linewidth": 1.0}),
        (plain, "s", "threshold, by hold and release", {"color": ORANGE, "markersize": 4.5}),
    ):
        axes.plot(rows["damage"], rows["distance"], form, label=label, **look)
    for setting, marker in MARKERS.items():
        chosen = settings[settings["setting"] == setting]
        look = {"color": HERE, "markersize": 8, "markeredgecolor": "black"}
        axes.plot(chosen["damage"], chosen["distance"], marker, label=f"fuzzy, {setting}", **look)
        distance, damage = TABLE_4[setting]
        look = {"markersize": 10, "markeredgecolor": PRINTED, "markeredgewidth": 1.4}
        label = f"source, {setting}"
        axes.plot([damage], [distance], marker, color="none", label=label, **look)
    _over_damage(axes)
    axes.legend(loc="upper right", fontsize=7)
    return drawn


@figure("slide-electric", "distance against Q: electric brake by controller beside slide protection",
        study("slide-protection"))  # fmt: skip
def slide_electric(table: pd.DataFrame) -> Figure:
    """Three cars; line: fuzzy slide protection over its sensitivity; filled: an inverter per car, hollow: per axle."""
    own = front(table[table["part"] == "pareto"])
    electric = table[table["part"] == PART]
    drawn, axes = new_panels(5.2, 3.8)
    label = "valves, fuzzy, by sensitivity"
    look: Look = {"color": GREY, "markersize": 4, "label": label}
    handles = axes.plot(own["damage"], own["distance"], ".-", **look)
    for controller in CONTROLLERS:
        look = controller_look(controller) | {"markersize": 7}
        for group, (fill, _) in FILLS.items():
            own = electric[(electric["controller"] == controller) & (electric["group"] == group)]
            axes.plot(own["damage"], own["distance"], fillstyle=fill, **look)
        handles.append(handle(controller, **look))
    look = {"linestyle": "none", "marker": "o", "color": DARK}
    handles += [handle(label, fillstyle=fill, **look) for fill, label in FILLS.values()]
    _over_damage(axes)
    axes.legend(handles=handles, loc="best", fontsize=7)
    return drawn
