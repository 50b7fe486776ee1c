"""From a train to the arrays that the plant computes with."""

from dataclasses import astuple
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.plant.train import Car, DraftGear, Train

Floats = NDArray[np.float64]
Ints = NDArray[np.int64]


NO_WEDGES = (0.0,) * 8
"""`DraftGear.wedges` of a coupler without friction."""


class Structure(NamedTuple):
    """What belongs to the train alone. Axles, cars, bodies, units and brake groups count from the front."""

    axle_body: Ints  # (axles,) the body (car, or the whole rigid train) an axle pushes
    axle_car: Ints
    axle_unit: Ints  # -1: no motor
    axle_group: Ints  # -1: no air brake
    axle_sander: Ints  # that lays sand ahead of it, -1: none
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
    draft_gear: Floats  # (bodies - 1, 8): `DraftGear.wedges`
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
    draft_gears: int
    """Couplers between the bodies where any of them has friction, else 0."""
    sanders: int

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
    def gear_travel(self) -> slice:
        """Travel of the wedges of each draft gear [m], positive in draft."""
        start = self.pressure.stop
        return slice(start, start + self.draft_gears)

    @property
    def friction_work(self) -> slice:
        """Work dissipated between wheel and rail by each axle [J]: JP4209318 (28), for driving too.

        At standstill it contains what the contact stores, a few joules.
        """
        start = self.gear_travel.stop
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
    sander: int
    offset: float
    gear: float
    shoe_gain: float
    shoe_friction: tuple[float, float, float]


def _axles(car: Car, number: int, front: float, unit: int, group: int, sander: int) -> list[_Axle]:
    """Axles of `car`, whose front is `front` [m] behind the train's; its first unit, brake group and sander are given."""
    brake, motors = car.air_brake, car.motors
    unit_of_axle = {i: unit + j for j, members in enumerate(car.units()) for i in members}
    sander_of_axle = {one.axle: sander + k for k, one in enumerate(car.sanders)}
    axles = []
    for i, (position, bogie) in enumerate(zip(car.axle_positions, car.bogie_of_axle, strict=True)):
        works = brake is not None and bogie not in brake.cut_out
        axles.append(
            _Axle(
                number,
                unit_of_axle.get(i, -1),
                -1 if brake is None else group + bogie,
                sander_of_axle.get(i, -1),
                -(front + position),
                motors.gear_ratio if motors is not None and i in unit_of_axle else 0.0,
                brake.force_per_pascal * brake.friction_factor if brake and works else 0.0,
                (0.0, 1.0, 0.0) if brake is None else brake.friction,
            )
        )
    return axles


def structure_of(train: Train) -> tuple[Structure, Layout]:
    """Arrays of the train, and the rows of its state."""
    cars, brakes, rigid = train.cars, train.brake_groups, train.couplers is None
    couplers = train.couplers or ()
    axles: list[_Axle] = []
    units = [(car, len(members)) for car in cars for members in car.units()]
    front, unit, group, sander = 0.0, 0, 0, 0
    for c, car in enumerate(cars):
        axles += _axles(car, c, front, unit, group, sander)
        front, unit, group = front + car.length, unit + len(car.units()), group + car.brake_groups
        sander += len(car.sanders)
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
        axle_sander=axle["sander"],
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
        coupler=np.array(
            [
                (0.0, 0.0, 0.0, one.slack) if isinstance(one, DraftGear) else astuple(one)
                for one in couplers
            ]
        ).reshape(-1, 4),
        draft_gear=np.array(
            [one.wedges() if isinstance(one, DraftGear) else NO_WEDGES for one in couplers]
        ).reshape(-1, len(NO_WEDGES)),
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
    rubs = any(isinstance(one, DraftGear) for one in couplers)
    return structure, Layout(*sizes, draft_gears=len(couplers) if rubs else 0, sanders=sander)
