"""Fuzzy inference of a valve's action from slip and slip rate: nine rules, zero-order Sugeno.

JP4209318 controls its valves by fuzzy inference and does not disclose the rules; these are this project's own.
"""

from alloc.compilation import equation
from alloc.onboard.fuzzy_inference import weighted_action

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
def infer(slip, rate, sensitivity, slip_knots, rate_knots):
    """Weighted mean of the rules' actions, `SUPPLY` to `RELEASE`; `slip` a ratio, `rate` in m/s2, knots (3,) each.

    It never falls with slip or rate. For sliding wheels whose slip grows, it does not fall with the sensitivity either,
    since the sets overlap in pairs and the rules are ordered.
    """
    x, y = sensitivity * slip, sensitivity * rate
    return weighted_action(RULES, x, y, slip_knots, rate_knots)


@equation
def valve_action(inferred):
    """The action nearest to the inferred value."""
    return SUPPLY if inferred < 0.5 else (HOLD if inferred < 1.5 else RELEASE)
