"""Allocation rules beside each other: limits of one problem (JP5484215 Fig. 6), and differences over events."""

import math
from collections.abc import Mapping, Sequence
from itertools import product

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.colors import Normalize
from matplotlib.figure import Figure
from numpy.typing import NDArray

from alloc.metrics import METRICS
from alloc.plant.rail import logarithmic_increments
from alloc.rules import RULES, Allocation, AllocationProblem, find_rule
from paper_figs.drawing import comparison, figure, study
from paper_figs.style import (
    BAND_GREY,
    BLACK,
    BOUND,
    DARK,
    NOTE,
    PAGE,
    WORSE_TO_BETTER,
    ZERO,
    Look,
    Panel,
    bare_rows,
    bare_table,
    controller_fill,
    controller_handles,
    handle,
    interval_mark,
    legend_below,
    name_rows,
    new_figure,
    new_panels,
    number_cell,
    remark,
    rule_colour,
    rule_handles,
    rule_look,
    tint_better,
    zero_line,
)
from studies.comparison.pooled import ALL, is_marked, pooled, shared_events
from studies.comparison.summary import EFFORT, NO_MEAN, REFERENCE, SummaryLine, summarise
from studies.core.drawn_events import complete
from studies.core.statement import LEAST_SHOWN, Interval, mean_interval
from studies.ladder.equal_effort_study import ARMS, MPC, SEARCH
from studies.ladder.equal_effort_study import BASE as SEARCHER
from studies.ladder.equal_effort_study import BEST as CHOSEN_ARM
from studies.ladder.equal_effort_study import pairs_of as pairs_of_arms
from studies.patent.differences_study import closed_loop
from studies.patent.headroom_study import RULES as HEADROOM_RULES
from studies.patent.headroom_study import STRATA, gain, in_stratum, pairs_of, rules_of
from studies.patent.information_study import DEMANDS, LEVELS, column
from studies.patent.information_study import pairs_of as pairs_of_information
from studies.patent.robustness_study import LOSSES, NOISES
from studies.patent.robustness_study import RULES as ROBUST_RULES
from studies.patent.robustness_study import column as robust_column
from studies.patent.robustness_study import pairs_of as robust_pairs

UNITS, AXLES_PER_UNIT = 8, 4
EXPECTED = 0.170
"""Planned coefficient of the readhesion paper's scenario (3.0 km/h/s)."""
HIGH, LOW = 0.160, 0.145
"""Coefficient found by the foremost unit: above and below the value at which the train can just meet the plan."""
DOT: Look = {"marker": "o", "markersize": 3.2, "linestyle": "none"}
SAME = (
    "plan-times", "uniform", "qp-daqp", "qp-robust", "greedy-printed", "greedy-literal", "greedy-tuned", "cooperative",
    "wear", "wear-qp", "wear-cvxpy", "preview",
)  # fmt: skip
"""Rules that ask all units for the same, or answer as others where they are only called: as `qp`, `greedy` and `exact`; and
those that need the marks of a run."""
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


DIFFERENCES = (
    Panel(EFFORT, "used of the bound,\nless alone's [%]", 100.0),
    Panel("over_delivery", "over plan,\nless alone's [%]", 100.0),
    Panel("damage", "wheel damage Q,\nless alone's [kJ]"),
    Panel("slip_time", "slip over axles,\nless alone's [s]"),
    Panel("jerk_rms", "jerk rms,\nless alone's [m/s³]"),
)
"""Metrics of which each rule's difference from `REFERENCE` is shown."""
ROW, AROUND = 0.115, 1.1
"""Height [inches] of a controller's mark in a rule's row, and of what stands around the rows."""
MARK: Look = {"markersize": 3.8, "elinewidth": 1.0, "markeredgewidth": 0.6}
EVENT_MARK: Look = {"marker": "o", "markersize": 1.6, "markeredgewidth": 0.0, "alpha": 0.35}
"""Of one event, below the mean of all."""
PALE = 0.35
"""Opacity of a mark that is not to be ranked."""
MIDDLE = (0.05, 0.95)
"""Share of the events' marks that an axis shows at least; one far event would leave no room for the others."""
NO_PAIRS = f"differences need the\nrule {REFERENCE} beside others"


