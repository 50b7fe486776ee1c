"""The claims of JP5484215 over random events: what they claim, and for which events they hold."""

from collections.abc import Mapping

import numpy as np
import pandas as pd
from matplotlib.axes import Axes
from matplotlib.figure import Figure

from paper_figs.counts import counted
from paper_figs.palette import DARK
from paper_figs.registry import figure
from paper_figs.source import study
from paper_figs.style import (
    BOUND,
    NOTE,
    PAGE,
    bare_rows,
    interval_mark,
    name_rows,
    new_panels,
    rule_handles,
    rule_look,
    sides_of,
)
from paper_figs.verdicts import Strip, verdict_strips
from studies.claims.measures import EXCESS_EDGES, RANGES, excess_column
from studies.claims.statements import (
    ARMS,
    PARTS,
    REACH_PARTS,
    REACHED,
    USED_LEAST,
    USED_OVER,
    WITHIN_REACH,
    claim_statements,
    claims_of,
    pairs_of,
    statement_name,
)
from studies.core.arms import COMPARED, Arm
from studies.core.claims import Claim, number, quantity
from studies.core.drawn_events import complete
from studies.core.statement import CONFIDENCE, mean_interval
from studies.core.verdict import LEAST_EVENTS

FEW_EVENTS = 24
"""Events that are run where the results have fewer: enough to show the form of a figure, not to support a conclusion.
`readhesion sweep claims` runs as many as the statements need."""
CLAIM_TABLE = study("claims", FEW_EVENTS)
RULE, CONTROLLER = "greedy-literal", "cut-and-ramp"
"""Of which these figures show the claims: the patent as printed."""
OWN = claims_of(Arm(RULE, CONTROLLER))
SEASON_MARKERS = {"summer": ("o", "#222222"), "winter": ("s", "#999999")}
"""Marker and colour of a season; greys, since colours represent rules."""
SHARE_95 = 0.95
"""Share of the adhesion that claim (c) says is used."""
AXES = {
    "a": ("(a) reaches the plan where alone does not", "effort over plan, at most 100 [%]", 100.0),
    "b": (
        "(b) every unit at about its bound",
        "adhesion used by the unit that uses least [%]",
        100.0,
    ),
    "c": (
        "(c) about 95 % used when a cap is too high",
        "adhesion used, limit up to 15 % too high [%]",
        100.0,
    ),
    "d": ("(d) better ride than sharing", "jerk rms less sharing [m/s³]", 1.0),
    "e": ("(e) better than the preset", "effort over plan less that of the preset [%]", 100.0),
}
"""Claim -> title, label of its metric, factor to the label's unit."""
WIDTHS = {"width_ratios": (1.0, 0.8)}


@figure("claim-verdicts", "claims (a) to (e) of JP5484215 under cut-and-ramp: each verdict over its threshold",
        CLAIM_TABLE)  # fmt: skip
def claim_verdicts(table: pd.DataFrame) -> Figure:
    """One panel per claim: the mean that decides, with its interval and that after Holm."""
    return _verdicts(table, COMPARED[0])


@figure("claim-verdicts-search", "claims (a) to (e) of JP5484215 under perturb-observe: each verdict over its threshold",
        CLAIM_TABLE)  # fmt: skip
def claim_verdicts_search(table: pd.DataFrame) -> Figure:
    """As `claim_verdicts`, under the controller that searches for the peak."""
    return _verdicts(table, COMPARED[1])


def _verdicts(table: pd.DataFrame, controller: str) -> Figure:
    """Verdicts of the rules under `controller`, after Holm over those under all controllers."""
    found = {s.name: s for s in claim_statements(complete(table))}
    shown = [arm for arm in ARMS if arm.controller == controller]
    return verdict_strips(
        Strip(*AXES[claim], {arm.rule: found[statement_name(claim, arm)] for arm in shown})
        for claim in AXES
    )


@figure("claim-a", "claim (a) of JP5484215 over random events: the plan reached where alone does not",
        CLAIM_TABLE)  # fmt: skip
