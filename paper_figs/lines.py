"""A minimum-time run over a line: speed under the limits, and the gradients, over position."""

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.palette import BLUE, DARK, GREY, ORANGE, SKY, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made
from paper_figs.style import NOTE, PAGE, new_panels
from studies.lines.line_run import LineRun, run_line
from studies.lines.named_files import find_line, find_stock

NAME_WIDTH = 0.02
"""Room that an upright name takes, as a share of the line; names that do not find it are left out."""
LONGEST_NAME = 22
"""Letters of a name that have room in the strip of names."""


@figure("real-line", "speed, limits and gradients of a minimum-time run (a line that ships; run-line draws yours)",
        made(lambda: run_line(find_line("dresden-goerlitz"), find_stock("br-642"))))  # fmt: skip
def real_line(found: LineRun) -> Figure:
    """Above: limits, permitted speed and the train's speed, with points passed and stops. Below: gradient by section."""
    drawn, (upper, names, lower) = new_panels(PAGE, 4.6, 3, sharex=True, height_ratios=(3.0, 1.15, 1.0))  # fmt: skip
    sections = found.path.sections
    edges = 1e-3 * np.array([section.start for section in sections] + [found.path.span[1]])
    _draw_speed(upper, found, edges)
    _name_points(upper, names, found)
    _draw_gradient(lower, np.array([1e3 * section.grade for section in sections]), edges)
    minutes, seconds = divmod(found.running_time, 60.0)
    # not what the file says about itself at length: the title has one line
    name = found.path.name if len(found.path.name) <= 60 else f"{found.path.name[:59]}…"
    upper.set_title(f"{name}: {found.stock.train.name}, {minutes:.0f} min {seconds:.0f} s")
    drawn.align_ylabels()
    return drawn


def _draw_speed(axes: Axes, found: LineRun, edges: np.ndarray) -> None:
    run = found.run
    start, end = found.path.span
    limits = 3.6 * np.array([section.speed_limit for section in found.path.sections])
    place = np.linspace(start, end, 4000)
    axes.stairs(limits, edges, baseline=None, color=GREY, linewidth=0.9, label="limit of the line")
    axes.plot(
        1e-3 * place, 3.6 * found.permitted(place), color=ORANGE, linewidth=0.9,
        linestyle=(0, (4, 1.5)), label="permitted: whole train, vehicle, braking",
    )  # fmt: skip
    x, speed = 1e-3 * run["position"].values, 3.6 * run["speed"].values
    axes.plot(x, speed, color=BLUE, linewidth=1.2, label="speed")
    top = max(
        limits[np.isfinite(limits)].max(initial=0.0),
        3.6 * max(max(leg.profile.limits) for leg in found.legs),
    )
    margin = 0.008 * (end - start)
    axes.set(xlim=(1e-3 * (start - margin), 1e-3 * (end + margin)), ylim=(0.0, 1.18 * top))
    axes.set_ylabel("speed [km/h]")
    axes.legend(loc="upper right", ncols=3)


def _name_points(axes: Axes, strip: Axes, found: LineRun) -> None:
    """Mark points passed and stops; their names stand in a strip of their own, where no curve runs.

    A name stands left of its mark, or right of it, where there is room.
    """
    start, end = found.path.span
    room = NAME_WIDTH * (end - start)
    taken = start
    marked = [*(one.point for one in found.passings), *(one.point for one in found.stops)]
    strip.set_axis_off()
    for _, point in sorted({point.station: point for point in marked}.items()):
        for panel, high in ((axes, 0.86), (strip, 1.0)):
            panel.axvline(1e-3 * point.station, ymax=high, color=GREY, linewidth=0.6, linestyle=":")
        left = point.station - room >= taken
        if not left and point.station < taken:
            continue
        taken = point.station if left else point.station + room
        name = point.name
        strip.annotate(
            name if len(name) <= LONGEST_NAME else f"{name[: LONGEST_NAME - 1]}…",
            (1e-3 * point.station, 1.0), xycoords=("data", "axes fraction"),
            xytext=(-1.5 if left else 1.5, -2.0), textcoords="offset points", rotation=90,
            ha="right" if left else "left", va="top", fontsize=NOTE, color=DARK,
        )  # fmt: skip


def _draw_gradient(axes: Axes, grades: np.ndarray, edges: np.ndarray) -> None:
    for colour, values in ((VERMILION, np.maximum(grades, 0.0)), (SKY, np.minimum(grades, 0.0))):
        axes.stairs(values, edges, fill=True, color=colour, linewidth=0.0)
    axes.axhline(0.0, color="black", linewidth=0.6)
    reach = max(5.0, 1.15 * float(np.abs(grades).max()))
    axes.set(ylim=(-reach, reach), xlabel="position [km]", ylabel="gradient [‰]")
