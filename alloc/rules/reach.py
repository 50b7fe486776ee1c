"""Whether the plan is within reach of what bounds the units."""

from alloc.compilation import jit

ROUNDING = 1e-12
"""Relative slack of comparisons between sums, so that a tie in exact arithmetic is one in floating point."""


@jit
def bounds_allow_plan(cap, expected, mass, limit_max):
    """Whether caps and torque limits allow more than the plan, weighted with mass."""
    balance = 0.0
    for j in range(cap.size):
        balance += mass[j] * (min(cap[j], limit_max[j]) - expected)
    return balance > 0.0


@jit
def within_reach(cap, expected):
    """Step S207: whether the mean cap (7) exceeds the plan, which is case B."""
    total = 0.0
    for j in range(cap.size):
        total += cap[j]
    return total > cap.size * expected * (1.0 + ROUNDING)


@jit
def sums_at_bounds(lower, upper, mass, expected):
    """Sums of m (upper - expected), m (lower - expected) and m."""
    most, least, total = 0.0, 0.0, 0.0
    for j in range(upper.size):
        most += mass[j] * (upper[j] - expected)
        least += mass[j] * (lower[j] - expected)
        total += mass[j]
    return most, least, total


@jit
def highest_cap(cap):
    """The level of case A, where every unit works at its cap."""
    highest = cap[0]
    for j in range(1, cap.size):
        highest = max(highest, cap[j])
    return highest


@jit
def lowest(values):
    """The smallest of an array's values."""
    smallest = values[0]
    for j in range(1, values.size):
        smallest = min(smallest, values[j])
    return smallest
