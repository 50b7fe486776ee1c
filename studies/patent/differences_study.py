"""Where greedy, exact level and QP differ: thousands of random problems, and some closed-loop events of each kind."""

import math
from dataclasses import replace

import pandas as pd

from studies.core.cell import Cell, Task
from studies.core.claims import AT_LEAST, AT_MOST, Claim, conjunction
from studies.core.job import Job
from studies.core.statement import LEAST_EVENTS, Interval, Statement, in_words, mean_interval
from studies.core.study import Study
from studies.patent.claim_measures import measure
from studies.patent.difference_problems import EVENTS, KINDS, RULES, event, event_name, problem_rows

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
BEYOND = f"by {MATTERS:.0%} of the plan"


def closed_loop(events: pd.DataFrame, kind: str, metric: str, rule: str) -> Interval:
    """Paired difference of a metric over the events of a kind, `rule` less exact."""
    one = events[events["kind"] == kind]
    wide = one.pivot(index="index", columns="rule", values=metric) if len(one) else one
    if not {rule, "exact"} <= set(wide):
        return mean_interval(pd.Series(dtype=float))
    return mean_interval(wide[rule] - wide["exact"])


def _greedy(kind: str) -> Claim:
    only = f"kind == '{kind}' and rule == greedy and within_reach == 1"
    over = Claim(
        "everywhere", mean=f"over > {MATTERS}", side=AT_MOST, value=RARE, only=only,
        reason="what exceeds the plan is seldom noticed",
    )  # fmt: skip
    return Claim(
        f"greedy: {kind}", f"greedy delivers what the exact level does, {kind}", f"short > {MATTERS}", AT_MOST, RARE,
        only=only, besides=(over,), reason="a difference that matters is rare",
        numbers={
            f"share of problems short {BEYOND}": f"short > {MATTERS}",
            f"share of problems over {BEYOND}": f"over > {MATTERS}",
            "shortfall over plan": "short", "excess over plan": "over",
            "largest distance of limits over plan, mean": "apart", "limit beyond what bounds allow, over plan": "'beyond'",
        },
        method=f"problems within reach of all bounds; holds if differences of {MATTERS:.0%} of the plan are rarer than "
        f"{RARE:.0%}, with conditions if greedy only exceeds; Wilson, bootstrap of pairs, 95 %",
    )  # fmt: skip


GREEDY = {kind: _greedy(kind) for kind in KINDS}
QUADRATIC = Claim(
    "qp", "the quadratic program gives the exact level, with all bounds", f"apart <= {EQUAL}", AT_LEAST, 1.0, exact=True,
    only="part == problem and rule == qp", reason="the same problem has the same answer",
    numbers={f"share of problems within {EQUAL:g} of the plan": f"apart <= {EQUAL}"},
    method="holds if it does in every problem; Wilson, 95 %",
)  # fmt: skip


def _case_b(rule: str, kind: str) -> str:
    return f"part == problem and kind == '{kind}' and case == B and rule == {rule}"


READING = Claim(
    "claim 1", "the reading of claim 1 meets the plan in case B", some=True,
    cases=tuple(
        Claim(f"with {kind}", mean="unmet == 1", side=AT_MOST, only=_case_b("greedy-claim", kind), exact=True,
              reason="a plan within reach is met")
        for kind in UNBOUNDED
    ),
    method="sum of the limits below that of the plan though the mean cap exceeds it; holds if it never happens; Wilson, "
    "95 %",
)  # fmt: skip
CLAIMS = (*GREEDY.values(), QUADRATIC, READING)
"""What is claimed, of every kind."""


def difference_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements on a table of `studies.patent.differences_study`, of the kinds that are in it."""
    good = table[table["status"] == "ok"]
    problems, events = good[good["part"] == "problem"], good[good["part"] == "event"]
    kinds = list(dict.fromkeys(problems["kind"]))
    known = tuple(one for one in READING.cases if len(one.bearing(problems)))
    enough = sum(len(one.bearing(problems)) for one in known) >= LEAST_EVENTS
    short = {
        f"share of case B that it falls short, {rule}, {kind}": f"unmet == 1 if {_case_b(rule, kind)}"
        for rule in ("greedy-claim", "greedy") for kind in kinds if kind in UNBOUNDED
    }  # fmt: skip
    return [
        *(_kind(kind, problems, events) for kind in kinds),
        conjunction(problems, QUADRATIC, numbers={
            "largest distance of limits over plan": _largest(QUADRATIC.bearing(problems)["apart"]),
        }),
        conjunction(problems, replace(READING, cases=known), numbers=short, least_events=1, enough=enough),
    ]  # fmt: skip


def _kind(kind: str, problems: pd.DataFrame, events: pd.DataFrame) -> Statement:
    claim = GREEDY[kind]
    rows = claim.bearing(problems)
    short = f"short {BEYOND} in {(rows['short'] > MATTERS).mean():.1%} of the problems"
    said = in_words(f"{short}, over by it in {{:.1%}}")
    numbers = {
        "largest shortfall over plan": _largest(rows["short"]),
        "largest excess over plan": _largest(rows["over"]),
        **{f"closed loop: {text}, greedy less exact": closed_loop(events, kind, name, "greedy")
           for name, text in METRICS.items()},
    }  # fmt: skip
    return conjunction(rows, replace(claim, besides=(replace(claim.besides[0], show=said),)), numbers=numbers)  # fmt: skip


def _largest(values: "pd.Series[float]") -> Interval:
    """The largest value; it has no interval."""
    return Interval(float(values.max()), math.nan, math.nan, len(values))


PROBLEMS_PER_EVENT = 50
"""One closed-loop event of each kind per this number of problems; at least two. Problems are answered in blocks of this
size."""


def cells(seed: int, problems: int, duration: float | None = None) -> list[Cell]:
    """`problems` of each kind, and closed-loop events of each kind; `duration` [s] shortens the events."""
    changed = {} if duration is None else {"duration_s": duration}
    size = PROBLEMS_PER_EVENT
    blocks = [(first, min(first + size, problems)) for first in range(0, problems, size)]
    return [
        *(
            Task(f"{kind}/{seed}/{block[0]}", problem_rows, (seed, kind, *block),
                 (("part", "problem"), ("kind", kind)))
            for kind in KINDS
            for block in blocks
        ),
        *(
            Job(event(seed, kind, k).changed(**changed), rule, "cut-and-ramp", k, measure)
            for kind in EVENTS
            for k in range(_events(problems))
            for rule in RULES
        ),
    ]  # fmt: skip


def _events(problems: int) -> int:
    return max(2, problems // PROBLEMS_PER_EVENT)


def labelled(table: pd.DataFrame, seed: int, problems: int) -> pd.DataFrame:
    """The table with part, kind and index of the closed-loop events too."""
    names = {
        event_name(seed, kind, k): (kind, k) for kind in EVENTS for k in range(_events(problems))
    }
    ran = table["scenario"].isin(names)
    meaning = table.loc[ran, "scenario"].map(names)
    table.loc[ran, "part"] = "event"
    table.loc[ran, "kind"] = meaning.str[0]
    table.loc[ran, "index"] = meaning.str[1]
    return table


DIFFERENCES = Study(
    name="differences",
    question="where greedy, exact level and QP differ, by how much, and when it matters",
    default_events=1000,  # problems of each kind
    step=PROBLEMS_PER_EVENT,
    cells=cells,
    finish=labelled,
    judge=difference_statements,
    claims=CLAIMS,
)
