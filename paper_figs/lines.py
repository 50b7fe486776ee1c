"""A train over a line: a minimum-time run, and speed control that compensates by position (JP H07-322414)."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alloc.onboard.line_memory import Odometer, PositionDetector
from paper_figs.drawing import figure, made, study
from paper_figs.style import (
    BLUE,
    BOUND,
    DARK,
    GREEN,
    GREY,
    NOTE,
    ORANGE,
    PAGE,
    SKY,
    VERMILION,
    Look,
    bare_rows,
    counted,
    handle,
    interval_mark,
    legend_below,
    name_rows,
    new_figure,
    new_panels,
)
from studies.core.claims import quantity as quantity_of
from studies.core.statement import mean_interval
from studies.lines.line_run import LineRun, run_line
from studies.lines.named_files import find_line, find_stock
from studies.resistance.driven_cases import CARS, FEEDBACK, RIGHT, TAUGHT, CaseRun, drive_case
from studies.resistance.line_position_study import KINDS, ratio
from studies.resistance.routes import (
    ARMS,
    LADDER,
    NONE,
    ODOMETER,
    RANGES,
    TYPICAL,
    Route,
    route,
    rung,
)

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
    grades = np.array([1e3 * section.grade for section in sections])
    for colour, values in ((VERMILION, np.maximum(grades, 0.0)), (SKY, np.minimum(grades, 0.0))):
        lower.stairs(values, edges, fill=True, color=colour, linewidth=0.0)
    lower.axhline(0.0, color="black", linewidth=0.6)
    reach = max(5.0, 1.15 * float(np.abs(grades).max()))
    lower.set(ylim=(-reach, reach), xlabel="position [km]", ylabel="gradient [‰]")
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


FEW_EVENTS = 4
"""Routes that are driven for the figure where the results hold fewer."""
LATE = (0.0, 50.0, 200.0)
"""Metres by which the position is behind in the passage that is shown."""
LATE_LOOKS = dict(zip(LATE, ((GREEN, "-"), (ORANGE, "--"), (VERMILION, ":")), strict=True))
BEFORE, AFTER = 6.0, 20.0
"""Time [s] shown before the front reaches the tunnel and after."""
CASE_LOOKS: Mapping[str, Look] = {
    RIGHT: {"color": VERMILION, "marker": "o"},
    CARS: {"color": GREEN, "marker": "s"},
    TAUGHT: {"color": BLUE, "marker": "D"},
}
NAMES = {
    RIGHT: "at one position",
    CARS: "car by car",
    TAUGHT: "car by car, coefficients learnt",
}
TOP = 1.15
"""End of the axis of panel (b)."""
QUANTITIES = (("speed_peak", "peak of speed"), ("acceleration_peak", "peak of acceleration"))

Passages = Mapping[float | None, CaseRun]


def late_passages(of: Route) -> Passages:
    """Runs of `of` under P control: feedback alone (None), and compensation car by car with a position that is behind."""
    found: dict[float | None, CaseRun] = {None: drive_case(of, FEEDBACK, "P")}
    for late in LATE:
        odometer = Odometer(stations=(0.0,), residuals=(-late,))
        found[late] = drive_case(of, CARS, "P", detector=PositionDetector(odometer))
    return found


@figure("line-position", "benefit of compensation by position with errors of odometer, signals and map",
        made(lambda: route("high-speed", load_share=0.5)),
        made(lambda: late_passages(route("high-speed", load_share=0.5))), study("line-position", FEW_EVENTS),
        events="routes")  # fmt: skip
def line_position(of: Route, passages: Passages, table: pd.DataFrame) -> Figure:
    """(a) A tunnel with a position that is behind. (b) Benefit over the odometer's error. (c), (d) The same with each error.

    Ratios to the feedback alone: less is better. Bars and bands are intervals. (a) is one run for each line.
    """
    drawn = new_figure(PAGE, 5.6)
    above, below = np.asarray(drawn.subfigures(2, 1, height_ratios=[1.0, 1.15])).tolist()
    passage, benefit = above.subplots(1, 2)
    _passage(passage, of, passages)
    _benefit(benefit, table)
    panels = below.subplots(1, len(QUANTITIES), sharey=True)
    arms = [arm for arm in ARMS if (table["arm"] == arm).any()]
    for letter, axes, (quantity, label) in zip("cd", panels, QUANTITIES, strict=True):
        _arms(axes, table, arms, quantity)
        axes.set(xlabel=f"{label}, over feedback alone [–]", title=f"({letter}) {label}")
    name_rows(panels[0], arms)
    marks = [handle(NAMES[case], linestyle="none", **look) for case, look in CASE_LOOKS.items()]
    legend_below(below, marks)
    return drawn


def _passage(axes: Axes, of: Route, passages: Passages) -> None:
    mouth = of.line.tunnels[0][0]
    for late, done in passages.items():
        time, position = done.run["time"].values, done.run["position"].values
        arrived = float(time[np.searchsorted(position, mouth)])
        shown = slice(*np.searchsorted(time, (arrived - BEFORE, arrived + AFTER)))
        off = (done.run["speed"].values - done.log["commanded_speed"].values)[shown]
        colour, dashes = (GREY, "-") if late is None else LATE_LOOKS[late]
        behind = f"{late:g} m behind" if late else "right"
        label = "feedback only" if late is None else f"position {behind}"
        axes.plot(time[shown] - arrived, off - off[0], dashes, color=colour, label=label)
    axes.set(xlabel="time since the front arrives [s]", ylabel="speed off command [m/s]")
    axes.set_title(f"(a) tunnel, train of {of.length:g} m")
    axes.legend(loc="lower left")


def _benefit(axes: Axes, table: pd.DataFrame) -> None:
    """Peak of speed over that of the feedback alone by the odometer's error, for each reading and train."""
    quantity, label = QUANTITIES[0]
    arms = [(0.0, NONE), (TYPICAL.odometer_error, ODOMETER), *((x, rung(x)) for x in LADDER)]
    arms = [(x, arm) for x, arm in arms if (table["arm"] == arm).any()]
    x = 100.0 * np.array([bound for bound, _ in arms])
    for train, dashes in zip(RANGES, ("--", "-"), strict=True):
        own = table[table["route"] == train]
        for case in (RIGHT, CARS):
            found = ratio(quantity, case, FEEDBACK)
            means = [mean_interval(quantity_of(own[own["arm"] == arm], found)) for _, arm in arms]
            look = {**CASE_LOOKS[case], "linestyle": dashes, "markersize": 4.5}
            look["fillstyle"] = "full" if dashes == "-" else "none"  # some points lie on each other
            axes.plot(x, [one.value for one in means], label=f"{train}, {NAMES[case]}", **look)
            counted(axes, means)
            if min(one.count for one in means) > 1:
                low, high = [one.low for one in means], [one.high for one in means]
                axes.fill_between(x, low, high, color=look["color"], alpha=0.15, linewidth=0)
    axes.axhline(1.0, **BOUND)
    axes.set(xlabel="bound of the odometer's error [%]", ylabel=f"{label}, over feedback alone [–]")
    axes.set(title="(b) odometer alone", ylim=(0.0, TOP))
    below_one = (0.0, 0.99 / TOP)  # the legend stands where small errors leave room
    axes.legend(loc="upper left", bbox_to_anchor=below_one, fontsize=NOTE, handlelength=3.4)


def _arms(axes: Axes, table: pd.DataFrame, arms: list[str], quantity: str) -> None:
    for k, (case, look) in enumerate(CASE_LOOKS.items()):
        for row, arm in enumerate(arms):
            own = table[table["arm"] == arm]
            found = mean_interval(quantity_of(own, ratio(quantity, case, FEEDBACK, KINDS)))
            style = dict(look) | {"markersize": 3.5, "capsize": 2.0, "linewidth": 0.9}
            interval_mark(axes, found, row + 0.22 * (k - 1), 1.0, style)
    axes.axvline(1.0, **BOUND)
    axes.set_xlim(0.0, None)
    bare_rows(axes)
