"""Torque of dynamic sharing over time beside the reference rule's: the one wanders, the other is set once per detection."""

from collections.abc import Sequence

import matplotlib as mpl
import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from alloc.metrics import evaluate
from alloc.metrics.motion import jerk
from paper_figs.slip_event import UNIT_COLOURS
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure, rule_colour

SCENARIO, CONTROLLER = "very-low-adhesion", "cut-and-ramp"
RULES = ("sharing", "greedy")


def figure(source: Source) -> Figure:
    """The figure, from two recorded runs of the same event."""
    return draw([source.run(SCENARIO, rule, CONTROLLER) for rule in RULES])


def draw(runs: Sequence[xr.Dataset]) -> Figure:
    """One column per run; rows: limits, torque, jerk of the worst car."""
    drawn = new_figure(7.1, 5.4)
    with mpl.rc_context(fname=STYLE_FILE):
        axes = drawn.subplots(3, len(runs), sharex=True, sharey="row", squeeze=False)
        for column, run in enumerate(runs):
            time, units = run["time"].values, run.sizes["unit"]
            colours = UNIT_COLOURS(np.linspace(0.0, 1.0, units))
            for j in range(units):
                axes[0, column].plot(time, run["limit"].values[:, j], color=colours[j], linewidth=0.9,
                                     label=f"unit {j + 1}")  # fmt: skip
                axes[1, column].plot(
                    time, run["motor_torque"].values[:, j], color=colours[j], linewidth=0.9
                )
            values = jerk(run)
            worst = int(np.argmax((values**2).mean(axis=0)))
            axes[2, column].plot(time, values[:, worst], color=rule_colour(str(run.attrs["rule"])))
            rms = evaluate(run)["jerk_rms"]
            axes[0, column].set_title(
                f"{run.attrs['rule']}: jerk {rms:.2f} m/s³ rms",
                color=rule_colour(str(run.attrs["rule"])),
            )
            axes[2, column].set_xlabel("time [s]")
        for row, label in enumerate(("limit [–]", "motor torque [N m]", "jerk [m/s³]")):
            axes[row, 0].set_ylabel(label)
        axes[0, 1].legend(loc="upper right", ncols=2)
        drawn.align_ylabels(axes[:, 0].tolist())
    return drawn