def by_gain(lines: Sequence[SummaryLine]) -> list[str]:
    """Rules but `REFERENCE`, the one first that gains most of the bound on the mean over controllers."""
    gains: dict[str, list[float]] = {}
    for line in lines:
        if line.rule != REFERENCE:
            gains.setdefault(line.rule, []).append(_gain(line).value)
    return sorted(gains, key=lambda rule: -float(np.nan_to_num(np.mean(gains[rule]), nan=-1e9)))


def _gain(line: SummaryLine) -> Interval:
    return line.differences.get(EFFORT, NO_MEAN)


@figure("rule-comparison", "rules over all events together: what each uses of the bound and costs, less that of alone",
        comparison)  # fmt: skip
def rule_comparison(table: pd.DataFrame) -> Figure:
    """Mean of paired differences from alone over the events, with its interval: how much events differ. Dots are events.

    A row per rule, a mark per controller. The better side is tinted. Pale: more than 1 % is delivered beyond the plan.
    ° knows the rail, as nobody on board can.
    """
    lines = summarise(table)
    means = pooled(lines)
    rules, controllers = by_gain(means), list(dict.fromkeys(line.controller for line in lines))
    panels = [one for one in DIFFERENCES if any(one.metric in line.metrics for line in means)]
    height = AROUND + ROW * max((len(controllers) + 1) * len(rules), 6)
    drawn, row = new_panels(PAGE, height, 1, len(panels), sharey=True, squeeze=False)
    far = sum(
        _forest(axes, panel, lines, means, rules)
        for axes, panel in zip(row[0], panels, strict=True)
    )
    name_rows(row[0, 0], _names(rules))
    if far:
        remark(row[0, 0], f"{far} dots lie beyond the axes.")
    legend_below(drawn, controller_handles(controllers))
    return drawn


def _forest(
    axes: Axes, panel: Panel, lines: Sequence[SummaryLine], means: Sequence[SummaryLine], rules: Sequence[str]
) -> int:  # fmt: skip
    """Means and events of one metric; gives how many events lie beyond the axis."""
    controllers = list(dict.fromkeys(line.controller for line in lines))
    ends, dots = [0.0], [0.0]
    for k, controller in enumerate(controllers):
        own = [line for line in lines if line.controller == controller]
        shared = shared_events(own)
        offset = (k - 0.5 * (len(controllers) - 1)) / (len(controllers) + 1)
        for line in means:
            found = line.differences.get(panel.metric, NO_MEAN)
            if line.controller != controller or not math.isfinite(found.value):
                continue
            place, look = rules.index(line.rule) + offset, rule_look(line.rule)
            single = [one.differences[panel.metric].value for one in own
                      if one.rule == line.rule and one.scenario in shared and one.differences]  # fmt: skip
            values = panel.factor * np.array([one for one in single if math.isfinite(one)])
            dot = look | EVENT_MARK | {"gid": f"{line.rule}, an event"}
            axes.plot(values, np.full(values.size, place), **dot)
            look |= controller_fill(controller) | MARK
            look |= {"alpha": PALE} if is_marked(line) else {}
            interval_mark(axes, found, place, panel.factor, look)
            dots += values.tolist()
            known = [one for one in (found.value, found.low, found.high) if math.isfinite(one)]
            ends += [panel.factor * one for one in known]
    low, high = np.quantile(dots, MIDDLE)
    low, high = min(low, *ends), max(high, *ends)
    room = 0.06 * (high - low) or 1.0
    axes.set_xlim(low - room, high + room)
    axes.locator_params(axis="x", nbins=4)
    axes.set_xlabel(panel.label)
    tint_better(axes, METRICS[panel.metric].better)
    zero_line(axes)
    bare_rows(axes)
    for k in range(1, len(rules)):
        axes.axhline(k - 0.5, color=BAND_GREY, linewidth=0.5, zorder=-1)
    if not any(line.differences for line in means):
        axes.text(0.5, 0.5, NO_PAIRS, transform=axes.transAxes, ha="center", va="center")
    return sum(not low - room <= one <= high + room for one in dots)


def _names(rules: Sequence[str]) -> list[str]:
    """Rules, with a mark at those that know the rail; of a rule that is no longer there it is not known."""
    return [f"{rule}°" if rule in RULES and RULES[rule].needs_truth else rule for rule in rules]


