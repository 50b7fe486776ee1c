"""Searches for the slip that the rail answers best: the reference of creep control moves.

In: the unit's coefficient estimate and the slip of its worst axle, as sensed. Out: its torque command. Searches share the
inner loop (`creep.hold_slip`) and the interval over which they compare (`interval_is_over`).
"""

import math

from alloc.compilation import jit
from alloc.onboard.columns import NAN, ONE
from alloc.onboard.controllers.controller import register
from alloc.onboard.controllers.creep import (
    ASSUMED,
    GAINS,
    HELD,
    TUNED,
    clip,
    has_lasted,
    hold_slip,
    set_defaults,
)
from alloc.onboard.reference_speed import LIMITING
from alloc.onboard.signatures import control
from alloc.schema.tables import Column, Table

# Means over intervals, and a reference that moves between bounds


FIRST = {"first": Column(0.085, "m s-1", "slip that is held at first", source=TUNED), **GAINS}
BOUNDS = {
    "lowest": Column(0.03, "m s-1", "least slip that is held", source=TUNED),
    "highest": Column(0.5, "m s-1", "greatest slip that is held", source=ASSUMED),
}
INTERVAL = {"interval": Column(0.2, "s", "time from move to move of the slip held", source=TUNED)}
SEARCH = FIRST | BOUNDS | INTERVAL
SEARCHED = HELD | {
    "reference": Column(NAN, "m s-1", "slip that is held"),
    "moved": Column(0.0, "m s-1", "its last move"),
    "ticks": Column(0, ONE, "control periods of this interval"),
    "samples": Column(0, ONE, "number of them in its second half"),
    "coefficient_sum": Column(0.0, ONE, "sum of coefficients in them"),
    "slip_sum": Column(0.0, "m s-1", "sum of slips in them"),
    "last_coefficient": Column(NAN, ONE, "mean coefficient of the last interval; nan: none"),
    "last_slip": Column(0.0, "m s-1", "mean slip of the last interval"),
}


@jit
def start_interval(m):
    """An interval begins."""
    m.ticks = m.samples = 0
    m.coefficient_sum = m.slip_sum = 0.0


@jit
def interval_is_over(unit, m, run):
    """Add what the unit senses to its means; whether an interval is over. Only while the controller limits the torque."""
    if math.isnan(m.reference):
        m.reference = m.first
    if m.share >= LIMITING:  # adhesion suffices: nothing to be learnt of the peak
        start_interval(m)
        m.last_coefficient = NAN
        return False
    m.ticks += 1
    if m.ticks * run.period > (0.5 + 1e-6) * m.interval:  # slip settles in the first half
        m.coefficient_sum += unit.coefficient_estimate
        m.slip_sum += unit.worst_slip
        m.samples += 1
    return has_lasted(m.ticks, m.interval, run.period)


@jit
def move_reference(m, step):
    """Move the reference by `step` [m/s] within its bounds, turn round there, and start an interval."""
    wanted = m.reference + step
    m.moved = -step if wanted < m.lowest or wanted > m.highest else step
    m.reference = clip(wanted, m.lowest, m.highest)
    m.last_coefficient, m.last_slip = m.coefficient_sum / m.samples, m.slip_sum / m.samples
    start_interval(m)


PERTURB = Table(
    "perturb-observe",
    **SEARCH,
    step=Column(0.012, "m s-1", "size of a move at the first slip", source=TUNED),
    **SEARCHED,
)
PERTURB_ROW = PERTURB.dtype


@control
def perturb_observe(unit, axles, memory, run):
    """The slip held climbs by steps, and turns back where the coefficient fell (arXiv 2406.13650).

    As the source says, the step is a compromise between the time of the search and the loss about the peak, and a change of
    the rail is mistaken for an answer to the step. So here steps are in proportion to the slip, beyond the first: with equal
    ones a slip of 0.5 m/s was 7 s away.
    """
    m = memory.view(PERTURB_ROW)[0]
    if interval_is_over(unit, m, run):
        worse = m.coefficient_sum / m.samples < m.last_coefficient
        step = m.step * max(1.0, m.reference / m.first)
        move_reference(m, math.copysign(step, -m.moved if worse else m.moved))
    hold_slip(unit, m, m.reference, unit.worst_slip, run)


STEEPEST = Table(
    "steepest-gradient",
    **set_defaults(SEARCH, first=0.158, proportional=0.39, lowest=0.0294, interval=0.131),
    gain=Column(0.15, "m2 s-2", "move over the slope of the curve", source=TUNED),
    least=Column(0.017, "m s-1", "least move", source=TUNED),
    largest=Column(0.0303, "m s-1", "largest move", source=TUNED),
    **SEARCHED,
)
STEEPEST_ROW = STEEPEST.dtype


@control
def steepest_gradient(unit, axles, memory, run):
    """As perturb-observe, but a move is a gain times the slope between the last two intervals (arXiv 2406.13650).

    Where the slip has hardly changed, the slope is noise, and the least move goes on. As the source says, the slope is
    noisy, and small where the curve falls slowly.
    """
    m = memory.view(STEEPEST_ROW)[0]
    if interval_is_over(unit, m, run):
        rise = m.coefficient_sum / m.samples - m.last_coefficient
        way = m.slip_sum / m.samples - m.last_slip
        step = math.copysign(m.least, m.moved)
        if not math.isnan(rise) and abs(way) >= 0.3 * m.least:
            wanted = m.gain * rise / way
            step = math.copysign(clip(abs(wanted), m.least, m.largest), wanted)
        move_reference(m, step)
    hold_slip(unit, m, m.reference, unit.worst_slip, run)


register(
    "perturb-observe",
    perturb_observe,
    "creep control whose reference climbs by steps in proportion to it",
    memory=PERTURB,
    colour="#395539",
    marker="D",
)
register(
    "steepest-gradient",
    steepest_gradient,
    "creep control whose reference climbs along the estimated slope",
    memory=STEEPEST,
    colour="#0000c6",
    marker="X",
)
