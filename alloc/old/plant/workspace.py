"""A model laid out for vector code: arrays in whole blocks of eight, the state as the integrator keeps it, and scratch.

In: a `Model`. Out: a `Workspace`, all memory that the compiled plant ever needs.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.old.plant.laws import HOLDING_BRAKE
from alloc.old.plant.model import NO_WEDGES, Floats, Ints, Layout, Model
from alloc.old.plant.operations import WIDTH, padded
from alloc.old.plant.rail import Patches
from alloc.old.records import ByReference, LaidOut

# Arrays in whole blocks of `WIDTH`, as vector code takes them.


def filled(values: NDArray[np.float64], fill: float = 0.0) -> Floats:
    """Values (..., size) as blocks, `fill` in what is left."""
    found = np.full((*values.shape[:-1], padded(values.shape[-1])), fill)
    found[..., : values.shape[-1]] = values
    return found


def indices(values: Ints, absent: int) -> Ints:
    """As `filled`, for indices, of which negative ones are `absent` too."""
    found = np.full(padded(values.size), absent, dtype=np.int64)
    found[: values.size] = np.where(values < 0, absent, values)
    return found


def members(owner: Ints, count: int, absent: int) -> Ints:
    """Which items each of `count` owners has, (most items, owners): `absent` where it has fewer."""
    own = [np.flatnonzero(owner == k) for k in range(count)]
    found = np.full((max([1, *map(len, own)]), padded(count)), absent, dtype=np.int64)
    for k, some in enumerate(own):
        found[: len(some), k] = some
    return found


# A model laid out for vector code: its arrays in whole blocks, the state as the integrator keeps it, and scratch.
#
# Which axle belongs to which car, unit and brake group stands here as rows of the state, so the right side only gathers
# and sums. What fills a block up has neither load nor motor; it adds nothing.


RUNGE_KUTTA = np.array(
    [[0.0, 0.5, 1.0 / 6.0], [0.5, 0.5, 1.0 / 3.0], [0.5, 1.0, 1.0 / 3.0], [1.0, 0.0, 1.0 / 6.0]]
)
"""Stages of the classical fourth-order method: where in the step, reach to the next, weight. As data, or the compiler would
write the right side out four times."""


class Rows(NamedTuple):
    """First row of each part of the padded state; parts begin on a block."""

    position: int
    speed: int
    omega: int
    torque: int
    pressure: int
    gear: int
    rotor: int
    twist: int
    recovery: int
    friction: int
    work: int
    nothing: int
    """A block of rows that are always 0: those of a motor or brake that is not there."""
    deflection: int
    """From here on what is 0 unless a contact may stick."""
    end: int


class AxleConstants(NamedTuple):
    """Constants of the axles, and the rows where each finds its body, motor and cylinder."""

    offset: Floats
    radius: Floats
    inertia: Floats
    inverse_inertia: Floats
    gear: Floats
    motor: Floats  # (3, axles) kind, breakdown torque and slip, as of `Motors.characteristic`
    parallel: bool  # whether motors share an inverter or a voltage
    shaft: Floats  # (2, axles) stiffness and damping of the drive
    inverse_rotor: Floats
    twists: bool  # whether any drive twists
    unit: Ints  # of the axle, or one without speed
    static_load: Floats
    contact: Floats
    unloading: Floats
    pitches: bool  # whether any axle is unloaded by its car's force
    shoe_gain: Floats  # torque [N m] per pascal and shoe friction; per pascal alone where no friction fades
    shoe_friction: Floats  # (3, axles)
    friction_fades: bool  # whether any shoe's friction depends on its wheel's speed
    holding_gain: Floats  # share of a brake that holds in full, per pascal
    law: Floats  # (2, axles) numerator and constant of the speed law
    increment: Floats
    sander: Ints  # that lays sand ahead of the axle, -1: none
    body: Ints
    car: Ints
    position_row: Ints
    speed_row: Ints
    torque_row: Ints
    pressure_row: Ints


class CarConstants(NamedTuple):
    """Constants of the cars, of the bodies and of the couplers behind them."""

    members: Ints  # (most axles of a car, cars) the car's axles
    position_row: Ints
    speed_row: Ints
    offset: Floats
    mass: Floats
    resistance: Floats  # (3, cars)
    inverse_body_mass: Floats
    coupler: Floats  # (4, bodies)
    draft_gear: Floats  # (8, bodies)
    rubs: bool  # whether there are friction draft gears


class UnitConstants(NamedTuple):
    """Constants of traction units and brake groups."""

    members: Ints  # (most axles of a unit, units) rows of the angular speeds of its axles
    share: Floats  # (most axles of a unit, units) by which they give the unit's rim speed
    shaft: Floats  # speed of the motor shaft [rad/s] over that of the rim
    inverse_lag: Floats
    failure_time: Floats
    table_start: Floats  # (units,) where its limits begin in the tables
    drive_table: Floats
    brake_table: Floats
    table_size: float  # of each
    inverse_times: Floats  # (2, groups) of filling and releasing


class RailConstants(NamedTuple):
    """The environment, common to all axles."""

    curve_kind: int
    curve: Floats
    presliding: float
    law_offset: float  # of the speed laws of all axles
    patch: Patches
    noise: Floats
    noise_length: float
    noisy: bool
    conditioning: float
    conditioning_slip: float
    conditioned: bool
    recovers: bool
    recovered: float
    recovery_energy: float
    recovery_time: float
    recovery_left: float
    cleaning_spacing: float
    sandy: bool
    sanded: float
    sand_saturation: float
    sand_kept: float
    grade: Floats
    air_factor: Floats
    curving: Floats
    curved: bool
    line_origin: float
    line_spacing: float
    uniform: bool  # everywhere the same grade, air and curve
    receptivity: Floats


class Remembered(NamedTuple):
    """A quantity that wheels and sanders leave on the rail."""

    under: Floats  # (axles,) where each axle stood at the start of the step
    left: Floats  # (cells,) on each rail cell, a ring by position


class Scratch(NamedTuple):
    """What the right side computes on its way, and what the plant remembers between steps."""

    state: Floats  # (rows,)
    stage: Floats
    slope: Floats
    total: Floats
    touching: Ints  # (patches,) first the numbers of those that touch the train now
    acting: Floats  # (patches,) their weight in time
    decline: Floats  # (bodies,) of the speed law
    peak: Floats  # (axles,)
    limit: Floats  # (3, axles) speed, adhesion limit and slip velocity there
    mu: Floats  # (axles,) tangential force coefficient
    load: Floats  # (2, axles) of a car's force and unloading, then zeros
    car_force: Floats
    net: Floats  # (bodies,) force without couplers
    tension: Floats  # (bodies,) behind a block of zeros
    normal: Floats  # (axles,) axle load
    force: Floats  # (axles,) of the rail
    shoe: Floats  # (axles,) torque of the brake shoes
    motor: Floats  # (axles,) torque of motors at the wheel, where drives twist
    shaft: Floats  # (axles,) what the drive hands on of it, where drives twist
    command: Floats  # (units,)
    unit_speed: Floats  # (units,) mean speed of the motor shafts [rad/s], and a block of zeros
    target: Floats  # (groups,) behind the dead time
    valve: Floats
    cleaning: Remembered  # degree, 0..1
    sand: Remembered  # [kg/m] on each rail
    sticking: Ints  # (1,) whether a contact may stick in this step
    cell: Ints  # (axles,) cell of each axle at the end of the last step
    delay_target: Floats  # (groups, slots)
    delay_valve: Floats
    delay_steps: Ints  # (groups,)
    clock: Ints  # (1,) steps taken


class Noted(NamedTuple):
    """What the right side computed at the start of the last `advance`, or of many, (instants, ...) each."""

    peak: Floats  # (axles,) peak coefficient
    coefficient: Floats  # (axles,) tangential force coefficient
    load: Floats  # (axles,) [N]; none where it is the static one
    force: Floats  # (axles,) of the rail [N]
    brake: Floats  # (axles,) of the brake shoes at the rim [N]
    motor: Floats  # (shafts,) torque of motors at the wheel [N m]
    shaft: Floats  # (shafts,) that drives hand on to their wheelsets [N m]
    acceleration: Floats  # (bodies,) [m/s2]
    tension: Floats  # (couplers,) [N]

    @classmethod
    def of(cls, n: Layout, *instants: int) -> "Noted":
        """Room for one instant, or for a number of `instants`."""
        axles, shafts = (n.axles, n.axles), (n.shafts, n.shafts)
        sizes = (*axles, n.pitching, *axles, *shafts, n.bodies, n.bodies - 1)
        return cls(*(np.zeros((*instants, size)) for size in sizes))


class Workspace(NamedTuple):
    """All that the compiled plant works on; it belongs to one run."""

    size: Layout
    row: Rows
    place: Ints  # (rows,) of the state among those of the padded one
    rigid: bool
    stages: Floats  # (4, 3) of the integrator
    axle: AxleConstants
    car: CarConstants
    unit: UnitConstants
    rail: RailConstants
    scratch: Scratch
    noted: Noted


def _sizes(n: Layout) -> tuple[int, ...]:
    """Rows of the parts of the state, in the order of `Rows`; nothing has none."""
    optional = (n.draft_gears, n.shafts, n.shafts, n.recoveries)
    return (n.bodies, n.bodies, n.axles, n.units, n.groups, *optional, n.axles, 4, 0, n.axles)


def _rows(n: Layout) -> Rows:
    # couplers are taken by the bodies before them, of which there is one more
    room = _sizes(n._replace(draft_gears=n.draft_gears + 1))
    ends = np.cumsum([padded(size) for size in room])
    return Rows(0, *(int(end) for end in ends))


def _axles(model: Model, row: Rows) -> AxleConstants:
    s, e, absent = model.structure, model.environment, row.nothing
    rotor, stiffness, damping = s.axle_shaft
    inertia = s.inertia - rotor
    fades = bool(s.shoe_friction[:, 0].any())
    return AxleConstants(
        offset=filled(s.axle_offset),
        radius=filled(s.radius),
        inertia=filled(inertia, 1.0),
        inverse_inertia=filled(1.0 / inertia),
        gear=filled(s.gear),
        motor=filled(s.axle_motor, 1.0),
        parallel=bool(s.axle_motor[0].any()),
        shaft=filled(np.stack([stiffness, damping])),
        inverse_rotor=filled(np.where(rotor > 0.0, 1.0 / np.maximum(rotor, 1e-9), 0.0)),
        twists=model.layout.shafts > 0,
        unit=indices(s.axle_unit, padded(model.layout.units)),
        static_load=filled(s.static_load),
        contact=filled(e.contact, 1.0),
        unloading=filled(s.unloading),
        pitches=bool(s.unloading.any()),
        shoe_gain=filled(s.shoe_gain * s.radius * (1.0 if fades else s.shoe_friction[:, 2])),
        shoe_friction=filled(s.shoe_friction.T, 1.0),
        friction_fades=fades,
        holding_gain=filled(s.shoe_gain / (s.static_load * HOLDING_BRAKE)),
        law=filled(e.law[::2]),
        increment=filled(e.increment),
        sander=indices(s.axle_sander, -1),
        body=indices(s.axle_body, 0),
        car=indices(s.axle_car, 0),
        position_row=indices(row.position + s.axle_body, row.position),
        speed_row=indices(row.speed + s.axle_body, row.speed),
        torque_row=indices(np.where(s.axle_unit < 0, -1, row.torque + s.axle_unit), absent),
        pressure_row=indices(np.where(s.axle_group < 0, -1, row.pressure + s.axle_group), absent),
    )


def _cars(model: Model, row: Rows) -> CarConstants:
    s, n = model.structure, model.layout
    return CarConstants(
        members=members(s.axle_car, n.cars, padded(n.axles)),
        position_row=indices(row.position + s.car_body, row.nothing),
        speed_row=indices(row.speed + s.car_body, row.nothing),
        offset=filled(s.car_offset),
        mass=filled(s.car_mass),
        resistance=filled(s.car_resistance.T),
        inverse_body_mass=filled(1.0 / s.body_mass, 1.0),
        # none behind the last body
        coupler=filled(np.append(s.coupler, np.zeros((1, 4)), axis=0).T),
        draft_gear=filled(np.append(s.draft_gear, [NO_WEDGES], axis=0).T),
        rubs=n.draft_gears > 0,
    )


def _units(model: Model, row: Rows) -> UnitConstants:
    s, n = model.structure, model.layout
    of_unit = members(s.axle_unit, n.units, -1)
    # a motor turns with its rotor
    turned = np.where(s.axle_shaft[1] > 0.0, row.rotor, row.omega) + np.arange(n.axles)
    points = s.drive_table.shape[1]
    return UnitConstants(
        members=np.where(of_unit < 0, row.nothing, turned[of_unit]),
        share=np.where(of_unit < 0, 0.0, s.radius[of_unit] / filled(s.unit_axles, 1.0)),
        shaft=filled(s.unit_gear / s.radius[of_unit[0, : n.units]]),
        inverse_lag=filled(1.0 / s.unit_lag, 1.0),
        failure_time=filled(model.environment.failure_time),
        table_start=points * filled(np.arange(float(n.units))),
        # look-ups take two neighbours, also where there is no unit
        drive_table=np.append(s.drive_table, np.zeros(2)),
        brake_table=np.append(s.brake_table, np.zeros(2)),
        table_size=float(max(points, 2)),
        inverse_times=filled(1.0 / np.array([s.group_fill, s.group_release]), 1.0),
    )


def _rail(model: Model) -> RailConstants:
    e = model.environment
    own = {name: getattr(e, name) for name in RailConstants._fields if name in e._fields}
    return RailConstants(
        **own,
        law_offset=float(e.law[1, 0]),
        grade=e.line[0],
        air_factor=e.line[1],
        curving=e.line[2],
        curved=bool(e.line[2].any()),
        recovers=model.layout.recoveries > 0,
        uniform=bool(np.all(e.line == e.line[:, :1])),
    )


def _scratch(model: Model, row: Rows, step: float) -> Scratch:
    n, e, train = model.layout, model.environment, model.train
    axles, bodies, cars, groups = map(padded, (n.axles, n.bodies, n.cars, n.groups))
    delay = np.array(
        [round(brake.dead_time / step) for brake in train.brake_groups], dtype=np.int64
    )
    slots = int(delay.max(initial=0)) + 1
    cells = int(sum(car.length for car in train.cars) / e.cleaning_spacing) + 256
    return Scratch(
        state=np.zeros(row.end),
        stage=np.zeros(row.end),
        slope=np.zeros(row.end),
        total=np.zeros(row.end),
        touching=np.zeros(e.patch.factor.size, dtype=np.int64),
        acting=np.zeros(e.patch.factor.size),
        decline=np.zeros(bodies),
        peak=np.zeros(axles),
        limit=np.zeros((3, axles)),
        mu=np.zeros(axles),
        load=np.zeros((2, axles + WIDTH)),
        car_force=np.zeros(cars),
        net=np.zeros(cars),
        tension=np.zeros(WIDTH + cars),
        normal=filled(model.structure.static_load),
        force=np.zeros(axles),
        shoe=np.zeros(axles),
        motor=np.zeros(axles),
        shaft=np.zeros(axles),
        command=np.zeros(padded(n.units)),
        unit_speed=np.zeros(padded(n.units) + WIDTH),
        target=np.zeros(groups),
        valve=np.zeros(groups),
        cleaning=Remembered(np.zeros(axles), np.zeros(cells if e.conditioned else 1)),
        sand=Remembered(np.zeros(axles), np.zeros(cells if e.sandy else 1)),
        sticking=np.ones(1, dtype=np.int64),
        cell=np.full(n.axles, np.iinfo(np.int64).min, dtype=np.int64),
        delay_target=np.zeros((n.groups, slots)),
        delay_valve=np.zeros((n.groups, slots)),
        delay_steps=delay,
        clock=np.zeros(1, dtype=np.int64),
    )


def workspace(model: Model, step: float) -> ByReference:
    """Everything that `model` needs to be advanced with `step` [s]: a `Workspace`."""
    made = model.made.once(step, lambda: LaidOut(_workspace(model, step)))
    return made.fresh()


def _workspace(model: Model, step: float) -> Workspace:
    n = model.layout
    row = _rows(n)
    parts = zip(row, _sizes(n), strict=False)
    return Workspace(
        size=n,
        row=row,
        place=np.concatenate([first + np.arange(size) for first, size in parts]),
        rigid=n.bodies == 1,
        stages=RUNGE_KUTTA,
        axle=_axles(model, row),
        car=_cars(model, row),
        unit=_units(model, row),
        rail=_rail(model),
        scratch=_scratch(model, row, step),
        noted=Noted.of(n),
    )
