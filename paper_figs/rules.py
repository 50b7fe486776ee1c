"""Allocation rules beside each other: limits of one problem (JP5484215 Fig. 6), and differences over events."""

import math
from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.ticker import FixedLocator, NullFormatter
from numpy.typing import NDArray

from alloc.metrics import METRICS
from alloc.plant.rail import logarithmic_increments
from alloc.rules import RULES, Allocation, AllocationProblem, find_rule
from paper_figs.drawing import comparison, figure, study
from paper_figs.style import (
    BAND_GREY,
    BOUND,
    DARK,
    NOTE,
    PAGE,
    ZERO,
    Look,
    Panel,
    bare_rows,
    controller_fill,
    controller_handles,
    handle,
    interval_mark,
    legend_below,
    name_rows,
    new_figure,
    new_panels,
    rule_colour,
    rule_handles,
    rule_look,
    tint_better,
    zero_line,
)
from studies.comparison.summary import REFERENCE, SummaryLine, summarise
from studies.core.drawn_events import complete
from studies.core.statement import mean_interval
from studies.patent.differences_study import closed_loop
from studies.patent.headroom_study import RULES as HEADROOM_RULES
from studies.patent.headroom_study import STRATA, gain, in_stratum, pairs_of, rules_of

UNITS, AXLES_PER_UNIT = 8, 4
EXPECTED = 0.170
"""Planned coefficient of the readhesion paper's scenario (3.0 km/h/s)."""
HIGH, LOW = 0.160, 0.145
"""Coefficient found by the foremost unit: above and below the value at which the train can just meet the plan."""
DOT: Look = {"marker": "o", "markersize": 3.2, "linestyle": "none"}
SAME = (
    "qp-daqp", "qp-robust", "greedy-printed", "greedy-literal", "greedy-tuned", "cooperative", "wear", "wear-qp",
    "wear-cvxpy",
)  # fmt: skip
"""Rules that answer as `qp`, `greedy` and `exact` where they are only called; and those that need the marks of a run."""
SHOWN = tuple(name for name in RULES if name not in SAME)
"""Rules shown."""


def caps(coefficient: float) -> NDArray[np.float64]:
    """Caps (5) of 8 units of four axles with the increments (15), (UNITS,)."""
    per_axle = logarithmic_increments(UNITS * AXLES_PER_UNIT)
    increments = per_axle.reshape(UNITS, AXLES_PER_UNIT).mean(axis=1)
    return np.asarray(coefficient + increments - increments[0])


def problem(coefficient: float) -> AllocationProblem:
    """Problem of every rule where `coefficient` is found: true caps, limits in force at the plan."""
    cap = caps(coefficient)
    delivered = np.minimum(cap, EXPECTED)
    return AllocationProblem(cap=cap, expected=EXPECTED, delivered=delivered, truth=cap)


def allocate(rule: str, coefficient: float) -> Allocation:
    """What a rule answers to `problem`; a rule that acts step by step has made one step."""
    return find_rule(rule)(problem(coefficient))


@figure("allocation-bars", "limits of all rules for high and low adhesion (JP5484215 Fig. 6 a, b)")
def allocation_bars(rules: Sequence[str] = SHOWN) -> Figure:
    """One column per rule; upper row high adhesion, lower row low adhesion. A dot per unit on its stem from the cap.

    Filled dots are limits that the rail carries; open ones ask for more than that. Above each panel stand the mean limit
    ("told") and the mean of what limit and adhesion together allow ("used"), as shares of the plan.
    """
    drawn, axes = new_panels(PAGE, 3.7, 2, len(rules), sharex=True, sharey=True, squeeze=False)
    for row, coefficient in enumerate((HIGH, LOW)):
        for one, rule in zip(axes[row], rules, strict=True):
            _limits(one, rule, coefficient)
    for (upper, lower), rule in zip(axes.T, rules, strict=True):
        title = f"{rule}\n{upper.get_title()}"
        upper.set_title(title, color=rule_colour(rule), loc="center", fontsize=NOTE)
        lower.set_xlabel("unit")
    axes[0, 0].set_ylabel("(a) high adhesion, case B\ncoefficient [–]")
    axes[1, 0].set_ylabel("(b) low adhesion, case A\ncoefficient [–]")
    shown = [
        handle("plan", color="black", linestyle="--", linewidth=0.8),
        handle("cap", color="black", linewidth=0.8),
        handle("limit", color=DARK, **DOT),
        handle("limit above the cap", color=DARK, **DOT, markerfacecolor="white"),
    ]
    legend_below(drawn, shown)
    return drawn


