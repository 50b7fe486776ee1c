"""The model on one picture: a train and its telegrams, the rail under it, and the loop of a control period."""

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle
from numpy.typing import NDArray

from alloc.plant.model import Structure, structure_of
from alloc.plant.rail import (
    Patch,
    logarithmic_increments,
    patch_factor,
    peak_coefficient,
    window,
)
from alloc.plant.sets import find_set
from alloc.plant.train import Train
from alloc.rules import RULES, AllocationProblem
from paper_figs.drawing import figure
from paper_figs.replay import MOTOR_CAR
from paper_figs.style import (
    BLUE,
    BOUND,
    DARK,
    GREEN,
    NOTE,
    PAGE,
    VERMILION,
    Look,
    new_figure,
    rule_colour,
)

RULE = "exact"
PLAN, LEVEL = 0.155, 0.172
"""Coefficient that is planned, and that of the rail apart from its patch."""
WET = Patch(0.72, start=-22.0, end=30.0, edge=6.0)
"""A wet patch that the foremost car has just reached; the train's front is at 0."""
ON_BOARD, PLANT = "#e8f0f7", "#f3f0e8"
"""Tints of what computers do and of what physics does."""
ARROW: Look = {
    "arrowstyle": "-|>",
    "mutation_scale": 7.0,
    "shrinkA": 0.0,
    "shrinkB": 0.0,
    "linewidth": 0.9,
}
LIMITS, REPORTS, READINGS = BLUE, VERMILION, GREEN
"""Colours of telegrams from the leader, of those to it, and of what sensors read."""


def example_train() -> Train:
    """Three motor cars and a trailer."""
    cars = find_set("commuter-8car").cars
    return Train("example", (cars[1], cars[0], cars[2], cars[1]))


def example_peaks(s: Structure) -> NDArray[np.float64]:
    """Peak coefficient at every axle, (axles,)."""
    wet = window(s.axle_offset, WET.start, WET.end, WET.edge)
    growth = logarithmic_increments(s.axle_offset.size)
    none = np.zeros(s.axle_offset.size)
    return np.asarray(
        peak_coefficient(none, none, LEVEL, patch_factor(wet, 1.0, WET.factor), growth, none, none)
    )


@figure("model", "the model: train and telegrams, rail and limits, the loop of a control period")
def model() -> Figure:
    """Top: each unit reports to the leader, the foremost unit that works, whose rule answers with limits.

    Middle: the peak coefficient at every axle and the limit of every unit, where a wet patch lies under the foremost car.
    Bottom: signals of a control period, with the numbers of the equations on the model's page.
    """
    train = example_train()
    structure, _ = structure_of(train)
    drawn = new_figure(PAGE, 5.3)
    top, rail, loop = drawn.subplots(3, 1, height_ratios=(1.0, 0.72, 1.45))
    length = sum(car.length for car in train.cars)
    for axes in (top, rail):
        axes.set_xlim(-length - 1.0, 1.0)
    for axes in (top, loop):
        axes.set(xticks=[], yticks=[])
        axes.set_axis_off()
    _train(top, train, structure)
    _rail(rail, train, structure)
    _loop(loop)
    return drawn


def _middles(train: Train) -> list[tuple[float, int]]:
    """Middle [m] of each car, the front at 0, and the number of its unit from 1 on, 0 for a trailer."""
    found, front, unit = [], 0.0, 0
    for car in train.cars:
        unit += len(car.units())
        found.append((front - 0.5 * car.length, unit if car.units() else 0))
        front -= car.length
    return found


Place = tuple[float, float]


def _box(axes: Axes, middle: Place, size: Place, words: str, colour: str) -> None:
    corner = middle[0] - 0.5 * size[0], middle[1] - 0.5 * size[1]
    axes.add_patch(
        Rectangle(corner, *size, facecolor=colour, edgecolor=DARK, linewidth=0.7, zorder=2)
    )
    axes.text(*middle, words, ha="center", va="center", fontsize=NOTE, linespacing=1.3, zorder=3)


