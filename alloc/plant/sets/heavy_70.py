"""Heavy train of 70 equal vehicles with friction draft gears: a published yardstick of forces in couplers."""

from alloc.plant.laws import GRAVITY
from alloc.plant.sets import SETS
from alloc.plant.train import AirBrake, Car, DraftGear, Motors, TorqueLimit, Train

SOURCES = {
    "formation": "published simulation: 70 vehicles of 85 t, up to 600 kN of traction at the foremost; no locomotive of "
    "85 t brings that to a real rail: it takes a level of 0.8 or more",
    "coupler": "published set of a friction draft gear (c1 2.57e7, c2 2.85e6, ck 2.5e8, T0 240 kN, t0 50 kN, lambda 0.09 m, "
    "delta 0.05 m), read as `alloc.plant.train.DraftGear` says; viscosity and damping assumed",
    "vehicle": "assumed: four-axle wagon of 13.9 m, bogie centres 8.65 m, wheelbase 1.85 m, wheels of 0.957 m, 22 t empty",
    "motors": "assumed: gear ratio and lag of a freight locomotive; power enough for 600 kN up to 120 km/h",
    "wheel_inertia": "assumed: 100 kg m2 per wheelset, of all vehicles, so that couplers share the force as masses do",
    "brake": "assumed: 10 % of the weight at 500 kPa, 3 s to fill, 6 s to release; the pipe's wave runs at 250 m/s",
    "resistance": "assumed: 2.0 kgf/t + 0.0006 V^2 kgf/t, V in km/h, of the order of published freight formulas",
    "planned_acceleration": "assumed: of 150 kN, a coefficient of 0.18 of the foremost vehicle's axles",
}

VEHICLES = 70
MASS = (22e3, 63e3)  # empty, load
LENGTH = 13.9
RADIUS = 0.4785
TRACTION = 600e3
GEAR_RATIO = 4.96
POWER = 5e6  # per motor
PRESSURE = 500e3


def _vehicle(number: int) -> Car:
    driven = number == 1
    torque = TRACTION / 4.0 * RADIUS / GEAR_RATIO
    motors = Motors("1C4M", GEAR_RATIO, TorqueLimit(torque, POWER), TorqueLimit(torque, POWER))
    return Car(
        name="locomotive" if driven else f"wagon {number - 1}",
        length=LENGTH,
        empty_mass=sum(MASS) if driven else MASS[0],
        load=0.0 if driven else MASS[1],
        axle_positions=(1.7, 3.55, 10.35, 12.2),
        bogie_of_axle=(0, 0, 1, 1),
        wheel_radius=RADIUS,
        wheel_inertia=(100.0,) * 4,
        driven=(driven,) * 4,
        motors=motors if driven else None,
        air_brake=AirBrake(
            PRESSURE,
            0.1 * sum(MASS) * GRAVITY / 4.0 / PRESSURE,
            fill_time=3.0,
            release_time=6.0,
            dead_time=0.3 + LENGTH * (number - 1) / 250.0,
        ),
    )


def train() -> Train:
    """The yardstick's train."""
    cars = tuple(_vehicle(number) for number in range(1, VEHICLES + 1))
    tonnes = VEHICLES * sum(MASS) / 1e3
    bare = Train(name="heavy-70", cars=cars)
    return Train(
        name=bare.name,
        cars=cars,
        resistance=(2.0 * GRAVITY * tonnes, 0.0, 0.0006 * 3.6**2 * GRAVITY * tonnes),
        couplers=(DraftGear(),) * (VEHICLES - 1),
        planned_acceleration=150e3 / (bare.mass + bare.rotating_mass),
        source="published simulation of coupler forces; composed, see sources",
        sources=SOURCES,
    )


SETS.register("heavy-70", train)
