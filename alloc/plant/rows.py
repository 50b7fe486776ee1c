"""Rows of a train as it is: wheelsets, cars, motors, cylinders; and the adhesion that a rail offers it. SI units."""

from collections.abc import Callable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.laws import GRAVITY
from alloc.plant.columns import CAR, CYLINDER, DRIVE, WHEELSET
from alloc.plant.train import EFFORT_TABLE_LENGTH, Car, Train
from alloc.schema.tables import Rows, put_fields

Floats = NDArray[np.float64]


class PlantRows(NamedTuple):
    """A train as rows, and tables of its motors."""

    wheelsets: Rows
    cars: Rows
    drives: Rows
    cylinders: Rows
    effort: Floats
    """Largest pulling torque of each motor [N m] every `EFFORT_SPEED_STEP`, (units, EFFORT_TABLE_LENGTH)."""
    retard: Floats
    """Largest braking torque of each motor."""


@lru_cache(maxsize=64)
def rows_of_train(train: Train) -> PlantRows:
    """Rows of a train, to be read or copied: `rows_of(train).wheelsets.unit`."""
    all_cars, coupled = train.cars, train.couplers is not None

    def of_axles(part: Callable[[Car], ArrayLike]) -> NDArray[Any]:
        return np.concatenate([np.asarray(part(vehicle)) for vehicle in all_cars])

    length, mass, radius, sensors = (
        np.array([getattr(vehicle, name) for vehicle in all_cars])
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
        put_fields(row, coupler)
    car = np.repeat(np.arange(mass.size), [len(vehicle.axle_positions) for vehicle in all_cars])
    wheelsets = WHEELSET.rows(
        car.size,
        car=car,
        body=car * coupled,
        offset=-(front[car] + of_axles(lambda vehicle: vehicle.axle_positions)),
        radius=radius[car],
        inertia=of_axles(lambda vehicle: [vehicle.wheel_inertia] * len(vehicle.axle_positions)),
        static_load=of_axles(lambda vehicle: vehicle.loaded_mass * GRAVITY * vehicle.shares),
        unloading=of_axles(Car.unloading) * train.load_transfer,
        sensed=sensors[car],
    )
    first = np.searchsorted(car, np.arange(mass.size))
    placed = list(zip(all_cars, first, strict=True))
    parts = [(vehicle, k + np.array(inside)) for vehicle, k in placed for inside in vehicle.units()]
    drives, limits = DRIVE.rows(len(parts)), np.zeros((2, len(parts), EFFORT_TABLE_LENGTH))
    for j, (vehicle, inside) in enumerate(parts):
        motors: Any = vehicle.motors
        axle_mass = vehicle.mass / len(vehicle.axle_positions)
        limits[:, j] = motors.limits(vehicle.wheel_radius, sum(vehicle.powered), axle_mass)
        greatest = limits[:, j].max()
        drives[j].lag, drives[j].slip_torque = motors.torque_lag, motors.slip_torque(greatest)
        drives[j].axles, drives[j].gear = inside.size, motors.gear_ratio
        drives[j].radius, drives[j].inertia = vehicle.wheel_radius, wheelsets.inertia[inside].mean()
        wheelsets.gear[inside], wheelsets.unit[inside] = motors.gear_ratio, j
    groups: list[tuple[Any, int, NDArray[np.int64]]] = [
        (vehicle, bogie, k + np.flatnonzero(np.equal(vehicle.bogie_of_axle, bogie)))
        for vehicle, k in placed
        for bogie in range(vehicle.brake_groups)
    ]
    cylinders = CYLINDER.rows(len(groups))
    for g, (vehicle, bogie, inside) in enumerate(groups):
        row, brake = cylinders[g], vehicle.air_brake
        row.fill_time, row.release_time = brake.lag, brake.release_lag or brake.lag
        row.dead_time = brake.dead_time + front[car[inside[0]]] / (brake.pipe_wave or np.inf)
        row.most_pressure, row.gain = brake.pressure, brake.force / brake.pressure
        row.friction_numerator, row.friction_offset, row.friction_constant = brake.friction
        works = brake.friction_factor * (bogie not in brake.cut_out)
        wheelsets.brake[inside], wheelsets.shoe_gain[inside] = g, row.gain * works
    rows = PlantRows(wheelsets, cars, drives, cylinders, *limits)
    for table in rows:
        table.flags.writeable = False
    return rows


def planned_coefficients(
    wheelsets: Rows,
    inertia: Floats,
    load: Floats,
    mass: float,
    inertia_in_limit: bool,
    blended: int,
) -> dict[str, float]:
    """Coefficients that each m/s2 of a train of `mass` [kg] needs of axles that pull and that brake; `inertia` [kg m2]
    and `load` [N], (axles,).

    The rail carries what accelerates the train and turns the wheelsets that do not act. What turns those that do comes from
    their own motors or shoes, on top of a limit.
    """
    turning, driven = inertia / wheelsets.radius**2, wheelsets.unit >= 0
    braked = driven | (wheelsets.brake >= 0) if blended else driven
    coefficients = {}
    for name, acting in (("planned", driven), ("brake_planned", braked)):
        resisting = turning[~acting] if inertia_in_limit else turning
        coefficients[name] = (mass + resisting.sum()) / load[acting].sum() if acting.any() else 0.0
    return coefficients


def offered_by(curve: Any, level: float, speed: float, train: Train) -> float:
    """Adhesion that a rail of `level` and `curve` offers to a train at `speed` [m/s].

    It is the largest force of all axles over their weight: the curve's maximum, averaged with the static axle loads as
    weights. Heavy axles have the softer contacts.
    """
    wheelsets = rows_of_train(train).wheelsets
    contact = curve.contact(0.5 * wheelsets.static_load, wheelsets.radius)
    most = curve.top(speed, level, contact)[0]
    return float(
        np.broadcast_to(most, contact.shape) @ wheelsets.static_load / wheelsets.static_load.sum()
    )


def level_for(curve: Any, adhesion: float, speed: float, train: Train) -> float:
    """Level of a rail whose `curve` offers `adhesion` to `train` at `speed` [m/s]: the inverse of `offered_by`."""
    level = adhesion
    for _ in range(20):  # the maximum of Polach's curve grows a little less than in proportion
        before, level = level, level * adhesion / offered_by(curve, level, speed, train)
        if level == before:
            break
    return level
