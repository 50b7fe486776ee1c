"""Train speed from all wheel speeds and all applied forces: an extended Kalman filter of four states.

State x = (v, d, c, q): speed of the train, unknown specific force (gradient, error of resistance and of shoe friction),
micro-slip per coefficient, relative error of the inverse mass. Axle i: rim speed y_i, force F_i that motor and shoes apply
at the rim, rotating mass m_i = J / r^2, load N_i. The prediction is the momentum balance of train and wheelsets, in which no
force has to be differentiated:

    M dv = (1 + q) (sum F_i dt - sum m_i dy_i) - R(v) dt + M d dt,    dd = walk,    dc = dq = 0

Coupled cars are a believed chain of bodies with springs and dampers; the filter corrects its common speed. Let s be the
direction of the demand, mu_i = F_i / N_i, and e the slip ratio of a rolling wheel at the full adhesion. Measurements:

    free axle                        y_i = v + n,                n ~ noise^2
    at ease, light, or sounded       y_i = v + c mu_i + n,       n ~ noise^2 + repeat (e v mu_i / mu_carried)^2
    any                              s (y_i - v) >= 0: an axle that violates it in the mean of 0.1 s measures v

An axle is at ease while nobody limits its force and it does not run away. It is light while its force is a small share of
what it carried lately and it no longer returns from a slide. `sounding` says when a sounded axle has settled. Other axles
may slide and give no upper bound. No matrix is inverted: axles are taken one by one.
"""

import math

from alloc.compilation import inlined_jit
from alloc.onboard.reference_speed.sounding import has_settled, is_relieved
from alloc.onboard.reference_speed.speed_reading import FORCE, MASS, SLIP, SPEED, believe
from alloc.onboard.reference_speed.state import OBSERVER_POLE
from alloc.onboard.shoe_force import believed_shoe_force
from alloc.plant.equations import (
    coupler_damper_force,
    coupler_spring_force,
    coupler_stretch,
    running_resistance,
)

STANDING = 0.1
"""Rim speed [m/s] below which a braked wheel counts as standing."""

LEAST_COEFFICIENT = 8e-3
"""Applied coefficient below which a wheel counts as free: no rail is that slippery."""

LEAST_SHARE = 0.1
"""Smallest share of its adhesion that a wheel is assumed to use: its own inertia makes even a free wheel creep."""


@inlined_jit
def start(eq, o, m, k):
    """Begin with the computers' initial reference speed."""
    k.ready[0] = 1
    k.state[SPEED], k.state[FORCE], k.state[SLIP], k.state[MASS] = m.reference[0], 0.0, o.slip, 0.0
    k.covariance[SPEED, SPEED] = o.noise**2
    k.covariance[FORCE, FORCE] = o.unknown_force**2
    k.covariance[SLIP, SLIP] = o.slip_deviation**2
    k.covariance[MASS, MASS] = o.mass_error**2
    k.smooth_speed[0] = m.reference[0]
    for i in range(k.rim.size):
        k.rim[i] = k.smooth_rim[i] = eq.axle_radius[i] * m.axle_omega[i]


@inlined_jit
def _apply_forces(eq, st, m, k, sign, torque, pressure):
    """Forces of motors and shoes on every axle and body; returns the specific force of all, and of the shoes."""
    total, of_shoes = 0.0, 0.0
    for b in range(k.force.size):
        k.force[b] = 0.0
    for i in range(k.rim.size):
        r, j, g, b = eq.axle_radius[i], eq.axle_unit[i], eq.axle_group[i], eq.axle_body[i]
        y = r * m.axle_omega[i]
        force, shoe = 0.0, 0.0
        if j >= 0:
            force = eq.gear[j] * 0.5 * (torque[j] + m.torque[j]) / r
        if g >= 0 and pressure[g] > 0.0:
            shoe = believed_shoe_force(eq.group, g, pressure[g], y)
            if y < STANDING and m.reference[b] > STANDING:
                shoe = min(shoe, k.carried[i])  # a standing wheel's shoe gives what the rail does
            force -= shoe
        k.applied[i] = sign * force
        acting = force - eq.chain.turning[i] * (y - k.rim[i]) / st.period
        k.force[b] += acting
        total += acting
        of_shoes += shoe
        k.rim_rate[i] += st.pace.rate_gain * ((y - k.rim[i]) / st.period - k.rim_rate[i])
        k.rim[i] = y
    return total / eq.chain.train_mass, of_shoes / eq.chain.train_mass


