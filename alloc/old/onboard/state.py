"""What the train's computers are set to and what they remember in a run; nothing is allocated later.

In: `Onboard` parameters and `Equipment`. Out: `Settings`, numbers that compiled functions read, and `Memory`,
arrays that they write.
"""

import math
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.old.onboard.brakes import (
    SandingMemory,
    SlideMemory,
    slide_memory,
    slide_settings,
)
from alloc.old.onboard.controllers.collection import (
    BUILT_IN,
    LawMemory,
    LawSettings,
    law_memory,
    law_settings,
)
from alloc.old.onboard.equipment import Equipment
from alloc.old.onboard.increment_learning import (
    KINDS,
    Increments,
    LearningMemory,
    learning_memory,
)
from alloc.old.onboard.laws import differentiator_gain, observer_gains
from alloc.old.onboard.parameters import Onboard
from alloc.old.onboard.reference_speed import (
    NOISE_MARGIN,
    OBSERVER_POLE,
    ReferenceMemory,
    ReferencePace,
    reference_memory,
    reference_pace,
)
from alloc.old.onboard.telegrams import (
    NOTHING_ADDED,
    NUMBERS,
    AddedNumbers,
    Attachment,
    Channel,
    ReportMemory,
    channel,
    report_memory,
)
from alloc.old.plant.model import Floats
from alloc.old.records import filled, numbers_of
from alloc.old.rules.rule import AT_SLIP, Caps, Trigger

# What differs between runs, as compiled code reads it: parameters of the on-board functions.


class RuleSettings(NamedTuple):
    """The allocation rule of the run."""

    law: int
    """Address of its compiled law; 0: it is called in Python."""
    trigger: int = Trigger.LIMITED
    """When it is asked, a `Trigger`; in `Settings` that of the event."""
    caps: int = Caps.FRONT
    """What it is given, `Caps`."""


class DropoutSettings(NamedTuple):
    """As `Dropout`, (dropouts,) each."""

    axle: NDArray[np.int64]
    begin: Floats
    until: Floats


class Settings(NamedTuple):
    """Parameters of the on-board functions for one run; `Any`: the dataclass's numbers, and what is said beside."""

    period: float
    hold_time: float
    rise_time: float
    rule: RuleSettings
    hosted: bool  # whether the controller is no built-in one; its reserve is
    law: LawSettings
    detector: Any  # with the `gain` of its differentiator
    observer: Any  # with the weights `keep`, `old`, `new` of `observer_gains`
    telegrams: Any  # with `ticks`: control periods between two of them
    sensors: Any  # `noisy`; `pole` of the speed estimate without sensors, 0: sensors; `dropout`: `DropoutSettings`
    reference: Any  # see `reference_settings`
    pace: ReferencePace
    brakes: Any  # with `by_pressure`: whether the air brake's force is that of the pressure
    sanding: Any
    # with `learner`, its identifier; `held`: a datum counts against the leader's last slip; `at_once`, `grows`: when and how
    # a running mean changes
    learning: Any


def reference_settings(onboard: Onboard) -> Any:
    """Numbers of `ReferenceSpeed` for a run, whether the true speed is `given`, and the `noise` of a reading [m/s].

    A reading is as uncertain as its noise and its quantum make it.
    """
    given, sensors = onboard.reference, onboard.sensors
    noise = math.sqrt(given.sensor**2 + sensors.speed_noise**2 + sensors.speed_quantum**2 / 12.0)
    return numbers_of(
        given,
        given=given.source == "truth",
        noise=noise,
        radius_prior=given.radius_prior,
        # what is taken for a motion of the wheel must exceed what noise makes of its speed
        returning=max(given.returning, NOISE_MARGIN * OBSERVER_POLE * noise),
    )


