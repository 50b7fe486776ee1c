"""The readhesion MPC of one traction unit: it holds the best slip that the rail offers, and finds it without a known curve.

All counts positive along the demand. Of each axle: w angular speed, s = r w - v slip, mu coefficient, N load, J inertia; T
is the torque of a motor, u its command, R the gear ratio; a hat means filtered.

Belief       J dw/dt = R T - r N mu, exact over a period; mu and s pass the same filter, of pole `pole`.
Search       The slip limit swings, l = s* (1 + a sin p). z_s and z_mu are ln s and ln mu of the axle with most slip, less
             their means, correlated with the answer expected over `memory` (instrumental variables). Elasticity and its
             certainty are e = z_mu / z_s and c = z_s^2 / (z_s^2 + D). The slip sought follows
             d ln s*/dt = gain c^2 (e - price s*), within +-`fastest`.
Prediction   mu(s) = mu^ (1 + e (s - s^) / s^) about the present pair (s^, mu^): linear, so s_k = free_k + sum_j g_(k-j) u_j.
Problem      minimise sum_k (u_k - target)^2 + w_u (u_k - u_(k-1))^2 + w_s max(0, s_k - l)^2   in 0 <= u_k <= upper,
             torques over that of a coefficient of 0.1, slips over 0.05 m/s.

`control` is one period of it, in this order; `plan` solves the problem. Registered as "mpc".
"""

import math

import numpy as np

from alloc.columns import NAN, ONE
from alloc.compilation import jit
from alloc.onboard.controllers import register
from alloc.onboard.searches import clip, lag_share, lasted, per_coefficient
from alloc.onboard.sensing import is_seen
from alloc.parts import control
from alloc.tables import Column, Table

STEPS, AXLES = 30, 8
"""Room for the longest horizon, and for the axles that a unit watches at most: its foremost."""
COEFFICIENT, SLIP = 0.1, 0.05
"""Scales: coefficient whose torque is one, slip that is one [m/s]."""
SMOOTH, LATE = 0.2, 1.5
"""Averaging time of means and acceleration [s]; periods from a command to the middle of that in which its answer shows."""
LEAST_SLIP, LEAST_COEFFICIENT = 0.004, 0.005
"""Smaller values [m/s, 1] have no logarithm worth its noise."""

ASSUMED, TUNED = "assumed", "tuned on 24 events of another seed than those that judge it"
OF_EACH = (0.0,) * AXLES

MPC = Table(
    "mpc",
    horizon=Column(15, ONE, "steps of the prediction, of a control period", source=TUNED),
    change_weight=Column(0.3, ONE, "weight w_u of changes of torque", source=ASSUMED),
    slip_weight=Column(2.0, ONE, "weight w_s of slip beyond its limit", source=ASSUMED),
    pole=Column(25.0, "s-1", "pole of the filter of the pairs", source="the observer's"),
    first=Column(0.08, "m s-1", "slip sought at first", source=ASSUMED),
    lowest=Column(0.02, "m s-1", "least slip sought", source=ASSUMED),
    highest=Column(1.6, "m s-1", "greatest slip sought", source=ASSUMED),
    margin=Column(4.0, ONE, "least slip sought over the noise of slip", source=ASSUMED),
    price=Column(0.15, "s m-1", "relative loss of force accepted per slip", source=ASSUMED),
    swing=Column(0.08, ONE, "relative swing a of the slip limit", source=TUNED),
    loud=Column(1.5, ONE, "swing over the relative noise of slip, if more", source=TUNED),
    most=Column(0.3, ONE, "greatest swing", source=TUNED),
    turn=Column(31.4, "rad s-1", "angular frequency of the swing", source=ASSUMED),
    memory=Column(0.3, "s", "memory of the search", source=TUNED),
    gain=Column(15.0, "s-1", "relative speed of the slip sought per elasticity", source=TUNED),
    fastest=Column(3.0, "s-1", "greatest relative speed of the slip sought", source=TUNED),
    doubt=Column(0.1, ONE, "D over the square of a full answer", source=TUNED),
    least=Column(0.1, ONE, "least elasticity that is predicted with", source=TUNED),
    direction=Column(0.0, ONE, "direction of the demand a period ago; 0: begins anew"),
    torque=Column(NAN, "N m", "torque of a motor a period ago"),
    speed=Column(NAN, "m s-1", "train speed a period ago"),
    acceleration=Column(0.0, "m s-2", "acceleration of the train, filtered"),
    noise=Column(0.005, "m s-1", "deviation of a slip's noise"),
    sought=Column(NAN, "m s-1", "slip sought, s*"),
    phase=Column(NAN, "rad", "phase p of the swing"),
    elasticity=Column(0.5, ONE, "elasticity e of the curve at the axle with most slip"),
    certainty=Column(0.0, ONE, "certainty c of it"),
    ticks=Column(0, ONE, "control periods for which the unit has been limited"),
    torques=Column((0.0,) * STEPS, ONE, "torques of the last plan, over their scale"),
    rim=Column(OF_EACH, "m s-1", "rim speed a period ago; nan: unknown"),
    now=Column(OF_EACH, "m s-1", "slip as read"),
    before=Column(OF_EACH, "m s-1", "slip as read a period ago"),
    slip=Column(OF_EACH, "m s-1", "slip, filtered"),
    coefficient=Column(OF_EACH, ONE, "coefficient, filtered, less the air brake's part"),
    mean_slip=Column(OF_EACH, ONE, "mean of the logarithm of the slip [m s-1]; nan: none"),
    mean_coefficient=Column(OF_EACH, ONE, "mean of the logarithm of the coefficient"),
    slip_answer=Column(OF_EACH, "s", "z_s, correlation of the slip with the answer expected"),
    coefficient_answer=Column(OF_EACH, "s", "z_mu, that of the coefficient"),
)
ROW = MPC.dtype


