"""Sounding: force is taken from a few wheels for a moment, so that they roll and tell the train's speed.

Where every axle may slide the estimate's deviation grows. Motors answer at once: a unit is cut for some tenths of a
second, one after the other. Cylinders do not: a bogie is released until the speed is known again.
"""

import math

from alloc.compilation import inlined_jit

NEAR = 0.015
"""Slip ratio of a wheel that runs near the estimated speed."""

LEAST_SPEED = 8.0
"""Speed [m/s] below which the deviations of air brakes do not shrink any further."""

PULLING = 0.01
"""Coefficient from which on a unit's motors act, so that relieving it tells something."""


@inlined_jit
def is_relieved(m, j):
    """Whether unit `j` is sounded or just getting its torque back: what its wheels do then is not of its own control."""
    return m.estimate.sounding.share[j] < 1.0


@inlined_jit
def _acting_unit(eq, m, k):
    """The next unit whose motors act, -1: none."""
    for n in range(1, eq.axles.size + 1):
        j = (k.last[0] + n) % eq.axles.size
        force = abs(m.torque[j]) * eq.gear[j] / eq.radius[j]
        if m.unit.axles_seen[j] > 0.0 and force > PULLING * eq.axle_load[j]:
            return j
    return -1


@inlined_jit
def _sound_unit(eq, st, m, deviation, anyone):
    """Begin, carry on or end the sounding of a unit; returns whether motors act."""
    s, k = st.reference.sounding, m.estimate.sounding
    k.clock[0] += st.period
    for j in range(k.share.size):
        k.share[j] = min(k.share[j] + st.period / s.return_time, 1.0)
    limit = max(s.doubt, s.doubt_ratio * abs(m.reference[0])) * (s.ease if anyone else 1.0)
    if k.unit[0] >= 0:
        if k.clock[0] > s.time:
            k.unit[0], k.clock[0] = -1, 0.0
        else:
            k.share[k.unit[0]] = s.share
        return True
    j = _acting_unit(eq, m, k)
    if j >= 0 and k.clock[0] > s.pause and deviation > limit:
        k.unit[0] = k.last[0] = j
        k.clock[0] = 0.0
        k.share[j] = s.share
    return j >= 0


@inlined_jit
def _sound_group(eq, st, m, deviation):
    """Begin, carry on or end the release of a brake group."""
    s, k, e = st.reference.sounding, m.estimate.sounding, m.estimate
    v = max(m.reference[0], LEAST_SPEED)
    fastest, slowest = 0.0, 1e9
    for i in range(e.rim.size):
        if m.axle_seen[i]:
            fastest, slowest = max(fastest, e.rim[i]), min(slowest, e.rim[i])
    near = (1.0 - NEAR) * m.reference[0]
    limit = s.air_doubt * v * (s.patience if fastest > near else 1.0)
    if slowest > near:
        limit = math.inf  # nothing slides, nothing to protect
    if k.group[0] >= 0:
        if deviation < s.air_known * v:
            k.group[0] = -1
    elif deviation > limit:
        best = math.inf
        for g in range(e.pressure.size):
            if e.pressure[g] < best:
                best, k.group[0] = e.pressure[g], g


@inlined_jit
def sound(eq, st, m, anyone):
    """Relieve a unit or a brake group where the estimate has grown vague; `anyone`: whether an axle has told the speed."""
    deviation, k = m.train.reference_deviation[0], m.estimate.sounding
    by_motors = False
    if eq.axles.size > 0:
        by_motors = _sound_unit(eq, st, m, deviation, anyone)
    braked = False
    for g in range(m.estimate.pressure.size):
        braked = braked or m.estimate.full[g] > 0.0
    if braked and not by_motors:
        _sound_group(eq, st, m, deviation)
    else:
        k.group[0] = -1
