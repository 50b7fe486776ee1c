"""The train's computers, compiled: sensing, allocation, telegrams, control. They read sensors only.

Everything here happens once per control period. What differs between runs is in `Settings` and `Equipment`, what is
remembered is in `Memory`; nothing is allocated after the start.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import jit
from alloc.onboard.cut_and_ramp import cut_and_ramp
from alloc.onboard.detector import differentiate, differentiator_gain, slip_signal
from alloc.onboard.observer import (
    empty_torque_limit,
    load_compensated,
    observe,
    observer_gains,
    tangential_coefficient_estimate,
)
from alloc.onboard.parameters import Onboard, OnboardError
from alloc.onboard.reference_speed import follow_reference
from alloc.plant.equations import GRAVITY
from alloc.plant.model import Model

Floats = NDArray[np.float64]

CONTROLLER_NONE, CONTROLLER_CUT_AND_RAMP, CONTROLLER_HOST = 0, 1, 2

ALLOCATE_ON_SLIP, ALLOCATE_PERIODICALLY = 0, 1
"""When a rule acts: at each detection by B1, or with every telegram."""

# Counters of a run
DETECTIONS, TELEGRAMS, LOST, FALLBACKS, RULE_CALLS, UNIT_DETECTIONS, COUNTERS = 0, 1, 2, 3, 4, 5, 6

SLOTS = 16
"""Telegrams that can be on their way to one unit."""


class Equipment(NamedTuple):
    """What the computers know of the train; believed values, one row per unit unless said otherwise."""

    axle_unit: NDArray[np.int64]  # (axles,)
    axle_radius: Floats  # (axles,)
    axles: Floats
    radius: Floats
    inertia: Floats
    gear: Floats
    empty_axle_mass: Floats
    load_per_axle: Floats
    mass: Floats  # relative mass on the unit's axles, mean 1
    increment: Floats  # of each unit over the train's mean axle position: mean over its own axles
    drive_table: Floats
    brake_table: Floats
    planned_share: float  # expected coefficient per m/s2 of commanded acceleration


class Settings(NamedTuple):
    """Parameters of the on-board functions for one run."""

    rule: int  # compiled identifier; -1: the rule is called through the host
    when: int
    always: bool  # the rule acts without slip too
    needs_truth: bool
    controller: int
    period: float
    detector: Floats  # on, off, pole, gain, speed_on
    observer: Floats  # pole, keep, old, new
    readhesion: Floats  # cut, recover, hold, ramp
    telegram: Floats  # latency, jitter, silence
    telegram_ticks: int
    hold_time: float
    rise_time: float
    rule_parameters: Floats
    speed_quantum: float


class Memory(NamedTuple):
    """What the computers remember; (units,) unless said otherwise."""

    reference: Floats  # (1,)
    differentiator: Floats
    acceleration: Floats
    observer: Floats
    observer_input: Floats
    estimate: Floats
    slipping: NDArray[np.bool_]
    speed: Floats  # mean rim speed
    worst_slip: Floats  # largest slip of the unit's axles against the reference speed, in the direction of the demand
    axle_omega: Floats  # (axles,) as measured
    cap: Floats
    limit_wanted: Floats  # what B1 wants
    limit: Floats  # in force in each unit
    delivered: Floats  # snapshot sent with the last telegram
    held: Floats  # (HELD,) what B1 holds, see the HELD_ indices
    last_heard: Floats
    mail_time: Floats  # (units, SLOTS) arrival; inf: empty
    mail_limit: Floats  # (units, SLOTS)
    target: Floats  # torque target per motor, signed
    rise: Floats  # slew-limited magnitude of the expected torque
    phase: NDArray[np.int64]
    clock: Floats
    base: Floats
    command: Floats  # torque command per motor, signed
    drive_limit: Floats
    brake_limit: Floats
    limit_max: Floats
    truth: Floats  # filled for the oracle only
    in_service: NDArray[np.bool_]
    fallen_back: NDArray[np.bool_]
    counter: NDArray[np.int64]  # (COUNTERS,)


# What B1 holds: coefficient at its last detection, time of that, time of the last slip of any unit, expected coefficient,
# level and case of the last allocation, number of the unit that is B1, whether something changed that needs a new allocation
HELD_ESTIMATE, HELD_TIME, HELD_ANY_TIME, HELD_EXPECTED, HELD_LEVEL, HELD_CASE = range(6)
HELD_FIRST, HELD_ALLOCATE, HELD = 6, 7, 8


def equipment(model: Model, onboard: Onboard) -> Equipment:
    """What the computers of `model`'s train believe; raises `OnboardError` where belief and train do not fit."""
    s, n = model.structure, model.layout
    if n.units == 0:
        raise OnboardError(
            "on board: the train has no traction unit; give at least one driven axle"
        )
    cars = model.train.cars
    generator = np.random.default_rng(onboard.sensors.seed)
    load_signal = np.array([car.load for car in cars]) * (
        1.0 + onboard.sensors.load_error * generator.standard_normal(len(cars))
    )
    share = s.static_load / np.array([car.mass for car in cars])[s.axle_car] / GRAVITY
    empty = np.array([car.empty_mass for car in cars])[s.axle_car] * share
    load = np.maximum(load_signal, 0.0)[s.axle_car] * share
    increments = onboard.belief.increments
    if increments is not None and len(increments) != n.axles:
        raise OnboardError(
            f"belief: {len(increments)} increments for {n.axles} axles; give one per axle from the front"
        )
    per_axle = np.zeros(n.axles) if increments is None else np.asarray(increments, dtype=float)

    def mean(values: Floats) -> Floats:
        return np.array([values[s.axle_unit == j].mean() for j in range(n.units)])

    axles = np.bincount(s.axle_unit[s.axle_unit >= 0], minlength=n.units).astype(float)
    empty_mean = mean(empty)
    moved = sum(car.empty_mass for car in cars) + float(np.sum(s.inertia / s.radius**2))
    weight = mean(empty + load) * axles
    return Equipment(
        axle_unit=s.axle_unit,
        axle_radius=s.radius,
        axles=axles,
        radius=mean(s.radius),
        inertia=mean(s.inertia),
        gear=s.unit_gear,
        empty_axle_mass=empty_mean,
        load_per_axle=mean(load),
        mass=weight / weight.mean(),
        increment=mean(per_axle),
        drive_table=s.drive_table,
        brake_table=s.brake_table,
        planned_share=moved / (GRAVITY * float(np.sum(empty_mean * axles))),
    )


