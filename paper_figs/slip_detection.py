"""Slip detection, JP5484215 Fig. 5: computed acceleration of a unit between its thresholds, and the signal."""

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from numpy.typing import NDArray

from alloc.onboard import Detector
from alloc.spans import spans
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.scenario.loading import load_scenario

SCENARIO, RULE, CONTROLLER = "wet-patch", "alone", "cut-and-ramp"
UNIT = 0
BEFORE, AFTER = 0.5, 0.8
"""Time shown around the onset of the longest signal [s]."""
VALUE_COLOUR, ON_COLOUR, OFF_COLOUR = "#0072b2", "#d55e00", "#009e73"


def figure(source: Source) -> Figure:
    """The figure, from a recorded run."""
    detector = load_scenario(SCENARIO).event().onboard.detector
    return draw(source.run(SCENARIO, RULE, CONTROLLER), detector)


def draw(run: xr.Dataset, detector: Detector, unit: int = UNIT) -> Figure:
    """Around the longest signal of a unit, driving. Rows: acceleration as computed on board; slip; signal.

    The patent's signal follows the acceleration alone; here a slip velocity above a threshold of its own raises it too and
    keeps it on, see `alloc.onboard.Detector`.
    """
    time = run["time"].values
    signal = run["slipping"].values[:, unit].astype(bool)
    start = float(time[_longest(signal)]) - BEFORE
    shown = (time >= start) & (time <= start + BEFORE + AFTER)
    on = signal[shown]
    drawn = new_figure(5.6, 4.8)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(3, 1, sharex=True, height_ratios=(3.0, 2.0, 0.9))
        _quantity(
            axes[0], time[shown], run["computed_acceleration"].values[shown, unit], on,
            (detector.on, "on above"), (detector.off, "off below"), "m/s²",
        )  # fmt: skip
        axes[0].set_ylabel("axle acceleration,\nunit's mean [m/s²]")
        axes[0].set_title(
            f"unit {unit + 1} of {run.sizes['unit']}, rule {run.attrs['rule']}, {run.attrs['event']}"
        )
        _quantity(
            axes[1], time[shown], _worst_slip(run, unit)[shown], on,
            (detector.speed_on, "on above"), (0.5 * detector.speed_on, "off below"), "m/s",
        )  # fmt: skip
        axes[1].set_ylabel("slip of its\nworst axle [m/s]")
        axes[2].step(time[shown], on.astype(float), where="post", color="black")
        axes[2].set(ylim=(-0.2, 1.2), xlabel="time [s]", ylabel="signal", xlim=time[shown][[0, -1]])
        axes[2].set_yticks([0, 1], ["off", "on"])
        drawn.align_ylabels(axes.tolist())
    return drawn


def _longest(signal: NDArray[np.bool_]) -> int:
    """Index at which the longest signal begins; 0 where there is none."""
    begin, end = spans(signal).T
    return int(begin[np.argmax(end - begin)]) if begin.size else 0


def _worst_slip(run: xr.Dataset, unit: int) -> NDArray[np.float64]:
    own = run["axle_unit"].values == unit
    return np.asarray(run["slip_velocity"].values[:, own].max(axis=1))


def _quantity(
    axes: Axes, time: NDArray[np.float64], value: NDArray[np.float64], signal: NDArray[np.bool_],
    on: tuple[float, str], off: tuple[float, str], unit: str,
) -> None:  # fmt: skip
    held = signal | np.concatenate([[False], signal[:-1]])  # a sample holds until the next one
    axes.fill_between(
        time, 0.0, 1.0, where=held.tolist(), step="post", transform=axes.get_xaxis_transform(),
        color="#bbbbbb", alpha=0.35, linewidth=0, label="signal on",
    )  # fmt: skip
    axes.plot(time, value, color=VALUE_COLOUR)
    for (level, words), colour, dashes in ((on, ON_COLOUR, "--"), (off, OFF_COLOUR, ":")):
        axes.axhline(level, color=colour, linestyle=dashes, label=f"{words} {level:g} {unit}")
    low, high = axes.get_ylim()
    axes.set_ylim(low, high + 0.25 * (high - low))  # room for the legend
    axes.legend(loc="upper left", ncols=3)
