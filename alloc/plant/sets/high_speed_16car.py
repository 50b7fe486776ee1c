"""Sixteen-car high-speed electric multiple unit, fourteen motor cars between two lead trailers."""

import numpy as np

from alloc.plant.laws import GRAVITY, hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS, Rail, logarithmic_increments
from alloc.plant.sets import SETS
from alloc.plant.train import (
    EFFORT_SPEED_STEP,
    EFFORT_TABLE_LENGTH,
    AirBrake,
    Car,
    Motors,
    TorqueLimit,
    Train,
)

FORMATION = "T" + 14 * "M" + "T"
"""T trailer, M motor car, from the front."""

SOURCES = {
    "formation": "14 motor cars, 2 trailers, 64 axles: series N700 (published data)",
    "group": "four motors per inverter (1C4M): JP5484215, embodiment 1",
    "length": "25 m: series N700 (published data)",
    "empty_mass": "series N700 (published data): about 700 t; 44 t a motor car and 42 t a lead trailer assumed",
    "power": "305 kW per motor: series N700 (published data)",
    "planned_acceleration": "2.6 km/h/s: series N700 (published data)",
    "drive": "least of the torque for 2.6 km/h/s with 10 % in hand, of planned adhesion 13.6/(V+85) "
    "(JP5484215 (12)) and of the power",
    "brake": "least of planned adhesion 13.6/(V+85) (JP5484215 (12)) and of 1.5 times the power; fading below 10 km/h "
    "assumed",
    "resistance": "Shinkansen series 100: g (1.273 + 0.001 V + 0.0001381 V^2) N/t, V in km/h (published data)",
    "gear_ratio": "assumed 2.79, of the class of series 700 and N700",
    "wheel_radius": "0.43 m: as in the other sets, Japan's 860 mm wheels",
    "wheel_inertia": "assumed: motor car 155 kg m2 (readhesion paper, Table 1), trailer 70 kg m2 with wheel discs",
    "torque_lag": "5 ms: readhesion paper, section 2.2",
    "axle_positions": "bogie centres 17.5 m, wheelbase 2.5 m: usual for Shinkansen cars",
    "air_brake": "assumed: disc brakes able to use planned adhesion at 100 km/h, 0.6 MPa, quick cylinders",
    "rail": "JP5484215 (12), (15): 13.6/(V+85), growth 0.0083 ln j - 0.0066, standard deviation 0.012",
}

MOTOR_CAR_MASS, TRAILER_MASS = 44e3, 42e3
PLANNED_ACCELERATION = 2.6 / 3.6
WHEEL_RADIUS, GEAR_RATIO = 0.43, 2.79
MOTOR_INERTIA, TRAILER_INERTIA = 155.0, 70.0
MOTOR_POWER = 305e3
BRAKE_PRESSURE = 600e3


def _motor_torque(rim_force: float) -> float:
    """Motor torque [N m] that puts this force [N] on the rim of one axle."""
    return rim_force * WHEEL_RADIUS / GEAR_RATIO


def _effort(peak: float, power: float, fade_speed: float) -> tuple[float, ...]:
    """Torque per motor [N m] every km/h: `peak` [N m], planned adhesion, `power` [W], fading at standstill."""
    speed = EFFORT_SPEED_STEP * np.arange(EFFORT_TABLE_LENGTH)
    coefficient = hyperbolic_speed_law(speed, *SPEED_LAWS["shinkansen"])
    adhesion = _motor_torque(1.0) * coefficient * MOTOR_CAR_MASS / 4 * GRAVITY
    limit = np.minimum(
        np.minimum(peak, adhesion), _motor_torque(1.0) * power / np.maximum(speed, 0.1)
    )
    if fade_speed > 0.0:
        limit = limit * np.minimum(1.0, speed / fade_speed)
    return tuple(float(value) for value in limit)


def _car(name: str, driven: bool, motors: Motors) -> Car:
    mass = MOTOR_CAR_MASS if driven else TRAILER_MASS
    planned = hyperbolic_speed_law(100.0 / 3.6, *SPEED_LAWS["shinkansen"])
    return Car(
        name=name,
        length=25.0,
        empty_mass=mass,
        load=0.0,
        axle_positions=(2.5, 5.0, 20.0, 22.5),
        bogie_of_axle=(0, 0, 1, 1),
        wheel_radius=WHEEL_RADIUS,
        wheel_inertia=((MOTOR_INERTIA if driven else TRAILER_INERTIA),) * 4,
        driven=(driven,) * 4,
        motors=motors if driven else None,
        air_brake=AirBrake(
            maximum_pressure=BRAKE_PRESSURE,
            force_per_pascal=float(planned) * mass / 4 * GRAVITY / BRAKE_PRESSURE,
            fill_time=0.3,
            release_time=0.3,
            dead_time=0.1,
        ),
    )


def train() -> Train:
    """The train, empty; loads come with `Train.loaded`."""
    driven = [kind == "M" for kind in FORMATION]
    motor_axles = 4 * sum(driven)
    mass = sum(MOTOR_CAR_MASS if d else TRAILER_MASS for d in driven)
    rotating = sum(4 * (MOTOR_INERTIA if d else TRAILER_INERTIA) for d in driven) / WHEEL_RADIUS**2
    peak = _motor_torque(1.1 * PLANNED_ACCELERATION * (mass + rotating) / motor_axles)
    motors = Motors(
        group="1C4M",
        gear_ratio=GEAR_RATIO,
        drive=TorqueLimit(peak, MOTOR_POWER, table=_effort(peak, MOTOR_POWER, 0.0)),
        brake=TorqueLimit(
            peak, 1.5 * MOTOR_POWER, table=_effort(2.0 * peak, 1.5 * MOTOR_POWER, 10.0 / 3.6)
        ),
        torque_lag=5e-3,
    )
    tonnes = mass / 1e3
    return Train(
        name="high-speed-16car",
        cars=tuple(
            _car(f"car {k} ({'motor' if d else 'trailer'})", d, motors)
            for k, d in enumerate(driven, start=1)
        ),
        resistance=(
            1.273 * GRAVITY * tonnes,
            0.001 * GRAVITY * tonnes * 3.6,
            0.0001381 * GRAVITY * tonnes * 3.6**2,
        ),
        planned_acceleration=PLANNED_ACCELERATION,
        source="composed; see sources",
        sources=SOURCES,
    )


def rail(seed: int = 0) -> Rail:
    """Wet rail at the planned level, growing along the train, with scatter drawn from `seed`."""
    axles = 4 * len(FORMATION)
    return Rail(
        level=1.0,
        speed_law="shinkansen",
        increments=tuple(logarithmic_increments(axles)),
        scatter=0.012,
        seed=seed,
    )


SETS.register("high-speed-16car", train)
