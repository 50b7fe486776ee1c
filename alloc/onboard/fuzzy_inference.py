"""Fuzzy inference from two inputs: three overlapping sets each, nine rules, zero-order Sugeno."""

from alloc.compilation import equation
from alloc.plant.operations import maximum, minimum


@equation
def memberships(x, low, middle, high):
    """Degrees to which `x` belongs to three sets that peak at `low`, `middle`, `high`; their sum is 1."""
    first = minimum(maximum((middle - x) / (middle - low), 0.0), 1.0)
    last = minimum(maximum((x - middle) / (high - middle), 0.0), 1.0)
    return first, 1.0 - first - last, last


@equation
def weighted_action(rules, x, y, x_knots, y_knots):
    """Weighted mean of the actions `rules` (3, 3), rows by `x`, columns by `y`; knots (3,): where the sets peak.

    Where the rules are ordered along a row or a column, the surface is: the sets overlap in pairs.
    """
    low, middle, high = memberships(x, x_knots[0], x_knots[1], x_knots[2])
    first, second, third = memberships(y, y_knots[0], y_knots[1], y_knots[2])
    at_low = first * rules[0][0] + second * rules[0][1] + third * rules[0][2]
    at_middle = first * rules[1][0] + second * rules[1][1] + third * rules[1][2]
    at_high = first * rules[2][0] + second * rules[2][1] + third * rules[2][2]
    return low * at_low + middle * at_middle + high * at_high
