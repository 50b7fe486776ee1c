"""Brakes: which car lacks brake force (RTRI report Fig. 6), and slide protection with its ensemble (JP4209318)."""

from collections.abc import Sequence
from itertools import cycle
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator

from paper_figs.drawing import figure, made, study
from paper_figs.style import (
    BAND,
    BLACK,
    BLUE,
    COLUMN,
    DARK,
    GREY,
    ORANGE,
    PAGE,
    SKY,
    VERMILION,
    Look,
    controller_look,
    handle,
    legend_below,
    new_panels,
    plain_ticks,
    remark,
)
from studies.brake_force.faulty_car import AllocatedStop, Fault, allocated_stops, driven_rows
from studies.brake_force.findings import running_test_row
from studies.brake_force.study import CUT_OUT
from studies.core.calibration import PERCENTILES
from studies.slides.electric import CONTROLLERS, PART
from studies.slides.jp4209318 import (
    CALIBRATED,
    MEMBERS,
    TABLE_4,
    Undisclosed,
    brake,
    brake_event,
    front,
)

DAY, FEW_DAYS = 0, 3
"""Day of the stop that is shown; days of tests that are run where the results have none."""
FAULT = Fault(3, (0,))
ACCUSED, ESTIMATED = VERMILION, BLUE


def _few_days() -> pd.DataFrame:
    """Rows of the tests with wagons cut out on `FEW_DAYS` days."""
    days = range(FEW_DAYS)
    return pd.DataFrame(
        [running_test_row(name, k) | {"event": k} for k in days for name in CUT_OUT]
    )


@figure("brake-cut-out", "averaged brake force over the number of braked wagons (RTRI report Fig. 6)",
        study("brake-force", 1, _few_days))  # fmt: skip
def brake_cut_out(table: pd.DataFrame) -> Figure:
    """Above: means over days and the line through them. Below: each day's test, with its uncertainty, off that line."""
    chosen = table[table["test"].isin(list(CUT_OUT))]
    count = chosen["test"].map(CUT_OUT).astype(float)
    mean, deviation = chosen["mean"].astype(float), chosen["whole_deviation"].astype(float)
    of_day = chosen["event"].rank(method="dense").astype(float)
    aside = 0.32 * (of_day - (of_day.max() + 1.0) / 2.0) / max(float(of_day.max()) - 1.0, 1.0)
    means = mean.groupby(count).mean()
    slope, intercept = np.polyfit(means.index.to_numpy(dtype=float), means.to_numpy(), 1)
    drawn, (forces, off) = new_panels(COLUMN, 3.9, 2, sharex=True, height_ratios=(1.3, 1.0))
    ends = np.array([0.0, 5.4])
    forces.plot(ends, slope * ends + intercept, color=BLACK, linewidth=0.9, label="line")
    forces.plot(means.index, means, "D", label="mean", color=BLUE, markersize=4.5)
    forces.annotate(
        f"line through the means:\n{slope:.1f} kN per wagon, {intercept:.1f} kN with none",
        (ends[1], 0.0), (0.0, 6.0), textcoords="offset points", ha="right", va="bottom",
    )  # fmt: skip
    forces.set(ylim=(0.0, None), ylabel="averaged brake force [kN]")
    forces.set_title("(a) all wagons, mean over days")
    off.axhline(0.0, color=BLACK, linewidth=0.9)
    off.errorbar(
        count + aside, mean - (slope * count + intercept), 1.96 * deviation, fmt="o", color=BLUE,
        markersize=2.5, elinewidth=0.8, label="a day's test, 95 %",
    )  # fmt: skip
    off.set(xlim=ends, xticks=(0, 1, 2, 2.5, 3, 4, 5), xlabel="braked wagons [–]")
    off.set(
        ylabel="off the line [kN]", title="(b) each day's test with its 95 %, off the line of (a)"
    )
    off.xaxis.set_major_formatter("{x:g}")
    drawn.align_ylabels([forces, off])
    return drawn


@figure("faulty-car", "which car did not deliver its allocated brake force (sweep brake-force)",
        made(allocated_stops, FAULT, DAY), study("brake-force", 1, lambda: pd.DataFrame(driven_rows(DAY))))  # fmt: skip
