"""Reference speed of the train from its axle speed sensors alone."""

from alloc.compilation import equation

ACCELERATION_MARGIN = 0.3
"""How much faster than commanded [m/s2] the train itself may plausibly change speed (gradients)."""


@equation
def follow_reference(reference, candidate, commanded, period):
    """New reference speed [m/s]: the candidate, as far as a train could have got in one `period` [s].

    `candidate` is the slowest axle when driving and the fastest when braking; where all axles slip it runs away, and
    the bound on the rate keeps the reference near the train's speed.
    """
    rise = (max(commanded, 0.0) + ACCELERATION_MARGIN) * period
    fall = (max(-commanded, 0.0) + ACCELERATION_MARGIN) * period
    return min(max(candidate, reference - fall), reference + rise)
