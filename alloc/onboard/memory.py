"""What differs between runs (`Settings`) and what the train's computers remember (`Memory`); nothing is allocated later."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.onboard import readhesion
from alloc.onboard.detector import differentiator_gain
from alloc.onboard.equipment import Equipment
from alloc.onboard.observer import observer_gains
from alloc.onboard.parameters import Onboard
from alloc.onboard.readhesion.torque_table import table_constants
from alloc.onboard.slide_protection.state import (
    SlideMemory,
    SlideSettings,
    slide_memory,
    slide_settings,
)

Floats = NDArray[np.float64]

ALLOCATE_ON_SLIP, ALLOCATE_PERIODICALLY = 0, 1
"""When a rule acts: at each detection by B1, or with every telegram."""

# Counters of a run
DETECTIONS, TELEGRAMS, LOST, FALLBACKS, RULE_CALLS, UNIT_DETECTIONS, BLINDED = range(7)
LOCKS, TIME_OUTS, COUNTERS = 7, 8, 9

SLOTS = 16
"""Telegrams that can be on their way to one unit."""


class Settings(NamedTuple):
    """Parameters of the on-board functions for one run."""

    rule: int  # compiled identifier; -1: the rule is called through the host
    when: int
    needs_truth: bool  # the rule reads the truth; who knows the rail need not wait for slip
    controller: int
    period: float
    detector: Floats  # on, off, pole, gain, speed_on
    observer: Floats  # pole, keep, old, new
    control: (
        Floats  # parameters of the readhesion controller, as `alloc.onboard.control` takes them
    )
    telegram: Floats  # latency, jitter, silence
    telegram_ticks: int
    hold_time: float
    rise_time: float
    rule_parameters: Floats
    speed_quantum: float
    dropout: Floats  # (dropouts, 3): axle, begin, until
    blind_share: float
    speed_pole: float  # of the speed estimate without sensors [1/s]; 0: sensors
    brake_inertia: float  # 1: the estimate (18) counts the wheelsets' deceleration; 0: as printed
    blend_time: float
    release_speed: float
    slide: SlideSettings


class Memory(NamedTuple):
    """What the computers remember; (units,) unless said otherwise."""

    reference: Floats  # (bodies,) reference speed
    candidate: Floats  # (bodies,) speed of its slowest axle driving, fastest braking, in the direction of the demand
    differentiator: Floats
    acceleration: Floats
    observer: Floats
    observer_input: Floats
    estimate: Floats
    slipping: NDArray[np.bool_]
    torque: Floats  # as the inverters know it
    air: Floats  # air brake force commanded per axle, at the rim [N]
    brake_rise: Floats  # (1,) share of the plan that the trailers' brakes have risen to
    slide: SlideMemory
    mean_speed: Floats  # mean rim speed of the unit's axles as read
    speed: Floats  # mean rim speed as the unit knows it
    worst_slip: Floats  # largest slip of the unit's axles against the reference speed, in the direction of the demand
    axle_omega: Floats  # (axles,) as measured
    cap: Floats
    limit_wanted: Floats  # what B1 wants
    received: Floats  # last limit received; inf: none, the plan stands
    limit: Floats  # in force in each unit
    delivered: Floats  # snapshot sent with the last telegram
    held: Floats  # (HELD,) what B1 holds, see the HELD_ indices
    last_heard: Floats
    mail_time: Floats  # (units, SLOTS) arrival; inf: empty
    mail_limit: Floats  # (units, SLOTS)
    target: Floats  # torque target per motor, signed
    rise: Floats  # slew-limited magnitude of the expected torque
    control: Floats  # (units, readhesion.MEMORY) what the readhesion controller remembers; nan: nothing yet
    factor: Floats  # share of its target that the readhesion controller leaves a unit
    seen: Floats  # axles of the unit whose speed is known
    axle_seen: NDArray[np.bool_]  # (axles,)
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


def settings(
    onboard: Onboard,
    rule: int,
    when: int,
    needs_truth: bool,
    controller: int,
    rule_parameters: Floats,
) -> Settings:
    """Settings of a run from the on-board parameters."""
    d, o, t = onboard.detector, onboard.observer, onboard.telegrams
    dropouts = [(d.axle, d.begin, d.until) for d in onboard.sensors.dropouts]
    keep, old, new = observer_gains(o.pole, onboard.period)
    gain = differentiator_gain(d.pole, onboard.period)
    return Settings(
        rule=rule,
        when=when,
        needs_truth=needs_truth,
        controller=controller,
        period=onboard.period,
        detector=np.array([d.on, d.off, d.pole, gain, d.speed_on]),
        observer=np.array([o.pole, keep, old, new]),
        control=_control_parameters(onboard, controller),
        telegram=np.array([t.latency, t.jitter, t.silence]),
        telegram_ticks=max(1, round(t.period / onboard.period)),
        hold_time=onboard.hold_time,
        rise_time=onboard.rise_time,
        rule_parameters=rule_parameters,
        speed_quantum=onboard.sensors.speed_quantum,
        dropout=np.array(dropouts, dtype=float).reshape(-1, 3),
        blind_share=onboard.sensors.blind_share,
        speed_pole=onboard.sensors.sensorless_pole or 0.0,
        brake_inertia=float(onboard.braking.inertia_in_estimate),
        blend_time=onboard.braking.blend_time,
        release_speed=onboard.braking.release_speed,
        slide=slide_settings(onboard.braking.slide_protection, onboard.period),
    )


def _control_parameters(onboard: Onboard, controller: int) -> Floats:
    """What the law of a built-in controller needs; of a hosted one, what cut-and-ramp needs in its stead."""
    creep = (onboard.creep.proportional, onboard.creep.integral, onboard.creep.reference)
    if controller == readhesion.TABLE:
        return np.array(table_constants(onboard.table, onboard.period))
    if controller == readhesion.PI_CREEP:
        return np.array(creep)
    if controller == readhesion.PERTURB_OBSERVE:
        p = onboard.perturb_observe
        return np.array([*creep, p.interval, p.lowest, p.highest, p.step])
    if controller == readhesion.STEEPEST_GRADIENT:
        g = onboard.steepest_gradient
        return np.array([*creep, g.interval, g.lowest, g.highest, g.gain, g.least, g.largest])
    r = onboard.cut_and_ramp
    return np.array([r.cut, r.recover, r.hold, r.ramp])


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
        reference=np.full(eq.axle_body.max() + 1, speed),
        candidate=np.zeros(eq.axle_body.max() + 1),
        differentiator=np.full(n, speed),
        acceleration=zeros(),
        observer=np.full(n, np.nan),
        observer_input=zeros(),
        estimate=zeros(),
        slipping=np.zeros(n, dtype=np.bool_),
        torque=zeros(),
        air=zeros(),
        brake_rise=np.zeros(1),
        slide=slide_memory(int(eq.axle_car.max()) + 1, eq.axle_car.size, eq.group_unit.size, speed),
        mean_speed=np.full(n, speed),
        speed=np.full(n, speed),
        worst_slip=zeros(),
        axle_omega=speed / eq.axle_radius,
        cap=np.full(n, expected),
        limit_wanted=np.full(n, expected),
        received=np.full(n, np.inf),
        limit=np.full(n, expected),
        delivered=np.full(n, expected),
        held=held,
        last_heard=zeros(),
        mail_time=np.full((n, SLOTS), np.inf),
        mail_limit=np.zeros((n, SLOTS)),
        target=zeros(),
        rise=zeros(),
        control=np.full((n, readhesion.MEMORY), np.nan),
        factor=np.ones(n),
        seen=eq.axles.copy(),
        axle_seen=np.ones(eq.axle_unit.size, dtype=np.bool_),
        command=zeros(),
        drive_limit=zeros(),
        brake_limit=zeros(),
        limit_max=np.full(n, np.inf),
        truth=zeros(),
        in_service=np.ones(n, dtype=np.bool_),
        fallen_back=np.zeros(n, dtype=np.bool_),
        counter=np.zeros(COUNTERS, dtype=np.int64),
    )
