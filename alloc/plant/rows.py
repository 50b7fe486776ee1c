"""Rows of a train: axles, cars, traction units, brake groups, limits of its motors; and the adhesion that a rail offers it.

What the train truly is and what its computers believe of it stand in columns of their own. SI units.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.laws import GRAVITY
from alloc.onboard.columns import AXLE, BRAKE, CAR, UNIT
from alloc.plant.train import EFFORT_TABLE_LENGTH, Car, Train
from alloc.schema.tables import Rows, put

Floats = NDArray[np.float64]


class TrainRows(NamedTuple):
    """A train as rows, tables of its motors, and what belongs into the rows of the plant and of the computers."""

    axles: Rows
    cars: Rows
    units: Rows
    brakes: Rows
    effort: Floats
    """Largest pulling torque of each motor [N m] every `EFFORT_SPEED_STEP`, (units, EFFORT_TABLE_LENGTH)."""
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
    empty, pay = np.array([(car.mass, car.load) for car in train.cars]).T
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
            row.radius = axles.believed_radius[inside].mean()
            row.inertia = axles.inertia[inside].mean()
    if units.size:
        weight = units.load * units.axles
        units.mass_share = weight / weight.mean()
    names = "resistance", "resistance_linear", "resistance_quadratic"
    onboard: dict[str, Any] = plans | dict(zip(names, train.resistance, strict=True))
    onboard |= {"blended": blends, "train_mass": mass.sum()}
    plant: dict[str, Any] = {"body_mass": train.mass if train.couplers is None else 0.0}
    plant |= {"pitches": axles.unloading.any(), "parallel": units.slip_torque.any()}
    plant |= _plans(axles, axles.static_load, train.mass, True, blends)
    return TrainRows(axles, cars, units, brakes, effort, retard, plant, onboard)


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
    all_cars, coupled = train.cars, train.couplers is not None

    def of_axles(part: Callable[[Car], ArrayLike]) -> NDArray[Any]:
        return np.concatenate([np.asarray(part(one)) for one in all_cars])

    length, mass, radius, sensors = (
        np.array([getattr(one, name) for one in all_cars])
        for name in ("length", "loaded_mass", "wheel_radius", "speed_sensors")
    )
    front = np.append(0.0, np.cumsum(length)[:-1])
    cars = CAR.rows(
        mass.size,
        body=np.arange(mass.size) * coupled,
        mass=mass,
        middle=-(front + 0.5 * length),
        resistance=train.resistance[0] * (mass / train.mass),
        resistance_linear=train.resistance[1] * (mass / train.mass),
        resistance_quadratic=train.resistance[2] * length / train.length,
    )
    for row, coupler in zip(cars, train.couplers or (), strict=False):
        put(row, coupler)
    car = np.repeat(np.arange(mass.size), [len(one.axle_positions) for one in all_cars])
    axles = AXLE.rows(
        car.size,
        car=car,
        body=car * coupled,
        offset=-(front[car] + of_axles(lambda one: one.axle_positions)),
        radius=radius[car],
        inertia=of_axles(lambda one: [one.wheel_inertia] * len(one.axle_positions)),
        static_load=of_axles(lambda one: one.loaded_mass * GRAVITY * one.shares),
        unloading=of_axles(Car.unloading) * train.load_transfer,
        sensed=sensors[car],
    )
    first = np.searchsorted(car, np.arange(mass.size))
    placed = list(zip(all_cars, first, strict=True))
    parts = [(one, k + np.array(inside)) for one, k in placed for inside in one.units()]
    units, limits = UNIT.rows(len(parts)), np.zeros((2, len(parts), EFFORT_TABLE_LENGTH))
    for j, (one, inside) in enumerate(parts):
        motors: Any = one.motors
        axle_mass = one.mass / len(one.axle_positions)
        limits[:, j] = motors.limits(one.wheel_radius, sum(one.powered), axle_mass)
        greatest = limits[:, j].max()
        units[j].lag, units[j].slip_torque = motors.torque_lag, motors.slip_torque(greatest)
        units[j].axles = units[j].seen = inside.size
        units[j].first, units[j].last = inside[0], inside[-1] + 1
        units[j].gear, units[j].true_radius = motors.gear_ratio, one.wheel_radius
        axles.gear[inside], axles.unit[inside] = motors.gear_ratio, j
    groups: list[tuple[Any, int, NDArray[np.int64]]] = [
        (one, bogie, k + np.flatnonzero(np.equal(one.bogie_of_axle, bogie)))
        for one, k in placed
        for bogie in range(one.brake_groups)
    ]
    brakes = BRAKE.rows(len(groups))
    for g, (one, bogie, inside) in enumerate(groups):
        row, brake = brakes[g], one.air_brake
        row.unit, row.axles = axles.unit[inside].max(), inside.size
        row.fill_time, row.release_time = brake.lag, brake.release_lag or brake.lag
        row.dead_time = brake.dead_time + front[car[inside[0]]] / (brake.pipe_wave or np.inf)
        row.most_pressure, row.gain = brake.pressure, brake.force / brake.pressure
        row.friction_numerator, row.friction_offset, row.friction_constant = brake.friction
        works = brake.friction_factor * (bogie not in brake.cut_out)
        axles.brake[inside], axles.shoe_gain[inside] = g, row.gain * works
    return axles, cars, units, brakes, *limits
