"""Relative wheel radii, found while the train rolls.

Wheels that no force acts on turn with the speed of their body. What one runs ahead of the others is then the error of its
believed radius, e_i:

    y_i = v (1 + e_i) + n,    e_i constant,    n ~ 2 noise^2,    sum of all e_i = 0

Each e_i has a scalar Kalman filter. The error that all wheels have in common is not seen, but it makes no slip either.
A train has mostly done so before a run begins (`ReferenceSpeed.radii_compared`).
"""

import numpy as np

from alloc.compilation import inlined_jit

LEAST_SPEED = 3.0
"""Speed [m/s] below which noise hides the radii."""

LEAST_COEFFICIENT, LEAST_PRESSURE = 1e-3, 1e3
"""Coefficient asked of a wheel, and cylinder pressure [Pa], below which neither makes it slip."""

AFTER = 0.5
"""Time [s] for which nothing has acted on any wheel: before, some may still return from a slide."""

GATE = 5.0
"""Deviations of a radius beyond which a reading is another fault."""


@inlined_jit
def _nothing_acts(eq, torque, pressure):
    """Whether neither motors nor shoes act on any wheel; `torque` (units,) [N m], `pressure` (groups,) [Pa]."""
    acts = False
    for j in range(torque.size):
        asked = abs(torque[j]) * eq.gear[j]
        acts = acts or asked > LEAST_COEFFICIENT * eq.radius[j] * eq.axle_load[j]
    for g in range(pressure.size):
        acts = acts or pressure[g] > LEAST_PRESSURE
    return not acts


@inlined_jit
def compare_radii(eq, st, m, commanded, torque, pressure):
    """Learn from one period in which the train rolls: fills `m.estimate.radii`.

    `commanded` acceleration [m/s2]; others as of `kalman_filter.predict`.
    """
    o, k, n = st.reference, m.estimate.radii, m.axle_omega.size
    if o.radius_deviation == 0.0:
        return
    rolls = commanded == 0.0 and _nothing_acts(eq, torque, pressure)
    k.rolling[0] = k.rolling[0] + st.period if rolls else 0.0
    if k.rolling[0] < AFTER or m.reference[0] < LEAST_SPEED:
        return
    most = GATE * o.radius_deviation
    together, count = 0.0, 0.0
    for i in range(n):
        v = m.reference[eq.axle_body[i]]
        k.ahead[i] = eq.axle_radius[i] * m.axle_omega[i] / v - 1.0
        if m.axle_seen[i] and abs(k.ahead[i]) < most:
            together, count = together + k.ahead[i], count + 1.0
    for i in range(n):
        if m.axle_seen[i] and abs(k.ahead[i]) < most:
            v = m.reference[eq.axle_body[i]]
            told = 0.5 * v * v / o.noise**2
            k.known[i] += told
            gain = told / (k.known[i] + 1.0 / o.radius_prior**2)
            change = 1.0 - gain * (k.ahead[i] - together / count)
            k.factor[i] *= change
            m.estimate.rim[i] *= change
            m.estimate.smooth_rim[i] *= change
    for j in range(torque.size):
        # the unit's speed is another now, which is no acceleration
        m.differentiator[j] = m.observer[j] = np.nan
