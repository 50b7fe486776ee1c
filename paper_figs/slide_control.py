"""Cars under slide protection: speeds, cylinder pressures and valves (JP4209318 Fig. 3)."""

from itertools import cycle
from typing import Any

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.slides.jp4209318 import CALIBRATED, brake, brake_event

AXLE_COLOURS = ("#d55e00", "#e69f00", "#0072b2", "#56b4e9")
"""Axles of a car from its front: those of a bogie are kin."""
BOGIE_COLOURS = ("#d55e00", "#0072b2")
ACTIONS = {1: ("hold", 0.35), 2: ("release", 1.0)}
"""Valves' action, its name and the opacity that it is drawn with."""


def figure(source: Source) -> Figure:
    """The figure, from a run of the calibrated set."""
    return draw(brake(brake_event(CALIBRATED)))


def draw(run: xr.Dataset) -> Figure:
    """A column per car, the foremost one left: speeds, pressures of its two bogies, and what their valves do."""
    moving = np.flatnonzero(run["speed"].values > 0.1)
    if moving.size:  # a second after the stop is enough
        run = run.sel(time=slice(None, run["time"].values[moving[-1]] + 1.0))
    cars = run.sizes["car"]
    drawn = new_figure(max(7.1, 2.0 * cars), 4.6)
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(
            3, cars, sharex=True, sharey="row", squeeze=False, height_ratios=[5, 3, 1.2]
        )
        for car in range(cars):
            _draw_car(run, car, panels[:, car])
            panels[0, car].set_title(f"car {car + 1}")
            panels[2, car].set_xlabel("time [s]")
        panels[0, 0].set(ylabel="speed [km/h]", ylim=(0.0, None))
        panels[1, 0].set(ylabel="pressure [kPa]", ylim=(0.0, None))
        panels[2, 0].set(yticks=[0, 1], yticklabels=["rear", "front"], ylim=(-0.5, 1.5))
        drawn.align_ylabels(panels[:, 0].tolist())
        drawn.legend(handles=_handles(), loc="outside lower center", ncols=5)
    return drawn


def _draw_car(run: xr.Dataset, car: int, panels: Any) -> None:
    time = run["time"].values
    own = np.flatnonzero(run["axle_car"].values == car)
    for axle, colour in zip(own, cycle(AXLE_COLOURS), strict=False):
        panels[0].plot(time, 3.6 * run["rim_speed"].values[:, axle], color=colour, linewidth=0.7)
    panels[0].plot(time, 3.6 * run["speed"].values, color="black", linewidth=1.0)
    groups = np.unique(run["axle_group"].values[own])
    # the first two bogies: a third one, of long locomotives, has no row
    for k, (group, colour) in enumerate(zip(groups[groups >= 0], BOGIE_COLOURS, strict=False)):
        pressure = run["cylinder_pressure"].values[:, group] / 1e3
        panels[1].plot(time, pressure, color=colour)
        valve = run["valve"].values[:, group]
        for action, (_, opacity) in ACTIONS.items():
            panels[2].fill_between(
                time, 0.6 - k, 1.4 - k, where=valve == action, step="post", color=colour,
                alpha=opacity, linewidth=0.0,
            )  # fmt: skip


def _handles() -> list[Line2D]:
    axles = [Line2D([], [], color=c, label=f"axle {k + 1}") for k, c in enumerate(AXLE_COLOURS)]
    bogies = [
        Line2D([], [], color=colour, label=f"{name} bogie", linewidth=2.5)
        for name, colour in zip(("front", "rear"), BOGIE_COLOURS, strict=True)
    ]
    valves = [
        Line2D([], [], color="#444444", alpha=opacity, linewidth=6, label=f"valves {name}")
        for name, opacity in ACTIONS.values()
    ]
    # read by columns: one bogie's axles and itself, the other's, the rest
    train = Line2D([], [], color="black", label="train")
    blank = Line2D([], [], linestyle="none", label=" ")
    return [*axles[:2], *axles[2:], *bogies, *valves, train, blank]
