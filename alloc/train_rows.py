"""Rows of a train: axles, cars, traction units, brake groups, limits of its motors; and the adhesion that a rail offers it.

What the train truly is and what its computers believe of it stand in columns of their own. SI units.
"""

from collections.abc import Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.columns import AXLE, BRAKE, CAR, UNIT
from alloc.laws import GRAVITY
from alloc.tables import Rows, Table
from alloc.train import EFFORT_TABLE_LENGTH, AirBrake, Car, Train

Floats = NDArray[np.float64]


class TrainRows(NamedTuple):
    """A train as rows, tables of its motors, and what belongs into the rows of the plant and of the computers."""

    axles: Rows
    cars: Rows
    units: Rows
    brakes: Rows
    effort: Floats
    """Largest pulling torque of each motor [N m] every `alloc.train.EFFORT_SPEED_STEP`, (units, EFFORT_TABLE_LENGTH)."""
    retard: Floats
    """Largest braking torque of each motor."""
    plant: dict[str, Any]
    """Columns of `PLANT`."""
    onboard: dict[str, Any]
    """Columns of `ONBOARD`."""


def train_rows(
    train: Train,
    loads: Sequence[float] | None = None,
    radius_errors: ArrayLike = 0.0,
    inertia_in_limit: bool = True,
    blended: bool = True,
) -> TrainRows:
    """Rows of a train; its computers believe the truth but for what is given.

    `loads` [kg]: pay load of each car as they have it. `radius_errors`: relative, of each axle's wheels. `inertia_in_limit`:
    whether a target holds the torque that turns the wheelsets, JP5484215 (6). `blended`: whether every car brakes itself.
    """
    axles, cars, units, brakes, effort, retard = (table.copy() for table in _truth(train))
    found = axles, cars, units, brakes
    onboard = _believe(train, *found, loads, radius_errors, inertia_in_limit, blended)
    rigid = train.mass if train.couplers is None else 0.0
    plant = {"body_mass": rigid, "pitches": int(axles.unloading.any())}
    plant |= _plans(axles, axles.static_load, train.mass, True, onboard["blended"])
    return TrainRows(*found, effort, retard, plant, onboard)


@lru_cache(maxsize=64)
def rows_of(train: Train) -> TrainRows:
    """Rows of a train whose computers believe the truth, to be read: `rows_of(train).axles.unit`."""
    made = train_rows(train)
    for table in made[:6]:
        table.flags.writeable = False
    return made


def offered_by(curve: Any, level: float, speed: float, train: Train) -> float:
    """Adhesion that a rail of `level` and `curve` offers to a train at `speed` [m/s].

    It is the largest force of all axles over their weight: the curve's maximum, averaged with the static axle loads as
    weights. Heavy axles have the softer contacts.
    """
    axles = rows_of(train).axles
    contact = curve.contact(0.5 * axles.static_load, axles.radius)
    most = curve.top(speed, level, contact)[0]
    return float(np.broadcast_to(most, contact.shape) @ axles.static_load / axles.static_load.sum())


def level_for(curve: Any, adhesion: float, speed: float, train: Train) -> float:
    """Level of a rail whose `curve` offers `adhesion` to `train` at `speed` [m/s]: the inverse of `offered_by`."""
    level = adhesion
    for _ in range(20):  # the maximum of Polach's curve grows a little less than in proportion
        before, level = level, level * adhesion / offered_by(curve, level, speed, train)
        if level == before:
            break
    return level


# The truth


@lru_cache(maxsize=64)
def _truth(train: Train) -> tuple[Any, ...]:
    """The arrays of `TrainRows` with what is true alone; to be copied."""
    axles, units, brakes, front = list[Rows](), list[Rows](), list[Rows](), 0.0
    limits: list[list[Floats]] = []
    cars, coupled = CAR.rows(len(train.cars)), train.couplers is not None
    for c, car in enumerate(train.cars):
        own = _axles(car, c, coupled, front, train.load_transfer)
        units += _units(car, own, len(units), limits)
        brakes += _brake_groups(car, own, len(brakes))
        axles.append(own)
        cars[c].mass, cars[c].middle = car.mass, -(front + 0.5 * car.length)
        cars[c].body, front = c * coupled, front + car.length
        cars[c].resistance_quadratic = train.resistance[2] * car.length / train.length
    cars.resistance, cars.resistance_linear = np.outer(train.resistance[:2], cars.mass / train.mass)
    for c, coupler in enumerate(train.couplers or ()):
        for name in ("stiffness", "stiffening", "damping", "slack"):
            cars[c][name] = getattr(coupler, name)
    tables = np.array(limits).reshape(-1, 2, EFFORT_TABLE_LENGTH).swapaxes(0, 1)
    joined = _joined(AXLE, axles), cars, _joined(UNIT, units), _joined(BRAKE, brakes)
    return (*joined, tables[0].copy(), tables[1].copy())


def _joined(table: Table, parts: Sequence[Rows]) -> Rows:
    rows, first = table.rows(sum(part.size for part in parts)), 0
    for part in parts:
        rows[first : first + part.size] = part
        first += part.size
    return rows


