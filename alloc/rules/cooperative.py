"""This project's own rules: limited units keep what they find, the others make up for it, by what all report.

Neither uses a belief about the rail. A limited unit's cap is what it delivers; any other may go up to its mark, the
coefficient that it has shown to carry, which rises with time. No unit is asked for less than the plan where it is
limited: its own controller finds the rail's recovery sooner than telegrams report it. One that is limited is asked
for a little more than it delivers, since a controller that searches for the peak learns nothing while its torque is
at a limit.
"""

import numpy as np

from alloc.compilation import jit
from alloc.onboard.beliefs import ROOM
from alloc.onboard.signatures import share
from alloc.rules.exact import level_between
from alloc.rules.problem import LEAST_MARK, ROUNDING
from alloc.rules.rule import RULES, Rule


@jit
def limit_to_search(u, run):
    """What a unit is asked for that does what it can: room to search, and the plan at least."""
    room = ROOM * u.mark if u.searching != 0 else u.mark
    return min(max(room, run.plan), u.most)


@share
def share_cooperative(units, run):
    """The exact level over all caps; no unit is asked for less than the plan, nor beyond it for more than its mark."""
    lower, upper, mass = np.zeros(units.size), np.empty(units.size), np.empty(units.size)
    for j in range(units.size):
        upper[j], mass[j] = min(units[j].cap, units[j].most), units[j].mass_share
    level, run.case = level_between(lower, upper, mass, run.needed)
    for u in units:
        limit = limit_to_search(u, run)
        # out of reach every unit does what it can
        u.wanted = min(limit, max(level, run.plan)) if run.case == 2 else limit
    return level


COOPERATIVE = Rule(
    "cooperative",
    "limited units keep what they find, the others make up for it",
    share_cooperative,
    "delivered",
    promise="effort",
    colour="#8e0055",
    marker="p",
)


@share
def share_wear(units, run):
    """The effort at the least wear: every unit at no bound at the same share x / p of its mark p.

    It minimises 1/2 sum m x^2 / p, a model of the power that wheels dissipate, whose marginal cost is that share.
    True slips are not known on board. But where units share the shape of a curve, the true marginal cost is one
    rising function of the share for all of them, so that model and truth have one optimum. The share L is the root of
    sum m min(p L, upper) = needed sum m, concave in L: iterates rise, and stop as soon as they pass no further bound,
    after n passes at most.
    """
    best, total, balance = run.plan, 0.0, 0.0
    for u in units:
        best = max(best, u.mark if u.mark < np.inf else 0.0)
        total += u.mass_share
        balance += u.mass_share * (min(u.cap, u.most) - run.needed)
    run.case = 2 if balance > ROUNDING * run.needed * total else 1
    share = 0.0
    for _ in range(units.size if run.case == 2 else 0):
        free, rest = 0.0, run.needed * total
        for u in units:
            # a unit that was never limited counts as the best of the others
            mark, upper = max(min(u.mark, best), LEAST_MARK), min(u.cap, u.most)
            if mark * share >= upper:
                rest -= u.mass_share * upper
            else:
                free += u.mass_share * mark
        if free == 0.0 or rest <= share * free:
            break
        share = rest / free
    for u in units:
        limit = max(min(u.mark, best), LEAST_MARK) * share
        # one at its bound has nothing to share, nor has any where the plan is out of reach
        at_bound = run.case == 1 or limit >= min(u.cap, u.most)
        u.wanted = limit_to_search(u, run) if at_bound else limit
    return np.nan


WEAR = Rule(
    "wear",
    "the plan at the least wear: each unit the same share of what it has shown to carry",
    share_wear,
    "delivered always",
    promise="effort",
    colour="#1b2c28",
    marker="$W$",
)

for _rule in (COOPERATIVE, WEAR):
    RULES.register(_rule)