def faulty_car(stops: Sequence[AllocatedStop], table: pd.DataFrame) -> Figure:
    """Left: shortfall of each car against its threshold, one bogie cut out; right: shares found over the shortfall."""
    drawn, (bars, shares) = new_panels(PAGE, 3.0, 1, 2, width_ratios=(1.4, 1.0))
    _stop(bars, stops[0])
    dry = table[table["part"] == "driven"]
    means = dry.groupby("missing")[["found", "wrong", "whole"]].mean() * 100.0
    for column, colour, marker, words in (
        ("found", ESTIMATED, "o", "the faulty car is found"),
        ("wrong", ORANGE, "x", "a car is accused that lacks < 5 %"),
        ("whole", BLACK, "+", "a car is accused that lacks < 1 %"),
    ):
        known = means[means.index > 0.0] if column == "found" else means
        shares.plot(100.0 * known.index, known[column], color=colour, marker=marker, label=words)
    shares.set(ylabel="share of stops [%]", ylim=(-4.0, 104.0))
    shares.set(
        xlabel="brake force missing on one car [%]",
        title="(b) dry stops: what is found, and who is accused",
    )
    legend_below(drawn, shares)
    return drawn


def _stop(axes: Axes, stop: AllocatedStop) -> None:
    """Bars of what was estimated to lack, a tick where a car is accused; one whose wheels slid has neither."""
    found = stop.shortfalls()
    allocated = stop.allocated[stop.window].mean(axis=0) / 1e3
    lacks, car = found.shortfall / 1e3, np.arange(1, allocated.size + 1)
    threshold = np.where(np.isfinite(found.threshold), found.threshold, np.nan) / 1e3
    accused = np.isin(car - 1, found.accused)
    axes.bar(car, np.nan_to_num(lacks), 0.7, color=np.where(accused, ACCUSED, ESTIMATED))
    axes.hlines(threshold, car - 0.42, car + 0.42, color=BLACK, linewidth=1.4)
    axes.axhline(0.0, color=BLACK, linewidth=0.7)
    top = float(np.nanmax(np.concatenate([lacks, threshold])))
    middle: Look = {"ha": "center", "va": "bottom"}
    for k in np.flatnonzero(accused):
        words = f"car {car[k]} is accused:\n{lacks[k]:.1f} of {allocated[k]:.1f} kN lack"
        axes.text(car[k], lacks[k] + 0.02 * top, words, color=ACCUSED, **middle)
    for k in np.flatnonzero(np.isnan(lacks)):
        axes.text(
            car[k], 0.05 * top, "not judged: its wheels slid", rotation=90, color=DARK, **middle
        )
    known = np.flatnonzero(np.isfinite(threshold) & ~accused)
    if known.size:
        place = (float(car[known[-1]]) + 0.42, float(np.nanmax(threshold)))
        axes.annotate(
            "accused beyond this", place, (0.0, 2.0), textcoords="offset points", ha="right"
        )
    axes.set_title(f"(a) a stop with one bogie of car {FAULT.car + 1} cut out")
    axes.set(xlabel="car (1 = foremost)", ylabel="shortfall of brake force [kN]")
    axes.set(xticks=car, ylim=(min(0.0, 1.2 * float(np.nanmin(lacks))), 1.3 * top))
    axes.grid(visible=False, axis="x")


AXLE_COLOURS = (VERMILION, ORANGE, BLUE, SKY)
"""Axles of a car from its front: those of a bogie are kin."""
BOGIE_COLOURS = {"front": VERMILION, "rear": BLUE}
ACTIONS = {1: ("hold", 0.35), 2: ("release", 1.0)}
"""Valves' action, its name and the opacity that it is drawn with."""


class MemberRuns(NamedTuple):
    """Runs of the ensemble's members, every 0.1 s."""

    time: np.ndarray
    """s"""
    speed: np.ndarray
    """m/s, (members, instants)"""
    pressure: np.ndarray
    """Pa, (members, instants, bogies)"""


