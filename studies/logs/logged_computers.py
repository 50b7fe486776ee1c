"""The reference speed's filter on the records of a log: what it needs beside them is concluded from forces and speeds.

The filter is the one of the computers, `alloc.onboard.reference_speed`. A log has one force per axle and no
commands, so here every axle is a unit and a brake group of its own, and

    demand      has the sign of the sum of all forces where that exceeds 2 per mille of the weight, else it stays
    limited     is an axle with less than 95 % of its greatest force, forgotten within 5 s in traction and 60 s in braking
    relieved     is, where no axle rolls freely, of those that pull with half of it at most the one that runs ahead least
    shoes       are all that brakes: a log does not say whether a motor does, and shoes are trusted less
    at rest     is a train whose wheels stand: with the estimate for 2 s, without any force for 0.5 s

A force that no column tells counts as none; its axle is read while the train pulls and it has no motor.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import inlined_jit, jit
from alloc.onboard.equipment import Chain, stable_steps
from alloc.onboard.reference_speed import (
    FORCE,
    SPEED,
    STANDING,
    ReferenceMemory,
    ReferencePace,
    correct,
    predict,
    reference_memory,
    reference_pace,
    start,
    take_reading,
)
from alloc.plant.laws import GRAVITY
from studies.logs.known_train import MeasuredTrain

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]
Numbers = NDArray[np.int64]

DEMAND = 2e-3
"""Sum of the forces over weight below which nobody pulls or brakes."""
UNLIMITED = 0.95
"""Share of its greatest force lately above which an axle counts as not limited."""
RELIEVED = 0.5
"""Share of its greatest force lately below which a driven axle counts as relieved."""
LATEST_RELIEF = 0.02
"""Time [s] for which a force counts as low, at most, where the log first has it so."""
MEMORY, BRAKE_MEMORY = 5.0, 60.0
"""Times [s] in which an axle's greatest force is forgotten while the train pulls, and while it brakes."""
LOCKED_WALK = 0.5
"""Change per root s of the force of locked wheels, relative: a log has what their shoes could, not what the rail does."""
UNTOLD_WALK = 0.5
"""Specific brake force that changes per root s where no column tells it [m/s2]."""
REST_TIME = 2.0
"""Time [s] after which a train counts as at rest whose wheels and estimate are."""
IDLE_TIME = 0.5
"""The same where only its wheels are and no force holds them: they would turn at once."""


class LoggedBrakes(NamedTuple):
    """A brake per axle whose "pressure" is its force."""

    gain: Floats
    friction: Floats


class LoggedEquipment(NamedTuple):
    """What the filter reads of `alloc.onboard.equipment.Equipment`, and which axles are driven."""

    axle_radius: Floats
    axle_unit: Numbers  # set from instant to instant: -1 unless it is driven and the train pulls
    axle_group: Numbers
    axle_body: Numbers
    gear: Floats  # the radius, so that a "torque" is a force at the rim
    group: LoggedBrakes
    chain: Chain
    driven: Flags


class LoggedSettings(NamedTuple):
    """What the filter reads of `alloc.onboard.state.Settings`."""

    period: float
    reference: Any  # see `alloc.onboard.state.reference_settings`
    pace: ReferencePace


class LoggedUnits(NamedTuple):
    """What the filter reads of `UnitMemory`."""

    torque_factor: Floats


class LoggedValves(NamedTuple):
    """What the filter reads of `SlideMemory`."""

    action: Floats


class LoggedDeviation(NamedTuple):
    """What the filter writes of `TrainMemory`."""

    reference_deviation: Floats


class LoggedMemory(NamedTuple):
    """What the filter reads and writes of `alloc.onboard.state.Memory`, and what is remembered of the log."""

    reference: Floats
    axle_omega: Floats
    axle_seen: Flags
    torque: Floats  # force one instant before [N]
    unit: LoggedUnits
    slide: LoggedValves
    train: LoggedDeviation
    estimate: ReferenceMemory
    force: Floats  # (axles,) now [N]
    brake: Floats  # (axles,) mean brake force since the instant before [N]
    most: Floats  # (axles,) greatest force lately [N]
    relieved: Floats  # (axles,) time for which it is less than `RELIEVED` [s]
    carried: Floats  # (axles,) greatest rail force before the wheel stood [N]
    unsure: Floats  # (1,) change of the unknown force per root s, for forces that nobody tells
    total: Floats  # (1,) of all forces [N]
    jump: Floats  # (1,) its change since the instant before, over mass [m/s2]
    rest: Floats  # (1,) time for which wheels and estimate have been at rest [s]
    sign: Floats  # (1,) of the demand
    idle: Flags  # (1,) whether there is none


