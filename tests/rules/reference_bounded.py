"""Rules under masses, torque limits and rates of change, transcribed unit by unit without regard to speed.

Sources: redistribution as JP5484215 par. 0050 and its generalisation by masses and bounds; the prior art of par. 0007 and
0009. Every number may be a `fractions.Fraction`, so that no result depends on rounding; what the sources leave open (how
much is moved, handed on, or overlooked) stands here as a number.
"""

import itertools
from fractions import Fraction

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
