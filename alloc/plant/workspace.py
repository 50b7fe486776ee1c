"""A model laid out for vector code: its arrays in whole blocks, the state as the integrator keeps it, and scratch.

Which axle belongs to which car, unit and brake group stands here as rows of the state, so the right side only gathers
and sums. What fills a block up has neither load nor motor; it adds nothing.
"""

from collections.abc import Iterator
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.by_reference import ByReference
from alloc.plant.model import Model
from alloc.plant.simd import WIDTH, padded
from alloc.plant.structure import Floats, Ints, Layout

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
    friction: int
    work: int
    nothing: int
    """A block of rows that are always 0: those of a motor or brake that is not there."""
    end: int


class Axles(NamedTuple):
    """Constants of the axles, and the rows where each finds its body, motor and cylinder."""

    offset: Floats
    radius: Floats
    inertia: Floats
    inverse_inertia: Floats
    gear: Floats
    static_load: Floats
    unloading: Floats
    shoe_gain: Floats  # torque [N m] per pascal and shoe friction
    law: Floats  # (2, axles) numerator and constant of the speed law
    increment: Floats
    body: Ints
    car: Ints
    position_row: Ints
    speed_row: Ints
    torque_row: Ints
    pressure_row: Ints


class Cars(NamedTuple):
    """Constants of the cars, of the bodies and of the couplers behind them."""

    members: Ints  # (most axles of a car, cars) the car's axles
    position_row: Ints
    speed_row: Ints
    offset: Floats
    mass: Floats
    resistance: Floats  # (3, cars)
    shoe_friction: Floats  # (3, cars)
    body_mass: Floats
    coupler: Floats  # (4, bodies)


class Units(NamedTuple):
    """Constants of traction units and brake groups."""

    members: Ints  # (most axles of a unit, units) rows of the angular speeds of its axles
    share: Floats  # (most axles of a unit, units) by which they give the unit's rim speed
    lag: Floats
    failure_time: Floats
    table_start: Floats  # (units,) where its limits begin in the tables
    drive_table: Floats
    brake_table: Floats
    table_end: float  # of each
    fill: Floats  # (groups,)
    release: Floats  # (groups,)


class Rail(NamedTuple):
    """The environment, common to all axles."""

    curve_kind: int
    curve: Floats
    law_offset: float  # of the speed laws of all axles
    patch: Floats
    noise: Floats
    noise_length: float
    noisy: bool
    conditioning: float
    conditioning_slip: float
    conditioned: bool
    cleaning_spacing: float
    grade: Floats
    air_factor: Floats
    origin: float
    spacing: float
    uniform: bool  # everywhere the same grade and air
    receptivity: Floats


class Scratch(NamedTuple):
    """What the right side computes on its way, and what the plant remembers between steps."""

    state: Floats  # (rows,)
    stage: Floats
    slope: Floats
    total: Floats
    active: Floats  # (patches, 5) those that touch the train now: factor, start, end, edge, weight in time
    decline: Floats  # (bodies,) of the speed law
    peak: Floats  # (axles,)
    mu: Floats  # and then rail force
    load: Floats  # (2, axles) of a car's force and unloading, then zeros
    car_force: Floats
    grip: Floats  # (cars,) shoe friction
    net: Floats  # (bodies,) force without couplers
    tension: Floats  # (bodies,) behind a block of zeros
    command: Floats  # (units,)
    target: Floats  # (groups,) behind the dead time
    valve: Floats
    cleaning: Floats  # (axles,) 0..1, left by the wheels ahead
    cleaned: Floats  # (cells,) degree of cleaning of each rail cell, a ring by position
    cell: Ints  # (axles,) cell of each axle at the end of the last step
    delay_target: Floats  # (groups, slots)
    delay_valve: Floats
    delay_steps: Ints  # (groups,)
    clock: Ints  # (1,) steps taken


class Noted(NamedTuple):
    """What the plant noted at the start of the last `advance`."""

    peak: Floats  # (axles,) peak coefficient
    acceleration: Floats  # (bodies,) [m/s2]


class Workspace(NamedTuple):
    """All that the compiled plant works on; it belongs to one run."""

    size: Layout
    row: Rows
    place: Ints  # (rows,) of the state among those of the padded one
    rigid: bool
    stages: Floats  # (4, 3) of the integrator
    axle: Axles
    car: Cars
    unit: Units
    rail: Rail
    scratch: Scratch
    noted: Noted


def _packed(parts: Any) -> Any:
    """The same with all arrays of numbers side by side, each on a cache line of its own.

    Where they happened to lie otherwise made the right side up to 1.5 times slower.
    """
    arrays = [values for values in _leaves(parts) if isinstance(values, np.ndarray)]
    places = np.cumsum([0, *(padded(values.size) for values in arrays)])
    raw = np.zeros(int(places[-1]) + WIDTH)
    start = -raw.ctypes.data // raw.itemsize % WIDTH
    rest = iter(zip(arrays, places + start, strict=False))

    def placed(part: Any) -> Any:
        if isinstance(part, tuple):
            return type(part)(*map(placed, part))
        if not isinstance(part, np.ndarray):
            return part
        values, first = next(rest)
        room = raw[first : first + values.size].view(values.dtype).reshape(values.shape)
        room[...] = values
        return room

    return placed(parts)


def _leaves(part: Any) -> Iterator[Any]:
    if isinstance(part, tuple):
        for one in part:
            yield from _leaves(one)
    else:
        yield part