@control
def mpc(unit, axles, memory, run):
    """A control period; a plan that is not solved counts as a fault, and everything but the search begins anew."""
    m = memory.view(ROW)[0]
    scale = COEFFICIENT * per_coefficient(unit)
    largest = unit.drive_limit if run.sign > 0.0 else unit.brake_limit
    upper = max(min(unit.torque_target, largest), 0.0)
    if m.direction != run.sign:
        begin(m, axles[0].unit, max(unit.motor_torque, 0.0) / scale)
        m.direction = run.sign
    worst = observe(unit, axles, m, run)
    if worst < 0:  # no speed is known, so nothing is known of slip
        unit.torque_command = upper
        return
    swing = seek(unit, m, unit.motor_torque < 0.999 * upper, run.period)
    n = m.horizon
    free, gain, torques = np.empty(n), np.empty(n), np.empty(n)
    respond(unit, m, worst, scale, free, gain, run.period)
    for k in range(n):
        torques[k] = clip(m.torques[min(k + 1, n - 1)], 0.0, upper / scale)
    limit = m.sought * (1.0 + swing * math.sin(m.phase)) / SLIP
    weights = m.change_weight, m.slip_weight
    wanted, last = unit.torque_target / scale, m.torques[0]
    if not plan(free, gain, limit, torques, last, wanted, upper / scale, weights):
        unit.faults += 1
        m.direction = 0.0
    m.torques[:n] = torques
    unit.torque_command = min(torques[0] * scale, upper)


@jit
def begin(m, unit, torque):
    """Nothing is known of the period before; `torque`: of a motor, over its scale."""
    m.torque = m.speed = NAN
    m.rim[:], m.torques[:] = NAN, torque
    if math.isnan(m.sought):
        m.sought, m.phase = m.first, 2.4 * unit  # units swing apart from each other


# Belief


