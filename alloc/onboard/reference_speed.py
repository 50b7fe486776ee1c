"""The train's reference speed: Kalman filter of its speed and of the specific force that nothing explains.

The momentum balance foresees the speed; the axle that runs least ahead measures it. An axle further ahead than `gate`
deviations slips. Where readhesion control holds any unit on the verge of slip, a driven axle may creep with all others: it
tells only that the train is no faster. The balance alone then carries the estimate on, and its deviation grows. Once it
exceeds `doubt`, one unit after the other is eased for a moment (`ease_units`): its wheels roll, and tell the speed.

Known limit: where every axle is braked by air, the best wheel creeps too and the estimate runs 0.15 to 0.2 m/s below the
train. `onboard.true_speed` gives the true one to studies of what follows from it.
"""

import math

from alloc.compilation import jit

RESTLESS, STEADY = 0.04, 0.001
"""Deviation by which the speed changes unforeseen in a second [m/s], as couplers shake a locomotive; and in blended braking,
where no unit is eased and wheels that slide would be followed."""
LEAST_SPEED = 1.4
"""Speed below which the deviation of a rolling wheel shrinks no further [m/s]."""
BOUND = 3.0
"""Deviations within which the unknown force is kept."""
EASED, SHORTEST, LONGEST, PAUSE = 0.4, 0.12, 0.4, 0.3
"""Share of its torque that an eased unit keeps; least and greatest time for which it is eased, and pause after that [s]."""
FEW = 5.0
"""Periods over which the creep of an eased wheel is the same."""


@jit
def ease_units(units, onboard, run):
    """`unit.eased`, the share of its torque command that a unit applies: one after the other while the speed is in doubt.

    It ends once the wheels have returned. Blended brakes are left alone: air would hold a slide.
    """
    if units.size == 0:
        return
    run.easing += run.period
    last = units[run.eased]
    if last.eased < 1.0 and (run.easing < SHORTEST or (last.returns and run.easing < LONGEST)):
        return
    last.eased = 1.0
    sure = run.reference_deviation < onboard.doubt or run.easing < LONGEST + PAUSE
    if sure or run.braking:
        return
    for n in range(1, units.size + 1):
        j = (run.eased + n) % units.size
        if units[j].seen > 0 and units[j].works:
            run.eased, run.easing, units[j].eased = j, 0.0, EASED
            return


@jit
def estimate_speed(axles, run, onboard, force, lead, rolling, sure):
    """One control period: `run.reference_speed`, its deviation, `run.unknown`.

    `force` [N]: what motors and shoes bring to the rims, less what turns the wheelsets. `lead` [m/s]: by how much the axle
    that runs least ahead, in the direction of the demand, was ahead of the last reference speed; inf: no axle is seen.
    `rolling`: the same of axles that roll, `sure`: of eased ones.
    """
    h, v, most = run.period, run.reference_speed, onboard.unknown_most
    drag = onboard.resistance + onboard.resistance_linear * v + onboard.resistance_quadratic * v * v
    drag = min(
        drag, onboard.train_mass * abs(v) / h
    )  # resistance stops a train and does not turn it
    v += h * ((force - drag) / onboard.train_mass + run.unknown)
    restless = STEADY if run.braking else RESTLESS
    run.p_vv += 2.0 * h * run.p_vd + h * h * run.p_dd + restless**2 * h
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