def settings(onboard: Onboard, rule: RuleSettings, controller: str) -> Settings:
    """Settings of a run; `controller` names a built-in one, any other name stands for a hosted one."""
    period, sensors, braking = onboard.period, onboard.sensors, onboard.braking
    trigger = Trigger(rule.trigger)
    if onboard.trigger == "slip" and rule.caps == Caps.FRONT:
        trigger = AT_SLIP.get(trigger, trigger)
    lost = np.array([(one.axle, one.begin, one.until) for one in sensors.dropouts], dtype=float)
    lost = lost.reshape(-1, 3)
    keep, old, new = observer_gains(onboard.observer.pole, period)
    return filled(
        Settings,
        onboard,
        rule=rule._replace(trigger=int(trigger), caps=int(rule.caps)),
        hosted=controller not in BUILT_IN,
        law=law_settings(onboard, onboard.period),
        detector=numbers_of(
            onboard.detector, gain=differentiator_gain(onboard.detector.pole, period)
        ),
        observer=numbers_of(onboard.observer, keep=keep, old=old, new=new),
        telegrams=numbers_of(
            onboard.telegrams, ticks=max(1, round(onboard.telegrams.period / period))
        ),
        sensors=numbers_of(
            sensors,
            noisy=sensors.speed_noise > 0.0,
            pole=float(sensors.sensorless_pole or 0.0),
            dropout=DropoutSettings(lost[:, 0].astype(np.int64), *lost[:, 1:].T.copy()),
        ),
        reference=reference_settings(onboard),
        pace=reference_pace(onboard.reference, period),
        brakes=numbers_of(
            braking,
            by_pressure=braking.air_force == "pressure",
            slide_protection=slide_settings(braking.slide_protection, period),
        ),
        sanding=numbers_of(onboard.sanding),
        learning=numbers_of(
            onboard.learning,
            learner=KINDS[onboard.learning.kind],
            at_once=onboard.learning.update == "run",
            grows=onboard.learning.weight == "all",
            held=onboard.learning.reference == "held",
        ),
    )


Counter = NDArray[np.int64]


class UnitMemory(NamedTuple):
    """What is recorded of every unit, (units,) each; a field is a name in `alloc.old.recording.VARIABLES`."""

    torque_command: Floats
    torque_target: Floats
    limit: Floats
    coefficient_estimate: Floats
    slipping: Floats
    fallen_back: Floats
    axles_seen: Floats
    torque_factor: Floats
    computed_acceleration: Floats
    air_brake_force: Floats


class TrainMemory(NamedTuple):
    """What is recorded of the train, (1,) each; a field is a name in `alloc.old.recording.VARIABLES`."""

    driver_command: Floats
    expected: Floats
    reference_speed: Floats
    reference_deviation: Floats
    case: Floats
    level: Floats


class LeadMemory(NamedTuple):
    """Values that the foremost unit that works stores for the train, (1,) each."""

    unit: NDArray[np.int64]  # its number
    estimate: Floats  # coefficient at its last detection
    detected: Floats  # time of that
    slipped: Floats  # time of the last slip of any unit
    allocate: NDArray[np.bool_]  # whether something changed that needs a new allocation
    needed: Floats  # coefficient of the units that makes up for the trailers too
    brake_rise: Floats  # share of the plan that the trailers' brakes have risen to


class Counters(NamedTuple):
    """What is counted in a run, (1,) each; a field is an attribute of the recorded run."""

    detections: Counter
    unit_detections: Counter
    telegrams_sent: Counter
    telegrams_lost: Counter
    fallbacks: Counter
    blinded: Counter
    locks: Counter
    time_outs: Counter
    rule_calls: Counter


class Memory(NamedTuple):
    """What the computers remember; (units,) unless said otherwise."""

    unit: UnitMemory
    unit_block: Floats  # (fields, units): the same numbers, to be recorded by one copy
    train: TrainMemory
    train_block: Floats  # (fields, 1)
    lead: LeadMemory
    counter: Counters
    slide: SlideMemory
    estimate: ReferenceMemory
    sanding: SandingMemory
    law: LawMemory
    reference: Floats  # (bodies,) reference speed
    axle_omega: Floats  # (axles,) as measured
    axle_seen: NDArray[np.bool_]  # (axles,)
    mean_speed: Floats  # mean rim speed of the unit's axles as read
    speed: Floats  # mean rim speed as the unit knows it
    worst_slip: Floats  # largest slip of the unit's axles against the reference speed, in the direction of the demand
    differentiator: Floats
    observer: Floats
    observer_input: Floats
    torque: Floats  # as the inverters know it
    foreseen: Floats  # torque of the motors if they work and the line takes all of it
    taken: Floats  # braking torque that the line is thought to take
    kept: Floats  # share of its part that the air brake keeps
    air_force: Floats  # of the air brake per axle at the rim, as the unit knows it [N]
    drive_limit: Floats
    brake_limit: Floats
    limit_max: Floats
    in_service: NDArray[np.bool_]
    rise: Floats  # slew-limited magnitude of the expected torque
    cap: Floats
    limit_wanted: Floats  # what the foremost unit wants
    delivered: Floats  # by each unit, as the leader has heard
    truth: Floats  # filled for rules that are told it
    demonstrated: Floats  # coefficient that each unit has shown to be able to deliver
    upper_bound: Floats  # coefficient up to which each unit may be asked for more than the plan
    mark: Floats  # `demonstrated`; of a unit that was never limited that of the best
    most: Floats  # up to which a limit may rise now
    limited: NDArray[np.bool_]  # whether the unit is limited, as the leader has heard
    by_rail: NDArray[np.bool_]  # whether it was the rail that limited it the last time
    slipping: NDArray[np.bool_]  # whether it slips, as the leader has heard
    since_limited: Floats  # time since it was limited the last time, as the leader knows it [s]
    pressure: Floats  # (groups,) of the brake cylinders as read [Pa]
    air_most: Floats  # (groups,) force per axle that the oracle allows a trailer's brake [N]
    message: Floats  # (units, 1 and what a controller adds) limit that the leader would send now; inf: none, the plan stands
    received: Floats  # last limit received; inf: none
    orders: Channel  # limits to the units
    report: ReportMemory
    learnt: Increments
    learning: LearningMemory


