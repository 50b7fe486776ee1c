"""What each unit senses in a control period, and what it reports: speeds, slip signal, coefficient, limits.

In: what has been read over the wire (`alloc.run.wire`). Out: columns of axles and units.

An axle without a signal is taken to roll at the reference speed, and a unit's speed is that of its other axles. Nothing in
their readings betrays that it slips. So its unit is asked for less (`limit_by_sight`), and the inverter watches it: from
voltage and current it roughly has the mean speed of its motors, and so that of those unseen (`watch_unseen`).
"""

import math

from alloc.backends import compiled as law
from alloc.compilation import jit
from alloc.onboard.reference_speed import estimate_speed
from alloc.schema.tables import look_up

NOTICED = 0.1
"""Time after which the train knows that a unit has failed [s]."""
ROUNDING = 1e-9
"""Tolerance of instants, which are multiples of the control period [s]."""
FILTER_TIME = 0.2
"""Time constant of what a unit reports that it delivers [s]: two telegrams, and one step of a searching controller."""
WHOLE = 0.985
"""Share of its target from which a unit counts as not limited: creep control keeps within a hundredth of it."""
ACTING = 0.5
"""Share of the plan that a target must reach: a smaller one says nothing about the rail."""
BLIND = 0.5
"""Share of the plan that is asked at most of a unit none of whose axles is seen [1]."""
WATCHED, WATCHED_SHARE = 1.0, 0.1
"""Slip at which unseen axles are known to run away [m/s], and a share of the speed that adds to it: the mean is rough."""


@jit
def sense_train(axles, units, brakes, effort, retard, onboard, run):
    """Everything sensed in this instant: reference speed, then each unit's limits, coefficient, slip signal.

    `effort`, `retard`: largest torques of the motors as the computers have them [N m], (units, speeds).
    """
    before = run.reference_speed
    force = sense_axles(axles, units, run)
    force -= read_shoes(axles, units, brakes, onboard, run)
    if onboard.true_speed:
        run.reference_speed = run.true_speed
    elif run.time > 0.0:
        estimate_speed(axles, units, brakes, onboard, force, run)
    for a in axles:
        if a.unit >= 0 and a.seen:
            u = units[a.unit]
            speed = a.true_speed if onboard.true_speed else run.reference_speed
            u.worst_slip = max(u.worst_slip, run.sign * (a.reading - speed))
    for j in range(units.size):
        u = units[j]
        if u.seen == 0:
            u.rim, u.worst_slip = before, 0.0
        u.rim /= max(u.seen, 1)
        u.drive_limit = look_up(effort, j, 3.6 * abs(u.rim))
        u.brake_limit = look_up(retard, j, 3.6 * abs(u.rim))
        watch_unseen(u, run)
        observe_coefficient(u, onboard, run)
        detect_slip(u, onboard, run)


@jit
def sense_axles(axles, units, run):
    """Readings of the axles and their sums in the units; returns the force [N] of motors less what turns the wheelsets."""
    force = 0.0
    for u in units:
        u.rim, u.seen, u.worst_slip = 0.0, 0, -math.inf
    for a in axles:
        before = a.reading
        a.reading = a.signal if a.seen else run.reference_speed
        a.pull = a.shoe = 0.0
        if run.time > 0.0:
            force -= a.inertia / a.radius**2 * (a.reading - before) / run.period
        if a.unit >= 0:
            u = units[a.unit]
            pull = a.gear * (run.sign * u.motor_torque) / a.radius
            force += pull
            a.pull = abs(pull) / u.load
            u.seen += a.seen
            u.rim += a.reading if a.seen else 0.0
            if a.seen != a.was_seen:  # the mean speed jumps, which is no acceleration
                u.filtered = u.observed = math.nan
    return force


@jit
def read_shoes(axles, units, brakes, onboard, run):
    """Force of all shoes at the rims [N]; `unit.air` by its cylinders' pressure, or as commanded."""
    total = 0.0
    for u in units:
        u.air = u.air_brake_force if onboard.air_commanded and run.braking else 0.0
    for i in range(axles.size):
        a = axles[i]
        if a.brake < 0 or brakes[a.brake].pressure <= 0.0:
            continue
        b = brakes[a.brake]
        shoe = b.gain * b.pressure * shoe_friction(b, a.reading)
        total += shoe
        a.shoe = shoe / b.load
        if a.unit >= 0 and run.braking and not onboard.air_commanded:
            u = units[a.unit]
            u.air += shoe / u.axles
    return total


@jit
def shoe_friction(b, speed):
    """Friction [1] between tread and shoes of brake group `b`, as believed; it falls with the rim speed [m/s]."""
    return law.speed_law(speed, b.friction_numerator, b.friction_offset, b.friction_constant)


