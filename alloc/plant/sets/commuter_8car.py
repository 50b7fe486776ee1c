"""Eight-car commuter electric multiple unit, four motor cars and four trailers, with trailers at both ends."""

from alloc.plant.laws import GRAVITY
from alloc.plant.sets import SETS
from alloc.plant.train import AirBrake, Car, Motors, TorqueLimit, Train

FORMATION = "TMMTTMMT"
"""T trailer, M motor car, from the front. Both lead cars are trailers, so the foremost traction unit is car 2."""

SOURCES = {
    "group": "four motors per inverter (1C4M), as JP5484215's embodiment 1",
    "gear_ratio": "7.07: readhesion paper, Table 1; also JR East series E231",
    "wheel_radius": "0.43 m: readhesion paper, Table 1",
    "wheel_inertia": "motor car 155.01 kg m2: readhesion paper, Table 1; trailer 65 kg m2 assumed: a bare "
    "wheelset of 0.86 m wheels with disc brakes",
    "torque_lag": "5 ms: readhesion paper, section 2.2",
    "planned_acceleration": "3.0 km/h/s: readhesion paper, Table 2",
    "resistance": "JR's electric multiple units: 1.32 + 0.0164 V + (0.028 + 0.0078 n) V^2 / W in kgf/t, V in km/h",
    "empty_mass": "assumed: 32 t motor car, 27 t trailer, of the class of JR East series E231 and E233",
    "formation": "assumed: T-M-M-T-T-M-M-T, trailers in front as in four-motor-car sets of this length",
    "axle_positions": "20 m car, bogie centres 13.8 m, wheelbase 2.1 m: usual for Japanese commuter cars",
    "drive": "assumed: 1150 N m hold 3.0 km/h/s with 12 t of passengers in each car, 160 kW per motor up to "
    "the end of that range near 33 km/h",
    "brake": "assumed: electric brake of the driven cars for 3.0 km/h/s loaded, fading below 5 km/h",
    "air_brake": "assumed: 4.5 km/h/s (JR East's emergency deceleration) of the empty car at 400 kPa, quick "
    "electropneumatic cylinders, composition shoes taken as constant over speed",
}

MOTOR_CAR_MASS, TRAILER_MASS = 32e3, 27e3
BRAKE_PRESSURE = 400e3
EMERGENCY_DECELERATION = 4.5 / 3.6
POSITIONS = (2.05, 4.15, 15.85, 17.95)


def _resistance(mass: float, cars: int) -> tuple[float, float, float]:
    """A, B, C in SI of the formula in `SOURCES`; `mass` in kg."""
    tonnes = mass / 1e3
    return (
        1.32 * GRAVITY * tonnes,
        0.0164 * GRAVITY * tonnes * 3.6,
        (0.028 + 0.0078 * cars) * GRAVITY * 3.6**2,
    )


def _car(name: str, driven: bool) -> Car:
    mass = MOTOR_CAR_MASS if driven else TRAILER_MASS
    motors = Motors(
        group="1C4M",
        gear_ratio=7.07,
        drive=TorqueLimit(peak=1150.0, power=160e3, pull_out_speed=80.0 / 3.6),
        brake=TorqueLimit(peak=1150.0, power=250e3, fade_speed=5.0 / 3.6),
        torque_lag=5e-3,
    )
    return Car(
        name=name,
        length=20.0,
        empty_mass=mass,
        load=0.0,
        axle_positions=POSITIONS,
        bogie_of_axle=(0, 0, 1, 1),
        wheel_radius=0.43,
        wheel_inertia=((155.01 if driven else 65.0),) * 4,
        driven=(driven,) * 4,
        motors=motors if driven else None,
        air_brake=AirBrake(
            maximum_pressure=BRAKE_PRESSURE,
            force_per_pascal=EMERGENCY_DECELERATION * mass / 4 / BRAKE_PRESSURE,
            fill_time=0.4,
            release_time=0.4,
            dead_time=0.1,
        ),
    )


def train() -> Train:
    """The train, empty; loads come with `Train.loaded`."""
    cars = tuple(
        _car(f"car {k} ({'motor' if kind == 'M' else 'trailer'})", kind == "M")
        for k, kind in enumerate(FORMATION, start=1)
    )
    mass = sum(car.mass for car in cars)
    return Train(
        name="commuter-8car",
        cars=cars,
        resistance=_resistance(mass, len(cars)),
        planned_acceleration=3.0 / 3.6,
        source="composed; see sources",
        sources=SOURCES,
    )


SETS.register("commuter-8car", train)