FULL = 5.0
"""Difference of the strongest colour [% of the bound]."""
LINE_HEIGHT, TITLE_HEIGHT, NAMES_HEIGHT = 0.155, 0.34, 1.0
"""Heights [inches] of a row of cells, of a controller's title, and of the rules' names with what stands below the cells."""
MOST_HEIGHT = 9.6
"""Height [inches] up to which rows keep theirs; of more events or controllers they are lower."""


@figure(
    "rule-events",
    "rules event by event: what each uses of the bound more than alone",
    comparison,
    events="seeds",
)
def rule_events(table: pd.DataFrame) -> Figure:
    """A panel per controller: points of the bound used, less alone's, over all events and in each. Blue is better.

    White: the interval over five seeds or more includes zero. An event with fewer has no interval, and one in which nothing
    is drawn needs none. * delivers more than 1 % beyond the plan. ° knows the rail, as nobody on board can.
    """
    lines = summarise(table)
    means = pooled(lines)
    rules, controllers = by_gain(means), list(dict.fromkeys(line.controller for line in lines))
    scenarios = list(dict.fromkeys(line.scenario for line in lines))
    rows = [ALL, *scenarios]
    around = NAMES_HEIGHT + TITLE_HEIGHT * len(controllers)
    height = min(around + LINE_HEIGHT * len(rows) * len(controllers), MOST_HEIGHT)
    drawn, panels = new_panels(PAGE, height, len(controllers), 1, sharex=True, squeeze=False)
    scale = Normalize(-FULL, FULL)
    for axes, controller in zip(panels[:, 0], controllers, strict=True):
        for line in [one for one in (*means, *lines) if one.controller == controller]:
            found = _gain(line)
            if line.rule == REFERENCE or not math.isfinite(found.value):
                continue
            gain = 100.0 * found.value
            open_ = found.count >= LEAST_SHOWN and found.low <= 0.0 <= found.high
            words = f"{round(gain, 1) + 0.0:+.1f}".replace("-", "\N{MINUS SIGN}")
            number_cell(axes, rules.index(line.rule), rows.index(line.scenario), (0.96, 0.92),
                        0.5 if open_ else float(scale(gain)), WORSE_TO_BETTER, words + "*" * is_marked(line))  # fmt: skip
        name_rows(axes, rows)
        axes.axhline(0.5, color=DARK, linewidth=0.8)
        axes.set(title=controller, ylabel="event")
        axes.set_xlim(-0.5, max(len(rules), 1) - 0.5)
        bare_table(axes)
        if not any(line.differences for line in means):
            axes.text(0.5, 0.5, NO_PAIRS, transform=axes.transAxes, ha="center", va="center")
    last = panels[-1, 0]
    last.set_xticks(range(len(rules)), _names(rules), rotation=90)
    for text, rule in zip(last.get_xticklabels(), rules, strict=True):
        text.set_color(rule_colour(rule))
    last.set_xlabel("used of the bound, less that of alone [%]")
    return drawn


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
    legend_below(above, [*rule_handles(HEADROOM_RULES[1:]), handle("the headroom", **BOUND)], 5)
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


@figure("information", "wheel damage over effort by what a rule is told: own sensors, reports, the truth",
        study("information"), events="starts")  # fmt: skip