def _axles(car: Car, number: int, coupled: bool, front: float, load_transfer: bool) -> Rows:
    """Axles of a car whose front is `front` [m] behind the train's."""
    return AXLE.rows(
        len(car.axle_positions),
        car=number,
        body=number * coupled,
        offset=-(front + np.array(car.axle_positions)),
        radius=car.wheel_radius,
        inertia=car.wheel_inertia,
        static_load=car.mass * GRAVITY * car.shares,
        unloading=car.unloading() * load_transfer,
        sensed=int(car.speed_sensors),
    )


def _units(car: Car, axles: Rows, first: int, limits: list[list[Floats]]) -> list[Rows]:
    """Traction units of a car, from number `first` on, written into its `axles`; their torque limits join `limits`."""
    rows, motors, radius = [], car.motors, car.wheel_radius
    for j, members in enumerate(car.units()):
        assert motors is not None
        axles.gear[members], axles.unit[members], n = motors.gear_ratio, first + j, len(members)
        known = {"axles": n, "seen": n, "gear": motors.gear_ratio, "true_radius": radius}
        rows.append(UNIT.rows(1, lag=motors.torque_lag, slip_torque=motors.slip_torque, **known))
        each = motors.drive, motors.brake
        limits.append([one.tabulate(radius, motors.gear_ratio) for one in each])
    return rows


def _brake_groups(car: Car, axles: Rows, first: int) -> list[Rows]:
    """Brake groups of a car, one per bogie, from number `first` on, written into its `axles`."""
    brake: AirBrake | None = car.air_brake
    if brake is None:
        return []
    rows, bogies = [], np.array(car.bogie_of_axle)
    numerator, offset, constant = brake.friction
    axles.brake = first + bogies
    for bogie in range(car.brake_groups):
        inside = bogies == bogie
        works = brake.friction_factor * (bogie not in brake.cut_out)
        axles.shoe_gain[inside] = brake.force_per_pascal * works
        rows.append(
            BRAKE.rows(
                1,
                unit=axles.unit[inside].max(),
                axles=inside.sum(),
                fill_time=brake.fill_time,
                release_time=brake.release_time,
                dead_time=brake.dead_time,
                most_pressure=brake.maximum_pressure,
                friction_numerator=numerator,
                friction_offset=offset,
                friction_constant=constant,
                gain=brake.force_per_pascal,
            )
        )
    return rows


# The belief


def _plans(
    axles: Rows, load: Floats, mass: float, inertia_in_limit: bool, blended: int
) -> dict[str, float]:
    """Coefficients that each m/s2 of a train of `mass` [kg] needs of axles that pull and that brake; `load` (axles,) [N].

    The rail carries what accelerates the train and turns the wheelsets that do not act. What turns those that do comes from
    their own motors or shoes, on top of a limit.
    """
    turning, driven = axles.inertia / axles.radius**2, axles.unit >= 0
    braked = driven | (axles.brake >= 0) if blended else driven
    found = {}
    for name, acting in (("planned", driven), ("brake_planned", braked)):
        resisting = turning[~acting] if inertia_in_limit else turning
        found[name] = (mass + resisting.sum()) / load[acting].sum() if acting.any() else 0.0
    return found


def _believe(
    train: Train, axles: Rows, cars: Rows, units: Rows, brakes: Rows,
    loads: Sequence[float] | None, radius_errors: ArrayLike, inertia_in_limit: bool, blended: bool,
) -> dict[str, Any]:  # fmt: skip
    """Write what the computers believe into the rows; what they believe of the whole train."""
    empty, pay = np.array([(car.empty_mass, car.load) for car in train.cars]).T
    mass = empty + np.maximum(pay if loads is None else loads, 0.0)
    load = axles.static_load * (mass / cars.mass)[axles.car]
    axles.believed_radius = axles.radius * (1.0 + np.asarray(radius_errors))
    blends = int(brakes.size > 0 and (blended or units.size == 0))
    plans = _plans(axles, load, mass.sum(), inertia_in_limit, blends)
    turning = GRAVITY * axles.inertia / axles.radius**2 * inertia_in_limit
    for rows, member in ((units, axles.unit), (brakes, axles.brake)):
        for k in range(rows.size):
            inside, row = member == k, rows[k]
            row.load = load[inside].mean()
            own = turning[inside].mean() / (GRAVITY * row.load)
            if rows is brakes:
                row.turning = own / plans["brake_planned"]
                continue
            row.turning, row.brake_turning = own / plans["planned"], own / plans["brake_planned"]
            row.radius, row.inertia = (
                axles.believed_radius[inside].mean(),
                axles.inertia[inside].mean(),
            )
    if units.size:
        weight = units.load * units.axles
        units.mass = weight / weight.mean()
    resistance = dict(
        zip(
            ("resistance", "resistance_linear", "resistance_quadratic"),
            train.resistance,
            strict=True,
        )
    )
    return plans | resistance | {"blended": blends, "train_mass": mass.sum()}