def settings(
    onboard: Onboard,
    rule: int,
    when: int,
    needs_truth: bool,
    controller: int,
    rule_parameters: Floats,
) -> Settings:
    """Settings of a run from the on-board parameters."""
    d, o, r, t = onboard.detector, onboard.observer, onboard.readhesion, onboard.telegrams
    keep, old, new = observer_gains(o.pole, onboard.period)
    gain = differentiator_gain(d.pole, onboard.period)
    return Settings(
        rule=rule,
        when=when,
        always=needs_truth,  # who knows the rail need not wait for slip
        needs_truth=needs_truth,
        controller=controller,
        period=onboard.period,
        detector=np.array([d.on, d.off, d.pole, gain, d.speed_on]),
        observer=np.array([o.pole, keep, old, new]),
        readhesion=np.array([r.cut, r.recover, r.hold, r.ramp]),
        telegram=np.array([t.latency, t.jitter, t.silence]),
        telegram_ticks=max(1, round(t.period / onboard.period)),
        hold_time=onboard.hold_time,
        rise_time=onboard.rise_time,
        rule_parameters=rule_parameters,
        speed_quantum=onboard.sensors.speed_quantum,
    )


def memory(eq: Equipment, speed: float, expected: float) -> Memory:
    """Memory at the start of a run, the train rolling at `speed` [m/s]."""
    n = eq.axles.size
    held = np.zeros(HELD)
    held[HELD_TIME] = held[HELD_ANY_TIME] = -np.inf
    held[HELD_EXPECTED] = expected
    held[HELD_LEVEL] = np.nan

    def zeros() -> Floats:
        return np.zeros(n)

    return Memory(
        reference=np.full(1, speed),
        differentiator=np.full(n, speed),
        acceleration=zeros(),
        observer=np.full(n, np.nan),
        observer_input=zeros(),
        estimate=zeros(),
        slipping=np.zeros(n, dtype=np.bool_),
        speed=np.full(n, speed),
        worst_slip=zeros(),
        axle_omega=speed / eq.axle_radius,
        cap=np.full(n, expected),
        limit_wanted=np.full(n, expected),
        limit=np.full(n, expected),
        delivered=np.full(n, expected),
        held=held,
        last_heard=zeros(),
        mail_time=np.full((n, SLOTS), np.inf),
        mail_limit=np.zeros((n, SLOTS)),
        target=zeros(),
        rise=zeros(),
        phase=np.zeros(n, dtype=np.int64),
        clock=zeros(),
        base=zeros(),
        command=zeros(),
        drive_limit=zeros(),
        brake_limit=zeros(),
        limit_max=np.full(n, np.inf),
        truth=zeros(),
        in_service=np.ones(n, dtype=np.bool_),
        fallen_back=np.zeros(n, dtype=np.bool_),
        counter=np.zeros(COUNTERS, dtype=np.int64),
    )


