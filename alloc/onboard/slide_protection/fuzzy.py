"""Fuzzy inference of a valve's action from slip and slip rate: nine rules, zero-order Sugeno.

JP4209318 controls its valves by fuzzy inference and does not disclose the rules; these are this project's own.
"""

from alloc.compilation import equation
from alloc.plant.operations import maximum, minimum

SUPPLY, HOLD, RELEASE = 0.0, 1.0, 2.0
"""Actions of a bogie's valves, as the plant takes them (`alloc.plant.model.Inputs.valve`)."""

# What the valves should do, by slip (rows) and by slip rate (columns)
RULES = (
    # falling  steady    growing
    (SUPPLY, SUPPLY, HOLD),  # small slip: brake, but do not feed a slide that begins
    (SUPPLY, HOLD, RELEASE),  # medium: the slip that is wanted; act on where it goes
    (HOLD, RELEASE, RELEASE),  # large: release until the wheel comes back by itself
)


@equation
def memberships(x, low, middle, high):
    """Degrees to which `x` belongs to three sets that peak at `low`, `middle`, `high`; their sum is 1."""
    first = minimum(maximum((middle - x) / (middle - low), 0.0), 1.0)
    last = minimum(maximum((x - middle) / (high - middle), 0.0), 1.0)
    return first, 1.0 - first - last, last


@equation
def infer(slip, rate, sensitivity, slip_knots, rate_knots):
    """Weighted mean of the rules' actions, `SUPPLY` to `RELEASE`; `slip` a ratio, `rate` in m/s2, knots (3,) each.

    It never falls with slip or rate, and for sliding wheels whose slip grows not with the sensitivity either, since the
    sets overlap in pairs and the rules are ordered.
    """
    x, y = sensitivity * slip, sensitivity * rate
    small, medium, large = memberships(x, slip_knots[0], slip_knots[1], slip_knots[2])
    falling, steady, growing = memberships(y, rate_knots[0], rate_knots[1], rate_knots[2])
    at_small = falling * RULES[0][0] + steady * RULES[0][1] + growing * RULES[0][2]
    at_medium = falling * RULES[1][0] + steady * RULES[1][1] + growing * RULES[1][2]
    at_large = falling * RULES[2][0] + steady * RULES[2][1] + growing * RULES[2][2]
    return small * at_small + medium * at_medium + large * at_large


@equation
def valve_action(inferred):
    """The action nearest to what was inferred."""
    return SUPPLY if inferred < 0.5 else (HOLD if inferred < 1.5 else RELEASE)
