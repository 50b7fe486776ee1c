"""Figures of JP5484215 that show numbers: slip detection (5), limits (6), the adhesion curve (17).

Figs. 10 to 13 are part of the study `learning`, Fig. 16 of `braking`; the others are block diagrams and flow charts, which
the code is.
"""

from typing import Any

import numpy as np
from matplotlib.figure import Figure

from alloc.curves import POLACH_DRY, POLACH_WET
from alloc.rail import logarithmic_increments
from alloc.rules import RULES, AllocationProblem
from paper_figs.sharing import of_study
from paper_figs.style import NARROW, WIDE, Drawing
from studies.runs import recorded
from studies.scenario import load

SOURCE = "jp5484215"
BLUE, RED, DARK = "#0072b2", "#d55e00", "#444444"


def detection() -> Figure:
    """Fig. 5: the signal of the foremost unit in the event wet-patch, by its thresholds."""
    event = load("wet-patch")
    detector = event.event().onboard.detector
    run = recorded(event, "greedy", "cut-and-ramp", 0).isel(unit=0)
    first = float(run["time"][int(np.argmax(run["slipping"].values > 0))])
    run = run.sel(time=slice(first - 0.5, first + 3.0))
    time, on = run["time"].values, run["slipping"].values > 0
    slip = np.abs(run["slip_velocity"].values[:, run["axle_unit"].values == 0]).max(axis=1)
    drawn = Figure(figsize=(NARROW, 2.8), layout="constrained")
    fast, slow = drawn.subplots(2, 1, sharex=True)
    fast.plot(time, 3.6 * run["computed_acceleration"].values, color=DARK)
    slow.plot(time, 3.6 * slip, color=DARK)
    second = detector.speed_on
    for axes, high, low in ((fast, detector.on, detector.off), (slow, second, 0.5 * second)):
        axes.axhline(3.6 * high, color=RED, linestyle="--", label="signal on above")
        axes.axhline(3.6 * low, color=BLUE, linestyle=":", label="off at or below")
        span = axes.get_xaxis_transform()
        axes.fill_between(time, 0.0, 1.0, where=on, transform=span, color="0.9", label="signal")
    fast.set_ylabel("mean computed\nacceleration [km/h/s]")
    slow.set(xlabel="time [s]", ylabel="slip of the\nworst axle [km/h]", xlim=time[[0, -1]])
    drawn.legend(*fast.get_legend_handles_labels(), loc="outside upper right", ncols=3)
    return drawn


UNITS, AXLES = 8, 4
PLAN = 0.170
"""Coefficient that 3.0 km/h/s needs of every unit (readhesion paper, Table 2)."""
FOUND = {"(a) high adhesion, case B": 0.160, "(b) low adhesion, case A": 0.145}
"""Coefficient found by the foremost unit: the train as a whole can just meet the plan at 0.158."""


LEVELS = {"greedy-claim": "claim 1", "greedy": "description", "exact": "exact level, par. 0050"}
"""Rule, and what the patent's text has of it."""


def limits() -> Figure:
    """Fig. 6: caps, and limits by the description, by claim 1, and by the exact level."""
    increments = logarithmic_increments(UNITS * AXLES).reshape(UNITS, AXLES).mean(axis=1)
    unit = np.arange(1, UNITS + 1)
    drawn = Figure(figsize=(WIDE, 2.6), layout="constrained")
    panels = drawn.subplots(1, 2, sharey=True)
    for axes, (title, found) in zip(panels, FOUND.items(), strict=True):
        cap = found + increments - increments[0]
        axes.plot(unit, cap, "-.", color=DARK, label="cap (5)")
        axes.axhline(PLAN, color="black", linestyle="--", linewidth=0.8, label="plan")
        for rule, words in LEVELS.items():
            part, limit = RULES[rule], RULES[rule](AllocationProblem(cap, PLAN)).limit
            look: dict[str, Any] = {"color": part.colour, "fillstyle": "none"}
            words += f": {100.0 * limit.mean() / PLAN:.1f} % of the plan"
            axes.plot(unit, limit, part.marker, label=words, **look)
        colours = np.where(limit < PLAN, RED, BLUE).tolist()
        axes.bar(unit, limit - PLAN, 1.0, PLAN, color=colours, alpha=0.15)
        axes.set(title=title, xlabel="unit", xticks=unit)
        axes.legend(loc="lower right")
    panels[0].set(ylabel="coefficient [1]", ylim=(0.128, 0.186))
    return drawn


def curve() -> Figure:
    """Fig. 17: wet and dry rail, by Polach's sets."""
    drawn = Figure(figsize=(NARROW, 2.4), layout="constrained")
    axes, slip, speed = drawn.subplots(), np.linspace(0.0, 4.0, 500), 20.0
    for law, friction, line in ((POLACH_WET, 0.30, "-"), (POLACH_DRY, 0.55, "--")):
        most, place = (float(one) for one in law.top(speed, friction))
        axes.plot(slip, law(slip, friction, speed), line, color=BLUE)
        axes.plot(place, most, "o", color=RED)
        axes.text(
            place, most + 0.02, f"{'wet' if line == '-' else 'dry'}: {most:.2f} at {place:.1f} m/s"
        )
    axes.set(xlabel="slip velocity [m/s]", ylabel="tangential force coefficient [1]")
    axes.set(xlim=(0.0, 4.0), ylim=(0.0, 0.5))
    return drawn


FIGURES = {
    "slip-detection": Drawing(
        detection,
        "Fig. 5: the slip signal comes on above one acceleration and goes off at or below a lower one; here it also goes by "
        "the slip itself, as at 9.0 s, since a unit whose slip grows slowly hardly accelerates.",
        source=SOURCE,
    ),
    "limits": Drawing(
        limits,
        "Fig. 6: where the train can meet the plan, units behind take over what those in front lack, by equal areas at the "
        "exact level, by more at the patent's, which are caps; where it cannot, every limit is its cap.",
        source=SOURCE,
    ),
    "wet-and-dry": Drawing(
        curve,
        "Fig. 17: the tangential force coefficient over the slip velocity on wet and dry rail (Polach's sets at 72 km/h); "
        "beyond the maximum, the adhesion coefficient, more slip carries less force.",
        source=SOURCE,
    ),
    "learning": Drawing(
        of_study("learning"),
        "Figs. 10 to 13, from drawn counts of slides to increments, and the error of increments that a train learns.",
        study="learning",
        source=SOURCE,
    ),
    "braking": Drawing(
        of_study("braking"),
        "Fig. 16, the brake forces of the foremost car in a blended stop, and what each rule adds to the deceleration.",
        study="braking",
        source=SOURCE,
    ),
    "claims": Drawing(
        of_study("claims"),
        "What decides claims (a) to (e) over random starts, for every layer of the patent; the line is the threshold.",
        study="claims",
        source=SOURCE,
    ),
}