@jit
def observe(unit, axles, m, run):
    """Pairs of coefficient and slip of each axle, noise of slip, acceleration; returns the axle with most slip, or -1."""
    period, v, torque = run.period, run.sign * run.reference_speed, unit.motor_torque
    share, left = lag_share(1.0 / m.pole, period), math.exp(-period / unit.lag)
    mean = torque  # of the torque over the period: the lag's answer to a command that was held
    if not math.isnan(m.torque):
        mean = (torque - m.torque * left) / (1.0 - left) + unit.lag / period * (m.torque - torque)
        m.acceleration += period / SMOOTH * ((v - m.speed) / period - m.acceleration)
    worst, known, rough, i, at_rail = -1, 0, 0.0, -1, unit.radius * unit.load
    for a in axles:
        if a.unit < 0 or i + 1 == AXLES:
            continue
        i += 1
        if not is_seen(a, run.time):
            m.rim[i] = NAN
            continue
        rim, s = run.sign * a.reading, run.sign * a.reading - v
        if math.isnan(m.rim[i]):
            m.rim[i], m.now[i], m.before[i], m.slip[i], m.mean_slip[i] = rim, s, s, s, NAN
            m.coefficient[i] = unit.gear * torque / at_rail
        turning = unit.inertia * (rim - m.rim[i]) / (unit.radius * period)
        m.coefficient[i] += share * ((unit.gear * mean - turning) / at_rail - m.coefficient[i])
        m.slip[i] += share * (0.5 * (s + m.now[i]) - m.slip[i])
        rough += abs(s - 2.0 * m.now[i] + m.before[i])
        m.rim[i], m.before[i], m.now[i] = rim, m.now[i], s
        known += 1
        if worst < 0 or m.slip[i] > m.slip[worst]:
            worst = i
    if known > 0:
        rough /= 1.95 * known  # mean size of a normal second difference: 0.8 sqrt(6) deviations
        m.noise += period * (min(rough, 4.0 * max(m.noise, 2e-4)) - m.noise)
    m.torque, m.speed = torque, v
    return worst


# Search


@jit
def seek(unit, m, limited, period):
    """Elasticity of the curve at the axle with most slip, and the slip sought; returns the size of the swing."""
    m.sought = min(max(m.sought, m.lowest, m.margin * m.noise), m.highest)
    unsure = m.noise / m.sought
    swing = min(max(m.swing, m.loud * unsure), m.most)
    m.phase += m.turn * period
    lag = math.atan(m.turn / m.pole) + math.atan(m.turn * unit.lag) + LATE * m.turn * period
    expected = math.sin(m.phase - lag)
    m.ticks = m.ticks + 1 if limited else 0
    top = -1
    for i in range(AXLES):
        mu = m.coefficient[i] + unit.air / unit.load
        heard = limited and not math.isnan(m.rim[i])
        if not heard or m.slip[i] < LEAST_SLIP or mu < LEAST_COEFFICIENT:
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
    settled = top >= 0 and lasted(m.ticks, SMOOTH, period)
    if settled and math.exp(m.mean_slip[top]) > 0.5 * m.sought:
        z, full, filtered = max(m.slip_answer[top], 1e-9), 0.5 * m.memory * swing, m.turn / m.pole
        sensors = 0.5 * period * m.memory / (1.0 + filtered * filtered) * unsure * unsure
        m.certainty = z * z / (z * z + m.doubt * full * full + sensors)
        e = clip(m.coefficient_answer[top] / z, -0.5, 1.0)
        m.elasticity += period / m.memory * m.certainty * (e - m.elasticity)
        rate = m.gain * m.certainty * m.certainty * (e - m.price * m.sought)
        m.sought *= math.exp(period * clip(rate, -m.fastest, m.fastest))
    return swing


# Prediction


@jit
def respond(unit, m, i, scale, free, gain, period):
    """Slip of axle `i` without torque from now on (`free`), and by one step of torque `scale` (`gain`), over SLIP.

    ds/dt = (r / J) (R T + r N (air - mu(s))) - dv/dt and lag dT/dt = u - T, both exact.
    """
    air = unit.air / unit.load
    mu, s = max(m.coefficient[i] + air, 1e-3), max(m.slip[i], LEAST_SLIP, m.noise)
    slope = clip(m.elasticity, m.least, 1.0) * mu / s
    stiff = unit.radius * unit.radius * unit.load / unit.inertia
    pull = unit.radius * unit.gear / unit.inertia
    push = stiff * (air - mu + slope * m.slip[i]) - m.acceleration
    keep, left = math.exp(-stiff * slope * period), math.exp(-period / unit.lag)
    reach = (1.0 - keep) / (stiff * slope)
    share = unit.lag / period * (1.0 - left)  # weight of the torque in its mean over a step
    slip, torque, more, held = m.now[i], m.torque, 0.0, 0.0
    for k in range(free.size):
        u = scale if k == 0 else 0.0
        slip = keep * slip + reach * (pull * share * torque + push)
        more = keep * more + reach * pull * ((1.0 - share) * u + share * held)
        torque, held = left * torque, left * held + (1.0 - left) * u
        free[k], gain[k] = slip / SLIP, more / SLIP


