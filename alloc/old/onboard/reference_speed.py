"""Torque relief: force is taken from a few wheels for a moment, so that they roll and tell the train's speed.

Where every axle may slide the estimate's deviation grows. Motors answer at once: one unit after the other is cut until its
wheels tell the speed, for 0.2 s at most. Cylinders do not: a bogie is released until the speed is known again.

A wheel that still slides while its unit is cut returns: it is accelerated by what the rail gave before the cut, less what is
applied now. One that does not return has settled, and tells the speed. Where the cut would make it return too slowly to be
seen, it tells nothing: air brakes may hold it in its slide.
"""

import math
from typing import Any, NamedTuple

import numpy as np

from alloc.old.compilation import equation, inlined_jit
from alloc.old.onboard.laws import believed_shoe_force
from alloc.old.plant.laws import (
    GRAVITY,
    coupler_damper_force,
    coupler_spring_force,
    coupler_stretch,
    running_resistance,
)
from alloc.old.plant.model import Floats, Ints

NEAR = 0.015
"""Slip ratio of a wheel that runs near the estimated speed."""

LEAST_SPEED = 8.0
"""Speed [m/s] below which the deviations of air brakes do not shrink any further."""

SEEN = 1.5
"""Rim acceleration [m/s2] of a sliding wheel that is seen when it is relieved."""

SETTLED = 0.5
"""Share of that acceleration below which it has settled."""

FALLING = 3.0
"""Rim acceleration [m/s2] with which no wheel has."""


@inlined_jit
def is_relieved(m, j):
    """Whether unit `j` is relieved or just getting its torque back: what its wheels do then is not of its own control."""
    return m.estimate.relief.share[j] < 1.0


@inlined_jit
def has_settled(s, k, before, applied, turning, rate):
    """Whether a wheel whose unit is relieved has settled.

    `before`: force [N] that the rail gave before, `applied`: force now [N], `turning` mass [kg], `rate`: its acceleration
    [m/s2].
    """
    sliding = (before - applied) / turning
    return k.clock[0] > s.time and sliding > SEEN and abs(rate) < min(FALLING, SETTLED * sliding)


@inlined_jit
def _acting_unit(eq, m, k, kept):
    """The next unit whose sliding wheels are seen to return when motors keep the share `kept` of their torque, -1: none."""
    for n in range(1, eq.axles.size + 1):
        j = (k.last[0] + n) % eq.axles.size
        coefficient = abs(m.torque[j]) * eq.gear[j] / (eq.radius[j] * eq.axle_load[j])
        relief = (1.0 - kept) * coefficient * GRAVITY
        if m.unit.axles_seen[j] > 0.0 and relief > SEEN * eq.own_inertia[j]:
            return j
    return -1


@inlined_jit
def _relieve_unit(eq, st, m, deviation, anyone):
    """Begin, carry on or end the relief of a unit; returns whether motors act."""
    s, k = st.reference.relief, m.estimate.relief
    k.clock[0] += st.period
    for j in range(k.share.size):
        k.share[j] = min(k.share[j] + st.period / s.return_time, 1.0)
    limit = max(s.doubt, s.doubt_ratio * abs(m.reference[0])) * (s.ease if anyone else 1.0)
    if k.unit[0] >= 0:
        if k.clock[0] > (s.time if k.measured[0] else s.longest):
            k.unit[0], k.clock[0] = -1, 0.0
        else:
            k.share[k.unit[0]] = s.share
        return True
    j = _acting_unit(eq, m, k, s.share)
    if j >= 0 and k.clock[0] > s.pause and deviation > limit:
        k.unit[0] = k.last[0] = j
        k.clock[0], k.measured[0] = 0.0, 0
        k.share[j] = s.share
    return j >= 0


@inlined_jit
def _release_group(eq, st, m, deviation):
    """Begin, carry on or end the release of a brake group."""
    s, k, e = st.reference.relief, m.estimate.relief, m.estimate
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
def relieve(eq, st, m, anyone):
    """Relieve a unit or a brake group where the estimate has grown vague; `anyone`: whether an axle has told the speed."""
    deviation, k = m.train.reference_deviation[0], m.estimate.relief
    by_motors = False
    if eq.axles.size > 0:
        by_motors = _relieve_unit(eq, st, m, deviation, anyone)
    braked = False
    for g in range(m.estimate.pressure.size):
        braked = braked or m.estimate.full[g] > 0.0
    if braked and not by_motors:
        _release_group(eq, st, m, deviation)
    else:
        k.group[0] = -1


# What a reading of the train's speed does to the estimate: a Kalman update, or, where it is odd, learning anew.


SPEED, FORCE, SLIP, MASS = range(4)
"""States."""

COMMON_ERROR = 0.7
"""Correlation of the errors of speed and unknown force where the force has changed unnoticed."""


