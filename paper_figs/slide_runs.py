"""Slide protection in the demonstration of JP4209318: its rail and its stop, and what the ensemble leaves open."""

from collections.abc import Sequence
from itertools import cycle
from typing import Literal, NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from paper_figs.palette import BLUE, DARK, GREEN, ORANGE, SKY, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made
from paper_figs.style import BAND, PAGE, Look, handle, new_panels
from studies.core.ensemble_range import PERCENTILES
from studies.slides.jp4209318 import CALIBRATED, Undisclosed, brake, brake_event
from studies.slides.members import MEMBERS

SPEEDS = {10.0: BLUE, 50.0: GREEN, 100.0: VERMILION}
"""Speed [km/h] and its colour."""
AXLES: dict[int, Literal["-", "--"]] = {1: "-", 12: "--"}
"""Axle from the front and its line."""
AXLE_COLOURS = (VERMILION, ORANGE, BLUE, SKY)
"""Axles of a car from its front: those of a bogie are kin."""
BOGIE_COLOURS = {"front": VERMILION, "rear": BLUE}
ACTIONS = {1: ("hold", 0.35), 2: ("release", 1.0)}
"""Valves' action, its name and the opacity that it is drawn with."""


@figure("slide-adhesion", "adhesion over slip ratio, speed and axle position (JP4209318 Fig. 2), and what is open about it",
        made(lambda: MEMBERS))  # fmt: skip
def slide_adhesion(members: Sequence[Undisclosed]) -> Figure:
    """Lines: the set in use, the first; bands: 90 % of the ensemble. Over slip ratio, over speed, along the train."""
    drawn, (by_slip, by_speed, by_axle) = new_panels(PAGE, 3.2, 1, 3, sharey=True)
    ratio, speeds = np.linspace(0.0, 0.12, 121), np.linspace(0.0, 100.0, 51)
    axles = np.arange(1, 13)
    for kmh, colour in SPEEDS.items():
        peaks = np.array([one.peaks(np.array([kmh]))[:, 0] for one in members])
        look: Look = {"color": colour, "markersize": 3.5}
        _with_band(by_axle, axles, peaks, "o-", look)
        for axle, line in AXLES.items():
            curves = [_over_slip(one, ratio, kmh, axle) for one in members]
            _with_band(by_slip, 100.0 * ratio, np.array(curves), line, look)
    for axle, line in AXLES.items():
        peaks = np.array([one.peaks(speeds)[axle - 1] for one in members])
        _with_band(by_speed, speeds, peaks, line, {"color": "black"})
    by_slip.set(xlabel="slip ratio [%]", ylabel="adhesion coefficient [–]", title="(a) over slip")
    by_slip.set(xlim=(0.0, 12.0), ylim=(0.0, 0.16), xticks=[0, 3, 6, 9, 12])
    by_speed.set(xlabel="train speed [km/h]", title="(b) over speed")
    by_axle.set(xlabel="axle from the front", title="(c) along the train", xticks=[1, 4, 8, 12])
    grey: Look = {"color": DARK}
    handles = [
        *(handle(f"{kmh:.0f} km/h", color=colour) for kmh, colour in SPEEDS.items()),
        *(handle(f"axle {axle}", linestyle=line, **grey) for axle, line in AXLES.items()),
        handle(f"90 % of {len(members)} sets", linewidth=6, alpha=BAND, **grey),
    ]
    drawn.legend(handles=handles, loc="outside lower center", ncols=6)
    return drawn


def _over_slip(undisclosed: Undisclosed, ratio: np.ndarray, kmh: float, axle: int) -> np.ndarray:
    """Coefficient over the slip ratio on rail that no wheel has conditioned."""
    speed = kmh / 3.6
    peak = float(undisclosed.peaks(np.array([kmh]))[axle - 1, 0])
    return -np.asarray(undisclosed.rail().curve.coefficient(-ratio * speed, peak, speed))


def _with_band(axes: Axes, x: np.ndarray, values: np.ndarray, form: str, look: Look) -> None:
    """The first of `values`, (members, points), and the band that most of them lie in."""
    low, high = np.nanpercentile(values, PERCENTILES, axis=0)
    axes.fill_between(x, low, high, color=look["color"], alpha=BAND, linewidth=0.0)
    axes.plot(x, values[0], form, **look)


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
        _draw_car(run, car, column)
        if members is not None:
            _draw_members(run, members, car, column)
        column[0].set_title(f"car {car + 1}")
        column[2].set_xlabel("time [s]")
    speed, pressure, valves = panels[:, 0]
    speed.set(ylabel="speed [km/h]", ylim=(0.0, None))
    pressure.set(ylabel="pressure [kPa]", ylim=(0.0, None))
    valves.set(yticks=[0, 1], yticklabels=["rear", "front"], ylim=(-0.5, 1.5))
    drawn.align_ylabels([speed, pressure, valves])
    handles = _handles()
    if members is not None:
        words = f"90 % of {len(members.speed)} sets: train, pressures"
        handles[-1] = handle(words, color=DARK, alpha=BAND, linewidth=6)
    drawn.legend(handles=handles, loc="outside lower center", ncols=5)
    return drawn


def _draw_members(run: xr.Dataset, members: MemberRuns, car: int, column: np.ndarray) -> None:
    speeds, pressures, _ = column
    low, high = np.percentile(members.speed, PERCENTILES, axis=0)
    speeds.fill_between(
        members.time, 3.6 * low, 3.6 * high, color="black", alpha=BAND, linewidth=0.0
    )
    groups = np.unique(run["axle_group"].values[run["axle_car"].values == car])
    for group, colour in zip(groups[groups >= 0], BOGIE_COLOURS.values(), strict=False):
        low, high = np.percentile(members.pressure[:, :, group], PERCENTILES, axis=0) / 1e3
        pressures.fill_between(members.time, low, high, color=colour, alpha=BAND, linewidth=0.0)
    speeds.set_xlim(0.0, float(run["time"].values[-1]))


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