def member_runs(members: Sequence[Undisclosed]) -> MemberRuns:
    """Three cars at medium sensitivity after every member."""
    runs = [brake(brake_event(one)).isel(time=slice(None, None, 10)) for one in members]
    return MemberRuns(
        runs[0]["time"].values,
        np.array([run["speed"].values for run in runs]),
        np.array([run["cylinder_pressure"].values for run in runs]),
    )


@figure("slide-control", "three cars under slide protection: speeds, pressures, valves (JP4209318 Fig. 3)",
        made(lambda: brake(brake_event(CALIBRATED))), made(lambda: member_runs(MEMBERS)))  # fmt: skip
def slide_control(run: xr.Dataset, members: MemberRuns | None = None) -> Figure:
    """A column per car, the foremost one left: speeds, pressures of its two bogies, and what their valves do.

    Bands: 90 % of the ensemble's members, of the train's speed and of every bogie's pressure.
    """
    moving = np.flatnonzero(run["speed"].values > 0.1)
    if moving.size:  # a second after the stop is enough
        run = run.sel(time=slice(None, run["time"].values[moving[-1]] + 1.0))
    cars = run.sizes["car"]
    shape = {"sharex": True, "sharey": "row", "squeeze": False, "height_ratios": [5, 3, 1.2]}
    drawn, panels = new_panels(PAGE, 4.6, 3, cars, **shape)
    for car, column in enumerate(panels.T):
        _car(run, car, column, members)
        column[0].set_title(f"car {car + 1}")
        column[2].set_xlabel("time [s]")
    speed, pressure, valves = panels[:, 0]
    speed.set(ylabel="speed [km/h]", ylim=(0.0, None))
    pressure.set(ylabel="pressure [kPa]", ylim=(0.0, None))
    valves.set(yticks=[0, 1], yticklabels=["rear", "front"], ylim=(-0.5, 1.5))
    drawn.align_ylabels([speed, pressure, valves])
    # read by columns: one bogie's axles and itself, the other's, the rest
    handles = [handle(f"axle {k + 1}", color=colour) for k, colour in enumerate(AXLE_COLOURS)]
    handles += [handle(f"{k} bogie", color=c, linewidth=2.5) for k, c in BOGIE_COLOURS.items()]
    wide: Look = {"color": DARK, "linewidth": 6}
    handles += [handle(f"valves {name}", alpha=alpha, **wide) for name, alpha in ACTIONS.values()]
    handles += [handle("train", color="black"), handle(" ", linestyle="none")]
    if members is not None:
        words = f"90 % of {len(members.speed)} sets: train, pressures"
        handles[-1] = handle(words, alpha=BAND, **wide)
    legend_below(drawn, handles, 5)
    return drawn


def _car(run: xr.Dataset, car: int, column: np.ndarray, members: MemberRuns | None) -> None:
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
        valve, bare = run["valve"].values[:, group], {"color": colour, "linewidth": 0.0}
        for action, (_, alpha) in ACTIONS.items():
            on = valve == action
            valves.fill_between(time, 0.6 - k, 1.4 - k, where=on, step="post", alpha=alpha, **bare)
        if members is not None:
            low, high = np.percentile(members.pressure[:, :, group], PERCENTILES, axis=0) / 1e3
            pressures.fill_between(members.time, low, high, alpha=BAND, **bare)
    if members is not None:
        low, high = 3.6 * np.percentile(members.speed, PERCENTILES, axis=0)
        speeds.fill_between(members.time, low, high, color="black", alpha=BAND, linewidth=0.0)
        speeds.set_xlim(0.0, float(time[-1]))


HERE, SOURCE_EDGE = BLUE, VERMILION
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