@inlined_jit
def take_reading(f, p, slip, innovation, variance):
    """Kalman update with a measurement of v + `slip` c."""
    row = (
        p[0, 0] + slip * p[0, 2], p[1, 0] + slip * p[1, 2],
        p[2, 0] + slip * p[2, 2], p[3, 0] + slip * p[3, 2],
    )  # fmt: skip
    inverse = 1.0 / (row[0] + slip * row[2] + variance)
    for i in range(4):
        f[i] += row[i] * inverse * innovation
        for k in range(4):
            p[i, k] -= row[i] * inverse * row[k]


@inlined_jit
def _forget(o, p, innovation):
    """The force was another than believed for some time, a gradient for one: speed and force are both wrong by it."""
    p[0, 0] = max(p[0, 0], innovation**2)
    p[1, 1] = max(p[1, 1], o.unknown_force**2)
    p[0, 1] = p[1, 0] = COMMON_ERROR * math.sqrt(p[0, 0] * p[1, 1])
    for i in range(2):
        for j in range(2, 4):
            p[i, j] = p[j, i] = 0.0


@inlined_jit
def believe(o, k, slip, innovation, variance, trusted):
    """Take a reading; where it is odd and `trusted`, gradient and speed are learnt anew, else it is left."""
    p = k.covariance
    odd = innovation**2 > 9.0 * (p[0, 0] + variance)
    if odd and trusted:
        _forget(o, p, innovation)
    if trusted or not odd:
        take_reading(k.state, p, slip, innovation, variance)


# Input of the reference speed's estimate about train and sensors, and its memory.


OBSERVER_POLE = 12.0
"""Pole [1/s] of the filter behind which rail forces and rim accelerations are compared."""


RATE_POLE = 50.0
"""The same [1/s] of the filter behind which a relieved wheel is seen to settle, fast against a relief."""

NOISE_MARGIN = 2.5
"""Deviations of a noisy acceleration within which a wheel counts as at rest against the train."""

USUAL_PERIOD = 0.01
"""Period [s] for which the parameters count samples, and for which `BOUND_SHARE` is."""

MEAN_TIME = 0.1
"""Time [s] over which an axle's lead is averaged."""

BOUND_SHARE = 0.2
"""Share of its violation by which the bound of an axle moves the estimate per period."""

SLOWEST_SHARE = 0.25
"""Share of a new value that the mean takes at most: over fewer samples noise would not cancel."""


class ReferencePace(NamedTuple):
    """What depends on the period."""

    observer_gain: float  # share of a new value that a filter of `OBSERVER_POLE` takes
    rate_gain: float  # as observer_gain, of a filter of `RATE_POLE`
    carried_kept: float  # share of a wheel's greatest force that is remembered
    slid_kept: float
    mean_share: float  # as observer_gain, of the mean over `MEAN_TIME`
    bound_share: float  # as `BOUND_SHARE`
    repeat: float  # number of samples, as those of `ReferenceSpeed`
    light_repeat: float
    relieved_repeat: float


@equation
def reference_pace(o, period):
    """`ReferencePace` of a period [s]; `o`: `ReferenceSpeed`, or its numbers."""
    usual = USUAL_PERIOD / period
    return ReferencePace(
        -math.expm1(-OBSERVER_POLE * period),
        -math.expm1(-RATE_POLE * period),
        math.exp(-period / o.carried_time),
        math.exp(-period / o.slid_time),
        min(period / MEAN_TIME, SLOWEST_SHARE),
        min(BOUND_SHARE / usual, 2.0 * SLOWEST_SHARE),
        o.repeat * usual,
        o.light_repeat * usual,
        o.relieved_repeat * usual,
    )


class ReliefMemory(NamedTuple):
    """Which wheels are relieved for the sake of the estimate."""

    unit: Ints  # (1,) that is relieved, -1: none
    group: Ints  # (1,) brake group that is released, -1: none
    last: Ints  # (1,) unit that was relieved last
    measured: Ints  # (1,) whether one of its wheels has shown the speed
    clock: Floats  # (1,) time since a relief of a unit began or ended [s]
    share: Floats  # (units,) of the torque command that is left to each


class RadiusMemory(NamedTuple):
    """What is known of the wheels' radii, (axles,) unless said otherwise."""

    rolling: Floats  # (1,) time for which nothing has acted on any wheel [s]
    factor: Floats  # by which the believed radius is multiplied
    known: Floats  # inverse of the variance that its readings leave
    ahead: Floats  # what a wheel runs ahead of its body, relative


