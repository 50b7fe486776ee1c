"""Figures of JP5484215: detection (5), limits (6), steps (7 to 9), increments (10 to 13), brake forces (16), curve (17).

The others are block diagrams.
"""

from itertools import pairwise
from typing import Any

import numpy as np
from matplotlib.figure import Figure

from alloc.plant.curves import POLACH_DRY, POLACH_WET
from alloc.plant.rail import GROWTH_SLOPE, logarithmic_increments
from alloc.rules import RULES, AllocationProblem
from paper_figs.sharing import study_figure
from paper_figs.style import NARROW, WIDE, Drawing
from studies.files.scenario_files import load_scenario
from studies.learning import SIGMA, axle_shifts, draw_counts, fit_slope, plan_at, unit_increments
from studies.run_cell import recorded

SOURCE = "jp5484215"
BLUE, RED, DARK = "#0072b2", "#d55e00", "#444444"


def draw_detection() -> Figure:
    """Fig. 5: the signal of the foremost unit in the event wet-patch, by its thresholds."""
    event = load_scenario("wet-patch")
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


def draw_limits() -> Figure:
    """Fig. 6: caps, and limits by the description, by claim 1, and by the exact level."""
    increments = logarithmic_increments(UNITS * AXLES).reshape(UNITS, AXLES).mean(axis=1)
    unit = np.arange(1, UNITS + 1)
    drawn = Figure(figsize=(WIDE, 2.6), layout="constrained")
    panels = drawn.subplots(1, 2, sharey=True)
    for axes, (title, coefficient) in zip(panels, FOUND.items(), strict=True):
        cap = coefficient + increments - increments[0]
        axes.plot(unit, cap, "-.", color=DARK, label="cap (5)")
        axes.axhline(PLAN, color="black", linestyle="--", linewidth=0.8, label="plan")
        for rule, label in LEVELS.items():
            part, limit = RULES[rule], RULES[rule](AllocationProblem(cap, PLAN)).limit
            look: dict[str, Any] = {"color": part.colour, "fillstyle": "none"}
            label += f": {100.0 * limit.mean() / PLAN:.1f} % of the plan"
            axes.plot(unit, limit, part.marker, label=label, **look)
        colours = np.where(limit < PLAN, RED, BLUE).tolist()
        axes.bar(unit, limit - PLAN, 1.0, PLAN, color=colours, alpha=0.15)
        axes.set(title=title, xlabel="unit", xticks=unit)
        axes.legend(loc="lower right")
    panels[0].set(ylabel="coefficient [1]", ylim=(0.128, 0.186))
    return drawn


STEPS = (
    "S201: increments and empty masses are stored",
    "S202: is this the foremost unit, B1?",
    "S203: slip of the foremost unit detected?",
    "S204, S205: estimate; caps: estimate + increment (5)",
    "S206, S207: mean of the caps (7) above the plan?",
    "S209: small: what the front lacks (8)",
    "S210: large: what the rear can add (9),\nunit by unit",
    "S211: level: first cap with large ≥ small",
    "S212: cap of the unit below the level?",
    "S214: limit: the level (11)",
    "S215: torque limits of empty cars (6) are sent",
    "S217: each unit adds its load (6')\nand controls its motors",
)
BRANCHES = {
    1: ("yes", "no", "end"),
    2: ("yes", "no", "S216: limits: the plan"),
    4: ("yes: B", "no: A", "S208: limits: the caps"),
    8: ("no: D", "yes: C", "S213: limit: the cap (10)"),
}
"""Steps that ask -> answers that lead on and to the right, and what is done there; but for the end all meet at `MEET`."""
MEET, RIGHT = 10, 1.3
"""A step, and the place of the second column; the first is at 0."""


