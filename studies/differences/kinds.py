"""Where rules can differ: one kind of allocation problem each, drawn at random, and one kind of slip event."""

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from alloc.plant.rail import logarithmic_increments
from alloc.rules import AllocationProblem
from studies.scenario.loading import load_scenario
from studies.scenario.scenario import Scenario

EXPECTED = 0.16
"""Planned coefficient: 3.0 km/h/s of the eight-car commuter train."""
SIGMA = 0.012
"""Scatter of coefficients in JP5484215, here the error of what was learnt for a unit."""
HEAVIEST = 1.4
"""Full over empty motor car: 44 t over 32 t."""

Generator = np.random.Generator
Values = dict[str, Any]


def _caps(g: Generator) -> Values:
    """4, 8 or 14 units; front 0 to 30 % short of the plan, growth from none to twice (15) in proportion to the plan."""
    n = int(g.choice([4, 8, 14]))
    axle = logarithmic_increments(4 * n, *(g.uniform(0.0, 0.0332) * np.array([1.0, -0.795])))
    unit = axle.reshape(n, 4).mean(axis=1)
    cap = EXPECTED * (1.0 - g.uniform(0.0, 0.3)) + unit - unit[0]
    return {"cap": cap, "expected": EXPECTED}


def _masses(g: Generator, v: Values) -> Values:
    return {"mass": g.uniform(1.0, HEAVIEST, v["cap"].size)}


def _not_growing(g: Generator, v: Values) -> Values:
    error = SIGMA * g.standard_normal(v["cap"].size)
    error[0] = 0.0
    return {"cap": np.maximum(v["cap"] + error, 0.0)}


def _torque(g: Generator, v: Values) -> Values:
    return {"limit_max": np.full(v["cap"].size, EXPECTED * g.uniform(1.0, 1.15))}


def _failed(g: Generator, v: Values) -> Values:
    limit_max = np.full(v["cap"].size, np.inf)
    limit_max[g.integers(1, v["cap"].size)] = 0.0
    return {"limit_max": limit_max}


def _rates(g: Generator, v: Values) -> Values:
    return {"previous": np.full(v["cap"].size, EXPECTED), "rate": EXPECTED * g.uniform(0.02, 0.2)}


def _all(g: Generator, v: Values) -> Values:
    # without a failed motor: with it the plan is hardly ever within reach
    values = v | _not_growing(g, v)
    for change in (_masses, _torque, _rates):
        values |= change(g, values)
    return values


KINDS: dict[str, Callable[[Generator, Values], Values]] = {
    "plain": lambda g, v: {},
    "unequal masses": _masses,
    "caps not growing": _not_growing,
    "torque limits": _torque,
    "failed motor": _failed,
    "rate limits": _rates,
    "all but a failed motor": _all,
}
"""Name -> what it changes of a problem with equal masses, growing caps and nothing else that bounds."""


def problem(seed: int, kind: str, k: int) -> AllocationProblem:
    """Problem `k` of a kind; it follows from `seed`, kind and `k` alone, and its front from `seed` and `k`."""
    values = _caps(np.random.default_rng([seed, k]))
    own = np.random.default_rng([seed, k, 1 + list(KINDS).index(kind)])
    return AllocationProblem(**(values | KINDS[kind](own, values)))


def _uneven(g: Generator) -> Scenario:
    load = g.uniform(0.0, 12.0, 8)
    return _start(g, load_t=tuple(load.tolist()), command=[_command(2.7)])


def _misbelieved(g: Generator) -> Scenario:
    axle = logarithmic_increments(32, 0.0166, -0.0132) + np.repeat(SIGMA * g.standard_normal(8), 4)
    return _start(g, belief={"increments": {"law": "given", "values": tuple(axle.tolist())}})


def _fast(g: Generator) -> Scenario:
    return _start(g, initial_speed_kmh=22.0, load_t=(6.0,) * 8, target_speed_kmh=None)


def _failing(g: Generator) -> Scenario:
    return _start(g, failures=[{"unit": int(g.integers(2, 5)), "time_s": 3.0}])


def _slow_limits(g: Generator) -> Scenario:
    return _start(g, onboard={"limit_rate": float(EXPECTED * g.uniform(0.02, 0.1))})


def _start(g: Generator, **values: Any) -> Scenario:
    base = load_scenario("wet-start")
    rail = base.rail.model_dump() | {"level": float(g.uniform(0.128, 0.148)), "scatter": 0.003}
    return base.changed(**({"duration_s": 12.0, "case": None, "rail": rail} | values))


def _command(acceleration_kmhs: float) -> Mapping[str, float]:
    return {"time_s": 0.0, "acceleration_kmhs": acceleration_kmhs}


EVENTS: dict[str, Callable[[Generator], Scenario]] = {
    "plain": _start,
    "unequal masses": _uneven,
    "caps not growing": _misbelieved,
    "torque limits": _fast,
    "failed motor": _failing,
    "rate limits": _slow_limits,
}
"""Kind -> a slip event of that kind: start on rail on which the front is short and the whole is not, or hardly."""


def event_name(seed: int, kind: str, k: int) -> str:
    """Name of event `k` of a kind."""
    return f"{kind.replace(' ', '-')}-{seed}-{k:04d}"


def event(seed: int, kind: str, k: int) -> Scenario:
    """Event `k` of a kind, from `seed`, kind and `k` alone."""
    generator = np.random.default_rng([seed, k, 101 + list(KINDS).index(kind)])
    return EVENTS[kind](generator).changed(name=event_name(seed, kind, k))