class LoggedSeries(NamedTuple):
    """A stretch of the log, (instants,) or (instants, axles); forces have no nan."""

    step: Floats
    rim: Floats
    seen: Flags
    force: Floats
    told: Flags  # (axles,) whether there are forces of it
    grade: Floats


class FilterTrace(NamedTuple):
    """What the filter did: states (instants, 4), covariances (instants, 4, 4), and (instants,)."""

    predicted: Floats
    predicted_covariance: Floats
    state: Floats
    covariance: Floats
    acting: Floats  # specific force of all axles [m/s2]
    lead: Floats  # of the train's mean speed over that of its first body [m/s]
    told: Flags  # whether an axle told the speed


def logged_equipment(train: MeasuredTrain, longest: float) -> LoggedEquipment:
    """What the filter is told of the train; `longest` step [s]."""
    axles = train.radius.size
    resistance = np.zeros((train.car_mass.size, 3))
    if train.resistance is not None:
        resistance = train.resistance
    coupler, body, mass = np.zeros((0, 4)), np.zeros(axles, dtype=np.int64), train.car_mass
    if train.coupler is None:
        resistance, mass = resistance.sum(axis=0, keepdims=True), mass.sum(keepdims=True)
    else:
        coupler, body = train.coupler, train.axle_car
    return LoggedEquipment(
        axle_radius=train.radius,
        axle_unit=np.arange(axles),
        axle_group=np.arange(axles),
        axle_body=body,
        gear=train.radius,
        group=LoggedBrakes(np.ones(axles), np.tile((0.0, 1.0, 1.0), (axles, 1))),
        chain=Chain(
            mass, float(mass.sum()), resistance, coupler, stable_steps(coupler, mass, longest),
            train.inertia / train.radius**2, train.axle_load,
        ),
        driven=train.driven,
    )  # fmt: skip


def logged_memory(bodies: int, axles: int, speed: float) -> LoggedMemory:
    """Memory of computers that believe the train to run at `speed` [m/s]."""
    empty = {name: np.zeros(axles) for name in ("torque", "force", "brake", "most", "relieved")}
    return LoggedMemory(
        reference=np.full(bodies, speed),
        axle_omega=np.zeros(axles),
        axle_seen=np.zeros(axles, dtype=bool),
        unit=LoggedUnits(np.ones(axles)),
        slide=LoggedValves(np.zeros(axles)),
        train=LoggedDeviation(np.zeros(1)),
        estimate=reference_memory(bodies, axles, axles, axles),
        carried=np.zeros(axles),
        unsure=np.zeros(1),
        total=np.zeros(1),
        jump=np.zeros(1),
        rest=np.zeros(1),
        sign=np.zeros(1),
        idle=np.zeros(1, dtype=bool),
        **empty,
    )


@inlined_jit
def _follow_force(eq, period, m, i, force, changed):
    """What the force [N] of axle `i` says of who limits it; returns its size in the direction of the demand."""
    k, sign = m.estimate, m.sign[0]
    before, size = m.force[i], max(sign * force, 0.0)
    pulls = eq.driven[i] and sign > 0.0
    eq.axle_unit[i] = i if pulls else -1
    m.torque[i], m.force[i] = before, force
    m.brake[i] = 0.0 if pulls else -0.5 * (before + force)
    # drivers shut off by and by; brakes that are held back are so because a wheel slides
    kept = math.exp(-period / (MEMORY if sign > 0.0 else BRAKE_MEMORY))
    m.most[i] = size if changed else max(kept * m.most[i], size)
    m.unit.torque_factor[i] = 1.0 if size >= UNLIMITED * m.most[i] else 0.0
    k.full[i] = m.most[i] if sign < 0.0 else 0.0
    return size