def draw_steps() -> Figure:
    """Figs. 7 to 9 as one chart."""
    drawn = Figure(figsize=(NARROW, 5.4), layout="constrained")
    axes = drawn.subplots()
    axes.set(xlim=(-0.65, 1.72), ylim=(0.5 - len(STEPS), 0.5))
    axes.set_axis_off()

    def box(x: float, step: int, text: str, **look: Any) -> Any:
        frame = {"boxstyle": "square", "fc": "white", "ec": DARK, "lw": 0.6} | look
        centred: dict[str, Any] = {"ha": "center", "va": "center", "zorder": 3}
        return axes.text(x, -step, text, bbox=frame, fontsize=6, **centred).get_bbox_patch()

    def arrow(start: tuple[float, float], end: tuple[float, float], **patches: Any) -> None:
        look = {"arrowstyle": "-|>", "color": DARK, "shrinkA": 0.0, "shrinkB": 0.0} | patches
        axes.annotate("", end, start, arrowprops=look)

    asks = {"boxstyle": "round", "fc": "#dcebf5"}
    main = [box(0.0, k, text, **(asks if k in BRANCHES else {})) for k, text in enumerate(STEPS)]
    for k, (upper, lower) in enumerate(pairwise(main)):
        arrow((0.0, -k), (0.0, -k - 1), patchA=upper, patchB=lower)
    for k, (on, right, text) in BRANCHES.items():
        arrow((0.0, -k), (RIGHT, -k), patchA=main[k], patchB=box(RIGHT, k, text))
        axes.text(0.03, -k - 0.5, on, fontsize=6, va="center")
        axes.text(0.68, -k + 0.22, right, fontsize=6)
    axes.plot([RIGHT, RIGHT], [-2.0, -MEET], color=DARK, lw=1.0)
    arrow((RIGHT, -MEET), (0.0, -MEET), patchB=main[MEET])
    return drawn


CARS, BRAKINGS = 16, 500
"""Length of the train whose slides are drawn, and brakings of its lead car."""
GROUPS = {"1C4M": ("s", BLUE), "1C2M": ("^", RED), "1C1M": ("o", "#009e73")}
"""Motors per inverter, and the look of its units."""


def draw_increments() -> Figure:
    """Figs. 10 to 13, by synthetic data: the measured ones are lost with the source's drawings."""
    drawn = Figure(figsize=(WIDE, 3.6), layout="constrained")
    (ten, eleven), (twelve, thirteen) = drawn.subplots(2, 2)
    g, speed = np.random.default_rng(1), np.linspace(20.0, 280.0, 100)
    at = g.uniform(30.0, 270.0, 200)
    coefficient = plan_at(at / 3.6) + SIGMA * g.standard_normal(at.size)
    ten.plot(at, coefficient, ".", ms=2, color=BLUE, label=f"synthetic, σ = {SIGMA}")
    ten.plot(speed, plan_at(speed / 3.6), color="black", label="planned (12)")
    ten.set(title="Fig. 10", xlabel="speed [km/h]", ylabel="coefficient [1]", ylim=(0.0, None))
    axle = np.arange(1, AXLES * CARS + 1)
    slides = draw_counts(axle.size, BRAKINGS)
    eleven.bar(axle, slides, width=1.0, color=BLUE, label="synthetic, from (14) and (15)")
    eleven.set(title="Fig. 11", ylabel="slides [1]")
    shift, covariance = axle_shifts(slides)
    slope, error = fit_slope(shift, covariance)
    look: dict[str, Any] = {"fmt": ".", "ms": 3, "lw": 0.5, "color": BLUE}
    twelve.errorbar(axle, shift, np.sqrt(np.diag(covariance)), **look, label="from the slides (14)")
    fitted, printed = slope * np.log(axle), logarithmic_increments(axle.size)
    label = f"fit, slope {slope:.4f} ± {error:.4f}"
    twelve.plot(axle, fitted - fitted[:AXLES].mean(), color=RED, label=label)
    twelve.plot(axle, printed, "k--", label=f"(15), slope {GROWTH_SLOPE}")
    twelve.set(title="Fig. 12", ylabel="shift k σ [1]")
    for group, (marker, colour) in GROUPS.items():
        unit = (axle - 1) // int(group[2])
        middle = [axle[unit == j].mean() for j in range(unit[-1] + 1)]
        look = {"marker": marker, "color": colour, "ls": "none", "ms": 3.5, "fillstyle": "none"}
        thirteen.plot(middle, unit_increments(printed, unit), **look, label=f"units of {group}")
    thirteen.set(title="Fig. 13", ylabel="increment over unit 1 [1]")
    for axes in (ten, eleven, twelve, thirteen):
        axes.legend()
    for axes in (eleven, twelve, thirteen):
        axes.set(xlabel="axle")
    return drawn


