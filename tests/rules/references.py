"""The patent's steps, and rules under masses, torque limits and rates, transcribed slowly; and random problems."""

import itertools
from fractions import Fraction

import numpy as np

from alloc.old.rules import AllocationProblem


def reference_limits(cap, expected, reading="description"):
    """Limits of all units under slip: (limits, level, case)."""
    n = len(cap)
    mean_cap = sum(cap) / n  # (7)
    if mean_cap <= expected:  # S207: no -> case A
        return list(cap), max(cap), "A"
    j_exp = 0  # the last unit before the first one with cap >= expected
    while cap[j_exp] < expected:
        j_exp += 1
    small = sum(expected - cap[j] for j in range(j_exp))  # (8)
    level = None
    for m in range(j_exp, n):
        if reading == "description":
            large = sum(min(cap[k], cap[m]) - expected for k in range(j_exp, n))  # (9)
        else:
            large = sum(cap[k] - expected for k in range(j_exp, m + 1))  # claim 1
        if large >= small:  # S211
            level = cap[m]
            break
    if level is None:  # the claim's sum runs out: the last unit added
        level = cap[-1]
    return [c if c < level else level for c in cap], level, "B"  # (10), (11)


def exact_level(cap, expected):
    """L with sum min(cap, L) = n expected by trying every number of capped units; None out of reach."""
    n = len(cap)
    if sum(cap) <= n * expected:
        return None
    ordered = sorted(cap)
    for capped in range(n):
        level = (n * expected - sum(ordered[:capped])) / Fraction(n - capped)
        if level <= ordered[capped]:
            return level
    raise AssertionError("the caps allow the plan, so some number of capped units must fit")


MOVED = Fraction(1, 10)


HANDED = Fraction(3, 20)


OVERLOOKED = Fraction(1, 25)


def reach(cap, mass, torque_limit, expected):
    """What the units could deliver together less what the plan needs of them; case B where it exceeds zero."""
    surplus = 0
    for c, m, t in zip(cap, mass, torque_limit, strict=True):
        surplus += m * ((c if c < t else t) - expected)
    return surplus


def bounds(cap, torque_limit, previous, rate):
    """Least and greatest limit of every unit; cap None for a rule that does not know it, rate None for any change."""
    lowest, highest = [], []
    for j, top in enumerate(torque_limit):
        bottom = 0
        if rate is not None:
            top = min(top, previous[j] + rate[j])
            bottom = max(previous[j] - rate[j], 0)
        if cap is not None:
            top = min(top, cap[j])
        # where adhesion or torque fell faster than the rate, they prevail
        lowest.append(min(bottom, top))
        highest.append(top)
    return lowest, highest


def inside(limits, lowest, highest):
    """Limits, each brought between its bounds."""
    return [min(max(x, a), b) for x, a, b in zip(limits, lowest, highest, strict=True)]


def preset_limits(mass, torque_limit, expected):
    """A line along the train: 1 - MOVED to 1 + MOVED of the plan if units are equal; the plan is its mean by mass."""
    n = len(mass)
    place = [
        Fraction(2 * j, n - 1) - 1 if n > 1 else Fraction(0) for j in range(n)
    ]  # front -1, rear 1
    centre = sum(m * p for m, p in zip(mass, place, strict=True)) / sum(mass)
    return [
        min(expected + expected * MOVED * (p - centre), t)
        for p, t in zip(place, torque_limit, strict=True)
    ]


def sharing_limits(mass, torque_limit, previous, delivered, expected):
    """A step of dynamic sharing: who delivers less than its limit is lowered, the others take over what lacks."""
    units = range(len(mass))
    delivered = [max(d, 0) for d in delivered]  # a negative estimate counts as nothing
    short = [previous[j] - delivered[j] > OVERLOOKED * expected for j in units]
    lacking = sum(mass[j] * expected for j in units) - sum(mass[j] * delivered[j] for j in units)
    able = sum(mass[j] for j in units if not short[j])
    limits = []
    for j in units:
        limit = previous[j]
        if delivered[j] < previous[j]:
            limit -= HANDED * (previous[j] - delivered[j])
        if not short[j]:
            limit += HANDED * lacking / able
        limits.append(min(max(limit, 0), torque_limit[j]))
    return limits


def level_within(lowest, highest, mass, expected):
    """Limits and level with sum m x = sum m expected, x = level where the bounds allow it, and the case; bounds are finite.

    What the train delivers at a level is a broken line that rises from bound to bound: the level lies between the two
    bounds whose deliveries enclose the plan. Out of reach: all at their upper bounds; the plan exceeded: at their lower.
    """

    def delivered(level):
        return sum(
            m * x for m, x in zip(mass, inside([level] * len(mass), lowest, highest), strict=True)
        )

    wanted = expected * sum(mass)
    most = sum(m * b for m, b in zip(mass, highest, strict=True))
    least = sum(m * a for m, a in zip(mass, lowest, strict=True))
    if most <= wanted:
        return list(highest), max(highest), "A"
    if least >= wanted:
        return list(lowest), min(lowest), "B"
    knots = sorted({*lowest, *highest})
    for below, above in itertools.pairwise(knots):
        if delivered(below) <= wanted <= delivered(above) and delivered(below) < delivered(above):
            share = (wanted - delivered(below)) / (delivered(above) - delivered(below))
            level = below + share * (above - below)
            return inside([level] * len(mass), lowest, highest), level, "B"
    raise AssertionError("the bounds enclose the plan, so some pair of them must")


def redistributed(upper, mass, scale, wanted):
    """Least sum of m (x / scale)^2 with sum m x = wanted and x <= upper, by pseudo-inverses; (n,) arrays.

    As Johansen and Fossen state the method: units beyond their bound are frozen there, the others are solved again.
    """
    x, free = np.zeros(mass.size), np.ones(mass.size, dtype=bool)
    while free.any():
        root = np.sqrt(mass[free])
        row = (root * scale[free])[None]  # of y = sqrt(m) x / scale, whose plain norm is least
        rest = wanted - mass[~free] @ x[~free]
        x[free] = scale[free] / root * (np.linalg.pinv(row, rcond=0.0) @ [rest])
        beyond = free & (x >= upper)
        if not beyond.any():
            break
        x[beyond], free = upper[beyond], free & ~beyond
    return x


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