def information(table: pd.DataFrame) -> Figure:
    """Above, a panel per controller: mean effort and mean wheel damage at each demand of the driver; a line is a front.

    Below: effort and wheel damage at demand 1, less those with own sensors alone, paired by start (better side tinted).
    """
    controllers, levels = list(dict.fromkeys(table["controller"])), list(LEVELS)
    pairs = pairs_of_information(table)
    looks: dict[str, Look] = {
        level: {
            "color": LEVEL_COLOURS(k / (len(levels) - 0.5)),
            "marker": "osD^vPX"[k],
            "markersize": 4.0,
        }
        for k, level in enumerate(levels)
    }
    drawn = new_figure(PAGE, 5.0)
    above, below = np.asarray(drawn.subfigures(2, 1, height_ratios=[1.5, 1.0])).tolist()
    fronts = above.subplots(1, len(controllers), sharex=True, sharey=True, squeeze=False)[0]
    for axes, controller in zip(fronts, controllers, strict=True):
        for level, look in looks.items():
            points = [
                [
                    factor * pairs[column(metric, controller, level, demand)].mean()
                    for demand in DEMANDS
                ]
                for metric, factor in (("effort", 100.0), ("damage", 1.0))
            ]
            axes.plot(*points, **look, linewidth=1.0, gid=level)
        least = _least_damage(pairs, controller)
        axes.plot(*least, color=BLACK, linestyle="--", linewidth=1.0, gid=LEAST)
        axes.set(title=controller, xlabel="effort, of the plan at demand 1 [%]")
    fronts[0].set_ylabel("wheel damage Q [kJ]")
    handles = [handle(level, **look) for level, look in looks.items()]
    legend_below(above, [*handles, handle(LEAST, color=BLACK, linestyle="--", linewidth=1.0)], 4)
    costs = below.subplots(1, 2, sharey=True)
    for axes, (metric, words, factor, better) in zip(costs, OF_INFORMATION, strict=True):
        for y, level in enumerate(levels[1:]):
            for controller, shift in zip(
                controllers, np.linspace(-0.2, 0.2, len(controllers)), strict=True
            ):
                less = (
                    pairs[column(metric, controller, level)]
                    - pairs[column(metric, controller, levels[0])]
                )
                look = looks[level] | {
                    "elinewidth": 0.9,
                    "linestyle": "none",
                    "gid": f"{level}, {controller}",
                }
                interval_mark(
                    axes,
                    mean_interval(less),
                    y + shift,
                    factor,
                    look | controller_fill(controller),
                )
        axes.set_xlabel(words)
        tint_better(axes, better)
        zero_line(axes)
        bare_rows(axes)
    name_rows(costs[0], levels[1:])
    legend_below(below, controller_handles(controllers))
    return drawn


def _least_damage(pairs: pd.DataFrame, controller: str) -> tuple[list[float], list[float]]:
    """Effort of who knows the truth [%], and the least wheel damage [kJ] at which it can be had, at each demand."""
    least = []
    for demand in DEMANDS:
        damage, excess = (
            pairs[column(metric, controller, "truth", demand)]
            for metric in ("damage", "excess_damage")
        )
        least.append(float((damage / (1.0 + excess)).mean()))
    effort = [100.0 * pairs[column("effort", controller, "truth", one)].mean() for one in DEMANDS]
    return effort, least


LEAST = "least damage, by the truth"
LEVEL_COLOURS = mpl.colormaps["viridis"]
OF_INFORMATION = (
    ("effort", "effort over plan, less own sensors [%]", 100.0, 1),
    ("damage", "wheel damage, less own sensors [kJ]", 1.0, -1),
)
"""Metric, label, factor to its unit, and the better side."""


FEW_STARTS = 1
"""Starts that are run for the figure where the results have none; each has 96 runs."""


@figure("robustness", "what each rule uses of the bound under lost telegrams and noisy speeds (sweep robustness)",
        study("robustness", FEW_STARTS), events="starts")  # fmt: skip
