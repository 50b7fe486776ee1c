"""Errors of position and map under a speed control that compensates by position (JP H07-322414, sweep line-position)."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alloc.onboard.line_memory import Odometer, PositionDetector
from paper_figs.counts import counted
from paper_figs.palette import BLUE, GREEN, GREY, ORANGE, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made, study
from paper_figs.style import (
    BOUND,
    NOTE,
    PAGE,
    Look,
    bare_rows,
    handle,
    interval_mark,
    name_rows,
    new_figure,
)
from studies.core.claims import quantity as quantity_of
from studies.core.statement import mean_interval
from studies.resistance.drawn_routes import RANGES
from studies.resistance.driven_cases import CARS, FEEDBACK, RIGHT, TAUGHT, CaseRun, drive_case
from studies.resistance.line_errors import ARMS, LADDER, NONE, ODOMETER, TYPICAL, rung
from studies.resistance.position_statements import KINDS, ratio
from studies.resistance.routes import Route, route

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
    below.legend(handles=marks, loc="outside lower center", ncols=len(marks))
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
