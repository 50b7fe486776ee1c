"""Slip detection: computed acceleration of a unit's axles against thresholds with hysteresis (JP5484215 Fig. 5)."""

import math

from alloc.compilation import equation


def differentiator_gain(pole: float, period: float) -> float:
    """Share of the new value that the differentiator's filter takes per `period` [s]."""
    return -math.expm1(-pole * period)


@equation
def differentiate(filtered, value, pole, gain):
    """Pseudo-differentiator p s / (s + p): returns the new filter state and the computed derivative."""
    derivative = pole * (value - filtered)
    return filtered + gain * (value - filtered), derivative


@equation
def slip_signal(was_on, acceleration, slip, on, off, speed_on):
    """New state of the detector's signal; acceleration and slip count positive in the direction of the demand.

    The signal comes on above `on` [m/s2] or beyond `speed_on` [m/s] of slip. It goes off only at or below `off` and below
    half of `speed_on`.
    """
    if acceleration > on or slip > speed_on:
        return True
    elif acceleration <= off and slip < 0.5 * speed_on:
        return False
    else:
        return was_on