def draw_brake_forces() -> Figure:
    """Fig. 16: what the foremost unit is asked for in the blended stop, and what each of its brakes does; at the rims."""
    run = recorded(load_scenario("wet-stop"), "greedy-literal", "cut-and-ramp", 0)
    time, member = run["time"].values, run["axle_unit"].values == 0
    load_of_unit = float(run["unit_static_load"][0]) / 1e3
    turning = run["axle_turning_mass"].values[member].sum() / 1e3
    turning = turning * np.abs(run["driver_command"].values)
    rim = float(run["unit_gear"][0] / run["unit_radius"][0]) * member.sum() / 1e3
    limit = np.minimum(run["limit"].values[:, 0], run["plan"].values) * load_of_unit + turning
    shown = {
        "pattern [kN]": (run["plan"].values * load_of_unit + turning, "black"),
        "electric [kN]": (rim * run["motor_torque"].values[:, 0], BLUE),
        "air, command\n[kN]": (member.sum() * run["air_brake_force"].values[:, 0] / 1e3, RED),
    }
    drawn = Figure(figsize=(NARROW, 3.2), layout="constrained")
    panels = drawn.subplots(3, 1, sharex=True, sharey=True)
    for axes, (label, (force, colour)) in zip(panels, shown.items(), strict=True):
        axes.plot(time, force, color=colour)
        axes.set_ylabel(label)
    panels[0].plot(time, limit, color=DARK, ls="--", label="limit")
    panels[0].legend()
    panels[-1].set(xlabel="time [s]", ylim=(0.0, None))
    return drawn


def draw_curve() -> Figure:
    """Fig. 17: wet and dry rail, by Polach's sets."""
    drawn = Figure(figsize=(NARROW, 2.4), layout="constrained")
    axes, slip, speed = drawn.subplots(), np.linspace(0.0, 4.0, 500), 20.0
    for polach, friction, line in ((POLACH_WET, 0.30, "-"), (POLACH_DRY, 0.55, "--")):
        most, place = (float(number) for number in polach.top(speed, friction))
        axes.plot(slip, polach(slip, friction, speed), line, color=BLUE)
        axes.plot(place, most, "o", color=RED)
        axes.text(
            place, most + 0.02, f"{'wet' if line == '-' else 'dry'}: {most:.2f} at {place:.1f} m/s"
        )
    axes.set(xlabel="slip velocity [m/s]", ylabel="tangential force coefficient [1]")
    axes.set(xlim=(0.0, 4.0), ylim=(0.0, 0.5))
    return drawn


FIGURES = {
    "slip-detection": Drawing(
        draw_detection,
        "Fig. 5: the slip signal comes on above one acceleration and goes off at or below a lower one. Here it also comes "
        "on above a slip, as at 9.0 s, since a unit whose slip grows slowly hardly accelerates; and it goes off when both "
        "acceleration and slip are low, so it lasts while the slip falls.",
        source=SOURCE,
    ),
    "limits": Drawing(
        draw_limits,
        "Fig. 6: where the train can meet the plan, units behind take over what those in front lack, by equal areas at the "
        "exact level, by more at the patent's, which are caps; where it cannot, every limit is its cap.",
        source=SOURCE,
    ),
    "rule-steps": Drawing(
        draw_steps,
        "Figs. 7 to 9: the steps by which the foremost unit limits all units; in case A all work at their caps, in case B "
        "the rear takes over what the front lacks.",
        source=SOURCE,
    ),
    "wet-and-dry": Drawing(
        draw_curve,
        "Fig. 17: the tangential force coefficient over the slip velocity on wet and dry rail (Polach's sets at 72 km/h); "
        "beyond the maximum, the adhesion coefficient, more slip carries less force.",
        source=SOURCE,
    ),
    "slide-counts": Drawing(
        draw_increments,
        "Figs. 10 to 13, from counts of slides to increments, with synthetic data since the measured ones are lost: counts "
        "drawn from (14) and (15) give (15) back within its error.",
        source=SOURCE,
    ),
    "brake-blending": Drawing(
        draw_brake_forces,
        "Fig. 16: the electric brake of the foremost unit fluctuates with what the line takes up, and the air brake is "
        "asked for the rest of the pattern, or of the limit while wheels slide; its force follows the command with a lag.",
        source=SOURCE,
    ),
    "learning": Drawing(
        study_figure("learning"),
        "The largest error of increments that were too high at first, over the stations at which the train learns.",
        study="learning",
        source=SOURCE,
    ),
    "braking": Drawing(
        study_figure("braking"),
        "What each rule adds to the deceleration of units that brake alone, over random blended stops.",
        study="braking",
        source=SOURCE,
    ),
    "claims": Drawing(
        study_figure("claims"),
        "What decides claims (a) to (e) over random starts, for every layer of the patent; the line is the threshold.",
        study="claims",
        source=SOURCE,
    ),
}
