"""The model in pictures: adhesion curves and their peaks; who tells whom what, and which forces act."""

from itertools import pairwise

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import Rectangle

from alloc.onboard import columns as onboard
from alloc.plant import columns as plant
from alloc.plant.curves import CURVES, AdhesionCurve, PiecewiseCurve
from alloc.plant.rows import rows_of_train
from paper_figs.style import WIDE, Drawing
from studies.files.scenario_files import load_scenario

BLUE, RED, GREEN, DARK, PALE = "#0072b2", "#d55e00", "#009e73", "#444444", "#e8f0f7"
SLIP, COEFFICIENT = "slip velocity [m/s]", "tangential force coefficient [1]"

# adhesion curves

PEAK, SPEED = 0.18, 30.0 / 3.6
"""Adhesion that every curve offers (readhesion paper, Table 2, before the drop), and the speed [m/s] at which it does."""
LOOKS = {
    "piecewise": ("piecewise", BLUE, "-"),
    "polach-wet": ("Polach, wet", "#56b4e9", "--"),
    "polach-dry": ("Polach, dry", RED, "-."),
    "slip-ratio": ("slip ratio", GREEN, ":"),
    "exponential-difference": ("difference of exponentials", "#7b3294", (0, (5, 1, 1, 1))),
}
"""Kind of curve: label, colour, dashes."""


def level_of_peak(curve: AdhesionCurve) -> float:
    """Level at which the peak is `PEAK`; that of Polach's curves is the friction coefficient, above the peak."""
    level = PEAK
    for _ in range(20):
        level *= PEAK / float(curve.top(SPEED, level)[0])
    return level


def draw_adhesion_curve() -> Figure:
    """Parts of the piecewise curve, and all curves at equal peaks."""
    drawn = Figure(figsize=(WIDE, 2.6), layout="constrained")
    left, right = drawn.subplots(1, 2, sharey=True)
    curve, end = PiecewiseCurve(), 0.2
    top = float(curve.top(0.0, PEAK)[1])
    line = PEAK / curve.micro_slope - curve.micro_slope / (4.0 * curve.top_curvature)
    tail = top + curve.macro_slope / (2.0 * curve.top_curvature)
    looks = (("line", BLUE), ("parabola", "black"), ("exponential", RED))
    for span, (name, colour) in zip(pairwise((0.0, line, tail, end)), looks, strict=True):
        slip = np.linspace(*span, 200)
        left.plot(slip, curve(slip, PEAK), color=colour, linewidth=2.0, label=name)
    for low, high, colour, text in (
        (0.0, top, BLUE, "micro slip,\nstable"),
        (top, end, RED, "macro slip,\nunstable"),
    ):
        left.axvspan(low, high, color=colour, alpha=0.1, linewidth=0.0)
        left.text(0.5 * (low + high), 0.01, text, ha="center")
    left.plot(top, PEAK, "ko")
    left.text(top, 1.05 * PEAK, f"peak, at {top:.3f} m/s")
    left.set(xlim=(0.0, end), ylim=(0.0, 1.2 * PEAK), xlabel=SLIP, ylabel=COEFFICIENT)
    left.set_title("(a) parts of the piecewise curve (readhesion paper)")
    left.legend(loc="center right")
    slip = np.concatenate([np.linspace(0.0, 0.2, 300), np.linspace(0.2, 4.0, 300)])
    for kind, (name, colour, dashes) in LOOKS.items():
        polach = CURVES[kind]()
        mu = polach(slip, level_of_peak(polach), SPEED)
        right.plot(slip, mu, color=colour, linestyle=dashes, label=name)
        right.plot(polach.top(SPEED, level_of_peak(polach))[1], PEAK, "o", color=colour)
    right.set(title=f"(b) equal peaks at {3.6 * SPEED:.0f} km/h", xlabel=SLIP, xlim=(0.0, 4.0))
    right.legend(loc="lower left", bbox_to_anchor=(0.37, 0.0))
    return drawn


def draw_creep() -> Figure:
    """How speed moves the peak of a creep law, and that of all curves."""
    drawn = Figure(figsize=(WIDE, 2.6), layout="constrained")
    left, right = drawn.subplots(1, 2)
    curve, slip = CURVES["polach-wet"](), np.linspace(0.0, 3.0, 400)
    level, speed = level_of_peak(curve), np.linspace(1.0, 120.0, 200)
    shades = {10: "#9ecae1", 30: "#56a0ce", 60: "#2171b5", 120: "#08306b"}
    for kmh, shade in shades.items():
        left.plot(slip, curve(slip, level, kmh / 3.6), color=shade, label=f"{kmh} km/h")
        most, place = curve.top(kmh / 3.6, level)
        left.plot(place, most, "o", color=shade)
    left.set(title="(a) Polach, wet", xlabel=SLIP, ylabel=COEFFICIENT, xlim=(0.0, 3.0), ylim=0.0)
    left.legend(loc="lower right")
    for kind, (name, colour, dashes) in LOOKS.items():
        place = CURVES[kind]().top(speed / 3.6, level_of_peak(CURVES[kind]()))[1]
        right.plot(speed, place, color=colour, linestyle=dashes, label=name)
    right.set(title="(b) all curves", xlabel="speed [km/h]", xlim=(0.0, 120.0), yscale="log")
    right.set_ylabel("slip velocity of the peak [m/s]")
    right.yaxis.set_major_formatter("{x:g}")
    drawn.legend(*right.get_legend_handles_labels(), loc="outside lower right", ncols=5)
    return drawn