class ReferenceMemory(NamedTuple):
    """What the filter remembers."""

    ready: Ints  # (1,)
    state: Floats  # (4,) speed, unknown specific force, micro-slip per coefficient, error of the inverse mass
    covariance: Floats  # (4, 4)
    place: Floats  # (bodies,) of the believed bodies [m]
    force: Floats  # (bodies,) on them
    change: Floats  # (bodies,) acceleration of each [m/s2] were the next one to keep its speed
    share: Floats  # (bodies,) of the next one's acceleration that it follows
    smooth_speed: Floats  # (1,) speed behind a filter
    shoe_decel: Floats  # (1,) greatest specific force of the shoes in this application [m/s2]
    rim: Floats  # (axles,) rim speed at the last period
    rim_rate: Floats  # (axles,) its acceleration behind a fast filter [m/s2]
    rail: Floats  # (axles,) rail force; of a relieved unit's axles that before [N]
    smooth_rim: Floats  # (axles,) behind a filter
    applied: Floats  # (axles,) force that motor and shoe apply, in the direction of the demand [N]
    smooth_applied: Floats  # (axles,) behind the same filter
    carried: Floats  # (axles,) greatest force lately [N]
    ease: Floats  # (axles,) time for which nobody has limited its force [s]
    rolling_time: Floats  # (axles,) time for which it has been light and rolled [s]
    ahead: Floats  # (axles,) mean over 0.1 s of what it runs ahead, in the direction of the demand [m/s]
    full: Floats  # (groups,) pressure that is asked for
    pressure: Floats  # (groups,) that is there
    relief: ReliefMemory
    radii: RadiusMemory


def reference_memory(bodies: int, axles: int, units: int, groups: int) -> ReferenceMemory:
    """Memory of a train whose computers have not sensed yet."""
    nobody, not_measured = np.full((3, 1), -1, dtype=np.int64), np.zeros(1, dtype=np.int64)

    def zeros(size: int, *names: str) -> dict[str, Any]:
        return {name: np.zeros(size) for name in names}

    return ReferenceMemory(
        ready=np.zeros(1, dtype=np.int64), state=np.zeros(4), covariance=np.zeros((4, 4)),
        **zeros(bodies, "place", "force", "change", "share"), **zeros(1, "smooth_speed", "shoe_decel"),
        **zeros(axles, "rim", "rim_rate", "rail", "smooth_rim", "applied", "smooth_applied", "carried", "ease"),
        **zeros(axles, "rolling_time", "ahead"), **zeros(groups, "full", "pressure"),
        relief=ReliefMemory(nobody[0], nobody[1], nobody[2], not_measured, np.zeros(1), np.ones(units)),
        radii=RadiusMemory(np.zeros(1), factor=np.ones(axles), known=np.zeros(axles), ahead=np.zeros(axles)),
    )  # fmt: skip


# Train speed from all wheel speeds and all applied forces: an extended Kalman filter of four states.
#
# State x = (v, d, c, q): speed of the train, unknown specific force (gradient, error of resistance and of shoe
# friction), micro-slip per coefficient, relative error of the inverse mass. Axle i: rim speed y_i, force F_i that motor
# and shoes apply at the rim, rotating mass m_i = J / r^2, load N_i. The prediction is the momentum balance of train and
# wheelsets, in which no force has to be differentiated:
#
#     M dv = (1 + q) (sum F_i dt - sum m_i dy_i) - R(v) dt + M d dt,    dd = walk,    dc = dq = 0
#
# Coupled cars are a believed chain of bodies with springs and dampers; the filter corrects its common speed. Let s be
# the direction of the demand, mu_i = F_i / N_i, and e the slip ratio of a rolling wheel at the full adhesion.
# Measurements:
#
#     free axle                        y_i = v + n,                n ~ noise^2
#     at ease, light, or relieved      y_i = v + c mu_i + n,       n ~ noise^2 + repeat (e v mu_i / mu_carried)^2
#     any                              s (y_i - v) >= 0: an axle that violates it in the mean of 0.1 s measures v
#
# An axle is at ease while nobody limits its force and it does not run away. It is light while its force is a small
# share of what it carried lately and it no longer returns from a slide. `relief` says when a relieved axle has
# settled. Other axles may slide and give no upper bound. No matrix is inverted: axles are taken one by one.


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
def _follow_rims(eq, st, k, sign, i, relieved):
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
    if not relieved:
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
        relieved = j >= 0 and k.relief.unit[0] == j
        relative, standing = _follow_rims(eq, st, k, sign, i, relieved)
        ease = _at_ease(eq, st, m, k, i)
        y, applied = k.rim[i], max(k.applied[i], 0.0)
        # of its body, with what the axles before it have shown
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
        k.rolling_time[i] = k.rolling_time[i] + st.period if light and settled else 0.0
        # brakes may press all wheels into one slow slide, which looks like a steeper climb; motors do not for long
        doubt = -2.0 if eq.axle_group[i] >= 0 and k.pressure[eq.axle_group[i]] > 0.0 else 2.0
        if j < 0 and applied == 0.0 and settled:
            free, together = free + 1.0, together + y - body
        elif relieved:
            turning = eq.chain.turning[i]
            if has_settled(o.relief, k.relief, k.rail[i], applied, turning, k.rim_rate[i]):
                k.relief.measured[0] = 1
                # while adhesion falls a sliding wheel may pass for settled: what is odd, and slips, is not believed
                believe(
                    o,
                    k,
                    mu,
                    innovation,
                    white + pace.relieved_repeat * creep**2,
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
    if k.rolling_time[i] > (0.5 * o.persist if braked_by_air else 0.1):
        trusted = k.rolling_time[i] > o.persist or not braked_by_air
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