def _arrow(axes: Axes, colour: str, *places: Place) -> None:
    """An arrow through `places`, of which neighbours have one coordinate in common."""
    *_, before, end = places
    for (x0, y0), (x1, y1) in pairwise(places[:-1]):
        axes.plot([x0, x1], [y0, y1], color=colour, linewidth=0.9, zorder=2.5)
    axes.annotate("", end, before, arrowprops={**ARROW, "color": colour}, zorder=2.5)


def _said(axes: Axes, place: Place, words: str, colour: str, **more: Any) -> None:
    """What runs along an arrow."""
    look: Look = {"ha": "center", "va": "bottom", "linespacing": 1.2} | more
    axes.text(*place, words, color=colour, fontsize=NOTE, zorder=3, **look)


def _train(axes: Axes, train: Train, s: Structure) -> None:
    axes.set_ylim(0.0, 1.2)
    axes.set_title("(a) train and telegrams; it runs to the right")
    axes.axhline(0.06, color=DARK, linewidth=1.5)
    wheels = np.where(s.axle_unit >= 0, 28.0, 12.0)
    axes.scatter(s.axle_offset, np.full(wheels.size, 0.14), s=wheels, color=DARK, zorder=1)
    middles = _middles(train)
    axes.plot([middles[-1][0], middles[0][0]], [0.27, 0.27], color=DARK, linewidth=2.0, zorder=1)
    leader = middles[0][0]
    for middle, unit in middles:
        words = f"motor car of unit {unit}" if unit else "trailer"
        _box(axes, (middle, 0.29), (18.6, 0.24), words, MOTOR_CAR if unit else "white")
        said = {0: "slide protection\nof the air brake", 1: "unit 1, the leader:\nallocation rule"}
        words = said.get(unit, f"unit {unit}:\nreadhesion controller")
        _box(axes, (middle, 0.72), (15.5, 0.25), words, ON_BOARD)
        _arrow(axes, DARK, (middle - 1.5, 0.595), (middle - 1.5, 0.41))
        _arrow(axes, READINGS, (middle + 1.5, 0.41), (middle + 1.5, 0.595))
        if unit > 1:
            for shift, height, colour in ((-1.5, 0.95, LIMITS), (1.5, 1.09, REPORTS)):
                ways = [(place + shift, 0.845) for place in (leader, middle)]
                start, end = ways if colour == LIMITS else ways[::-1]
                _arrow(axes, colour, start, (start[0], height), (end[0], height), end)
    _said(axes, (-30.0, 0.94), "limits", LIMITS, va="top")
    _said(axes, (-30.0, 1.1), "reports: limited by what, delivered, last slip", REPORTS)
    _said(axes, (leader - 2.2, 0.5), "torque", DARK, ha="right", va="center")
    _said(axes, (leader + 2.2, 0.5), "readings", READINGS, ha="left", va="center")


def _rail(axes: Axes, train: Train, s: Structure) -> None:
    peak, driven = example_peaks(s), s.axle_unit >= 0
    cap = [float(peak[s.axle_unit == j].min()) for j in range(int(s.axle_unit.max()) + 1)]
    limit = RULES[RULE](AllocationProblem(cap, PLAN)).limit
    for chosen, fill, name in ((driven, DARK, "peak at driven axles"), (~driven, "white", "at others")):  # fmt: skip
        look: Look = {
            "color": DARK,
            "markerfacecolor": fill,
            "markersize": 3.5,
            "linestyle": "none",
        }
        axes.plot(s.axle_offset[chosen], peak[chosen], marker="o", label=name, **look)
    axes.axhline(PLAN, **BOUND, label="plan")
    places = [middle for middle, unit in _middles(train) if unit]
    axes.errorbar(
        places, limit, xerr=9.0, fmt="none", ecolor=rule_colour(RULE), elinewidth=2.0, label=f"limit by {RULE}",
        gid="limit",
    )  # fmt: skip
    axes.set(
        ylim=(0.09, 0.2), xlabel="place from the train's front [m]", ylabel="coefficient [–]",
        title="(b) a wet patch under the foremost car: units 2 and 3 make up for unit 1",
    )  # fmt: skip
    axes.legend(ncols=2, loc="lower left")


