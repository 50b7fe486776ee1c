"""The train's reference speed: Kalman filter of its speed and of the specific force that nothing explains.

The momentum balance foresees the speed, and axles measure it. Pulling or braking, an axle ahead of the train slips:

- No axle runs behind the train. The one that runs least ahead bounds the speed from one side, always; but what slides deep
  when the demand turns round is behind then, and says nothing until it has returned.
- While nothing holds an axle back, that axle measures the speed. Where readhesion control or slide protection holds one
  back, and for some time after, all may creep, and it does not.
- An axle on which hardly any force acts rolls, and is sure. Once the deviation exceeds `doubt`, one unit after the other is
  eased for a moment (`ease_units`) so that there is one; from `GREAT` times as much on, units that brake by air too.

An axle further ahead than `gate` deviations slips, unless it is sure. Known limit: where every axle is braked by air and
slide protection does not act, the best wheel creeps too and the estimate runs 0.15 to 0.2 m/s below the train.
`onboard.true_speed` gives the true one to studies of what follows from it.
"""

import math

from alloc.compilation import jit

RESTLESS = 0.04
"""Deviation by which the speed changes unforeseen in a second [m/s], as couplers shake a locomotive."""
LEAST_SPEED = 1.4
"""Speed below which the deviation of a rolling wheel shrinks no further [m/s]."""
BOUND = 3.0
"""Deviations within which the unknown force is kept."""
EASED, SHORTEST, LONGEST, PAUSE = 0.4, 0.12, 0.4, 0.3
"""Share of its torque that an eased unit keeps; least and greatest time for which it is eased, and pause after that [s]."""
GREAT, EMPTIED = 2.0, 1.5
"""Deviation over `doubt` from which a unit's air is released too; greatest time for which that is waited for [s]."""
FEW = 5.0
"""Periods over which the creep of an eased wheel is the same."""
MEAN_TIME = 0.1
"""Time over which it is averaged how far an axle runs ahead [s]: noise and a wheel's swing are shorter."""
RETURNING = 0.5
"""Deceleration against that mean above which an axle returns from slip [m/s2]."""
LIMITING = 0.999
"""Share of its target below which a unit is limited by its readhesion controller in this instant."""
AFTER = 2.0
"""Time for which axles may creep after the last was held back [s]."""
FREE, LEAST_PLAN, ROLLS = 0.1, 0.01, 0.2
"""Share of the plan, or of the least plan [1], up to which an axle is free of force; time after which it rolls then [s]."""
NEAR, FAR = 0.05, 1.0
"""How far a sure axle may run ahead of the one that is least ahead; and, beside four deviations, of the reference speed, for
without force too wheels stay in a deep slide for long [m/s]."""


@jit
def ease_units(units, onboard, run):
    """`unit.eased`, the share of its torque command that a unit applies: one after the other while the speed is in doubt.

    It ends once the wheels have returned, and before that what air had held them has escaped.
    """
    if units.size == 0:
        return
    last = units[run.eased]
    if last.eased < 1.0 and last.clasped and run.emptying < EMPTIED:
        run.emptying += run.period
        return
    run.easing += run.period
    if last.eased < 1.0 and (run.easing < SHORTEST or (last.returns and run.easing < LONGEST)):
        return
    last.eased = 1.0
    doubt = run.reference_deviation / onboard.doubt
    if doubt < 1.0 or run.easing < LONGEST + PAUSE:
        return
    for n in range(1, units.size + 1):
        j = (run.eased + n) % units.size
        u = units[j]
        if u.seen > 0 and u.works and (doubt > GREAT or not u.clasped):
            run.eased, run.easing, run.emptying, u.eased = j, 0.0, 0.0, EASED
            return


@jit
def turn_round(axles, units, run):
    """The demand has turned round: what ran ahead runs behind, until it has returned, and torque rises anew."""
    run.turned = run.time
    for a in axles:
        a.ahead = -a.ahead
    for u in units:
        u.pattern = 0.0


