"""A minimum-time run over a line: speed under the limits, and the gradients, over position."""

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.source import Source
from paper_figs.style import STYLE_FILE, new_figure
from studies.lines.example_line import EXAMPLE_PATH, example_stock
from studies.lines.line_run import LineRun, run_line

LIMIT, PERMITTED, SPEED = "#7f7f7f", "#e69f00", "#0072b2"
CLIMB, FALL = "#d55e00", "#56b4e9"
NAME_WIDTH = 0.02
"""Room that an upright name takes, as a share of the line; names that do not find it are left out."""


def figure(source: Source) -> Figure:
    """The figure of the example line; it needs no data from `source`."""
    return draw(run_line(EXAMPLE_PATH, example_stock()))


def draw(found: LineRun) -> Figure:
    """Above: limits, permitted speed and the train's speed. Below: gradient, of the section."""
    drawn = new_figure(7.1, 4.0)
    with mpl.rc_context(fname=STYLE_FILE):
        upper, lower = drawn.subplots(2, 1, sharex=True, height_ratios=(3.0, 1.0))
        _draw_speed(upper, found)
        _draw_gradient(lower, found)
        minutes, seconds = divmod(found.running_time, 60.0)
        # not what the file says about itself at length: the title has one line
        name = found.path.name if len(found.path.name) <= 60 else f"{found.path.name[:59]}…"
        upper.set_title(f"{name}: {found.stock.train.name}, {minutes:.0f} min {seconds:.0f} s")
        drawn.align_ylabels()
    return drawn


def _draw_speed(axes: Axes, found: LineRun) -> None:
    profile, run = found.profile, found.run
    start, end = found.path.span
    sections = found.path.sections
    edges = np.array([section.start for section in sections] + [end])
    line_limits = 3.6 * np.array([section.speed_limit for section in sections])
    place = np.linspace(start, end, 4000)
    axes.stairs(
        line_limits, 1e-3 * edges, baseline=None, color=LIMIT, linewidth=0.9,
        label="limit of the line",
    )  # fmt: skip
    axes.plot(
        1e-3 * place, 3.6 * profile.permitted(place), color=PERMITTED, linewidth=0.9,
        linestyle=(0, (4, 1.5)), label="permitted: whole train, vehicle, braking",
    )  # fmt: skip
    axes.plot(
        1e-3 * run["position"].values, 3.6 * run["speed"].values, color=SPEED, linewidth=1.2,
        label="speed",
    )  # fmt: skip
    top = max(line_limits[np.isfinite(line_limits)].max(initial=0.0), 3.6 * max(profile.limits))
    _name_points(axes, found)
    margin = 0.008 * (end - start)
    axes.set(
        xlim=(1e-3 * (start - margin), 1e-3 * (end + margin)),
        ylim=(0.0, 1.18 * top),
        ylabel="speed [km/h]",
    )
    axes.legend(loc="upper right", ncols=3)


def _name_points(axes: Axes, found: LineRun) -> None:
    """Mark the points of interest; a name stands left of its mark, or right of it, where there is room."""
    start, end = found.path.span
    room = NAME_WIDTH * (end - start)
    taken = start
    for point in sorted((passed.point for passed in found.passings), key=lambda p: p.station):
        axes.axvline(1e-3 * point.station, ymax=0.86, color=LIMIT, linewidth=0.6, linestyle=":")
        left = point.station - room >= taken
        if not left and point.station < taken:
            continue
        taken = point.station if left else point.station + room
        axes.annotate(
            point.name, (1e-3 * point.station, 0.02), xycoords=("data", "axes fraction"),
            xytext=(-1.5 if left else 1.5, 0.0), textcoords="offset points", rotation=90,
            ha="right" if left else "left", va="bottom", fontsize=6.5, color="#444444",
        )  # fmt: skip


def _draw_gradient(axes: Axes, found: LineRun) -> None:
    sections = found.path.sections
    edges = 1e-3 * np.array([section.start for section in sections] + [sections[-1].end])
    grades = 1e3 * np.array([section.grade for section in sections])
    for colour, values in ((CLIMB, np.maximum(grades, 0.0)), (FALL, np.minimum(grades, 0.0))):
        axes.stairs(values, edges, fill=True, color=colour, linewidth=0.0)
    axes.axhline(0.0, color="black", linewidth=0.6)
    reach = max(5.0, 1.15 * float(np.abs(grades).max()))
    axes.set(ylim=(-reach, reach), xlabel="position [km]", ylabel="gradient [‰]")