def robustness(table: pd.DataFrame) -> Figure:
    """A column per controller, each panel with a scale of its own; a line per share of lost telegrams over the noise.

    Above: mean use of the bound under cooperative; the dashed line is alone, without loss. Below: cooperative less alone at
    the same loss and noise, paired by start. The places of the noise are evenly spaced.
    """
    controllers, pairs = list(dict.fromkeys(table["controller"])), robust_pairs(table)
    base, sharing = ROBUST_RULES
    drawn, axes = new_panels(PAGE, 4.4, 2, len(controllers), sharex=True, squeeze=False)
    shifts, marks = np.linspace(-0.18, 0.18, len(LOSSES)), "osD^"
    looks: list[Look] = [
        {"color": LEVEL_COLOURS(k / (len(LOSSES) - 0.5)), "marker": marks[k], "markersize": 3.6}
        for k in range(len(LOSSES))
    ]
    for controller, (used, gained) in zip(controllers, axes.T, strict=True):
        alone = [100.0 * pairs[robust_column(EFFORT, controller, base, 0.0, one)].mean() for one in NOISES]  # fmt: skip
        used.plot(range(len(NOISES)), alone, **BOUND, gid=base)
        for loss, shift, look in zip(LOSSES, shifts, looks, strict=True):
            own, less = (
                [pairs[robust_column(EFFORT, controller, rule, loss, one)] for one in NOISES]
                for rule in (sharing, base)
            )
            gains = [one - other for one, other in zip(own, less, strict=True)]
            for one, values in ((used, own), (gained, gains)):
                found = [mean_interval(value) for value in values]
                places, gid = np.arange(len(NOISES)) + shift, f"{100 * loss:g} % lost"
                for place, mean in zip(places, found, strict=True):
                    bar = look | {"elinewidth": 0.8, "linestyle": "none", "gid": gid}
                    interval_mark(one, mean, place, 100.0, bar, upright=True)
                line = {"color": look["color"], "linewidth": 0.8, "gid": gid}
                one.plot(places, [100.0 * mean.value for mean in found], **line)
        gained.axhline(0.0, color=ZERO, linewidth=0.8, zorder=0)
        gained.set_xticks(range(len(NOISES)), [f"{one:g}" for one in NOISES])
        used.set_title(controller)
    axes[0, 0].set_ylabel("used of the bound [%]")
    axes[1, 0].set_ylabel("used of the bound,\nless alone's [%]")
    axes[1, len(controllers) // 2].set_xlabel("noise of measured speeds [km/h]")
    lost = [
        handle(f"{100 * loss:g} %", **look, linewidth=0.8)
        for loss, look in zip(LOSSES, looks, strict=True)
    ]
    legend_below(drawn, [handle("telegrams lost:", linestyle="none"), *lost, handle(base, **BOUND)])
    return drawn


@figure("equal-effort", "wheel damage over effort: a search, and the MPC by its price of friction (sweep equal-effort)",
        study("equal-effort", FEW_STARTS), events="starts")  # fmt: skip
def equal_effort(table: pd.DataFrame) -> Figure:
    """Left: wheel damage over effort, both less those of cooperative with perturb-observe, paired by start.

    A line is the MPC under one rule over its price of friction [s/m]; a point by itself is the search. Right: the excess of
    wheel damage over the least at the same effort, over the same effort.
    """
    pairs = pairs_of_arms(table)
    drawn, axes = new_panels(PAGE, 2.8, 1, 2, sharex=True)
    rules = dict.fromkeys(arm.rule for arm in ARMS)
    for rule, controller in product(rules, (SEARCH, MPC)):
        own = [arm for arm in ARMS if (arm.rule, arm.controller) == (rule, controller)]
        effort = [
            mean_interval(100.0 * (pairs[arm.of(EFFORT)] - pairs[SEARCHER.of(EFFORT)]))
            for arm in own
        ]
        base = pairs[SEARCHER.of("damage")]
        damage = [mean_interval((pairs[arm.of("damage")] - base) / base.mean()) for arm in own]
        excess = [mean_interval(pairs[arm.of("excess_damage")]) for arm in own]
        look = rule_look(rule) | controller_fill(controller) | {"markersize": 4.0}
        for one, costs in zip(axes, (damage, excess), strict=True):
            for x, y in zip(effort, costs, strict=True):
                interval_mark(
                    one,
                    y,
                    x.value,
                    100.0,
                    look | {"elinewidth": 0.8, "linestyle": "none", "gid": f"{rule}, {controller}"},
                    upright=True,
                )
            line = {"color": look["color"], "linewidth": 0.8, "gid": f"{rule}, {controller}"}
            one.plot([x.value for x in effort], [100.0 * y.value for y in costs], **line)
            for arm, x, y in zip(own, effort, costs, strict=True):
                if arm.price and rule == CHOSEN_ARM.rule:
                    one.annotate(
                        f"{arm.price:g}",
                        (x.value, 100.0 * y.value),
                        (4, 2),
                        textcoords="offset points",
                        fontsize=NOTE,
                    )
    axes[0].set_ylabel("wheel damage, less the search's [%]")
    axes[1].set_ylabel("excess of wheel damage [%]")
    for one in axes:
        one.set_xlabel("used of the bound, less the search's [%]")
        one.axvline(0.0, color=ZERO, linewidth=0.8, zorder=0)
    legend_below(drawn, [*rule_handles(rules), *controller_handles((SEARCH, MPC))])
    return drawn