def _limits(axes: Axes, rule: str, coefficient: float) -> None:
    units, asked, answer = (
        np.arange(1, UNITS + 1),
        problem(coefficient),
        allocate(rule, coefficient),
    )
    cap, look = caps(coefficient), {**DOT, "color": rule_colour(rule), "zorder": 3}
    axes.axhline(EXPECTED, color="black", linestyle="--", linewidth=0.8, zorder=1)
    axes.stairs(cap, np.arange(0.5, UNITS + 1.0), color="black", linewidth=0.8, baseline=None)
    axes.vlines(units, cap, answer.limit, color=look["color"], linewidth=0.9)
    axes.plot(units, answer.limit, **look, gid=f"limit of {rule}")
    above = answer.limit > cap + 1e-9
    look |= {"markerfacecolor": "white", "gid": f"limit of {rule} above the cap"}
    axes.plot(units[above], answer.limit[above], **look)
    told, used = (100.0 * x / EXPECTED for x in (answer.effort(asked), answer.usable(asked)))
    axes.set_title(f"told {told:.1f} %\nused {used:.1f} %", loc="center", fontsize=NOTE)
    axes.margins(y=0.05)
    axes.set(xlim=(0.3, UNITS + 0.7), xticks=[1, 4, 8])
    axes.grid(visible=False, axis="x")


class Change(NamedTuple):
    """A metric as its difference from `REFERENCE`: label, factor to its unit, and up to where the axis is linear."""

    metric: str
    label: str
    factor: float
    linear: float


GAINS = (
    Change("effort_ratio", "effort over plan,\nless alone's [%]", 100.0, 1.0),
    Change("damage", "wheel damage Q,\nless alone's [kJ]", 1.0, 10.0),
)
ABREAST = 3
"""Controllers side by side; more of them stand below each other."""
ROW, BETWEEN, LEAST_BANDS = 0.056, 0.95, 0.45
"""Heights [inches] of a rule's row, of what stands above and below the rows, and of all rows of one event alone."""
MARK: Look = {"markersize": 3.2, "elinewidth": 0.8, "markeredgewidth": 0.4, "clip_on": False}
"""Of a rule's row; the first and the last stand at the panel's edge, and are not cut there."""
NO_PAIRS = f"differences need the\nrule {REFERENCE} beside others"


@figure("rule-comparison", "rules over all events: effort and wheel damage, less those of alone", comparison,
        events="seeds")  # fmt: skip
