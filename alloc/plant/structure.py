"""From a train to the arrays that the plant computes with."""

from dataclasses import astuple
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.plant.train import Car, Train

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


class Structure(NamedTuple):
    """What belongs to the train alone. Axles, cars, bodies, units and brake groups count from the front."""

    axle_body: Ints  # (axles,) the body (car, or the whole rigid train) an axle pushes
    axle_car: Ints
    axle_unit: Ints  # -1: no motor
    axle_group: Ints  # -1: no air brake
    axle_offset: Floats  # position relative to the train's front [m], <= 0
    radius: Floats
    inertia: Floats
    gear: Floats  # motor torque times gear is wheel torque; 0: no motor
    static_load: Floats  # [N]
    unloading: Floats
    car_body: Ints
    car_offset: Floats  # middle of the car relative to the train's front [m]
    car_mass: Floats
    car_resistance: Floats  # (cars, 3)
    body_mass: Floats
    coupler: Floats  # (bodies - 1, 4): stiffness, stiffening, damping, slack
    unit_axles: Floats  # number of axles of each unit
    unit_lag: Floats
    unit_gear: Floats
    drive_table: Floats  # (units, EFFORT_TABLE_LENGTH) torque per motor [N m]
    brake_table: Floats
    group_fill: Floats
    group_release: Floats
    shoe_gain: Floats  # (axles,) force at the rim per pascal
    shoe_friction: Floats  # (axles, 3)


class Layout(NamedTuple):
    """Sizes of a train, and with them the rows of the state array (rows,)."""

    bodies: int
    axles: int
    cars: int
    units: int
    groups: int

    @property
    def position(self) -> slice:
        """Position of the train's front, as each body implies it [m]."""
        return slice(0, self.bodies)

    @property
    def speed(self) -> slice:
        """Speed of each body [m/s]."""
        return slice(self.bodies, 2 * self.bodies)

    @property
    def omega(self) -> slice:
        """Angular speed of each wheelset [rad/s]."""
        start = 2 * self.bodies
        return slice(start, start + self.axles)

    @property
    def torque(self) -> slice:
        """Motor torque of each unit's motors [N m], at the shaft, per motor."""
        start = self.omega.stop
        return slice(start, start + self.units)

    @property
    def pressure(self) -> slice:
        """Brake cylinder pressure of each group [Pa]."""
        start = self.torque.stop
        return slice(start, start + self.groups)

    @property
    def friction_work(self) -> slice:
        """Work dissipated between wheel and rail by each axle [J]: JP4209318 (28), for driving too.

        At standstill it contains what the contact stores, a few joules.
        """
        start = self.pressure.stop
        return slice(start, start + self.axles)

    @property
    def work(self) -> slice:
        """Works [J]: of the motors, lost in the shoes, against resistance and gradient, lost in couplers."""
        start = self.friction_work.stop
        return slice(start, start + 4)

    @property
    def deflection(self) -> slice:
        """Deflection of each axle's contact [m] near standstill, see `alloc.plant.static_adhesion`."""
        start = self.work.stop
        return slice(start, start + self.axles)

    @property
    def rows(self) -> int:
        """Number of rows."""
        return self.deflection.stop


class _Axle(NamedTuple):
    """An axle's part of `Structure`."""

    car: int
    unit: int
    group: int
    offset: float
    gear: float
    shoe_gain: float
    shoe_friction: tuple[float, float, float]


def _axles(car: Car, number: int, front: float, unit: int, group: int) -> list[_Axle]:
    """Axles of `car`, whose front is `front` [m] behind the train's; its first traction unit and brake group are given."""
    brake, motors = car.air_brake, car.motors
    unit_of_axle = {i: unit + j for j, members in enumerate(car.units()) for i in members}
    axles = []
    for i, (position, bogie) in enumerate(zip(car.axle_positions, car.bogie_of_axle, strict=True)):
        works = brake is not None and bogie not in brake.cut_out
        axles.append(
            _Axle(
                number,
                unit_of_axle.get(i, -1),
                -1 if brake is None else group + bogie,
                -(front + position),
                motors.gear_ratio if motors is not None and i in unit_of_axle else 0.0,
                brake.force_per_pascal if brake is not None and works else 0.0,
                (0.0, 1.0, 0.0) if brake is None else brake.friction,
            )
        )
    return axles


def structure_of(train: Train) -> tuple[Structure, Layout]:
    """Arrays of the train, and the rows of its state."""
    cars, brakes, rigid = train.cars, train.brake_groups, train.couplers is None
    axles: list[_Axle] = []
    units = [(car, len(members)) for car in cars for members in car.units()]
    front, unit, group = 0.0, 0, 0
    for c, car in enumerate(cars):
        axles += _axles(car, c, front, unit, group)
        front, unit, group = front + car.length, unit + len(car.units()), group + car.brake_groups
    motors = [(car.motors, car.wheel_radius) for car, _ in units if car.motors is not None]
    drive = [motor.drive.tabulate(radius, motor.gear_ratio) for motor, radius in motors]
    brake = [motor.brake.tabulate(radius, motor.gear_ratio) for motor, radius in motors]
    columns = zip(_Axle._fields, zip(*axles, strict=True), strict=True)
    axle = {name: np.array(values) for name, values in columns}
    mass = np.array([car.mass for car in cars])
    length = np.array([car.length for car in cars])
    a, b, quadratic = train.resistance
    car_body = np.zeros(len(cars), dtype=np.int64) if rigid else np.arange(len(cars))
    structure = Structure(
        axle_body=car_body[axle["car"]],
        axle_car=axle["car"],
        axle_unit=axle["unit"],
        axle_group=axle["group"],
        axle_offset=axle["offset"],
        radius=np.concatenate([np.full(len(car.axle_positions), car.wheel_radius) for car in cars]),
        inertia=np.concatenate([np.array(car.wheel_inertia, dtype=float) for car in cars]),
        gear=axle["gear"],
        static_load=np.concatenate([car.static_axle_loads for car in cars]),
        unloading=np.concatenate([car.unloading_factors() for car in cars])
        * float(train.load_transfer),
        car_body=car_body,
        car_offset=-(np.cumsum(length) - 0.5 * length),
        car_mass=mass,
        car_resistance=np.stack(
            [a * mass / mass.sum(), b * mass / mass.sum(), quadratic * length / length.sum()],
            axis=1,
        ),
        body_mass=np.array([mass.sum()]) if rigid else mass,
        coupler=np.array([astuple(coupler) for coupler in train.couplers or ()]).reshape(-1, 4),
        unit_axles=np.array([float(count) for _, count in units]),
        unit_lag=np.array([motor.torque_lag for motor, _ in motors]),
        unit_gear=np.array([motor.gear_ratio for motor, _ in motors]),
        drive_table=np.stack(drive) if drive else np.zeros((0, 0)),
        brake_table=np.stack(brake) if brake else np.zeros((0, 0)),
        group_fill=np.array([one.fill_time for one in brakes]),
        group_release=np.array([one.release_time for one in brakes]),
        shoe_gain=axle["shoe_gain"],
        shoe_friction=axle["shoe_friction"],
    )
    sizes = (structure.body_mass.size, len(axles), len(cars), len(units), len(brakes))
    return structure, Layout(*sizes)
