"""Reference speed of the train from its axle speed sensors alone."""

from alloc.compilation import equation


@equation
def acceleration_from_command(commanded, margin):
    """Least and greatest acceleration [m/s2] that a train may have under a command, `margin` for gradients."""
    return min(commanded, 0.0) - margin, max(commanded, 0.0) + margin


@equation
def follow_reference(reference, candidate, least, greatest, period):
    """New reference speed [m/s]: the candidate, as far as a train could have got in one `period` [s].

    `candidate` is the slowest axle when driving and the fastest when braking; where all axles slip it runs away, and the
    bounds `least` and `greatest` [m/s2] on the train's acceleration keep the reference near its speed.
    """
    return min(max(candidate, reference + least * period), reference + greatest * period)
