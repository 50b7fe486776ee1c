"""Running resistance in tunnels and on gradients, JP H07-322414 Figs. 3, 9 and 10, and learning it."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from alloc.onboard.speed_control.resistance import WEIGHTS
from alloc.plant.equations import GRAVITY, running_resistance
from paper_figs.palette import BLUE, GREEN, GREY, OLIVE, ORANGE, SKY, VERMILION
from paper_figs.registry import figure
from paper_figs.source import made
from paper_figs.style import PAGE, legend_below, new_panels
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
from studies.resistance.learners import GRADIENT, NORMALISED, PRINTED, SQUARES, convergence
from studies.resistance.routes import Route, route

READINGS = (("cars", "black", "-", "plant, car by car"), ("middle", SKY, "--", "memory, middle of the train"),
            ("front", ORANGE, ":", "memory, front"))  # fmt: skip
MARGIN = 300.0
"""Line [m] shown before and behind the tunnel's first mouth."""
CASE_LOOKS: dict[str, tuple[str, str]] = {
    FEEDBACK: (GREY, "-"),
    RIGHT: (VERMILION, "-"),
    WRONGLY: (OLIVE, "--"),
    LEARNED: (BLUE, ":"),
    CARS: (GREEN, "-"),
}
"""Colour and dashes of each case."""
BEFORE, AFTER = 8.0, 20.0
"""Time [s] shown before the front reaches the place and after the rear has left it."""
LEARNER_LOOKS = {
    GRADIENT: (ORANGE, "-"),
    PRINTED: (GREY, "--"),
    NORMALISED: (VERMILION, "-"),
    SQUARES: (BLUE, "-"),
}
"""Colour and dashes of each learner."""
MEANING = {"W1": "air, open", "W2": "air, tunnel", "W3": "mass"}
PASSES = 4
LEAST = 0.02
"""Least error shown [%]."""

Runs = Mapping[tuple[Control, str], CaseRun]


@figure("air-resistance", "air resistance coefficient, open and tunnel (JP H07-322414 Fig. 3)",
        made(route, "commuter"))  # fmt: skip
def air_resistance(of: Route) -> Figure:
    """Left: coefficient over the front's position at a mouth. Right: running resistance over speed, and V² alone."""
    a, b, c = of.train.resistance
    factor, mouth = of.line.tunnel_factor, of.line.tunnels[0][0]
    cruise = of.command.speeds[0]
    drawn, (left, right) = new_panels(PAGE, 3.1, 1, 2)
    x = np.linspace(mouth - MARGIN, mouth + MARGIN, 1201)
    for reading, colour, dashes, label in READINGS:
        coefficient = c * (1.0 + (factor - 1.0) * of.memory(reading).read(x)[0])
        left.plot(x, coefficient, color=colour, linestyle=dashes, label=label)
    left.set(xlabel="position of the front [m]", ylabel="coefficient of V² [kg/m]")
    left.set_title(f"(a) open and tunnel, train of {of.length:g} m")
    left.legend(loc="lower right")
    v = np.linspace(0.0, 1.25 * cruise, 200)
    for name, weight, air, colour in (
        ("open", "W1", 1.0, BLUE),
        ("tunnel", "W2", factor, VERMILION),
    ):
        equivalent = running_resistance(cruise, a, b, c, air) / cruise**2
        for resistance, dashes, law in (
            (running_resistance(v, a, b, c, air), "-", "A + BV + CV²"),
            (equivalent * v**2, "--", f"{weight} V²"),
            (air * c * v**2, ":", "CV²"),
        ):
            right.plot(v, 1e-3 * resistance, dashes, color=colour, label=f"{law}, {name}")
    right.set(xlabel="speed [m/s]", ylabel="running resistance [kN]")
    right.set_title(f"(b) weights learnt at {cruise:g} m/s")
    right.legend(loc="upper left")
    for axes in (left, right):
        axes.set_ylim(0.0, None)
    return drawn


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
    """All cases through the route's tunnel, a column per control."""
    return _passage(of, runs, of.line.tunnels[0], tunnel=True)


@figure("gradient-change", "acceleration and speed over a climb, by case (JP H07-322414 Fig. 10)",
        made(lambda: route("commuter", load_share=0.5)), made(_driven, "commuter"))  # fmt: skip