@jit
def weigh_axles(axles, units, brakes, run):
    """How far [m/s] in the direction of the demand axles were ahead of the last reference speed; inf: none.

    Returns it of the axle that is least ahead of all, and of the one that measures the speed; and whether that is sure.
    """
    h, least, eased, free = run.period, math.inf, math.inf, math.inf
    most, deep = FREE * max(run.plan, LEAST_PLAN), FAR + 4.0 * run.reference_deviation
    turned = run.time < run.turned + 2.0 * MEAN_TIME
    for b in brakes:
        if b.valve != 0.0 and run.braking:
            run.verge = run.time
    for u in units:
        u.returns = u.clasped = 0
        if u.torque_command < LIMITING * u.torque_target:
            run.verge = run.time
    for a in axles:
        if not a.seen:
            continue
        ahead = run.sign * (a.reading - run.reference_speed)
        a.ahead += h / MEAN_TIME * (ahead - a.ahead)
        returns = a.ahead - ahead > RETURNING * MEAN_TIME
        # it runs away, or returns from slip of the other direction
        leaves = ahead - a.ahead > RETURNING * MEAN_TIME
        clasped = a.shoe > most
        released = clasped and run.sign > 0.0  # brakes that still hold a slide
        if (turned or released) and a.ahead < -deep:
            a.slid = 1
        if a.slid and a.ahead < -FAR:
            continue
        a.slid = 0
        if not leaves and not released:
            least = min(least, a.ahead)
        rests = a.pull + a.shoe <= most and not returns and not leaves
        a.free = a.free + h if rests else 0.0
        if a.free > ROLLS:
            free = min(free, a.ahead)
        if a.unit >= 0:
            u = units[a.unit]
            if clasped:
                u.clasped = 1
            if returns:
                u.returns = 1
            elif u.eased < 1.0 and run.easing > 0.5 * SHORTEST and not clasped:
                eased = min(eased, a.ahead)
    if turned:  # which wheels return is not known yet
        return math.inf, math.inf, False
    sure = min(eased, free)
    if sure < least + NEAR and abs(sure) < deep:
        return least, sure, True
    return least, least if run.time >= run.verge + AFTER else math.inf, False


@jit
def estimate_speed(axles, units, brakes, onboard, force, run):
    """One control period: `run.reference_speed`, its deviation, `run.unknown`.

    `force` [N]: what motors and shoes bring to the rims, less what turns the wheelsets.
    """
    lead, rolling, sure = weigh_axles(axles, units, brakes, run)
    h, v, most = run.period, run.reference_speed, onboard.unknown_most
    drag = onboard.resistance + onboard.resistance_linear * v + onboard.resistance_quadratic * v * v
    drag = min(
        drag, onboard.train_mass * abs(v) / h
    )  # resistance stops a train and does not turn it
    v += h * ((force - drag) / onboard.train_mass + run.unknown)
    run.p_vv += 2.0 * h * run.p_vd + h * h * run.p_dd + RESTLESS**2 * h
    run.p_vd += h * run.p_dd
    run.p_dd = min(run.p_dd + onboard.walk**2 * h, most**2)
    variance = onboard.reading**2 + run.noise**2
    variance += (onboard.creep * max(abs(v), LEAST_SPEED)) ** 2
    foreseen = run.sign * (v - run.reference_speed)
    off = (lead if lead < foreseen else rolling) - foreseen
    within = onboard.gate * math.sqrt(run.p_vv + variance)
    if off < -within or (sure and off > within):  # another force has acted than believed
        run.p_vv, run.p_vd, run.p_dd = off**2, 0.0, most**2
    if off < within or sure:
        # a wheel's creep is the same over many periods, which are one measurement then
        total = run.p_vv + (FEW if sure else onboard.repeats) * variance
        gain_v, gain_d = run.p_vv / total, run.p_vd / total
        v += gain_v * run.sign * off
        for a in axles:  # what they run ahead of has moved
            a.ahead -= gain_v * off
        unknown = run.unknown + gain_d * run.sign * off
        run.unknown = min(max(unknown, -BOUND * most), BOUND * most)
        run.p_dd -= gain_d * run.p_vd
        run.p_vv *= 1.0 - gain_v
        run.p_vd *= 1.0 - gain_v
    run.reference_speed = max(v, 0.0) if run.sign < 0.0 else v
    run.reference_deviation = math.sqrt(run.p_vv)