def claim_a(table: pd.DataFrame) -> Figure:
    """Left: effort under alone against other rules, one mark per event within reach. Right: the claim's mean by part."""
    rules = (RULE, "exact", "oracle")
    pairs, events = _bearing_on(table, "a")
    reach = pairs[quantity(pairs, WITHIN_REACH)]
    drawn, (left, right) = new_panels(PAGE, 3.7, 1, 2, **WIDTHS)
    alone = 100 * reach["held_effort@alone"]
    for rule in rules:
        _points(left, alone, 100 * reach[f"held_effort@{rule}"], **rule_look(rule))
    _diagonal(left)
    left.axhline(100 * REACHED, **BOUND)
    left.axvline(100 * REACHED, **BOUND)
    left.set(xlabel="effort over plan, alone [%]", ylabel="effort over plan, other rules [%]")
    left.set_title(f"{len(reach)} of {len(pairs)} events within reach")
    left.legend(handles=rule_handles(rules), loc="lower right")
    _forest(right, events, OWN["a"], f"effort over plan, {RULE} [%]", 100.0)
    right.set_title("alone below the line")
    return drawn


@figure("claim-b", "claim (b) of JP5484215 over random events: in case A every unit at its bound",
        CLAIM_TABLE)  # fmt: skip
def claim_b(table: pd.DataFrame) -> Figure:
    """Left: adhesion used by the unit that uses least, one mark per event of case A. Right: its mean by part."""
    rules = ("alone", "preset", "sharing", RULE, "exact", "oracle")
    pairs, events = _bearing_on(table, "b")
    drawn, (left, right) = new_panels(PAGE, 3.7, 1, 2, **WIDTHS)
    spread = np.random.default_rng(0)
    for x, rule in enumerate(rules):
        known = 100.0 * events[f"unit_use_low@{rule}"].dropna().to_numpy(dtype=float)
        offset = spread.uniform(-0.28, 0.28, known.size)
        left.plot(x + offset, known, markersize=2.0, alpha=0.5, **rule_look(rule))
        if known.size:
            left.plot([x - 0.35, x + 0.35], 2 * [np.median(known)], color="black", linewidth=1.2)
    left.set_xticks(range(len(rules)), [rule.replace("-", "-\n") for rule in rules])
    left.grid(visible=False, axis="x")
    left.axhline(100 * USED_LEAST, **BOUND)
    left.set_ylabel("adhesion used by the unit that uses least [%]")
    left.set_title(f"{len(events)} of {len(pairs)} events out of reach")
    _forest(right, events, OWN["b"], f"adhesion used, {RULE} [%]", 100.0)
    return drawn


@figure("claim-c", "claim (c) of JP5484215 over random events: adhesion used under caps too high",
        CLAIM_TABLE)  # fmt: skip
def claim_c(table: pd.DataFrame) -> Figure:
    """Left: adhesion used over the excess of a limit, one mark per event. Right: its mean by part."""
    rules = {RULE: -0.7, "exact": 0.7}
    pairs, events = _bearing_on(table, "c")
    drawn, (left, right) = new_panels(PAGE, 3.7, 1, 2, **WIDTHS)
    for rule, shift in rules.items():
        look = rule_look(rule)
        for k in range(len(EXCESS_EDGES) - 1):
            centre = 50.0 * (EXCESS_EDGES[k] + EXCESS_EDGES[k + 1]) + shift
            values = 100.0 * events[f"{excess_column(k)}@{rule}"].dropna()
            left.plot([centre] * len(values), values, **{**look, "marker": "_"}, alpha=0.15)
            mean = mean_interval(values)
            if mean.count >= LEAST_EVENTS:
                counted(left, [mean])
                error = sides_of(mean, 1.0)
                left.errorbar(centre, mean.value, error, markersize=5.0, elinewidth=1.2, **look)
    left.axhline(100 * SHARE_95, color="black", linewidth=0.8, zorder=0)
    left.axhline(100 * USED_OVER, **BOUND)
    left.set_xticks([100 * edge for edge in EXCESS_EDGES])
    left.set(xlabel="limit above the true adhesion by [%]", ylabel="adhesion used there [%]")
    left.set(ylim=(75.0, 101.0), title=f"{len(events)} of {len(pairs)} events")
    left.legend(handles=rule_handles(rules), loc="lower right")
    right.set_title("limit up to 15 % too high")
    _forest(right, events, OWN["c"], f"adhesion used, {RULE} [%]", 100.0)
    return drawn


@figure("claim-d", "claim (d) of JP5484215 over random events: jerk against dynamic sharing",
        CLAIM_TABLE)  # fmt: skip
