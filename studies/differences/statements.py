"""Thresholds, verdicts and numbers of the study of differences."""

import math

import pandas as pd

from studies.core.statement import Interval, Statement, mean_interval, share_interval
from studies.core.verdict import LEAST_EVENTS, Bound, decide, decided, with_and_without

MATTERS = 0.01
"""Difference of effort, as a share of the plan, above which it matters: what a driver could notice in a timetable."""
RARE = 0.05
"""Share of problems below which a difference that matters is rare."""
EQUAL = 1e-5
"""Distance of limits, as a share of the plan, up to which two rules are the same: OSQP stops at 1e-8 of its own scale."""
UNBOUNDED = ("plain", "unequal masses", "caps not growing")
"""Kinds without torque and rate limits: there the patent's sum of limits must reach the plan."""
METRICS = {
    "held_effort": "effort over plan",
    "damage": "wheel damage [kJ]",
    "jerk_rms": "jerk rms [m/s3]",
    "slip_time": "slip [axle s]",
}


def difference_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements on a table of `studies.differences.study`."""
    good = table[table["status"] == "ok"]
    problems, events = good[good["part"] == "problem"], good[good["part"] == "event"]
    kinds = list(dict.fromkeys(problems["kind"]))
    return [
        *(_kind(kind, problems, events) for kind in kinds),
        _quadratic(problems),
        _claim_reading(problems, kinds),
    ]


def closed_loop(events: pd.DataFrame, kind: str, metric: str, rule: str) -> Interval:
    """Paired difference of a metric over the events of a kind, `rule` less exact."""
    one = events[events["kind"] == kind]
    wide = one.pivot(index="index", columns="rule", values=metric) if len(one) else one
    if not {rule, "exact"} <= set(wide):
        return mean_interval(pd.Series(dtype=float))
    return mean_interval(wide[rule] - wide["exact"])


def _kind(kind: str, problems: pd.DataFrame, events: pd.DataFrame) -> Statement:
    chosen = (problems["kind"] == kind) & (problems["rule"] == "greedy") & problems["within_reach"]
    rows = problems[chosen]
    short, over = (rows[name].astype(float) > MATTERS for name in ("short", "over"))
    said = (
        f"everywhere: short by {MATTERS:.0%} of the plan in {short.mean():.1%} of the problems, "
        f"over by it in {over.mean():.1%}"
    )
    return decided(
        f"greedy: {kind}", f"greedy delivers what the exact level does, {kind}",
        {"": Bound("", short, most=RARE)},
        {
            f"share of problems short by {MATTERS:.0%} of the plan": short,
            f"share of problems over by {MATTERS:.0%} of the plan": over,
            "shortfall over plan": rows["short"],
            "largest shortfall over plan": _largest(rows["short"]),
            "excess over plan": rows["over"],
            "largest excess over plan": _largest(rows["over"]),
            "largest distance of limits over plan, mean": rows["apart"],
            "limit beyond what bounds allow, over plan": rows["beyond"],
            **{f"closed loop: {text}, greedy less exact": closed_loop(events, kind, name, "greedy")
               for name, text in METRICS.items()},
        },
        f"problems within reach of all bounds; holds if differences of {MATTERS:.0%} of the plan are rarer than "
        f"{RARE:.0%}, with conditions if greedy only exceeds; Wilson, bootstrap of pairs, 95 %",
        {said: Bound("", over, most=RARE)},
    )  # fmt: skip


def _quadratic(problems: pd.DataFrame) -> Statement:
    rows = problems[problems["rule"] == "qp"]
    equal = share_interval(rows["apart"] <= EQUAL)
    return decided(
        "qp", "the quadratic program gives the exact level, with all bounds", {"": equal.value == 1.0},
        {
            f"share of problems within {EQUAL:g} of the plan": equal,
            "largest distance of limits over plan": _largest(rows["apart"]),
        },
        "holds if it does in every problem; Wilson, 95 %", enough=len(rows) >= LEAST_EVENTS,
    )  # fmt: skip


def _claim_reading(problems: pd.DataFrame, kinds: list[str]) -> Statement:
    unbounded = problems[problems["kind"].isin(UNBOUNDED) & (problems["case"] == "B")]
    shares = {
        (rule, kind): share_interval(rows["unmet"].astype(bool))
        for rule in ("greedy-claim", "greedy")
        for kind in kinds
        if kind in UNBOUNDED
        for rows in [unbounded[(unbounded["rule"] == rule) & (unbounded["kind"] == kind)]]
    }
    claimed = {kind: share for (rule, kind), share in shares.items() if rule == "greedy-claim"}
    met = {kind: share.value == 0.0 for kind, share in claimed.items() if share.count}
    enough = sum(share.count for share in claimed.values()) >= LEAST_EVENTS
    return Statement(
        "claim 1", "the reading of claim 1 meets the plan in case B",
        decide(met.values(), partly=any(met.values()), enough=enough),
        {f"share of case B that it falls short, {rule}, {kind}": share for (rule, kind), share in shares.items()},
        () if all(met.values()) else with_and_without(met),
        "sum of the limits below that of the plan though the mean cap exceeds it; holds if it never happens; Wilson, 95 %",
    )  # fmt: skip


def _largest(values: "pd.Series[float]") -> Interval:
    """The largest value; it has no interval."""
    return Interval(float(values.max()), math.nan, math.nan, len(values))