def _loop(axes: Axes) -> None:
    """Boxes stand in two lanes; the signals go round clockwise."""
    axes.set(xlim=(0.0, 100.0), ylim=(0.0, 10.0))
    axes.set_title("(c) signals of a control period; numbers are those of the equations")
    for low, high, colour, words in (
        (5.3, 9.8, ON_BOARD, "computers on board, every 10 ms"),
        (0.2, 4.2, PLANT, "plant, in steps of 2 ms or less: the only place with true values"),
    ):
        axes.add_patch(Rectangle((0.0, low), 100.0, high - low, facecolor=colour, zorder=0))
        axes.text(1.0, high - 0.2, words, va="top", color=DARK, fontsize=NOTE)
    places, above, below = (11.5, 37.0, 61.5, 87.0), 7.4, 1.7
    size = 19.0, 1.9
    on_board = (
        "sensing: speeds,\nslip, coefficient (13)", "leader: caps,\nallocation rule (15)",
        "unit: target torque,\nbounded rise (14)", "readhesion controller:\ntorque command",
    )  # fmt: skip
    plant = (
        "car bodies, couplers,\nresistance (10)–(12)", "contact: rail and\ncurve (1)–(6)",
        "wheelset, brake\nshoes (7), (8)", "motors (9), cylinders,\ndrives",
    )  # fmt: skip
    for height, lane in ((above, on_board), (below, plant)):
        for place, text in zip(places, lane, strict=True):
            _box(axes, (place, height), size, text, "white")
    half = 0.5 * size[0]
    right = [place + half for place in places]
    left = [place - half for place in places]
    for k, words, colour in ((0, "report", REPORTS), (1, "limit", LIMITS), (2, "target", DARK)):
        _arrow(axes, colour, (right[k], above), (left[k + 1], above))
        _said(axes, (0.5 * (right[k] + left[k + 1]), above + 0.15), words, colour)
    _arrow(axes, DARK, (places[1], 9.6), (places[1], above + 0.95))
    _said(axes, (places[1] + 1.0, 8.95), "driver's plan", DARK, ha="left", va="center")
    ends = [(places[k], above - 0.95) for k in (0, 3)]
    _arrow(axes, READINGS, ends[0], (places[0], 5.8), (places[3], 5.8), ends[1])
    _said(axes, (0.5 * (places[1] + places[2]), 5.85), "slip, coefficient", READINGS)
    _arrow(axes, READINGS, (3.5, 4.2), (3.5, above - 0.95))
    _said(axes, (4.5, 4.75), "axle speeds, motor torques, cylinder pressures", READINGS, ha="left", va="center")  # fmt: skip
    _arrow(axes, DARK, (right[3] - 1.5, above - 0.95), (right[3] - 1.5, below + 0.95))
    _said(axes, (right[3] - 2.5, 4.75), "torque command", DARK, ha="right", va="center")
    _arrow(axes, DARK, (left[3], below), (right[2], below))
    _said(axes, (0.5 * (left[3] + right[2]), below + 0.15), "torque", DARK)
    for k, to_left, to_right in ((1, "slip", "force"), (0, "force", "speed")):
        middle = 0.5 * (right[k] + left[k + 1])
        _arrow(axes, DARK, (left[k + 1], below + 0.35), (right[k], below + 0.35))
        _said(axes, (middle, below + 0.5), to_left, DARK)
        _arrow(axes, DARK, (right[k], below - 0.35), (left[k + 1], below - 0.35))
        _said(axes, (middle, below - 0.5), to_right, DARK, va="top")