# train, telegrams, and the loop of a control period


def draw_model() -> Figure:
    """Who tells whom what, and which forces act; below it the loop of a control period."""
    drawn = Figure(figsize=(WIDE, 4.0), layout="constrained")
    top, below = drawn.subplots(2, 1, height_ratios=(1.15, 1.0))
    _draw_train(top)
    _draw_loop(below)
    for axes in (top, below):
        axes.set_axis_off()
    return drawn


def _draw_box(
    axes: Axes, x: float, y: float, size: tuple[float, float], text: str, colour: str
) -> None:
    corner = (x - 0.5 * size[0], y - 0.5 * size[1])
    axes.add_patch(Rectangle(corner, *size, facecolor=colour, edgecolor=DARK))
    axes.text(x, y, text, ha="center", va="center", linespacing=1.3)


def _draw_arrow(axes: Axes, colour: str, *places: tuple[float, float]) -> None:
    """An arrow through `places`."""
    axes.plot(*zip(*places[:-1], strict=True), color=colour, linewidth=0.9)
    look = {"arrowstyle": "-|>", "color": colour, "linewidth": 0.9, "shrinkA": 0.0, "shrinkB": 0.0}
    axes.annotate("", places[-1], places[-2], arrowprops=look)


def _draw_train(axes: Axes) -> None:
    """A trailer and two motor cars of the commuter train, the front at 0, and a wet patch below the front."""
    axle = rows_of_train(load_scenario("wet-start").event().train).wheelsets
    axes.set(xlim=(-61.0, 9.0), ylim=(0.0, 10.0), title="(a) train, telegrams and forces")
    for start, length, colour in ((-61.0, 70.0, "#c9ced3"), (-31.0, 40.0, BLUE)):
        axes.add_patch(Rectangle((start, 0.9), length, 0.35, facecolor=colour))
    axes.text(-1.0, 0.1, "a wet patch: less adhesion", color=BLUE, ha="right")
    axes.plot([-59.0, -1.0], [2.3, 2.3], color=DARK, linewidth=2.0, zorder=0)
    _draw_box(axes, -10.0, 2.8, (18.6, 2.0), "trailer", "white")
    leader = "unit 1, the leader:\nallocation rule,\nreadhesion controller"
    for x, text in ((-30.0, leader), (-50.0, "unit 2:\nreadhesion\ncontroller")):
        _draw_box(axes, x, 2.8, (18.6, 2.0), "motor car", PALE)
        _draw_box(axes, x, 6.3, (14.0, 2.2), text, "white")
        _draw_arrow(axes, DARK, (x - 2.0, 5.2), (x - 2.0, 3.8))
        _draw_arrow(axes, GREEN, (x + 2.0, 3.8), (x + 2.0, 5.2))
    for x, unit in zip(axle.offset, axle.unit, strict=True):
        if x > -60.0:
            axes.plot(x, 1.6, "o", color=DARK, markersize=6.5 if unit >= 0 else 5.0)
        if x > -60.0 and unit >= 0:
            _draw_arrow(axes, RED, (x - 0.9, 0.6), (x + 0.9, 0.6))
    _draw_arrow(axes, DARK, (8.0, 2.8), (0.2, 2.8))
    for x, y, text, colour in (
        (0.6, 3.1, "resistance,\ngradient", DARK),
        (-34.2, 0.4, "rail forces", RED),
        (-35.5, 4.3, "torque", DARK),
        (-27.5, 4.3, "speeds, torques", GREEN),
        (-41.0, 8.4, "limits", BLUE),
        (-47.0, 9.35, "reports: delivered, limited by what, last slip", RED),
    ):
        axes.text(x, y, text, color=colour)
    _draw_arrow(axes, BLUE, (-32.0, 7.4), (-32.0, 8.3), (-52.0, 8.3), (-52.0, 7.4))
    _draw_arrow(axes, RED, (-48.0, 7.4), (-48.0, 9.2), (-28.0, 9.2), (-28.0, 7.4))


