"""Where greedy, exact level and QP differ: thousands of random problems, and some closed-loop events of each kind."""

import math
from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.plant.rail import logarithmic_increments
from alloc.rules import RULES as ALL_RULES
from alloc.rules import AllocationProblem
from studies.core.cell import Cell, Task
from studies.core.claims import AT_LEAST, AT_MOST, Claim, conjunction
from studies.core.drawn_events import drawn_scenario
from studies.core.job import Job
from studies.core.statement import LEAST_EVENTS, Interval, Statement, in_words, mean_interval
from studies.core.study import Study
from studies.files.units import stated
from studies.patent.claim_events import measure
from studies.scenario.scenario import Scenario, shipped_scenario

# Where rules can differ: one kind of allocation problem each, drawn at random, and one kind of slip event.

EXPECTED = 0.16
"""Planned coefficient: 3.0 km/h/s of the eight-car commuter train."""
SIGMA = 0.012
"""Scatter of coefficients in JP5484215, here the error of what was learnt for a unit."""
DURATION = 12.0
"""Length of an event [s]."""
HEAVIEST = 1.4
"""Full over empty motor car: 44 t over 32 t."""

Floats = NDArray[np.float64]
Generator = np.random.Generator
Values = dict[str, Any]


def _caps(g: Generator) -> Values:
    """4, 8 or 14 units; front 0 to 30 % short of the plan, growth from none to twice (15) in proportion to the plan."""
    n = int(g.choice([4, 8, 14]))
    axle = logarithmic_increments(4 * n, *(g.uniform(0.0, 0.0332) * np.array([1.0, -0.795])))
    unit = axle.reshape(n, 4).mean(axis=1)
    cap = EXPECTED * (1.0 - g.uniform(0.0, 0.3)) + unit - unit[0]
    return {"cap": cap, "expected": EXPECTED}


def _not_growing(g: Generator, v: Values) -> Values:
    error = SIGMA * g.standard_normal(v["cap"].size)
    error[0] = 0.0
    return {"cap": np.maximum(v["cap"] + error, 0.0)}


def _failed(g: Generator, v: Values) -> Values:
    limit_max = np.full(v["cap"].size, np.inf)
    limit_max[g.integers(1, v["cap"].size)] = 0.0
    return {"limit_max": limit_max}


def _all(g: Generator, v: Values) -> Values:
    # without a failed motor: with it the plan is hardly ever within reach
    values = dict(v)
    for kind in ("caps not growing", "unequal masses", "torque limits", "rate limits"):
        values |= KINDS[kind](g, values)
    return values


def _of_each(v: Values, value: float) -> Floats:
    return np.full(v["cap"].size, value)


KINDS: dict[str, Callable[[Generator, Values], Values]] = {
    "plain": lambda g, v: {},
    "unequal masses": lambda g, v: {"mass": g.uniform(1.0, HEAVIEST, v["cap"].size)},
    "caps not growing": _not_growing,
    "torque limits": lambda g, v: {"limit_max": _of_each(v, EXPECTED * g.uniform(1.0, 1.15))},
    "failed motor": _failed,
    "rate limits": lambda g, v: {"previous": _of_each(v, EXPECTED), "rate": EXPECTED * g.uniform(0.02, 0.2)},
    "all but a failed motor": _all,
}  # fmt: skip
"""Name -> what it changes of a problem with equal masses, growing caps and nothing else that bounds."""


def problem(seed: int, kind: str, k: int) -> AllocationProblem:
    """Problem `k` of a kind; it follows from `seed`, kind and `k` alone, and its front from `seed` and `k`."""
    values = _caps(np.random.default_rng([seed, k]))
    own = np.random.default_rng([seed, k, 1 + list(KINDS).index(kind)])
    return AllocationProblem(**(values | KINDS[kind](own, values)))


def _believed(g: Generator) -> dict[str, Any]:
    axle = logarithmic_increments(32, 0.0166, -0.0132) + np.repeat(SIGMA * g.standard_normal(8), 4)
    return {"increments": {"law": "given", "values": tuple(axle.tolist())}}


EVENTS: dict[str, Callable[[Generator], dict[str, Any]]] = {
    "plain": lambda g: {},
    "unequal masses": lambda g: {
        "load_t": tuple(stated("_t", load) for load in g.uniform(0.0, 12.0, 8).tolist()),
        "command": [{"time_s": 0.0, "acceleration_kmhs": 2.7}],
    },
    "caps not growing": lambda g: {"belief": _believed(g)},
    "torque limits": lambda g: {"initial_speed_kmh": 22.0, "load_t": (6.0,) * 8, "target_speed_kmh": None},
    "failed motor": lambda g: {"failures": [{"unit": int(g.integers(2, 5)), "time_s": 3.0}]},
    "rate limits": lambda g: {"onboard": {"limit_rate": float(EXPECTED * g.uniform(0.02, 0.1))}},
}  # fmt: skip
"""Kind -> what it changes of a start on rail on which the front is short and the whole is not, or hardly."""


def event_name(seed: int, kind: str, k: int) -> str:
    """Name of event `k` of a kind."""
    return f"{kind.replace(' ', '-')}-{seed}-{k:04d}"


def event(seed: int, kind: str, k: int) -> Scenario:
    """Event `k` of a kind, from `seed`, kind and `k` alone."""
    generator = np.random.default_rng([seed, k, 101 + list(KINDS).index(kind)])
    own = EVENTS[kind](generator)
    base = shipped_scenario("wet-start")
    level = float(generator.uniform(0.128, 0.148))
    rail = base.rail.model_dump() | {"level": level, "scatter": 0.003}
    return drawn_scenario(base, event_name(seed, kind, k), base.title, DURATION, rail, **own)


RULES = ("greedy", "greedy-claim", "exact", "qp")


def problem_rows(seed: int, kind: str, first: int, end: int) -> list[dict[str, object]]:
    """Rows of `answer_rows` for the problems `first` to `end` - 1 of a kind."""
    return [
        {"index": k, **row}
        for k in range(first, end)
        for row in answer_rows(problem(seed, kind, k))
    ]


def answer_rows(asked: AllocationProblem) -> list[dict[str, object]]:
    """Answer of each rule to a problem, all relative to the plan's coefficient.

    - case: that of the patent, which counts caps alone.
    - within_reach: whether caps, torque and rate allow the plan, with masses counted.
    - effort: mean of what limits and caps allow, weighted with mass.
    - short, over: effort below and above what the bounds allow of the plan.
    - beyond: largest limit above what cap, torque and rate allow.
    - apart: largest distance of a limit from the exact one.
    - unmet: whether the patent's case is B, and the sum of the limits below the plan.
    """
    answers = {rule: ALL_RULES[rule](asked) for rule in RULES}
    exact, upper, plan = answers["exact"].limit, asked.box[1], asked.expected
    case = "B" if float(np.asarray(asked.cap, dtype=float).mean()) > plan else "A"
    rows: list[dict[str, object]] = []
    for rule, answer in answers.items():
        effort = answer.usable(asked)
        rows.append(
            {
                "rule": rule,
                "status": "ok" if answer.status == "ok" else "failed",
                "case": case,
                "within_reach": asked.within_reach,
                "effort": effort / plan,
                "short": max(asked.attainable - effort, 0.0) / plan,
                "over": max(effort - asked.attainable, 0.0) / plan,
                "beyond": max(float((answer.limit - upper).max()), 0.0) / plan,
                "apart": float(np.abs(answer.limit - exact).max()) / plan,
                "unmet": case == "B" and float(answer.limit.sum()) < asked.n * plan * (1 - 1e-9),
            }
        )
    return rows


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