def _over_damage(table: pd.DataFrame) -> tuple[Figure, Axes, pd.DataFrame]:
    """Distance over Q with the band in which the fronts of 90 % of the members lie, where half of them reach.

    Returns the rows of the set in use too.
    """
    drawn, axes = new_panels(PAGE, 4.0)
    grid = np.geomspace(DAMAGES[0], DAMAGES[-1], 120)
    fronts = []
    for _, rows in table[(table["part"] == "pareto") & table["member"].notna()].groupby("member"):
        own = front(rows).sort_values("damage")
        reach = np.interp(grid, own["damage"], own["distance"], left=np.nan, right=np.nan)
        fronts.append(reach)
    if fronts:
        values = np.array(fronts)
        common = np.isfinite(values).mean(axis=0) >= 0.5
        low, high = np.nanpercentile(values[:, common], PERCENTILES, axis=0)
        look: Look = {"color": HERE, "alpha": BAND, "linewidth": 0.0, "label": BAND_WORDS}
        axes.fill_between(grid[common], low, high, **look)
    count = table["member"].nunique()
    remark(axes, f"Ensemble: n = {count} members." if count else "No ensemble.")
    axes.set(xlabel="wheel damage Q [kJ]", ylabel="braking distance [m]", xscale="log")
    plain_ticks(axes.xaxis, FixedLocator(DAMAGES))
    return drawn, axes, table[table["member"].isna()]


@figure("slide-pareto", "distance against Q over the sensitivity of slide protection, and thresholds",
        study("slide-protection"))  # fmt: skip
def slide_pareto(table: pd.DataFrame) -> Figure:
    """Three cars. Small: every sensitivity tried; line: those that none beats in both; large: the three settings.

    Band: where the fronts of 90 % of the ensemble lie, over those Q that at least half of its members reach.
    """
    drawn, axes, table = _over_damage(table)
    every = table[table["part"] == "pareto"]
    own, plain = front(every), table[table["part"] == "threshold"].sort_values("damage")
    settings = table[(table["part"] == "tables") & (table["cars"] == 3)]
    for rows, form, label, colour, size in (
        (every, ".", "fuzzy, by sensitivity", HERE, 3.5),
        (own, "-", "its front", HERE, 1.0),
        (plain, "s", "threshold, by hold and release", ORANGE, 4.5),
    ):
        look: Look = {"color": colour, "linewidth" if form == "-" else "markersize": size}
        axes.plot(rows["damage"], rows["distance"], form, label=label, **look)
    edge: Look = {"markeredgecolor": "black", "markeredgewidth": 0.6, "markersize": SETTING}
    hollow: Look = {"markeredgecolor": SOURCE_EDGE, "markersize": OF_SOURCE, "color": "none"}
    for setting, marker in MARKERS.items():
        chosen = settings[settings["setting"] == setting]
        q, metres = chosen["damage"], chosen["distance"]
        axes.plot(q, metres, marker, color=HERE, label=f"fuzzy, {setting}", **edge)
        distance, damage = TABLE_4[setting]
        axes.plot([damage], [distance], marker, label=f"source, {setting}", **hollow)
    axes.legend(loc="upper right")
    return drawn


@figure("slide-electric", "distance against Q: electric brake by controller beside slide protection",
        study("slide-protection"))  # fmt: skip
def slide_electric(table: pd.DataFrame) -> Figure:
    """Three cars; line: fuzzy slide protection over its sensitivity; filled: an inverter per car, hollow: per axle.

    Band and crosses: where 90 % of the ensemble lies.
    """
    every = table[table["part"] == PART]
    drawn, axes, table = _over_damage(table)
    own = front(table[table["part"] == "pareto"])
    label = "valves, fuzzy, by sensitivity"
    look: Look = {"color": GREY, "markersize": 4, "label": label}
    handles = axes.plot(own["damage"], own["distance"], ".-", **look)
    handles.append(handle(BAND_WORDS, color=HERE, alpha=BAND, linewidth=6))
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
    dot: Look = {"linestyle": "none", "marker": "o", "color": DARK}
    handles += [handle(label, fillstyle=fill, **dot) for fill, label in FILLS.values()]
    axes.legend(handles=handles, loc="best")
    return drawn


def _whisker(values: np.ndarray) -> np.ndarray:
    """How far 90 % of the members reach below and above the set in use, the first, (2,); 0 where there are none."""
    if values.size < 2:
        return np.zeros(2)
    low, high = np.nanpercentile(values[1:], PERCENTILES)
    return np.array([max(values[0] - low, 0.0), max(high - values[0], 0.0)])