@inlined_jit
def _read(eq, m, series, t):
    """Fill in what the log says at instant `t`, and what is concluded from it; returns the sign of the demand."""
    k, total, weight, untold = m.estimate, 0.0, 0.0, 0.0
    for i in range(m.force.size):
        total += series.force[t, i]
        weight += eq.chain.load[i]
        untold += 0.0 if series.told[i] else eq.chain.load[i]
    pulling, braking = total > DEMAND * weight, total < -DEMAND * weight
    sign = m.sign[0]  # stays where there is none: wheels come back after their brakes are released
    if braking:
        sign = -1.0
    elif pulling or sign == 0.0:
        sign = 1.0
    changed, m.idle[0] = sign != m.sign[0], not pulling and not braking
    m.sign[0] = sign
    m.jump[0] = (total - m.total[0]) / eq.chain.train_mass
    m.total[0] = total
    chosen, locked, free = -1, 0.0, False
    for i in range(m.force.size):
        size = _follow_force(eq, series.step[t], m, i, series.force[t, i], changed)
        m.axle_seen[i] = series.seen[t, i] and (series.told[i] or pulling)
        rim = series.rim[t, i] if m.axle_seen[i] else m.reference[eq.axle_body[i]]
        m.axle_omega[i] = rim / eq.axle_radius[i]
        begun = min(0.5 * series.step[t], LATEST_RELIEF)
        since = m.relieved[i] + series.step[t] if m.relieved[i] > 0.0 else begun
        m.relieved[i] = since if size < RELIEVED * m.most[i] else 0.0
        relieved = eq.axle_unit[i] >= 0 and m.axle_seen[i] and m.relieved[i] > 0.0
        if relieved and (chosen < 0 or k.ahead[i] < k.ahead[chosen]):
            chosen = i
        free = free or (m.axle_seen[i] and not eq.driven[i] and series.force[t, i] == 0.0)
        if sign < 0.0 and rim < STANDING and m.reference[0] > STANDING:
            # sliding friction goes on; the filter forgets it within a second
            k.carried[i] = m.carried[i]
            locked += min(size, m.carried[i])
        m.carried[i] = k.carried[i]
    m.unsure[0] = LOCKED_WALK * locked / eq.chain.train_mass
    m.unsure[0] += 0.0 if pulling else UNTOLD_WALK * untold / weight
    k.relief.unit[0] = -1 if free else chosen
    if chosen >= 0:
        k.relief.clock[0] = m.relieved[chosen]
    return sign


@inlined_jit
def _take_rest(reference, m, period):
    """Take that a train whose wheels have stood for a while is at rest; returns whether it does."""
    k, seen, standing = m.estimate, False, True
    for i in range(m.force.size):
        if m.axle_seen[i]:
            seen, standing = True, standing and abs(k.rim[i]) < STANDING
    still = seen and standing and (m.idle[0] or abs(m.reference[0]) < STANDING)
    m.rest[0] = m.rest[0] + period if still else 0.0
    if m.rest[0] <= (IDLE_TIME if m.idle[0] else REST_TIME):
        return False
    take_reading(k.state, k.covariance, 0.0, -k.state[SPEED], reference.noise**2)
    for b in range(m.reference.size):
        m.reference[b] = k.state[SPEED]
    return True


@inlined_jit
def _copy(state, covariance, k, t):
    for a in range(4):
        state[t, a] = k.state[a]
        for b in range(4):
            covariance[t, a, b] = k.covariance[a, b]


@jit
def run_filter(eq, reference, m, series, trace):
    """Filter a stretch; `m.reference` and the variance in `trace.covariance[0, 0, 0]` are what it begins with."""
    k = m.estimate
    for t in range(series.step.size):
        period = series.step[t]
        pace = reference_pace(reference, period)
        st = LoggedSettings(period, reference, pace)
        sign = _read(eq, m, series, t)
        if t == 0:
            start(eq, reference, m, k)
            k.covariance[SPEED, SPEED] += trace.covariance[0, 0, 0]
            k.state[FORCE] = -GRAVITY * series.grade[0]
            _copy(trace.predicted, trace.predicted_covariance, k, t)
        else:
            k.state[FORCE] -= GRAVITY * (series.grade[t] - series.grade[t - 1])
            if m.rest[0] > 0.0:
                m.brake[:] = 0.0  # what holds a train at rest is less than what its shoes could
            trace.acting[t], of_shoes = predict(eq, st, m, sign, m.force, m.brake)
            k.covariance[FORCE, FORCE] += m.unsure[0] ** 2 * period
            # a force may have jumped at any instant between the two
            k.covariance[SPEED, SPEED] += (m.jump[0] * period) ** 2 / 12.0
            _copy(trace.predicted, trace.predicted_covariance, k, t)
            told = correct(eq, st, m, sign, of_shoes)
            trace.told[t] = _take_rest(reference, m, period) or told
        _copy(trace.state, trace.covariance, k, t)
        for b in range(m.reference.size):
            lead = m.reference[b] - m.reference[0]
            trace.lead[t] += eq.chain.mass[b] / eq.chain.train_mass * lead