def gradient_change(of: Route, runs: Runs) -> Figure:
    """All cases over the route's first climb, a column per control."""
    climb = max(range(len(of.line.grades)), key=lambda k: of.line.grades[k])
    place = of.line.stations[climb], of.line.stations[climb + 1]
    return _passage(of, runs, place, tunnel=False)


def _passage(of: Route, runs: Runs, place: tuple[float, float], tunnel: bool) -> Figure:
    """A column per control; rows (a) acceleration, (b) speed, (c) what changes, over time.

    `place` [m]: begin and end of the tunnel or the gradient; `tunnel`: which of them it is.
    """
    controls = list(dict.fromkeys(control for control, _ in runs))
    shape = {"sharex": True, "sharey": "row", "squeeze": False, "height_ratios": (1.0, 1.0, 0.6)}
    drawn, panels = new_panels(PAGE, 5.4, 3, len(controls), **shape)
    for column, control in zip(panels.T, controls, strict=True):
        own = {case: done for (held, case), done in runs.items() if held == control}
        for case, done in own.items():
            _lines(column, of, done, case, place)
        _change(column[2], of, next(iter(own.values())), place, tunnel)
        column[0].set_title(f"{control} control")
        column[2].set_xlabel("time since the front arrives [s]")
    panels[0, 0].set_ylabel("(a) acceleration [m/s²]")
    panels[1, 0].set_ylabel("(b) speed off command [m/s]")
    panels[2, 0].set_ylabel("(c) air factor [–]" if tunnel else "(c) gradient [%]")
    legend_below(drawn, 4, panels[0, 0], panels[2, 0])
    return drawn


def _shown(of: Route, done: CaseRun, place: tuple[float, float]) -> tuple[slice, np.ndarray]:
    time, position = done.run["time"].values, done.run["position"].values
    ends = np.searchsorted(position, (place[0], place[1] + of.length))
    first, last = time[np.minimum(ends, time.size - 1)]
    inside = slice(*np.searchsorted(time, (first - BEFORE, last + AFTER)))
    return inside, time[inside] - first


def _lines(
    column: np.ndarray, of: Route, done: CaseRun, case: str, place: tuple[float, float]
) -> None:
    inside, time = _shown(of, done, place)
    off = (done.run["speed"].values - done.log["commanded_speed"].values)[inside]
    colour, dashes = CASE_LOOKS[case]
    look = {"color": colour, "linestyle": dashes, "linewidth": 1.1}
    column[0].plot(time, done.run["acceleration"].values[inside], label=case, **look)
    column[1].plot(time, off, **look)


def _change(axes: Axes, of: Route, done: CaseRun, place: tuple[float, float], tunnel: bool) -> None:
    """The change as the train feels it, car by car, and as a memory that is read at one position has it."""
    inside, time = _shown(of, done, place)
    position = done.run["position"].values[inside]
    for reading, colour, dashes, label in (
        ("cars", "black", "-", "as the train feels it"),
        ("middle", SKY, "--", "as the memory has it"),
    ):
        share, slope = of.memory(reading).read(position)
        factor = 1.0 + (of.line.tunnel_factor - 1.0) * share
        grade = 100.0 * np.tan(np.arcsin(slope / GRAVITY))
        axes.plot(time, factor if tunnel else grade, color=colour, linestyle=dashes, label=label)


@figure("resistance-weights", "convergence of the weights of running resistance, by learner",
        made(lambda: convergence(route("commuter", load_share=0.5).square_only(), PASSES)))  # fmt: skip
def resistance_weights(errors: pd.DataFrame) -> Figure:
    """A panel per weight: size of its error relative to the plant's, over time."""
    drawn, panels = new_panels(PAGE, 3.0, 1, len(WEIGHTS), sharex=True, sharey=True)
    for axes, weight in zip(panels, WEIGHTS, strict=True):
        for learner, (colour, dashes) in LEARNER_LOOKS.items():
            own = errors[errors["learner"] == learner]
            error = 100.0 * own[weight].abs()
            axes.plot(own["time"], error, color=colour, linestyle=dashes, label=learner)
        axes.set(yscale="log", title=f"{weight} ({MEANING[weight]})")
        axes.set(ylim=(LEAST, None), xlabel="time of running [s]")
    panels[0].set_ylabel("error of the weight [%]")
    legend_below(drawn, len(LEARNER_LOOKS), panels[0])
    return drawn
