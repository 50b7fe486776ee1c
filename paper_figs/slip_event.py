"""One slip event over time: speeds, slip velocity, torque and limit of every motor car."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.colors import LinearSegmentedColormap, Normalize
from matplotlib.figure import Figure
from matplotlib.ticker import MultipleLocator
from numpy.typing import NDArray

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure, rule_colour

SCENARIO = "wet-patch"
RULES = ("alone", "exact")
CONTROLLER = "cut-and-ramp"
UNIT_COLOURS = LinearSegmentedColormap.from_list(
    "units", ["#0b2a5b", "#3f7fb5", "#7fb7a0", "#e3b23c"]
)
"""From the foremost unit (dark) to the rearmost (light); lightness alone tells them apart."""


def figure(source: Source) -> Figure:
    """The figure, from two recorded runs of the same event."""
    return draw([source.run(SCENARIO, rule, CONTROLLER) for rule in RULES])


def draw(runs: Sequence[xr.Dataset]) -> Figure:
    """One column per run, all of the same train; rows: speeds, slip velocity, torque, limit."""
    drawn = new_figure(7.1 if len(runs) > 1 else 5.0, 7.2)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(4, len(runs), sharex=True, sharey="row", squeeze=False)
        units = runs[0].sizes["unit"]
        colours = UNIT_COLOURS(np.linspace(0.0, 1.0, units))
        for column, run in enumerate(runs):
            _speeds(axes[0, column], run, colours)
            _slips(axes[1, column], run, colours)
            _torques(axes[2, column], run, colours)
            _limits(axes[3, column], run, colours)
            rule = str(run.attrs["rule"])
            axes[0, column].set_title(
                f"rule {rule}, controller {run.attrs['controller']}", color=rule_colour(rule)
            )
            axes[3, column].set_xlabel("time [s]")
            axes[3, column].set_xlim(0.0, float(run["time"].values[-1]))
        axes[0, 0].legend(loc="best")
        axes[3, 0].legend(loc="best")
        axes[3, 0].xaxis.set_major_locator(MultipleLocator(5.0))
        axes[0, 0].set_ylabel("speed [km/h]")
        axes[1, 0].set_ylabel("slip velocity [m/s]")
        axes[2, 0].set_ylabel("motor torque [N m]")
        axes[3, 0].set_ylabel("limit [–]")
        drawn.align_ylabels(axes[:, 0].tolist())
        if units > 1:
            _unit_bar(drawn, axes[:, -1].tolist(), units)
    return drawn


def _unit_bar(drawn: Figure, axes: list[Axes], units: int) -> None:
    boundaries = Normalize(vmin=0.5, vmax=units + 0.5)
    levels = UNIT_COLOURS.resampled(units)
    bar = drawn.colorbar(
        mpl.cm.ScalarMappable(norm=boundaries, cmap=levels),
        ax=axes,
        shrink=0.4,
        aspect=18,
        pad=0.02,
    )
    bar.set_ticks([1, units] if units > 4 else list(range(1, units + 1)))
    bar.set_label("traction unit (1 = foremost)")
    bar.outline.set_visible(False)


def _per_unit(run: xr.Dataset, name: str) -> NDArray[np.float64]:
    """Of each unit the axle that has it worst, (time, unit)."""
    unit, values = run["axle_unit"].values, run[name].values
    columns = []
    for j in range(run.sizes["unit"]):
        own = values[:, unit == j]
        columns.append(own[np.arange(own.shape[0]), np.abs(own).argmax(axis=1)])
    return np.stack(columns, axis=1)


def _speeds(axes: Axes, run: xr.Dataset, colours: NDArray[np.float64]) -> None:
    time = run["time"].values
    for j, values in enumerate(_per_unit(run, "rim_speed").T):
        axes.plot(time, 3.6 * values, color=colours[j], linewidth=0.9)
    axes.plot(time, 3.6 * run["speed"].values, color="black", linestyle="--", label="train")
    axes.plot([], [], color=colours[0], label="rim, fastest axle of a unit")


def _slips(axes: Axes, run: xr.Dataset, colours: NDArray[np.float64]) -> None:
    for j, values in enumerate(_per_unit(run, "slip_velocity").T):
        axes.plot(run["time"].values, values, color=colours[j], linewidth=0.9)


def _torques(axes: Axes, run: xr.Dataset, colours: NDArray[np.float64]) -> None:
    for j, values in enumerate(run["motor_torque"].values.T):
        axes.plot(run["time"].values, values, color=colours[j], linewidth=0.9)


def _limits(axes: Axes, run: xr.Dataset, colours: NDArray[np.float64]) -> None:
    time = run["time"].values
    for j, values in enumerate(run["limit"].values.T):
        axes.plot(time, values, color=colours[j], linewidth=0.9)
    axes.plot(time, run["expected"].values, color="black", linestyle="--", label="plan")
