"""From the units' limits to the torque of their motors and the pressures of their brakes.

Pulling, and braking without air: limits (6), (6') of JP5484215, within what the motors can, rising with bounded jerk.

Blended braking is its embodiment 3 (Fig. 15, 16). The electric brake comes first, air supplies what the line does not take.
A unit that follows an order brakes electrically with its limit less the air brake's force (par. 0078), and so makes up at
once for the lag of the cylinders; its air fills what the line lacks in the same way. What readhesion control takes away air
does not fill, and in the end it gives way too: it could hold wheels in a slide that no cut of torque ends. Nor is air asked
for more than the plan: what a unit carries beyond it is its motors', which can let go of wheels that slide at once.
"""

import math

from alloc.compilation import jit
from alloc.onboard.sensing import limit_by_sight, shoe_friction
from alloc.onboard.slide_protection import LEAST_SPEED, SUPPLY

MIDDLE = 0.5
"""Share of their torque that readhesion control leaves the motors, below which the air brake gives way [1]: mid-ranging
control, where the slow actuator leaves the fast one room on both sides."""
EASE_TIME = 1.0
"""Integral time of that [s]."""
LEAST_GAIN = 1e-9
"""Shoe force over pressure [N/Pa] below which a brake is asked for all its pressure: it gives nothing."""


# Pulling


@jit
def set_targets(units, onboard, run):
    """Torque target of each unit while it pulls, or brakes with its motors alone; nothing is asked of air.

    A unit one of whose unseen axles runs away is asked for nothing until it has returned, and begins anew.
    """
    for u in units:
        scale = torque_per_coefficient(u, u.turning, onboard)
        bound = u.drive_limit if run.sign > 0.0 else u.brake_limit
        rising = u.pattern + scale * run.plan * run.period / run.rise
        # what its limit has held back the oracle may have again at once
        most = u.limit if u.truth == math.inf else max(u.limit, run.plan)
        u.pattern = min(scale * min(most, limit_by_sight(u, run)), bound, rising)
        if run.driver_command == 0.0 or u.runs_away:
            u.pattern = 0.0
        u.torque_target = min(u.pattern, scale * u.limit)
        u.air_brake_force, u.taken, u.kept = 0.0, math.inf, 1.0
    run.braked = 0.0


@jit
def torque_per_coefficient(u, turning, onboard):
    """Torque of each motor [N m] over the limit that it follows: (6) with the load (6') of its axles.

    A limit is of the force at the rail. `turning`: torque that turns the wheelsets, over that; (6) as printed is without.
    """
    share = 1.0 + turning if onboard.inertia_in_limit else 1.0
    return share * u.load * u.radius / u.gear


# Blended braking


@jit
def set_brake_targets(units, onboard, run):
    """Torque target and air brake force of each unit while the train brakes."""
    for u in units:
        scale, at_rim = torque_per_coefficient(u, u.brake_turning, onboard), u.gear / u.radius
        full = scale * run.plan
        u.pattern = min(scale * u.limit, u.pattern + full * run.period / run.rise)
        if u.runs_away:  # as pulling; air too would hold the slide
            u.pattern = 0.0
        bound = min(u.brake_limit, scale * limit_by_sight(u, run))
        motors = share_of_motors(u, bound, full, onboard, run)
        left = u.torque_command / motors if motors > 0.0 else 1.0
        u.kept = min(max(u.kept + (left - MIDDLE) * run.period / EASE_TIME, 0.0), 1.0)
        u.air_brake_force = u.kept * max(min(u.pattern, full) - motors, 0.0) * at_rim
        if u.eased < 1.0:  # its wheels are to roll
            u.air_brake_force = 0.0
        if u.follows and u.works:
            motors = min(max(u.pattern - u.air / at_rim, 0.0), bound)
        u.torque_target = motors
    run.braked = min(run.braked + run.period / run.rise, 1.0)


@jit
def share_of_motors(u, bound, full, onboard, run):
    """Braking torque asked of each motor of a unit: what the line takes of its pattern, Fig. 15, 16.

    `bound` of the motors, `full`: torque of the whole plan [N m]. The line's share is not known. It shows where motors give
    less than was foreseen: their lag, and what readhesion control takes away, are foreseen. What the line turns out to take
    they take over slowly, for cylinders empty slowly.
    """
    if not u.works:
        u.taken = 0.0
        return 0.0
    electric, slow = max(u.motor_torque, 0.0), full * run.period / onboard.blend_time
    if min(run.sign * u.foreseen, u.pattern, bound) > electric + 2.0 * slow:
        u.taken = electric
    u.taken = max(u.taken, electric + slow)
    return min(u.pattern, bound, u.taken)


@jit
def foresee_torques(units, run):
    """What motors are commanded, `unit.applied`, and what they give a period on if they work and the line takes it,
    `unit.foreseen`; both positive pulling.
    """
    for u in units:
        part = 1.0 - math.exp(-run.period / u.lag)
        u.applied = run.sign * u.eased * u.torque_command
        u.foreseen += part * (u.applied - u.foreseen)


@jit
def trailers_lack(units, brakes, run):
    """What the trailers' shoes lack of their part of the plan, as a coefficient of the units: it is asked of them too.

    Cylinders lag, valves release, and motors can make up for both. 0 where there are no units.
    """
    lacking, carried = 0.0, 0.0
    for b in brakes:
        if b.unit < 0:
            shoes = b.gain * b.pressure * shoe_friction(b, run.reference_speed)
            lacking += b.axles * (planned_force(b, run) - shoes / (1.0 + b.turning))
    for u in units:
        carried += u.axles * u.load
    return lacking / carried if carried > 0.0 else 0.0


@jit
def planned_force(b, run):
    """Force at the rail [N per axle] that a trailer's brake has of the plan, risen as far as the train's."""
    return b.share * run.plan * run.braked * b.load


@jit
def ask_brakes(axles, units, brakes, onboard, run):
    """Pressure commanded of each brake group: a unit's for its air brake force, a trailer's for its part of the plan.

    The pressure is that for wheels that roll: one that slides must not lower the others'. Slide protection comes before:
    `unit.protected` says that it acts on an axle of a unit; a bogie may have several. `brake.most` is the oracle's bound.
    """
    for u in units:
        u.protected = 0
    for a in axles:
        if run.braking and a.unit >= 0 and a.brake >= 0 and brakes[a.brake].valve != SUPPLY:
            units[a.unit].protected = 1
    for b in brakes:
        b.pressure_target = 0.0
        if not run.braking:
            continue
        if b.unit >= 0:
            force = units[b.unit].air_brake_force
        else:
            turning = b.turning if onboard.inertia_in_limit else 0.0
            force = min(planned_force(b, run), b.most) * (1.0 + turning)
        per_pascal = b.gain * shoe_friction(b, max(run.reference_speed, LEAST_SPEED))
        b.pressure_target = min(force / max(per_pascal, LEAST_GAIN), b.most_pressure)
