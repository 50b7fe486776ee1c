"""What the train's computers remember in a run; nothing is allocated later."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.attachment import NOTHING_ADDED, AddedNumbers, Attachment
from alloc.onboard.controllers.collection import LawMemory, law_memory
from alloc.onboard.equipment import Equipment
from alloc.onboard.increment_learning import Increments, LearningMemory, learning_memory
from alloc.onboard.mail import Mail, mail
from alloc.onboard.reference_speed.state import ReferenceMemory, reference_memory
from alloc.onboard.reports import NUMBERS, ReportMemory, report_memory
from alloc.onboard.sanding import SandingMemory
from alloc.onboard.slide_protection.state import SlideMemory, slide_memory
from alloc.plant.model import Floats

Counter = NDArray[np.int64]


class UnitMemory(NamedTuple):
    """What is recorded of every unit, (units,) each; a field is a name in `alloc.recorded_variables.VARIABLES`."""

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
    """What is recorded of the train, (1,) each; a field is a name in `alloc.recorded_variables.VARIABLES`."""

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
    truth: Floats  # filled for the oracle only
    shown: Floats  # coefficient that each unit has shown to be able to deliver
    open_to: Floats  # coefficient up to which each unit may be asked for more than the plan
    most: Floats  # up to which a limit may rise now
    limited: NDArray[np.bool_]  # whether the unit is limited, as the leader has heard
    by_rail: NDArray[np.bool_]  # whether it was the rail that limited it the last time
    slipping: NDArray[np.bool_]  # whether it slips, as the leader has heard
    since_limited: Floats  # time since it was limited the last time, as the leader knows it [s]
    pressure: Floats  # (groups,) of the brake cylinders as read [Pa]
    air_most: Floats  # (groups,) force per axle that the oracle allows a trailer's brake [N]
    told: Floats  # (units, 1 and what a controller adds) limit that the leader would send now; inf: none, the plan stands
    received: Floats  # last limit received; inf: none
    orders: Mail  # limits to the units
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
        Attachment(m.told[:, 1:], m.orders.read[:, 1:], m.orders.heard),
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
    orders = mail(n, 1 + added.order, np.inf)
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
        shown=np.full(n, np.inf),
        open_to=np.full(n, np.inf),
        pressure=np.zeros(eq.group.unit.size),
        air_most=np.full(eq.group.unit.size, np.inf),
        told=nothing,
        received=np.full(n, np.inf),
        orders=orders,
        report=report_memory(n, speed, expected, added.report),
        learnt=learnt,
        learning=learning,
    )
