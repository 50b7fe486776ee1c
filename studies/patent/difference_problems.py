"""Where rules can differ: one kind of allocation problem each, drawn at random, and one kind of slip event."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.plant.rail import logarithmic_increments
from alloc.rules import RULES as ALL_RULES
from alloc.rules import AllocationProblem
from studies.core.drawn_scenarios import drawn_scenario
from studies.files.units import stated
from studies.scenario.loading import shipped_scenario
from studies.scenario.scenario import Scenario

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