# Problem


@jit
def plan(free, gain, limit, u, before, target, upper, weights):
    """Put the torques that solve the problem into `u`, from those in it on; whether they do. All are over their scales.

    Newton's method on the torques that are off their bounds, with steps projected and halved until the cost falls.
    `weights`: w_u, w_s. `before`: the torque commanded last.
    """
    n, reached = u.size, cost(free, gain, limit, u, before, target, weights)
    hessian, slope = np.empty((n, n)), np.empty(n)
    for _ in range(20):
        differentiate(free, gain, limit, u, before, target, weights, hessian, slope)
        steepest = 0.0
        for k in range(n):
            if (u[k] <= 0.0 and slope[k] > 0.0) or (u[k] >= upper and slope[k] < 0.0):
                hessian[k, :] = hessian[:, k] = slope[k] = 0.0
                hessian[k, k] = 1.0
            steepest = max(steepest, abs(slope[k]))
        if steepest < 1e-6:
            return True
        divide(slope, hessian)
        share, now, tried = 1.0, math.inf, u
        while now >= reached and share > 1e-4:
            tried = np.minimum(np.maximum(u - share * slope, 0.0), upper)
            now, share = cost(free, gain, limit, tried, before, target, weights), 0.5 * share
        if not now < reached:  # rounding hides the rest, or there is no way down
            return steepest < 1e-3
        u[:], reached = tried, now
    return False


@jit
def excess(free, gain, limit, u, k):
    """Slip beyond its limit after step `k`, negative below."""
    over = free[k] - limit
    for j in range(k + 1):
        over += gain[k - j] * u[j]
    return over


@jit
def cost(free, gain, limit, u, before, target, weights):
    """The problem's cost."""
    total, last = 0.0, before
    for k in range(u.size):
        missed, change = u[k] - target, u[k] - last
        over = max(excess(free, gain, limit, u, k), 0.0)
        total += missed * missed + weights[0] * change * change + weights[1] * over * over
        last = u[k]
    return total


@jit
def differentiate(free, gain, limit, u, before, target, weights, hessian, slope):
    """Fill `hessian` and `slope`: half of the cost's second and first derivatives."""
    hessian[:], slope[:] = 0.0, 0.0
    for k in range(u.size):
        change, over = u[k] - (u[k - 1] if k > 0 else before), excess(free, gain, limit, u, k)
        hessian[k, k] += 1.0 + weights[0]
        slope[k] += u[k] - target + weights[0] * change
        if k > 0:
            hessian[k - 1, k - 1] += weights[0]
            hessian[k, k - 1] -= weights[0]
            hessian[k - 1, k] -= weights[0]
            slope[k - 1] -= weights[0] * change
        for i in range(k + 1 if over > 0.0 else 0):
            slope[i] += weights[1] * gain[k - i] * over
            for j in range(k + 1):
                hessian[i, j] += weights[1] * gain[k - i] * gain[k - j]


@jit
def divide(x, a):
    """Put the solution of a y = x into `x`, by Cholesky's factor, which replaces the lower half of `a`."""
    n = x.size
    for i in range(n):
        for j in range(i + 1):
            for k in range(j):
                a[i, j] -= a[i, k] * a[j, k]
            a[i, j] = math.sqrt(a[i, i]) if i == j else a[i, j] / a[j, j]
        for k in range(i):
            x[i] -= a[i, k] * x[k]
        x[i] /= a[i, i]
    for i in range(n - 1, -1, -1):
        for k in range(i + 1, n):
            x[i] -= a[k, i] * x[k]
        x[i] /= a[i, i]


register(
    "mpc", mpc, "model predictive control of each unit",
    MPC, "#aa39ff", "P",
    {"horizon": (1, STEPS)} | dict.fromkeys(("change_weight", "slip_weight", "margin", "price", "loud"), (0.0, math.inf)),
)  # fmt: skip