@inlined_jit
def _move(eq, st, m, k):
    """Move the believed bodies through one period under `k.force`; the unknown force acts on all.

    Dampers and stiffening springs act with the speeds of the end, so no coupler is too stiff for the step: with the masses
    M, the Laplacian L of these couplings and the step h, (M + h L) a = net force, solved from front to rear and back.
    """
    chain, n = eq.chain, k.force.size
    h = st.period / chain.steps
    f = k.state
    for _ in range(chain.steps):
        pull, passed, inertia = (
            0.0,
            0.0,
            0.0,
        )  # of the coupler ahead, and of all before it through the coupler
        for b in range(n):
            v = m.reference[b]
            a, linear, quadratic = chain.resistance[b]
            # resistance brings a body to rest within a step at most, and does not turn it round
            most = chain.mass[b] * abs(v) / h
            resistance = running_resistance(v, a, linear, quadratic, 1.0)
            net = (1.0 + f[MASS]) * k.force[b] - min(max(resistance, -most), most)
            net += pull
            coupling = 0.0
            if b + 1 < n:
                q = chain.coupler[b]
                stretch = coupler_stretch(k.place[b] - k.place[b + 1], q[3])
                damping = coupler_damper_force(stretch, 1.0, q[2])
                pull = coupler_spring_force(stretch, q[0], q[1])
                pull += damping * (v - m.reference[b + 1])
                net -= pull
                coupling = h * (damping + 3.0 * h * q[1] * stretch * stretch)
            # what moves with the body before it only as far as the coupler passes it on
            inertia += chain.mass[b]
            passed += net
            k.change[b] = passed / (inertia + coupling)
            k.share[b] = coupling / (inertia + coupling)
            inertia *= k.share[b]
            passed *= k.share[b]
        change = 0.0
        for b in range(n - 1, -1, -1):
            change = k.change[b] + k.share[b] * change
            m.reference[b] += h * (change + f[FORCE])
            k.place[b] += h * m.reference[b]


@inlined_jit
def _predict(st, k, acting, of_shoes):
    """Covariance one period later; `acting` specific force of all axles, `of_shoes` of the shoes [m/s2]."""
    o, p, period = st.reference, k.covariance, st.period
    for j in range(4):  # P <- F P F' + Q
        p[0, j] += period * (p[1, j] + acting * p[3, j])
    for i in range(4):
        p[i, 0] += period * (p[i, 1] + acting * p[i, 3])
    p[0, 0] += o.speed_walk**2 * period
    walk = o.shoe_walk * of_shoes
    p[1, 1] += (o.force_walk**2 + walk**2) * period
    if of_shoes > k.shoe_decel[0]:  # as the brakes are applied their unknown share grows
        p[1, 1] += o.shoe_error**2 * (of_shoes**2 - k.shoe_decel[0] ** 2)
        k.shoe_decel[0] = of_shoes
    elif of_shoes == 0.0:
        k.shoe_decel[0] = 0.0


@inlined_jit
def _follow_rims(eq, st, k, sign, i, sounded):
    """Rail force and acceleration of axle `i` against the train's [m/s2], both behind one filter."""
    o, gain, y = st.reference, st.pace.observer_gain, k.rim[i]
    rate = OBSERVER_POLE * (y - k.smooth_rim[i])
    k.smooth_rim[i] += gain * (y - k.smooth_rim[i])
    k.smooth_applied[i] += gain * (k.applied[i] - k.smooth_applied[i])
    relative = sign * (rate - OBSERVER_POLE * (k.state[SPEED] - k.smooth_speed[0]))
    rail = k.smooth_applied[i] - sign * eq.chain.turning[i] * rate
    slides = relative < -o.returning or relative > 3.0 * o.returning
    kept = st.pace.slid_kept if slides else st.pace.carried_kept
    standing = sign < 0.0 and y < STANDING
    k.carried[i] = max(k.carried[i] * kept, 0.0 if standing else rail)
    if not sounded:
        k.rail[i] = rail
    return relative, standing


