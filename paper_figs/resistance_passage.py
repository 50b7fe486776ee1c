"""What a train feels where its running resistance changes: the panels of JP H07-322414 Figs. 9 and 10."""

from collections.abc import Mapping

import matplotlib as mpl
import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alloc.plant.equations import GRAVITY
from paper_figs.style import STYLE_FILE, new_figure
from studies.resistance.driven_cases import (
    CARS,
    CASES,
    CONTROLS,
    FEEDBACK,
    LEARNED,
    RIGHT,
    WRONGLY,
    CaseRun,
    Control,
    drive_case,
)
from studies.resistance.routes import Route

CASE_LOOKS: dict[str, tuple[str, str]] = {
    FEEDBACK: ("#7f7f7f", "-"),
    RIGHT: ("#d55e00", "-"),
    WRONGLY: ("#b0a000", "--"),
    LEARNED: ("#0072b2", ":"),
    CARS: ("#009e73", "-"),
}
"""Colour and dashes of each case."""
BEFORE, AFTER = 8.0, 20.0
"""Time [s] shown before the front reaches the place and after the rear has left it."""

Runs = Mapping[tuple[Control, str], CaseRun]


def drive_all(route: Route) -> dict[tuple[Control, str], CaseRun]:
    """All cases under both controls; half a minute."""
    return {
        (control, case): drive_case(route, case, control)
        for control in CONTROLS
        for case in (*CASES, CARS)
    }


def draw(route: Route, runs: Runs, place: tuple[float, float], tunnel: bool) -> Figure:
    """A column per control; rows (a) acceleration, (b) speed, (c) what changes, over time.

    `place` [m]: begin and end of the tunnel or the gradient; `tunnel`: which of them it is.
    """
    controls = list(dict.fromkeys(control for control, _ in runs))
    drawn = new_figure(7.1, 5.4)
    with mpl.rc_context(fname=STYLE_FILE):
        panels = drawn.subplots(
            3, len(controls), sharex=True, sharey="row", squeeze=False,
            gridspec_kw={"height_ratios": (1.0, 1.0, 0.6)},
        )  # fmt: skip
        for column, control in zip(panels.T, controls, strict=True):
            for case in (case for c, case in runs if c == control):
                _lines(column, route, runs[control, case], case, place)
            _change(
                column[2],
                route,
                runs[control, next(c for k, c in runs if k == control)],
                place,
                tunnel,
            )
            column[0].set_title(f"{control} control")
            column[2].set_xlabel("time since the front arrives [s]")
        panels[0, 0].set_ylabel("(a) acceleration [m/s²]")
        panels[1, 0].set_ylabel("(b) speed off command [m/s]")
        panels[2, 0].set_ylabel("(c) air factor [–]" if tunnel else "(c) gradient [%]")
        handles, labels = panels[0, 0].get_legend_handles_labels()
        lower, names = panels[2, 0].get_legend_handles_labels()
        drawn.legend(handles + lower, labels + names, loc="outside lower center", ncols=4)
    return drawn


def _shown(route: Route, done: CaseRun, place: tuple[float, float]) -> tuple[slice, np.ndarray]:
    time, position = done.run["time"].values, done.run["position"].values
    first = time[min(int(np.searchsorted(position, place[0])), time.size - 1)]
    last = time[min(int(np.searchsorted(position, place[1] + route.length)), time.size - 1)]
    inside = slice(*np.searchsorted(time, (first - BEFORE, last + AFTER)))
    return inside, time[inside] - first


def _lines(
    column: np.ndarray, route: Route, done: CaseRun, case: str, place: tuple[float, float]
) -> None:
    inside, time = _shown(route, done, place)
    colour, dashes = CASE_LOOKS[case]
    off = (done.run["speed"].values - done.log["commanded_speed"].values)[inside]
    look = {"color": colour, "linestyle": dashes, "linewidth": 1.1}
    column[0].plot(time, done.run["acceleration"].values[inside], label=case, **look)
    column[1].plot(time, off, **look)


def _change(
    axes: Axes, route: Route, done: CaseRun, place: tuple[float, float], tunnel: bool
) -> None:
    """The change as the train feels it, car by car, and as a memory that is read at one position has it."""
    inside, time = _shown(route, done, place)
    position = done.run["position"].values[inside]
    for reading, colour, dashes, label in (
        ("cars", "black", "-", "as the train feels it"),
        ("middle", "#56b4e9", "--", "as the memory has it"),
    ):
        share, slope = route.memory(reading).read(position)
        factor = 1.0 + (route.line.tunnel_factor - 1.0) * share
        grade = 100.0 * np.tan(np.arcsin(slope / GRAVITY))
        axes.plot(time, factor if tunnel else grade, color=colour, linestyle=dashes, label=label)