def rule_comparison(table: pd.DataFrame) -> Figure:
    """Mean of paired differences over the seeds, with its interval; one seed has none. A band per event, a row per rule.

    The better side is tinted. Axes are linear between the two inner ticks and logarithmic beyond.
    """
    lines = summarise(table)
    scenarios = list(dict.fromkeys(line.scenario for line in lines))
    rules = [rule for rule in dict.fromkeys(line.rule for line in lines) if rule != REFERENCE]
    controllers = list(dict.fromkeys(line.controller for line in lines))
    blocks = math.ceil(len(controllers) / ABREAST)
    abreast = math.ceil(len(controllers) / blocks)
    bands = max(ROW * max(len(rules), 3), 0.14) * len(scenarios)
    height = blocks * (BETWEEN + max(bands, LEAST_BANDS))
    shape = {"sharey": True, "squeeze": False}
    drawn, panels = new_panels(PAGE, height, blocks, abreast * len(GAINS), **shape)
    limits = {change: _ends(change, lines) for change in GAINS}
    for k, controller in enumerate(controllers):
        own = [line for line in lines if line.controller == controller]
        for place, change in enumerate(GAINS):
            axes = panels[k // abreast][place * abreast + k % abreast]
            _change(axes, change, own, scenarios, rules)
            _scale(axes, change, limits[change])
            axes.set_title(controller, loc="center")
            if k % abreast == (min(abreast, len(controllers)) - 1) // 2:
                axes.set_xlabel(change.label)
    for axes in panels.flat:
        axes.set_visible(bool(axes.get_title("center")))
    name_rows(panels[0, 0], scenarios)
    legend_below(drawn, rule_handles(rules), 5)
    return drawn


def _change(
    axes: Axes, change: Change, lines: Sequence[SummaryLine], scenarios: list[str], rules: list[str]
) -> None:
    """Each rule's own row in each event's band, so no mark covers another."""
    for line in lines:
        found = line.differences.get(change.metric)
        if found is not None and math.isfinite(found.value):
            y = scenarios.index(line.scenario) + (rules.index(line.rule) + 0.5) / len(rules) - 0.5
            interval_mark(axes, found, y, change.factor, rule_look(line.rule) | MARK)
    if not any(line.differences for line in lines):
        axes.text(0.5, 0.5, NO_PAIRS, transform=axes.transAxes, ha="center", va="center")
    for k in range(len(scenarios) + 1):
        axes.axhline(k - 0.5, color=BAND_GREY, linewidth=0.5, zorder=-1)
    axes.axvline(0.0, color=ZERO, linewidth=0.7, zorder=0)
    bare_rows(axes)


def _ends(change: Change, lines: Sequence[SummaryLine]) -> tuple[float, float]:
    """Ends of the axis: all intervals, and at least what is linear."""
    found = [line.differences.get(change.metric) for line in lines]
    known = [one for at in found if at is not None for one in (at.value, at.low, at.high)]
    ends = [1.3 * change.factor * one for one in known if math.isfinite(one)]
    ends += [-1.5 * change.linear, 1.5 * change.linear]
    return min(ends), max(ends)


def _scale(axes: Axes, change: Change, limits: tuple[float, float]) -> None:
    """Linear around zero, logarithmic beyond, with numbers at zero and at the last tick of both sides."""
    axes.set_xscale("symlog", linthresh=change.linear)
    axes.set_xlim(limits)
    powers = change.linear * 10.0 ** np.arange(0, 9)
    ticks = [*(-powers[powers <= -limits[0]]), 0.0, *powers[powers <= limits[1]]]
    last = {min(ticks), 0.0, max(ticks)}
    axes.xaxis.set_major_locator(FixedLocator(sorted(last)))
    axes.xaxis.set_major_formatter("{x:g}")
    axes.xaxis.set_minor_locator(FixedLocator([tick for tick in ticks if tick not in last]))
    axes.xaxis.set_minor_formatter(NullFormatter())
    axes.tick_params(axis="x", labelsize=NOTE)  # those of neighbours would meet
    tint_better(axes, METRICS[change.metric].better)


FEW_PROBLEMS = 100
"""Problems of each kind that are run where the results have none."""
DIFFERING = ("greedy", "greedy-claim")
NO_EVENT = "no event"
"""Where a kind of problem has no events in closed loop."""
CLOSED_LOOP = (
    Panel("held_effort", "effort over plan,\nless exact [%]", 100.0),
    Panel("damage", "wheel damage Q,\nless exact [kJ]"),
    Panel("jerk_rms", "jerk rms,\nless exact [m/s³]"),
)
BETTER_SIDES = (1, -1, -1)
"""Whether more or less of each is better."""


@figure("differences", "where greedy and exact level differ: random problems and closed loop",
        study("differences", FEW_PROBLEMS))  # fmt: skip
def differences(table: pd.DataFrame) -> Figure:
    """Left: effort of problems within reach, less that of the exact answer: median, quartiles, 1 and 99 %.

    Right: the same kinds in closed loop, means of paired differences with their intervals; the better side is tinted.
    """
    good = table[table["status"] == "ok"]
    problems, events = good[good["part"] == "problem"], good[good["part"] == "event"]
    within = problems[problems["within_reach"].astype(bool)]
    kinds = list(dict.fromkeys(problems["kind"]))
    drawn, axes = new_panels(PAGE, 3.4, 1, 4, sharey=True, width_ratios=(1.6, 1, 1, 1))
    for rule, shift in zip(DIFFERING, (-0.15, 0.15), strict=True):
        for y, kind in enumerate(kinds):
            rows = within[(within["kind"] == kind) & (within["rule"] == rule)]
            _spread(axes[0], 100 * (rows["over"] - rows["short"]), rule, y + shift)
            for (metric, _, factor, _), one in zip(CLOSED_LOOP, axes[1:], strict=True):
                found = closed_loop(events, kind, metric, rule)
                if found.count == 0 and rule == DIFFERING[0]:
                    one.text(0.0, y, NO_EVENT, ha="center", va="center", fontsize=NOTE, color=DARK)
                elif found.count:
                    look = rule_look(rule) | {"markersize": 4.0, "elinewidth": 0.9}
                    interval_mark(one, found, y + shift, factor, look)
    counts = within.loc[within["rule"] == DIFFERING[0], "kind"].value_counts()
    name_rows(axes[0], [f"{kind} ({counts.get(kind, 0)})" for kind in kinds])
    axes[0].set(xlabel="effort of the limits,\nless the exact one's [%]", title="random problems")
    axes[1].set_title("closed loop")
    for panel, better, one in zip(CLOSED_LOOP, BETTER_SIDES, axes[1:], strict=True):
        one.set_xlabel(panel.label)
        tint_better(one, better)
    for one in axes:
        zero_line(one, rule_colour("exact"))
        bare_rows(one)
    legend_below(drawn, rule_handles(DIFFERING))
    return drawn


def _spread(axes: Axes, values: "pd.Series[float]", rule: str, y: float) -> None:
    if values.empty:
        return
    low, q1, median, q3, high = np.quantile(values, (0.01, 0.25, 0.5, 0.75, 0.99))
    colour = rule_colour(rule)
    axes.plot([low, high], [y, y], color=colour, linewidth=0.8)
    axes.plot([q1, q3], [y, y], color=colour, linewidth=3.5, solid_capstyle="butt")
    axes.plot(median, y, **rule_look(rule) | {"markeredgecolor": "black", "markersize": 3.5})


FEW_EVENTS = 20
"""Events that are run for the figure where the results have fewer: every train in every class of headroom."""
COSTS = (
    Panel("slip_time", "slip over axles,\nless alone [s]"),
    Panel("damage", "wheel damage Q,\nless alone [kJ]"),
    Panel("jerk_rms", "jerk rms,\nless alone [m/s³]"),
)


@figure("headroom", "what rules gain over alone by headroom, and what it costs (sweep headroom)",
        study("headroom", FEW_EVENTS))  # fmt: skip
def headroom(table: pd.DataFrame) -> Figure:
    """Above, a panel per controller: the mean gain of each rule among events of like headroom. Below: what each rule costs.

    A dashed line is the mean headroom of these events, all that sharing could gain.
    """
    good = complete(table)
    pairs = {one: pairs_of(good, one) for one in dict.fromkeys(good["controller"])}
    drawn = new_figure(PAGE, 5.4)
    above, below = np.asarray(drawn.subfigures(2, 1, height_ratios=[1.35, 1.0])).tolist()
    gains = above.subplots(1, len(pairs), sharex=True, sharey=True, squeeze=False)[0]
    for axes, (controller, events) in zip(gains, pairs.items(), strict=True):
        _gains(axes, events)
        axes.set_title(f"{controller} ({len(events)} events)")
    gains[0].set_ylabel("gain over alone,\nof the plan [%]")
    legend_below(above, [*rule_handles(HEADROOM_RULES[1:]), handle("the headroom", **BOUND)])
    costs = below.subplots(1, len(COSTS), sharey=True)
    for panel, axes in zip(COSTS, costs, strict=True):
        _costs(axes, panel, pairs)
    name_rows(costs[0], HEADROOM_RULES[1:])
    legend_below(below, controller_handles(pairs))
    return drawn


def _gains(axes: Axes, events: pd.DataFrame) -> None:
    """A band per stratum: mean gain of each rule beside the others, and the mean headroom there as a line."""
    rules = rules_of(events)[1:]
    for band, name in enumerate(STRATA):
        chosen = events[in_stratum(events, name)]
        if len(chosen) < 2:
            continue
        room = 100 * float(chosen["headroom"].mean())
        axes.plot([band - 0.46, band + 0.46], [room, room], gid="headroom", **BOUND)
        places = np.linspace(-0.36, 0.36, len(rules)) if len(rules) > 1 else np.zeros(1)
        for place, rule in zip(places, rules, strict=True):
            look = rule_look(rule) | {"markersize": 3.2, "elinewidth": 0.9}
            found = mean_interval(100 * gain(chosen, rule))
            interval_mark(axes, found, band + place, 1.0, look, upright=True)
    for edge in range(1, len(STRATA)):
        axes.axvline(edge - 0.5, color=BAND_GREY, linewidth=0.6, zorder=0)
    axes.axhline(0.0, color=ZERO, linewidth=0.8, zorder=0)
    axes.grid(visible=False, axis="x")
    axes.tick_params(axis="x", length=0)
    axes.set_xticks(range(len(STRATA)), [name.removesuffix(" points") for name in STRATA])
    axes.set(xlim=(-0.5, len(STRATA) - 0.5), xlabel="headroom, of the plan [%]")


def _costs(axes: Axes, panel: Panel, pairs: Mapping[str, pd.DataFrame]) -> None:
    """Mean of what each rule adds to a cost, a mark per controller."""
    shifts = np.linspace(-0.3, 0.3, len(pairs)) if len(pairs) > 1 else np.zeros(1)
    for shift, (controller, events) in zip(shifts, pairs.items(), strict=True):
        for rule in rules_of(events)[1:]:
            look = rule_look(rule) | {"markersize": 3.6, "elinewidth": 0.9}
            look |= controller_fill(controller)
            found = mean_interval(gain(events, rule, panel.metric))
            place = HEADROOM_RULES.index(rule) - 1 + shift
            interval_mark(axes, found, place, panel.factor, look)
    zero_line(axes)
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlabel(panel.label)
    bare_rows(axes)
