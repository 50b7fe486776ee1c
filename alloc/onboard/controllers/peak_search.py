"""What searches for the peak of the adhesion curve share: means over intervals, and a reference that moves."""

import math

from alloc.compilation import equation
from alloc.onboard.reference_speed.sounding import is_relieved

LIMITING = 0.999
"""Share of its target below which a unit counts as limited by its readhesion controller, and a search goes on."""


REMEMBERED = {
    "allowed": math.nan,  # integral of creep control; nan: nothing yet
    "reference": 0.0,  # slip velocity that is held [m/s]
    "step": 0.0,  # last one of the reference [m/s]
    "clock": 0.0,  # time in this interval [s]
    "coefficient_sum": 0.0,
    "slip_sum": 0.0,
    "samples": 0.0,
    "last_coefficient": math.nan,  # mean of the last interval; nan: none
    "last_slip": 0.0,
}
"""What a searching creep controller remembers of every unit."""


@equation
def _start_interval(k, j):
    k.clock[j] = k.coefficient_sum[j] = k.slip_sum[j] = k.samples[j] = 0.0


@equation
def interval_is_over(st, m, p, k, j):
    """Add what unit `j` senses to its means; whether an interval is over. Only while the controller limits the torque."""
    if math.isnan(k.allowed[j]):
        k.reference[j] = st.law.creep.reference
    if is_relieved(m, j):
        _start_interval(k, j)
        return False
    if m.unit.torque_factor[j] >= LIMITING:  # adhesion suffices: nothing to be learnt of the peak
        _start_interval(k, j)
        k.last_coefficient[j] = math.nan
        return False
    k.clock[j] += st.period
    if k.clock[j] > 0.5 * p.interval:  # the first half is for the slip to settle at its reference
        k.coefficient_sum[j] += m.unit.coefficient_estimate[j]
        k.slip_sum[j] += m.worst_slip[j]
        k.samples[j] += 1.0
    return k.clock[j] >= p.interval


@equation
def interval_means(k, j):
    """Means of coefficient and slip [m/s] over the interval of unit `j` that is over."""
    return k.coefficient_sum[j] / k.samples[j], k.slip_sum[j] / k.samples[j]


@equation
def move_reference(p, k, j, step, coefficient, slip):
    """Move the reference of unit `j` by `step` [m/s] within its bounds, and start an interval; both means are the last's."""
    wanted = k.reference[j] + step
    k.step[j] = -step if wanted < p.lowest or wanted > p.highest else step
    k.reference[j] = min(max(wanted, p.lowest), p.highest)
    k.last_coefficient[j], k.last_slip[j] = coefficient, slip
    _start_interval(k, j)