@inlined_jit
def _at_ease(eq, st, m, k, i):
    """Time for which nobody has limited the force of axle `i`."""
    j, g = eq.axle_unit[i], eq.axle_group[i]
    limited = j >= 0 and (m.unit.torque_factor[j] < 0.99 or is_relieved(m, j))
    if g >= 0:
        limited = limited or m.slide.action[g] > 0.0 or k.pressure[g] < 0.95 * k.full[g]
    k.ease[i] = 0.0 if limited else k.ease[i] + st.period
    return k.ease[i]


@inlined_jit
def _adhesion(eq, o, k, i, sign):
    """Coefficient that axle `i` asks for, and the deviation of its micro-slip [m/s]."""
    applied = max(k.applied[i], 0.0)
    used = applied / max(k.carried[i], LEAST_COEFFICIENT * eq.chain.load[i])
    scale = o.creep * max(abs(k.state[SPEED]), o.creep_speed)
    return sign * applied / eq.chain.load[i], scale * min(max(used, LEAST_SHARE), 1.5)


@inlined_jit
def _measure(eq, st, m, k, sign):
    """Take what the axles tell; returns whether one of them rolls as it pleases."""
    o, pace, f, p = st.reference, st.pace, k.state, k.covariance
    white = 2.0 * o.noise**2
    lead, lightest, foremost, least, anyone = 1e9, -1, 1e9, 0.0, False
    free, together = 0.0, 0.0
    unknown = math.sqrt(p[1, 1])
    before = f[SPEED]
    for i in range(k.rim.size):
        if not m.axle_seen[i]:
            continue
        j = eq.axle_unit[i]
        sounded = j >= 0 and k.sounding.unit[0] == j
        relative, standing = _follow_rims(eq, st, k, sign, i, sounded)
        ease = _at_ease(eq, st, m, k, i)
        y, applied = k.rim[i], max(k.applied[i], 0.0)
        # of its body, with what the axles before it have told
        body = m.reference[eq.axle_body[i]] + f[SPEED] - before
        mu, creep = _adhesion(eq, o, k, i, sign)
        innovation = y - body - f[SLIP] * mu
        k.ahead[i] += st.pace.mean_share * (sign * (y - body) - k.ahead[i])
        foremost = min(foremost, k.ahead[i])
        settled = relative > -o.returning and not standing
        # a sliding wheel would return by more than `returning` under so little force, or slide on; motors may hold its slip
        would = 0.0 if j >= 0 else o.light * k.carried[i] - eq.chain.turning[i] * o.returning
        light = applied < max(would, LEAST_COEFFICIENT * eq.chain.load[i])
        light = light and relative < o.returning
        k.telling[i] = k.telling[i] + st.period if light and settled else 0.0
        # brakes may press all wheels into one slow slide, which looks like a steeper climb; motors do not for long
        doubt = -2.0 if eq.axle_group[i] >= 0 and k.pressure[eq.axle_group[i]] > 0.0 else 2.0
        if j < 0 and applied == 0.0 and settled:
            free, together = free + 1.0, together + y - body
        elif sounded:
            turning = eq.chain.turning[i]
            if has_settled(o.sounding, k.sounding, k.rail[i], applied, turning, k.rim_rate[i]):
                k.sounding.told[0] = 1
                # while adhesion falls a sliding wheel may pass for settled: what is odd, and slips, is not believed
                believe(
                    o,
                    k,
                    mu,
                    innovation,
                    white + pace.sounded_repeat * creep**2,
                    sign * innovation < 0.0,
                )
        elif light:
            if settled and k.ahead[i] < lead:
                lead, lightest = k.ahead[i], i
        elif (
            settled
            and ease > o.ease_time
            and relative < o.away + doubt * unknown
            and k.ahead[i] - sign * f[SLIP] * mu < o.gate * math.sqrt(p[0, 0] + creep**2 + white)
        ):
            believe(o, k, mu, innovation, white + pace.repeat * creep**2, False)
            anyone = True
        if not (light and settled):
            least = min(least, k.ahead[i] + sign * (before - f[SPEED]))
    if free > 0.0:
        creep = LEAST_SHARE * o.creep * max(abs(f[SPEED]), o.creep_speed)
        innovation = together / free + before - f[SPEED]
        believe(o, k, 0.0, innovation, (white + pace.light_repeat * creep**2) / free, True)
        anyone = True
    # a light wheel may slide on where the rail gives little; then one that cannot outrun the train is nearer to its speed
    near = o.creep * max(abs(f[SPEED]), o.creep_speed) + o.gate * o.noise
    if lightest >= 0 and lead < foremost + near:
        _take_light(eq, st, m, k, sign, lightest, f[SPEED] - before)
        anyone = True
    change = sign * min(least + o.noise, 0.0) * pace.bound_share
    for a in range(4):  # a bound moves all states and tells no more than that, so P stays
        f[a] += p[a, 0] / p[0, 0] * change
    return anyone