@jit
def watch_unseen(u, run):
    """Whether the unseen axles of a unit run away, `u.runs_away`; their speeds' sum is that of all motors less the seen.

    The sum of their slips counts, for one of them may slip alone. It stays so until half of that slip is left.
    """
    if u.seen == u.axles:
        u.runs_away = 0
        return
    slip = run.sign * (u.unseen - (u.axles - u.seen) * run.reference_speed)
    bound = WATCHED + WATCHED_SHARE * abs(run.reference_speed)
    if slip > bound:
        u.runs_away = 1
    elif slip < 0.5 * bound:
        u.runs_away = 0


@jit
def limit_by_sight(u, run):
    """Largest limit [1] of a unit by what it sees: a share `BLIND` of the plan where it sees none of its axles.

    The oracle, which alone has `unit.truth`, needs no sight.
    """
    return BLIND * run.plan if u.seen == 0 and u.truth == math.inf else math.inf


@jit
def observe_coefficient(u, onboard, run):
    """Coefficient of a unit by the disturbance observer, JP5484215 (1)-(4); in blended braking with air, (18).

    tau_c = a / (s + a) (tau_m - J s w) is z - a J w with z = a / (s + a) (tau_m + a J w), which needs no derivative. Torque
    and speed are taken to be linear from sample to sample; the recursion is exact for that.
    """
    pole, h = onboard.observer_pole, run.period
    keep = math.exp(-pole * h)
    mean = (1.0 - keep) / (pole * h)
    wheel_torque, at_rail = run.sign * u.gear * u.motor_torque, u.load * u.radius
    momentum = pole * u.inertia * u.rim / u.radius
    value = wheel_torque + momentum
    if math.isnan(u.observed):  # at rest before the first sample
        u.observed = u.observed_input = value
    u.observed = keep * u.observed + (mean - keep) * u.observed_input + (1.0 - mean) * value
    u.observed_input = value
    load_torque = u.observed - momentum  # (3)
    if run.braking and not onboard.inertia_in_estimate:
        load_torque = wheel_torque
    u.coefficient_estimate = run.sign * load_torque / at_rail  # (4)
    if run.braking:
        u.coefficient_estimate += u.air / u.load  # (18)


@jit
def detect_slip(u, onboard, run):
    """Acceleration of a unit's axles and its slip signal, JP5484215 Fig. 5; the estimate at the signal's begin is held.

    The differentiator is p s / (s + p). The filter's advance over a period finds a constant acceleration as it is; p times
    what the speed is ahead of the filter would be p h / (1 - exp(-p h)) times as much.
    """
    if math.isnan(u.filtered):
        u.filtered = u.rim
    advance = (1.0 - math.exp(-onboard.detector_pole * run.period)) * (u.rim - u.filtered)
    u.filtered += advance
    u.computed_acceleration = run.sign * advance / run.period
    was = u.slipping
    speed_on = onboard.detector_speed_on
    if u.computed_acceleration > onboard.detector_on or u.worst_slip > speed_on:
        u.slipping = 1
    elif u.computed_acceleration <= onboard.detector_off and u.worst_slip < 0.5 * speed_on:
        u.slipping = 0
    if u.slipping and run.driver_command != 0.0:
        u.slipped = run.time
        if not was:
            u.detected, u.held = run.time, min(max(u.coefficient_estimate, 0.0), 1.0)


@jit
def report_units(units, run):
    """What each unit would say of itself: `delivered`, the limit at which it would deliver what it delivers, and `limited`.

    A limit holds the torque that turns the wheelsets at the planned acceleration; they take what the train really gains.
    Without this a train behind the plan would report too little, and limits that follow would fall without end.
    """
    gain = run.period / (FILTER_TIME + run.period)
    run.gained += gain * ((run.reference_speed - run.before) / run.period - run.gained)
    run.before = run.reference_speed
    pulls = run.driver_command != 0.0
    reached = min(max(run.gained / run.driver_command, 0.0), 1.0) if pulls else 0.0
    due = round(run.time / run.period) % round(run.telegram / run.period) == 0
    for j in range(units.size):
        u = units[j]
        turning = u.brake_turning if run.braking else u.turning
        delivered = max(u.coefficient_estimate, 0.0) + turning * reached * run.plan
        u.delivered += gain * (delivered / (1.0 + turning) - u.delivered)
        target = u.torque_target * u.gear / (u.load * u.radius)
        short = u.torque_command < WHOLE * u.torque_target and target > ACTING * run.plan
        held_back = u.runs_away == 1 or u.protected == 1 or (u.works == 0 and run.braking == 0)
        # said with a telegram; the leader needs none to hear itself
        if pulls and (short or held_back) and (due or j == run.leader):
            u.limited = run.time
