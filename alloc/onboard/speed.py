"""The train's reference speed: Kalman filter of its speed and of the specific force that nothing explains.

The momentum balance foresees the speed; the axle that runs least ahead measures it. An axle further ahead than `gate`
deviations slips: then the balance alone carries the estimate on, and its deviation grows until wheels are believed again.

Known limit: where every axle is braked by air, the best wheel creeps too and the estimate runs 0.15 to 0.2 m/s below the
train. `onboard.true_speed` gives the true one to studies of what follows from it.
"""

import math

from alloc.compilation import jit

RESTLESS = 1e-3
"""Deviation by which the speed changes unforeseen, per root of time [m s-1.5]: it keeps the filter awake."""
LEAST_SPEED = 1.4
"""Speed below which the deviation of a rolling wheel shrinks no further [m/s]."""
BOUND = 3.0
"""Deviations within which the unknown force is kept."""


@jit
def estimate_speed(run, onboard, force, lead):
    """One control period: `run.reference_speed`, its deviation, `run.unknown`.

    `force` [N]: what motors and shoes bring to the rims, less what turns the wheelsets. `lead` [m/s]: by how much the axle
    that runs least ahead, in the direction of the demand, was ahead of the last reference speed; inf: no axle is seen.
    """
    h, v, most = run.period, run.reference_speed, onboard.unknown_most
    drag = onboard.resistance + onboard.resistance_linear * v + onboard.resistance_quadratic * v * v
    drag = min(
        drag, onboard.train_mass * abs(v) / h
    )  # resistance stops a train and does not turn it
    v += h * ((force - drag) / onboard.train_mass + run.unknown)
    run.p_vv += 2.0 * h * run.p_vd + h * h * run.p_dd + RESTLESS**2 * h
    run.p_vd += h * run.p_dd
    run.p_dd = min(run.p_dd + onboard.walk**2 * h, most**2)
    off = lead - run.sign * (v - run.reference_speed)  # seen from the speed foreseen
    variance = onboard.reading**2 + onboard.noise**2
    variance += (onboard.creep * max(abs(v), LEAST_SPEED)) ** 2
    if off < onboard.gate * math.sqrt(run.p_vv + variance):
        # a wheel's creep is the same over many periods, which are one measurement then
        total = run.p_vv + onboard.repeats * variance
        gain_v, gain_d = run.p_vv / total, run.p_vd / total
        v += gain_v * run.sign * off
        unknown = run.unknown + gain_d * run.sign * off
        run.unknown = min(max(unknown, -BOUND * most), BOUND * most)
        run.p_dd -= gain_d * run.p_vd
        run.p_vv *= 1.0 - gain_v
        run.p_vd *= 1.0 - gain_v
    run.reference_speed = max(v, 0.0) if run.sign < 0.0 else v
    run.reference_deviation = math.sqrt(run.p_vv)
