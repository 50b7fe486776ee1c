"""The patent's steps, transcribed word by word without regard to speed: what every solver is tested against.

JP5484215, description: equations (5) to (11) and steps S206 to S214; claim 1 for the other reading of S210. Numbers may
be `fractions.Fraction`, so that no result depends on rounding.
"""

from fractions import Fraction


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
