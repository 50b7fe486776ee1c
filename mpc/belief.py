"""What the unit believes of its axles, and the slip that it seeks: from readings to a slip limit, without a known curve.

Belief       J dw/dt = R T - r N mu, exact over a period; mu and s of each axle pass the same filter, of pole `pole`.
Search       The slip limit swings, l = s* (1 + a sin p). z_s and z_mu are ln s and ln mu of the axle with most slip, less
             their means, correlated with the answer expected over `memory` (instrumental variables). Elasticity and its
             certainty are e = z_mu / z_s and c = z_s^2 / (z_s^2 + D). The target slip follows
             d ln s*/dt = gain c^2 (e - price s*), within +-`fastest`.

`m` is a row of `mpc.unit.MPC`.
"""

import math

from alloc.compilation import jit
from alloc.onboard.columns import NAN
from alloc.onboard.controllers.creep import clip, has_lasted, lag_share

AXLES = 8
"""Room for the axles that a unit watches at most: its foremost."""
SMOOTH, LATE = 0.2, 1.5
"""Averaging time of means and acceleration [s]; periods from a command to the middle of that in which its answer shows."""
LEAST_SLIP, LEAST_COEFFICIENT = 0.004, 0.005
"""Smaller values [m/s, 1] have no logarithm worth its noise."""


@jit
def observe_axles(unit, axles, m, run):
    """Pairs of coefficient and slip of each axle, noise of slip, acceleration; returns the axle with most slip, or -1."""
    period, v, torque = run.period, run.sign * run.reference_speed, unit.motor_torque
    share, left = lag_share(1.0 / m.pole, period), math.exp(-period / unit.lag)
    mean = torque  # of the torque over the period: the lag's answer to a command that was held
    if not math.isnan(m.torque):
        mean = (torque - m.torque * left) / (1.0 - left) + unit.lag / period * (m.torque - torque)
        m.acceleration += period / SMOOTH * ((v - m.speed) / period - m.acceleration)
    worst, seen, rough, i, at_rail = -1, 0, 0.0, -1, unit.radius * unit.load
    # the loop passes over axles that no motor drives: a selection of rows would copy them
    for a in axles:
        if a.unit < 0 or i + 1 == AXLES:
            continue
        i += 1
        if a.seen == 0 or not math.isfinite(a.reading):
            m.rim[i] = NAN
            continue
        rim, s = run.sign * a.reading, run.sign * a.reading - v
        if math.isnan(m.rim[i]):
            m.rim[i], m.mean_slip[i] = rim, NAN
            m.reading[i] = m.last_reading[i] = m.slip[i] = s
            m.coefficient[i] = unit.gear * torque / at_rail
        turning = unit.inertia * (rim - m.rim[i]) / (unit.radius * period)
        m.coefficient[i] += share * ((unit.gear * mean - turning) / at_rail - m.coefficient[i])
        m.slip[i] += share * (0.5 * (s + m.reading[i]) - m.slip[i])
        rough += abs(s - 2.0 * m.reading[i] + m.last_reading[i])
        m.rim[i], m.last_reading[i], m.reading[i] = rim, m.reading[i], s
        seen += 1
        if worst < 0 or m.slip[i] > m.slip[worst]:
            worst = i
    if seen > 0:
        rough /= 1.95 * seen  # mean size of a normal second difference: 0.8 sqrt(6) deviations
        m.noise += period * (min(rough, 4.0 * max(m.noise, 2e-4)) - m.noise)
    m.torque, m.speed = torque, v
    return worst


@jit
def seek_slip(unit, m, limited, period):
    """Elasticity of the curve at the axle with most slip, and the target slip; returns the slip limit [m/s]."""
    m.sought = min(max(m.sought, m.lowest, m.margin * m.noise), m.highest)
    unsure = m.noise / m.sought
    swing = min(max(m.swing, m.loud * unsure), m.most)
    m.phase += m.turn * period
    lag = math.atan(m.turn / m.pole) + math.atan(m.turn * unit.lag)
    expected = math.sin(m.phase - lag - (LATE + m.late) * m.turn * period)
    m.ticks = m.ticks + 1 if limited else 0
    top = correlate_answers(unit, m, limited, expected, period)
    settled = top >= 0 and has_lasted(m.ticks, SMOOTH, period)
    if settled and math.exp(m.mean_slip[top]) > 0.5 * m.sought:
        z, full, filtered = max(m.slip_answer[top], 1e-9), 0.5 * m.memory * swing, m.turn / m.pole
        sensors = 0.5 * period * m.memory / (1.0 + filtered * filtered) * unsure * unsure
        m.certainty = z * z / (z * z + m.doubt * full * full + sensors)
        e = clip(m.coefficient_answer[top] / z, -0.5, 1.0)
        m.elasticity += period / m.memory * m.certainty * (e - m.elasticity)
        rate = m.gain * m.certainty * m.certainty * (e - m.price * m.sought)
        m.sought *= math.exp(period * clip(rate, -m.fastest, m.fastest))
    return m.sought * (1.0 + swing * math.sin(m.phase))


@jit
def correlate_answers(unit, m, limited, expected, period):
    """z_s and z_mu of each axle with the answer `expected` now; returns the axle with most slip of those seen, or -1."""
    top = -1
    for i in range(AXLES):
        mu = m.coefficient[i] + unit.air / unit.load
        seen = limited and not math.isnan(m.rim[i])
        if not seen or m.slip[i] < LEAST_SLIP or mu < LEAST_COEFFICIENT:
            m.mean_slip[i] = NAN
            continue
        x, y = math.log(m.slip[i]), math.log(mu)
        if math.isnan(m.mean_slip[i]):
            m.mean_slip[i], m.mean_coefficient[i] = x, y
            m.slip_answer[i] = m.coefficient_answer[i] = 0.0
        m.mean_slip[i] += period / SMOOTH * (x - m.mean_slip[i])
        m.mean_coefficient[i] += period / SMOOTH * (y - m.mean_coefficient[i])
        x, y = expected * (x - m.mean_slip[i]), expected * (y - m.mean_coefficient[i])
        m.slip_answer[i] += period * (x - m.slip_answer[i] / m.memory)
        m.coefficient_answer[i] += period * (y - m.coefficient_answer[i] / m.memory)
        if top < 0 or m.mean_slip[i] > m.mean_slip[top]:
            top = i
    return top
