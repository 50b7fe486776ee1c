"""Blended braking over time: what electric and air brake give of the pattern (JP5484215 Fig. 16)."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure

SCENARIO, RULE, CONTROLLER = "wet-stop", "greedy", "cut-and-ramp"
ELECTRIC, AIR, TRAILER = "#0072b2", "#e69f00", "#009e73"
SHOWN = 30.0
"""Time shown [s]: until the last limits have been lifted."""


def figure(source: Source) -> Figure:
    """The figure, from one recorded run."""
    return draw(source.run(SCENARIO, RULE, CONTROLLER))


def draw(run: xr.Dataset) -> Figure:
    """Rows: forces of the foremost unit, forces of the rearmost, cylinder pressures."""
    run = run.sel(time=slice(0.0, SHOWN))
    drawn = new_figure(5.6, 6.0)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(3, 1, sharex=True)
        last = run.sizes["unit"] - 1
        _forces(axes[0], run, 0, "foremost motor car")
        _forces(axes[1], run, last, "rearmost motor car")
        axes[1].sharey(axes[0])
        _pressures(axes[2], run)
        axes[0].legend(loc="lower right", bbox_to_anchor=(1.0, 1.0), ncols=2, borderaxespad=0.2)
        axes[2].set_xlabel("time [s]")
        axes[2].set_xlim(0.0, SHOWN)
        drawn.align_ylabels(axes.tolist())
    return drawn


def _forces(axes: Axes, run: xr.Dataset, unit: int, title: str) -> None:
    time = run["time"].values
    to_rim = float(run["unit_gear"][unit] / run["unit_radius"][unit]) / 1e3
    electric = np.maximum(-run["motor_torque"].values[:, unit], 0.0) * to_rim
    air = run["air_brake_force"].values[:, unit] / 1e3
    load = float(run["unit_static_load"][unit]) / int((run["axle_unit"] == unit).sum()) / 1e3
    axes.stackplot(
        time, electric, air, colors=(ELECTRIC, AIR), alpha=0.75,
        labels=("electric brake", "air brake, commanded"),
    )  # fmt: skip
    axes.plot(time, run["limit"].values[:, unit] * load, color="black", label="limit, at the rail")
    axes.plot(
        time,
        run["expected"].values * load,
        color="black",
        linestyle="--",
        linewidth=0.9,
        label="plan",
    )
    axes.set_ylabel("force per axle [kN]")
    axes.set_title(title)


def _pressures(axes: Axes, run: xr.Dataset) -> None:
    time, pressure = run["time"].values, run["cylinder_pressure"].values / 1e3
    car_of_unit = [
        int(run["axle_car"].values[run["axle_unit"].values == j][0])
        for j in (0, -1 + run.sizes["unit"])
    ]
    axes.plot(time, pressure[:, 0], color=TRAILER, label="lead trailer")
    axes.plot(time, pressure[:, 2 * car_of_unit[0]], color=ELECTRIC, label="foremost motor car")
    axes.plot(time, pressure[:, 2 * car_of_unit[1]], color=AIR, label="rearmost motor car")
    axes.set_ylabel("cylinder pressure [kPa]")
    axes.legend(loc="lower center", bbox_to_anchor=(0.5, 1.0), ncols=3)
