"""A train under speed control passes a tunnel or a climb, JP H07-322414 Figs. 9 and 10: a row per case."""

from collections.abc import Mapping, Sequence

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alloc.plant.laws import GRAVITY
from paper_figs.palette import BLACK, BLUE, GREEN, GREY, OLIVE, SKY, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made
from paper_figs.style import NOTE, PAGE, new_figure
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
from studies.resistance.routes import Route, route

CASE_COLOURS = {FEEDBACK: GREY, RIGHT: VERMILION, WRONGLY: OLIVE, LEARNED: BLUE, CARS: GREEN}
CASE_WORDS = {
    FEEDBACK: "feedback alone",
    RIGHT: "compensation, read at the middle of the train",
    WRONGLY: "the same with wrong coefficients",
    LEARNED: "the same with coefficients learnt on the way",
    CARS: "compensation, read car by car",
}
"""What each case is called where it is drawn."""
BEFORE, AFTER = 8.0, 16.0
"""Time [s] shown before the front reaches the place and after the rear has left it."""
NOTE_ROOM = 0.3
"""Room below the curves for a note, over their range."""

Runs = Mapping[tuple[Control, str], CaseRun]
Place = tuple[float, float]
"""Begin and end of a tunnel or a gradient [m]."""


def _driven(name: str) -> Runs:
    """All cases under both controls on a route, half loaded; half a minute."""
    of = route(name, load_share=0.5)
    cases = (*CASES, CARS)
    return {
        (control, case): drive_case(of, case, control) for control in CONTROLS for case in cases
    }


@figure("tunnel-mouth", "acceleration and speed through a tunnel, by case (JP H07-322414 Fig. 9)",
        made(lambda: route("high-speed", load_share=0.5)), made(_driven, "high-speed"))  # fmt: skip
def tunnel_mouth(of: Route, runs: Runs) -> Figure:
    """All cases through the route's tunnel, under both controls."""
    return _passage(of, runs, of.line.tunnels[0], tunnel=True)


@figure("gradient-change", "acceleration and speed over a climb, by case (JP H07-322414 Fig. 10)",
        made(lambda: route("commuter", load_share=0.5)), made(_driven, "commuter"))  # fmt: skip
def gradient_change(of: Route, runs: Runs) -> Figure:
    """All cases over the route's first climb, under both controls."""
    climb = max(range(len(of.line.grades)), key=lambda k: of.line.grades[k])
    place = of.line.stations[climb], of.line.stations[climb + 1]
    return _passage(of, runs, place, tunnel=False)


def _passage(of: Route, runs: Runs, place: Place, tunnel: bool) -> Figure:
    """Above: what changes. Below a row per case: acceleration and speed under each control, with the largest change noted.

    `tunnel`: whether `place` is one, or a gradient.
    """
    controls = list(dict.fromkeys(control for control, _ in runs))
    cases = list(dict.fromkeys(case for _, case in runs))
    drawn = new_figure(PAGE, 1.9 + 0.8 * len(cases))
    above, below = np.asarray(drawn.subfigures(2, 1, height_ratios=[1.3, 0.6 + 0.8 * len(cases)]))
    _change(above.subplots(), of, runs[controls[0], cases[0]], place, tunnel)
    halves = np.asarray(below.subfigures(1, 2)).tolist()
    for half, quantity, letters in zip(
        halves, ("acceleration", "speed"), ("bc", "de"), strict=True
    ):
        panels = half.subplots(len(cases), len(controls), sharex=True, sharey=True, squeeze=False)
        for row, case in zip(panels, cases, strict=True):
            for axes, control in zip(row, controls, strict=True):
                _case(axes, of, runs[control, case], case, place, quantity)
            # beside it the same height stays free, so that rows stand level
            name = CASE_WORDS[case] if quantity == "acceleration" else " "
            row[0].set_title(name, color=CASE_COLOURS[case])
        _frame(panels, controls, letters, quantity)
    return drawn


def _frame(panels: np.ndarray, controls: Sequence[str], letters: str, quantity: str) -> None:
    """What panels of a quantity share: its name once, the controls above, the time below."""
    label = "acceleration [m/s²]" if quantity == "acceleration" else "speed off command [m/s]"
    panels[len(panels) // 2, 0].set_ylabel(label)
    for axes, control, letter in zip(panels[0], controls, letters, strict=False):
        axes.annotate(
            f"({letter}) {quantity}, {control} control", (0.0, 1.0), (0.0, 14.0), "axes fraction",
            "offset points", va="bottom",
        )  # fmt: skip
    for axes in panels[-1]:
        axes.set_xlabel("time [s]")
    low, high = panels[0, 0].get_ylim()
    panels[0, 0].set_ylim(low - NOTE_ROOM * (high - low), high)


def _case(axes: Axes, of: Route, done: CaseRun, case: str, place: Place, quantity: str) -> None:
    inside, time = _shown(of, done, place)
    if quantity == "acceleration":
        values = done.run["acceleration"].values[inside]
        note = f"up to {np.abs(values).max():.3f} m/s²"
    else:
        values = (done.run["speed"].values - done.log["commanded_speed"].values)[inside]
        note = f"changes by {np.ptp(values):.2f} m/s"
    axes.axhline(0.0, color=BLACK, linewidth=0.5)
    axes.plot(time, values, color=CASE_COLOURS[case], linewidth=0.9)
    axes.annotate(
        note, (1.0, 0.0), (0.0, 1.0), "axes fraction", "offset points", ha="right", fontsize=NOTE,
    )  # fmt: skip


def _shown(of: Route, done: CaseRun, place: Place) -> tuple[slice, np.ndarray]:
    time, position = done.run["time"].values, done.run["position"].values
    ends = np.searchsorted(position, (place[0], place[1] + of.length))
    first, last = time[np.minimum(ends, time.size - 1)]
    inside = slice(*np.searchsorted(time, (first - BEFORE, last + AFTER)))
    return inside, time[inside] - first


def _change(axes: Axes, of: Route, done: CaseRun, place: Place, tunnel: bool) -> None:
    """The change as the train feels it, car by car, and as a memory that is read at one position has it."""
    inside, time = _shown(of, done, place)
    position = done.run["position"].values[inside]
    for reading, colour, dashes, label in (
        ("cars", BLACK, "-", "as the train feels it, car after car"),
        ("middle", SKY, "--", "as read at the middle of the train"),
    ):
        share, slope = of.memory(reading).read(position)
        factor = 1.0 + (of.line.tunnel_factor - 1.0) * share
        grade = 100.0 * np.tan(np.arcsin(slope / GRAVITY))
        axes.plot(time, factor if tunnel else grade, color=colour, linestyle=dashes, label=label)
    axes.set_title(f"(a) what changes at the {'tunnel' if tunnel else 'climb'}")
    axes.set_ylabel("air factor [–]" if tunnel else "gradient [%]")
    axes.set_xlabel("time since the front arrives [s]")
    middle = float(time[factor > 1.0 if tunnel else grade > 0.0].mean())
    axes.legend(
        loc="center", bbox_to_anchor=(middle, 0.4), bbox_transform=axes.get_xaxis_transform()
    )