def _draw_loop(axes: Axes) -> None:
    """Signals go round clockwise: computers above, plant below."""
    axes.set(xlim=(0.0, 100.0), ylim=(0.0, 10.0), title="(b) a control period of 10 ms")
    for low, high, colour, text in (
        (5.5, 10.0, PALE, "computers on board"),
        (0.0, 4.3, "#f3f0e8", "plant, the only place with true values"),
    ):
        axes.add_patch(Rectangle((0.0, low), 100.0, high - low, facecolor=colour))
        axes.text(1.0, 9.2 if low else 0.3, text, color=DARK)
    for x, computer, part in (
        (12.0, "sensing: slip,\ncoefficient", "car bodies,\nresistance"),
        (37.0, "leader: caps,\nallocation rule", "contact:\nadhesion curve"),
        (62.0, "unit: target torque\nunder its limit", "wheelsets,\nbrake shoes"),
        (87.0, "readhesion\ncontroller", "motors,\ncylinders"),
    ):
        _draw_box(axes, x, 7.2, (18.0, 2.2), computer, "white")
        _draw_box(axes, x, 2.6, (18.0, 2.2), part, "white")
    for text, *places in (
        ("report", (21.0, 7.2), (28.0, 7.2)),
        ("limit", (46.0, 7.2), (53.0, 7.2)),
        ("target", (71.0, 7.2), (78.0, 7.2)),
        ("torque", (78.0, 2.6), (71.0, 2.6)),
        ("slip", (53.0, 2.9), (46.0, 2.9)),
        ("force", (28.0, 2.9), (21.0, 2.9)),
    ):
        _draw_arrow(axes, DARK, *places)
        axes.text(0.5 * (places[0][0] + places[1][0]), places[0][1] + 0.2, text, ha="center")
    for text, side, x, y, start, end in (
        ("torque command", "right", 86.0, 4.7, (87.0, 6.1), (87.0, 3.7)),
        ("speeds, torques, pressures", "left", 13.0, 4.7, (12.0, 3.7), (12.0, 6.1)),
        ("driver's plan", "left", 38.0, 8.9, (37.0, 9.9), (37.0, 8.3)),
        ("force", "center", 49.5, 1.4, (46.0, 2.3), (53.0, 2.3)),
        ("speed", "center", 24.5, 1.4, (21.0, 2.3), (28.0, 2.3)),
    ):
        _draw_arrow(axes, DARK, start, end)
        axes.text(x, y, text, ha=side)


# the plan of the house


def draw_house() -> Figure:
    """The rooms of `alloc`: two wings with their tables, as the code has them, and the wire between."""
    drawn = Figure(figsize=(WIDE, 2.9), layout="constrained")
    axes = drawn.subplots()
    axes.set(xlim=(0.0, 100.0), ylim=(0.0, 12.6))
    axes.set_axis_off()
    for y, name, text, colour in (
        (1.0, "schema", "tables and columns, parameters, parts by name", "#eeeeee"),
        (9.4, "run", "event, the loop of control periods, recorded run", "white"),
        (11.6, "evaluation", "metrics of a recorded run", "white"),
    ):
        _draw_box(axes, 50.0, y, (98.0, 1.7), f"{name}: {text}", colour)
    for x, title, tables, colour in (
        (18.0, "plant: what is true", plant.TABLES, "#f3f0e8"),
        (82.0, "onboard: what is known", onboard.TABLES, PALE),
    ):
        axes.add_patch(Rectangle((x - 17.0, 2.2), 34.0, 6.0, facecolor=colour, edgecolor=DARK))
        axes.text(x, 7.5, title, ha="center", weight="bold")
        for k, table in enumerate(tables):
            title = f"{table.name.replace('_', ' ')} ({len(table.columns)})"
            axes.text(x - 16.0 + 17.0 * (k % 2), 6.5 - 0.95 * (k // 2), title)
    _draw_box(axes, 82.0, 3.2, (32.0, 1.5), "rules, mpc: functions on these rows", "white")
    for y, start, end, text, colour, dashes in (
        (7.1, 35.0, 65.0, "read: noise, quantum, loss", GREEN, "-"),
        (5.2, 65.0, 35.0, "apply: torque, pressure, valve", DARK, "-"),
        (3.3, 35.0, 65.0, "told to the oracle alone", RED, "--"),
    ):
        look = {"arrowstyle": "-|>", "color": colour, "linestyle": dashes}
        axes.annotate("", (end, y), (start, y), arrowprops=look)
        axes.text(50.0, y + 0.25, text, color=colour, ha="center")
    axes.text(50.0, 2.4, "run/wire.py", ha="center", weight="bold")
    return drawn


FIGURES = {
    "house": Drawing(
        draw_house,
        "What is true and what is known have tables and folders of their own (in brackets: columns), and meet at one wire.",
    ),
    "model": Drawing(
        draw_model,
        "Each unit reports to the leader, the foremost unit that works, whose allocation rule answers with limits; "
        "below are the signals of a control period.",
    ),
    "adhesion-curve": Drawing(
        draw_adhesion_curve,
        "Left of its peak an adhesion curve is stable, right of it a wheel under the same torque runs away; curves of "
        "equal peak differ in where it lies and in how far they fall behind it.",
    ),
    "creep": Drawing(
        draw_creep,
        "The slip velocity of the peak differs twentyfold between curves, and grows with speed where a curve goes by "
        "creepage, so no fixed slip suits all rails.",
    ),
}