@inlined_jit
def _take_light(eq, st, m, k, sign, i, moved):
    """Take what the foremost of the light axles tells: others may still be on their way."""
    o, f = st.reference, k.state
    mu, creep = _adhesion(eq, o, k, i, sign)
    innovation = k.rim[i] - m.reference[eq.axle_body[i]] - moved - f[SLIP] * mu
    variance = 2.0 * o.noise**2 + st.pace.light_repeat * creep**2
    braked_by_air = eq.axle_group[i] >= 0 and k.pressure[eq.axle_group[i]] > 0.0
    if k.telling[i] > (0.5 * o.persist if braked_by_air else 0.1):
        trusted = k.telling[i] > o.persist or not braked_by_air
        believe(o, k, mu, innovation, variance, trusted)


@inlined_jit
def predict(eq, st, m, sign, torque, pressure):
    """Move the estimate through one period; returns the specific force of all axles, and of the shoes [m/s2].

    `sign` of the demand, `torque` (units,) of the motors [N m], `pressure` (groups,) of the cylinders [Pa].
    """
    k = m.estimate
    for g in range(pressure.size):
        k.pressure[g] = pressure[g]
    acting, of_shoes = _apply_forces(eq, st, m, k, sign, torque, pressure)
    _move(eq, st, m, k)
    k.state[SPEED] = m.reference[0]
    _predict(st, k, acting, of_shoes)
    return acting, of_shoes


@inlined_jit
def correct(eq, st, m, sign, of_shoes):
    """Use the axles' measurements: fills `m.reference` (bodies,) [m/s]; returns whether an axle measured the speed."""
    k, f = m.estimate, m.estimate.state
    anyone = _measure(eq, st, m, k, sign)
    most = st.reference.slip + 2.0 * st.reference.slip_deviation
    f[SLIP] = min(max(f[SLIP], 0.0), most)
    bound = 2.0 * st.reference.unknown_force + st.reference.shoe_error * of_shoes
    f[FORCE] = min(max(f[FORCE], -bound), bound)
    if sign < 0.0:
        f[SPEED] = max(f[SPEED], 0.0)
    k.smooth_speed[0] += st.pace.observer_gain * (f[SPEED] - k.smooth_speed[0])
    change = f[SPEED] - m.reference[0]
    for b in range(m.reference.size):
        m.reference[b] += change
    m.train.reference_deviation[0] = math.sqrt(max(k.covariance[0, 0], 0.0))
    return anyone


@inlined_jit
def estimate_speed(eq, st, m, sign, torque, pressure):
    """One control period; arguments as of `predict`, result as of `correct`."""
    if m.estimate.ready[0] == 0:
        start(eq, st.reference, m, m.estimate)
    _, of_shoes = predict(eq, st, m, sign, torque, pressure)
    return correct(eq, st, m, sign, of_shoes)
