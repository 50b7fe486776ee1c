"""Mixed random problems: few and many units, masses alike or a million apart, every kind of bound, and the degenerate."""

import numpy as np

from alloc.rules import AllocationProblem

PLAN = 0.17


def random_problem(seed, largest=32, ratio=1e6):
    """Problem number `seed`: 2 to `largest` units, masses log-uniform with ratios up to `ratio`."""
    draw = np.random.default_rng([seed, largest])
    n = int(draw.integers(2, largest + 1))
    kind = draw.integers(10)
    given = {}
    if draw.random() < 0.8:
        span = draw.choice([0.3, np.log(ratio)])
        given["mass"] = 30e3 * np.exp(span * draw.uniform(-0.5, 0.5, n))
    if draw.random() < 0.3:
        given["limit_max"] = np.where(
            draw.random(n) < 0.5, np.inf, PLAN * draw.uniform(0.7, 2.0, n)
        )
    if draw.random() < 0.5:  # limits that may not fall or rise as they want: lower bounds too
        given["previous"] = PLAN * draw.uniform(0.3, 2.0, n)
        given["rate"] = PLAN * draw.choice([0.0, 0.01, 0.1, 0.5]) * draw.uniform(0.5, 1.5, n)
    if draw.random() < 0.5:
        given["deviation"] = PLAN * draw.uniform(0.0, 0.1, n)
    cap = PLAN * draw.uniform(0.4, 1.8, n) * draw.uniform(0.9, 1.6)
    if kind == 0:  # equal caps, perhaps the plan itself
        cap = np.full(n, PLAN * draw.choice([0.8, 1.0, 1.3]))
    elif kind == 1:  # few values, so that units meet the level together
        cap = PLAN * draw.choice([0.7, 1.0, 1.2, 1.5], n)
    elif kind == 2:  # nothing lacks
        cap = PLAN * draw.uniform(1.0, 2.0, n)
    elif kind == 3:  # out of reach
        cap = PLAN * draw.uniform(0.0, 1.0, n)
    elif kind == 4:  # the plan is just met, but for rounding
        mass = given.get("mass", np.ones(n))
        cap *= PLAN * mass.sum() / (mass @ cap)
    elif (
        kind == 5
    ):  # the heavy units nearly carry the plan: what they lack decides how high the light ones stand
        mass = np.sort(30e3 * np.exp(np.log(ratio) * draw.uniform(-0.5, 0.5, n)))
        lights, level = int(draw.integers(1, n)), PLAN * draw.uniform(1.1, 1.5)
        cap = PLAN * draw.uniform(0.6, 1.1, n)
        rest = PLAN * mass.sum() - level * mass[:lights].sum()
        cap[lights:] *= max(rest, 0.0) / (mass[lights:] @ cap[lights:])
        cap[:lights] = 1.6 * PLAN
        given = {"mass": mass}
    return AllocationProblem(cap, PLAN, **given)