@jit
def _limit_at(table, speed):
    x = min(max(abs(speed) * 3.6, 0.0), table.size - 1.000001)
    k = int(x)
    return table[k] + (table[k + 1] - table[k]) * (x - k)


@jit
def sense(eq, st, m, time, commanded, omega, torque, noise):
    """Read the sensors: speeds, accelerations, slip signals, coefficient estimates; note B1's detection.

    `omega` (axles,) true angular speeds as the sensors see them, `noise` (axles,) [m/s at the rim], `torque` (units,) motor
    torque known to the inverters.
    """
    units = eq.axles.size
    sign = 1.0 if commanded >= 0.0 else -1.0
    slowest, fastest = np.inf, -np.inf
    for j in range(units):
        m.speed[j] = 0.0
    for i in range(omega.size):
        rim = eq.axle_radius[i] * omega[i] + noise[i]
        if st.speed_quantum > 0.0:
            rim = np.floor(rim / st.speed_quantum + 0.5) * st.speed_quantum
        m.axle_omega[i] = rim / eq.axle_radius[i]
        slowest, fastest = min(slowest, rim), max(fastest, rim)
        j = eq.axle_unit[i]
        if j >= 0:
            m.speed[j] += rim / eq.axles[j]
    m.reference[0] = follow_reference(
        m.reference[0], slowest if sign > 0.0 else fastest, commanded, st.period
    )
    for j in range(units):
        m.worst_slip[j] = -np.inf
    for i in range(omega.size):
        j = eq.axle_unit[i]
        if j >= 0:
            slip = sign * (eq.axle_radius[i] * m.axle_omega[i] - m.reference[0])
            m.worst_slip[j] = max(m.worst_slip[j], slip)
    first = 0
    while first < units - 1 and not m.in_service[first]:
        first += 1
    m.held[HELD_FIRST] = first
    m.held[HELD_ALLOCATE] = 0.0
    on, off, pole, gain, speed_on = st.detector
    a, keep, old, new = st.observer
    for j in range(units):
        m.differentiator[j], m.acceleration[j] = differentiate(
            m.differentiator[j], m.speed[j], pole, gain
        )
        angular = m.speed[j] / eq.radius[j]
        wheel_torque = torque[j] * eq.gear[j]
        if np.isnan(m.observer[j]):  # first sample: start in equilibrium
            m.observer_input[j] = wheel_torque + a * eq.inertia[j] * angular
            m.observer[j] = m.observer_input[j]
        m.observer[j], m.observer_input[j], load_torque = observe(
            m.observer[j],
            m.observer_input[j],
            wheel_torque,
            angular,
            eq.inertia[j],
            a,
            keep,
            old,
            new,
        )
        axle_load = (eq.empty_axle_mass[j] + eq.load_per_axle[j]) * GRAVITY
        m.estimate[j] = sign * tangential_coefficient_estimate(load_torque, axle_load, eq.radius[j])
        was = m.slipping[j]
        m.slipping[j] = slip_signal(
            was, sign * m.acceleration[j], m.worst_slip[j], on, off, speed_on
        )
        if m.slipping[j] and commanded != 0.0:
            m.held[HELD_ANY_TIME] = time
        if m.slipping[j] and not was:
            m.counter[UNIT_DETECTIONS] += 1
            if j == first and commanded != 0.0:
                m.counter[DETECTIONS] += 1
                m.held[HELD_ESTIMATE] = min(max(m.estimate[j], 0.0), 1.0)
                m.held[HELD_TIME] = time
                m.held[HELD_ALLOCATE] = 1.0
        m.drive_limit[j] = _limit_at(eq.drive_table[j], m.speed[j])
        m.brake_limit[j] = _limit_at(eq.brake_table[j], m.speed[j])
        bound = m.drive_limit[j] if sign > 0.0 else m.brake_limit[j]
        m.limit_max[j] = bound * eq.gear[j] / (axle_load * eq.radius[j]) if m.in_service[j] else 0.0


