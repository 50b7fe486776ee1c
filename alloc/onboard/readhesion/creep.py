"""Creep control: a slip velocity is held, and for maximum adhesion tracking its reference is searched for."""

import math

from alloc.compilation import equation


@equation
def hold_slip(allowed, slip, reference, ceiling, proportional, integral, period):
    """One period of the PI controller of slip: returns the integral's new value and the coefficient to pull with.

    `allowed` is the integral, `ceiling` the coefficient that the target asks for; slip and reference [m/s] count positive in
    the direction of the demand. The integral stays within what can be commanded, so it does not wind up in adhesion.
    """
    error = reference - slip
    allowed = min(max(allowed + integral * error * period, 0.0), ceiling)
    return allowed, min(max(allowed + proportional * error, 0.0), ceiling)


@equation
def perturbed_step(last_step, coefficient_change, step):
    """Next step of the reference [m/s]: on in the same direction if the coefficient rose, back if it fell."""
    onward = last_step >= 0.0
    if coefficient_change < 0.0:
        onward = not onward
    return step if onward else -step


@equation
def gradient_step(last_step, coefficient_change, slip_change, gain, least, largest):
    """Next step of the reference [m/s] along the slope of the curve between the last two intervals.

    Where the slip has hardly changed the quotient says nothing: the last direction is probed with the least step.
    """
    if abs(slip_change) < 0.3 * least:
        return math.copysign(least, last_step)
    wanted = gain * coefficient_change / slip_change
    return math.copysign(min(max(abs(wanted), least), largest), wanted)