def _block(kind: Any, size: int) -> tuple[Any, Floats]:
    """A record of zeros whose fields are the rows of a block, and the block."""
    values = np.zeros((len(kind._fields), size))
    return kind(*values), values


def _singles(kind: Any, dtype: Any = np.float64, **others: Any) -> Any:
    """A record of single zeros of `dtype`; `others`: types of the fields that have another."""
    return kind(*(np.zeros(1, others.get(name, dtype)) for name in kind._fields))


def attachments(m: Memory) -> tuple[Attachment, Attachment]:
    """What a controller adds to the reports and to the limits that are sent, in the memory itself."""
    line = m.report.line
    return (
        Attachment(m.report.own[:, NUMBERS:], line.read[:, NUMBERS:], line.heard),
        Attachment(m.message[:, 1:], m.orders.read[:, 1:], m.orders.heard),
    )


def memory(
    eq: Equipment, speed: float, expected: float, added: AddedNumbers = NOTHING_ADDED
) -> Memory:
    """Memory at the start of a run, the train rolling at `speed` [m/s]; telegrams have room for what is `added`."""
    n, bodies = eq.axles.size, int(eq.axle_body.max()) + 1
    unit, unit_block = _block(UnitMemory, n)
    unit.limit[:] = expected
    unit.axles_seen[:] = eq.axles
    unit.torque_factor[:] = 1.0
    train, train_block = _block(TrainMemory, 1)
    train.expected[:] = expected
    train.level[:] = np.nan
    lead = _singles(LeadMemory, unit=np.int64, allocate=np.bool_)
    lead.detected[:] = lead.slipped[:] = -np.inf
    learnt, learning = learning_memory(eq.learnt)
    nothing = np.tile([np.inf, *[np.nan] * added.order], (n, 1))
    orders = channel(n, 1 + added.order, np.inf)
    orders.read[:] = nothing
    empty = Memory(*(np.zeros(n) for _ in Memory._fields))  # type: ignore[arg-type]
    return empty._replace(
        unit=unit,
        unit_block=unit_block,
        train=train,
        train_block=train_block,
        lead=lead,
        counter=_singles(Counters, np.int64),
        slide=slide_memory(eq.axle_car.size, eq.group.unit.size),
        estimate=reference_memory(bodies, eq.axle_car.size, n, eq.group.unit.size),
        sanding=SandingMemory(np.full(1, -np.inf), np.full(1, -np.inf)),
        law=law_memory(n),
        reference=np.full(bodies, speed),
        axle_omega=speed / eq.axle_radius,
        axle_seen=eq.axle_sensed.copy(),
        mean_speed=np.full(n, speed),
        speed=np.full(n, speed),
        differentiator=np.full(n, speed),
        observer=np.full(n, np.nan),
        limit_max=np.full(n, np.inf),
        taken=np.full(n, np.inf),
        kept=np.ones(n),
        in_service=np.ones(n, dtype=np.bool_),
        cap=np.full(n, expected),
        limit_wanted=np.full(n, expected),
        delivered=np.full(n, expected),
        limited=np.zeros(n, dtype=np.bool_),
        by_rail=np.zeros(n, dtype=np.bool_),
        slipping=np.zeros(n, dtype=np.bool_),
        demonstrated=np.full(n, np.inf),
        upper_bound=np.full(n, np.inf),
        mark=np.full(n, expected),
        pressure=np.zeros(eq.group.unit.size),
        air_most=np.full(eq.group.unit.size, np.inf),
        message=nothing,
        received=np.full(n, np.inf),
        orders=orders,
        report=report_memory(n, speed, expected, added.report),
        learnt=learnt,
        learning=learning,
    )
