"""Readhesion control of one unit: cut the torque on slip, hold, ramp back; driven by the observer's estimate."""

from alloc.compilation import equation

FOLLOW, CUT, HOLD, RAMP = 0, 1, 2, 3
"""Phases of the controller."""

RECOVERY_TIMEOUT = 3.0
"""Time [s] after which an unsuccessful cut goes to zero torque: the estimate was too high to readhere."""


@equation
def cut_and_ramp(
    phase, clock, base, torque, target, slipping, rail_torque, cut, recover, hold, ramp_rate, period
):
    """One control period; torques as magnitudes in the direction of the demand [N m].

    `rail_torque` is what the observer says the rail carries, `base` its value held at detection. Returns phase,
    clock [s], base, torque command. A slip signal in any later phase starts anew with the new estimate.
    """
    clock = clock + period
    if slipping and phase != CUT:
        phase, clock = CUT, 0.0
        base = min(max(rail_torque, 0.0), target)
    elif phase == CUT and not slipping:
        phase, clock = HOLD, 0.0
    elif phase == HOLD and clock >= hold:
        phase = RAMP
    elif phase == RAMP and torque >= target:
        phase = FOLLOW
    if phase == CUT:
        torque = cut * base if clock < RECOVERY_TIMEOUT else 0.0
    elif phase == HOLD:
        torque = recover * base
    elif phase == RAMP:
        torque = torque + ramp_rate * period
    else:
        torque = target
    return phase, clock, base, min(torque, target)