def _sizes(n: Layout) -> tuple[int, ...]:
    """Rows of the parts of the state, in its order."""
    return (n.bodies, n.bodies, n.axles, n.units, n.groups, n.axles, 4)


def _rows(n: Layout) -> Rows:
    ends = np.cumsum([padded(size) for size in (*_sizes(n), 1)])
    return Rows(0, *(int(end) for end in ends))


def _filled(values: NDArray[np.float64], fill: float = 0.0) -> Floats:
    """Values (..., size) as blocks, `fill` in what is left."""
    found = np.full((*values.shape[:-1], padded(values.shape[-1])), fill)
    found[..., : values.shape[-1]] = values
    return found


def _indices(values: Ints, absent: int) -> Ints:
    """As `_filled`, for indices, of which negative ones are `absent` too."""
    found = np.full(padded(values.size), absent, dtype=np.int64)
    found[: values.size] = np.where(values < 0, absent, values)
    return found


def _members(owner: Ints, count: int, absent: int) -> Ints:
    """Which items each of `count` owners has, (most items, owners): `absent` where it has fewer."""
    own = [np.flatnonzero(owner == k) for k in range(count)]
    found = np.full((max([1, *map(len, own)]), padded(count)), absent, dtype=np.int64)
    for k, some in enumerate(own):
        found[: len(some), k] = some
    return found


def workspace(model: Model, step: float) -> ByReference:
    """Everything that `model` needs to be advanced with `step` [s]: a `Workspace`."""
    n, s, e = model.layout, model.structure, model.environment
    row = _rows(n)
    axles, absent = padded(n.axles), row.nothing
    of_car = _members(s.axle_car, n.cars, axles)
    of_unit = _members(s.axle_unit, n.units, -1)
    share = np.where(of_unit < 0, 0.0, s.radius[of_unit] / _filled(s.unit_axles, 1.0))
    length = sum(car.length for car in model.train.cars)
    cells = int(length / e.cleaning_spacing) + 256
    delay = np.array(
        [round(brake.dead_time / step) for brake in model.train.brake_groups], dtype=np.int64
    )
    points, slots = s.drive_table.shape[1], int(delay.max(initial=0)) + 1
    return ByReference(
        _packed(
            Workspace(
                n,
                row,
                np.concatenate(
                    [first + np.arange(size) for first, size in zip(row, _sizes(n), strict=False)]
                ),
                n.bodies == 1,
                RUNGE_KUTTA,
                Axles(
                    *map(_filled, (s.axle_offset, s.radius)),
                    _filled(s.inertia, 1.0),
                    _filled(1.0 / s.inertia),
                    *map(_filled, (s.gear, s.static_load, s.unloading, s.shoe_gain * s.radius)),
                    _filled(e.law[::2]),
                    _filled(e.increment),
                    _indices(s.axle_body, 0),
                    _indices(s.axle_car, 0),
                    _indices(row.position + s.axle_body, row.position),
                    _indices(row.speed + s.axle_body, row.speed),
                    _indices(np.where(s.axle_unit < 0, -1, row.torque + s.axle_unit), absent),
                    _indices(np.where(s.axle_group < 0, -1, row.pressure + s.axle_group), absent),
                ),
                Cars(
                    of_car,
                    _indices(row.position + s.car_body, absent),
                    _indices(row.speed + s.car_body, absent),
                    _filled(s.car_offset),
                    _filled(s.car_mass),
                    _filled(s.car_resistance.T),
                    _filled(s.shoe_friction[of_car[0, : n.cars]].T, 1.0),
                    _filled(s.body_mass, 1.0),
                    np.stack([_filled(np.append(values, np.zeros(1))) for values in s.coupler.T]),
                ),
                Units(
                    np.where(of_unit < 0, absent, row.omega + of_unit),
                    share,
                    _filled(s.unit_lag, 1.0),
                    _filled(e.failure_time),
                    points * _filled(np.arange(float(n.units))),
                    *(np.append(table, np.zeros(2)) for table in (s.drive_table, s.brake_table)),
                    max(points, 2) - 1.000001,
                    _filled(s.group_fill, 1.0),
                    _filled(s.group_release, 1.0),
                ),
                Rail(
                    *e[: e._fields.index("curve") + 1],
                    e.law[1, 0],
                    *e[e._fields.index("patch") : e._fields.index("line_origin")],
                    *e.line,
                    e.line_origin,
                    e.line_spacing,
                    bool(np.all(e.line == e.line[:, :1])),
                    e.receptivity,
                ),
                Scratch(
                    *np.zeros((4, row.end)),
                    np.zeros((e.patch.shape[0], 5)),
                    np.zeros(padded(n.bodies)),
                    *np.zeros((2, axles)),
                    np.zeros((2, axles + WIDTH)),
                    *np.zeros((3, padded(n.cars))),
                    np.zeros(WIDTH + padded(n.cars)),
                    np.zeros(padded(n.units)),
                    *np.zeros((2, padded(n.groups))),
                    np.zeros(axles),
                    np.zeros(cells if e.conditioned else 1),
                    np.full(n.axles, np.iinfo(np.int64).min, dtype=np.int64),
                    *np.zeros((2, n.groups, slots)),
                    delay,
                    np.zeros(1, dtype=np.int64),
                ),
                Noted(np.zeros(n.axles), np.zeros(n.bodies)),
            )
        )
    )