def claim_d(table: pd.DataFrame) -> Figure:
    """Left: jerk under sharing against jerk under the patent's rule, one mark per event. Right: difference by part."""
    pairs, events = _bearing_on(table, "d")
    drawn, (left, right) = new_panels(PAGE, 3.7, 1, 2, **WIDTHS)
    _by_season(left, events, events["jerk_rms@sharing"], events[f"jerk_rms@{RULE}"])
    _diagonal(left)
    left.set(xlabel="jerk rms, sharing [m/s³]", ylabel=f"jerk rms, {RULE} [m/s³]")
    left.set_title(f"{len(events)} of {len(pairs)} events with slip")
    left.legend(loc="lower right")
    _forest(right, events, OWN["d"], "jerk rms less sharing [m/s³]")
    return drawn


@figure("claim-e", "claim (e) of JP5484215 over random events: effort and slip against the preset",
        CLAIM_TABLE)  # fmt: skip
def claim_e(table: pd.DataFrame) -> Figure:
    """Left: paired difference of effort over the adhesion available, one mark per event. Right: effort and slip by part."""
    pairs, events = _bearing_on(table, "e")
    parts = {**PARTS, **REACH_PARTS}
    effort = OWN["e"]
    (slip,) = effort.besides
    drawn, (left, middle, right) = new_panels(PAGE, 3.7, 1, 3, width_ratios=(1.0, 0.55, 0.55))
    _by_season(left, events, 100 * events["reach_low@oracle"], 100 * effort.values(events))
    left.axhline(0.0, **BOUND)
    left.axvline(100.0, color=DARK, linewidth=0.8, zorder=0)
    left.set_xlabel("adhesion of all units over plan [%]")
    left.set_ylabel(f"effort over plan, {RULE} less preset [%]")
    left.set_title(f"{len(events)} of {len(pairs)} events")
    left.legend(loc="lower right")
    _forest(middle, events, effort, "effort [%]", 100.0, parts)
    _forest(right, events, slip, "slip, axle seconds [s]", parts=parts)
    right.set_yticklabels([])
    for narrow in (middle, right):
        narrow.locator_params(axis="x", nbins=3)
    return drawn


def _bearing_on(table: pd.DataFrame, claim: str) -> tuple[pd.DataFrame, pd.DataFrame]:
    """All events of the sweep, one row each, and those that bear on a claim."""
    whole = complete(table)
    pairs = pairs_of(whole[whole["controller"] == CONTROLLER])
    return pairs, OWN[claim].bearing(pairs)


def _points(axes: Axes, x: "pd.Series[float]", y: "pd.Series[float]", **look: str) -> None:
    axes.plot(x, y, markersize=3.0, alpha=0.7, **look)  # type: ignore[arg-type]


def _by_season(
    axes: Axes, events: pd.DataFrame, x: "pd.Series[float]", y: "pd.Series[float]"
) -> None:
    for season, (marker, colour) in SEASON_MARKERS.items():
        own = events["season"] == season
        _points(axes, x[own], y[own], linestyle="none", marker=marker, color=colour, label=season)


def _diagonal(axes: Axes) -> None:
    """The line on which both rules are alike, and the same bounds for both axes."""
    bounds = [*axes.get_xlim(), *axes.get_ylim()]
    ends = min(bounds), max(bounds)
    axes.plot(ends, ends, color=DARK, linewidth=0.8, zorder=0)
    axes.set(xlim=ends, ylim=ends)


def _forest(
    axes: Axes,
    events: pd.DataFrame,
    claim: Claim,
    label: str,
    factor: float = 1.0,
    parts: Mapping[str, str] = PARTS,
) -> None:
    """The quantity of a claim over all its events, with its 95 % interval, and over each part, after Bonferroni.

    Parts of fewer than `LEAST_EVENTS` events are named, but have no mark. `factor`: to the label's unit.
    """
    confidence = 1.0 - (1.0 - CONFIDENCE) / len(parts)
    found = {"all": number(events, claim.mean, RANGES)} | {
        name: number(events[quantity(events, part)], claim.mean, RANGES, confidence)
        for name, part in parts.items()
    }
    for y, interval in enumerate(found.values()):
        if interval.count >= LEAST_EVENTS:
            size = {"markersize": 3.5 if y else 5.5, "elinewidth": 0.8 if y else 1.3}
            interval_mark(axes, interval, y, factor, rule_look(RULE) | size)
    name_rows(axes, [f"{name} ({interval.count})" for name, interval in found.items()])
    axes.axvline(factor * claim.value, **BOUND)
    axes.axhline(0.5, color="#bbbbbb", linewidth=0.6)
    bare_rows(axes)
    axes.tick_params(axis="y", labelsize=NOTE)
    axes.margins(x=0.08)
    axes.locator_params(axis="x", nbins=5)
    axes.set_xlabel(label)