@jit
def prepare_allocation(eq, st, m, time, tick, commanded):
    """Caps by (5) from the coefficient held at detection; returns whether the rule must be called now.

    Without slip the limits are the plan and no rule is called.
    """
    expected = abs(commanded) * eq.planned_share
    changed = expected != m.held[HELD_EXPECTED]
    m.held[HELD_EXPECTED] = expected
    first = int(m.held[HELD_FIRST])
    periodic = st.when == ALLOCATE_PERIODICALLY
    since = m.held[HELD_ANY_TIME] if periodic else m.held[HELD_TIME]
    slip = time - since <= st.hold_time
    for j in range(m.cap.size):
        m.cap[j] = max(m.held[HELD_ESTIMATE] + eq.increment[j] - eq.increment[first], 0.0)
    if expected == 0.0 or not (slip or st.always):
        for j in range(m.cap.size):
            m.limit_wanted[j] = expected
        m.held[HELD_CASE] = 0.0
        m.held[HELD_LEVEL] = np.nan
        return False
    if periodic:
        return tick % st.telegram_ticks == 0 or changed
    return m.held[HELD_ALLOCATE] > 0.0 or changed


@jit
def distribute(eq, st, m, time, tick, arrival_draw, loss_draw, loss):
    """Send limits and states with the periodic telegrams; each unit takes what has arrived, or falls back."""
    units = eq.axles.size
    first = int(m.held[HELD_FIRST])
    if tick % st.telegram_ticks == 0:
        for j in range(units):
            m.delivered[j] = m.estimate[j]
            if j == first:
                continue
            m.counter[TELEGRAMS] += 1
            if loss_draw[j] < loss:
                m.counter[LOST] += 1
                continue
            for k in range(SLOTS):
                if np.isinf(m.mail_time[j, k]):
                    m.mail_time[j, k] = time + st.telegram[0] + st.telegram[1] * arrival_draw[j]
                    m.mail_limit[j, k] = m.limit_wanted[j]
                    break
    m.limit[first] = m.limit_wanted[first]
    m.last_heard[first] = time
    for j in range(units):
        if j == first:
            continue
        for _ in range(SLOTS):  # oldest first, so that the newest limit stands
            k = int(np.argmin(m.mail_time[j]))
            if m.mail_time[j, k] > time + 1e-9:
                break
            m.limit[j] = m.mail_limit[j, k]
            m.last_heard[j] = time
            m.fallen_back[j] = False
            m.mail_time[j, k] = np.inf
        if time - m.last_heard[j] > st.telegram[2]:
            if not m.fallen_back[j]:
                m.counter[FALLBACKS] += 1
            m.fallen_back[j] = True
            m.limit[j] = m.held[HELD_EXPECTED]


@jit
def set_targets(eq, st, m, commanded):
    """Torque target of each unit: limit (6), compensated for load (6'), within the motor's limit, with bounded rise."""
    sign = 1.0 if commanded >= 0.0 else -1.0
    for j in range(eq.axles.size):
        limit = m.limit[j] if commanded != 0.0 else 0.0
        empty = empty_torque_limit(limit, eq.empty_axle_mass[j], eq.radius[j], eq.gear[j])
        wanted = load_compensated(empty, eq.empty_axle_mass[j], eq.load_per_axle[j])
        planned = m.held[HELD_EXPECTED] * (eq.empty_axle_mass[j] + eq.load_per_axle[j])
        step = planned * GRAVITY * eq.radius[j] / eq.gear[j] * st.period / st.rise_time
        bound = m.drive_limit[j] if sign > 0.0 else m.brake_limit[j]
        m.rise[j] = min(min(wanted, bound), m.rise[j] + step) if commanded != 0.0 else 0.0
        m.target[j] = sign * m.rise[j]


@jit
def cut_and_ramp_unit(eq, st, m, j, commanded):
    """Built-in readhesion control of unit `j`: fills its torque command."""
    sign = 1.0 if commanded >= 0.0 else -1.0
    axle_load = (eq.empty_axle_mass[j] + eq.load_per_axle[j]) * GRAVITY
    to_torque = axle_load * eq.radius[j] / eq.gear[j]
    cut, recover, hold, ramp = st.readhesion
    rate = m.held[HELD_EXPECTED] * to_torque / ramp
    m.phase[j], m.clock[j], m.base[j], torque = cut_and_ramp(
        m.phase[j],
        m.clock[j],
        m.base[j],
        sign * m.command[j],
        sign * m.target[j],
        m.slipping[j],
        m.estimate[j] * to_torque,
        cut,
        recover,
        hold,
        rate,
        st.period,
    )
    m.command[j] = sign * torque


@jit
def control(eq, st, m, commanded):
    """Torque commands of all units by the built-in controller of the run."""
    for j in range(eq.axles.size):
        if st.controller == CONTROLLER_NONE:
            m.command[j] = m.target[j]
        else:
            cut_and_ramp_unit(eq, st, m, j, commanded)
