"""Two coupled four-car multiple units of Great Britain, as in the sander trials of RSSB T1107; braked by air alone."""

from dataclasses import replace

from alloc.plant.sets import SETS
from alloc.plant.train import AirBrake, Car, Sander, Train

SOURCES = {
    "formation": "RSSB T1107: two class 387 units of four cars (Rail Engineer, 12 Feb 2018; seen)",
    "length": "20.4 m: class 387 (encyclopaedia; seen)",
    "empty_mass": "43.4 t a car: 173.6 t of a four-car class 377, of the same family (seen); no load assumed",
    "axle_positions": "assumed: bogie centres 14.2 m, wheelbase 2.6 m",
    "wheel_radius": "assumed: 0.42 m, half worn",
    "wheel_inertia": "assumed: 80 kg m2, a wheelset with its discs, the motors of some counted in",
    "air_brake": "assumed: discs of constant friction, 1.2 m/s2 (12 %g) at 300 kPa, cylinders of 0.4 s, 0.1 s dead "
    "time; the electric brake is left out",
    "planned_acceleration": "0.9 m/s2: brake step 3 of T1107 (seen)",
    "resistance": "assumed: 5 kN + 150 N s/m v + 14 N s2/m2 v2 for eight cars",
    "sanders": "axle 3, fixed rate: the usual practice (Rail Engineer; seen). 2 kg/min per rail: "
    "assumed, as usual in Great Britain. Second sander of a unit at axle 7: assumed. Variable rate: more sand at higher "
    "speed (RSSB; seen); assumed: 4.5 g/m per rail, up to 6 kg/min (a later product gives 5: Railway Gazette, 16 Apr "
    "2024; seen)",
}

CARS_PER_UNIT = 4
CAR_MASS = 43.4e3
BRAKE_PRESSURE = 300e3
FULL_BRAKE = 1.2
"""Deceleration [m/s2] at full pressure."""
FIXED_RATE, GREATEST_RATE = 2.0 / 60.0, 6.0 / 60.0
"""Sand per rail [kg/s]: of a sander of fixed rate, and at most of one of variable rate."""
VARIABLE_AMOUNT = 4.5e-3
"""Sand per rail [kg/m] that a sander of variable rate keeps to as long as its rate allows."""


def fixed(axle: int) -> Sander:
    """A sander of fixed rate ahead of an axle of its car, 0 = foremost."""
    return Sander(axle, FIXED_RATE)


def variable(axle: int) -> Sander:
    """A sander of variable rate."""
    return Sander(axle, GREATEST_RATE, VARIABLE_AMOUNT)


def car(name: str = "car") -> Car:
    """A car without sanders."""
    return Car(
        name=name,
        length=20.4,
        empty_mass=CAR_MASS,
        load=0.0,
        axle_positions=(1.8, 4.4, 16.0, 18.6),
        bogie_of_axle=(0, 0, 1, 1),
        wheel_radius=0.42,
        wheel_inertia=(80.0,) * 4,
        driven=(False,) * 4,
        air_brake=AirBrake(
            maximum_pressure=BRAKE_PRESSURE,
            force_per_pascal=FULL_BRAKE * CAR_MASS / 4 / BRAKE_PRESSURE,
            fill_time=0.4,
            release_time=0.4,
            dead_time=0.1,
        ),
    )


def sanded(train: Train, sanders: dict[int, Sander]) -> Train:
    """The train with these sanders alone, each by the number of its axle in the train (0 = foremost) in place of its own."""
    cars, first = [], 0
    for one in train.cars:
        axles = range(first, first + len(one.axle_positions))
        own = tuple(replace(sanders[i], axle=i - first) for i in axles if i in sanders)
        cars.append(replace(one, sanders=own))
        first = axles.stop
    return replace(train, cars=tuple(cars))


def train(units: int = 2) -> Train:
    """A train of this many units; each has a sander of fixed rate at its third axle."""
    cars = CARS_PER_UNIT * units
    bare = Train(
        name=f"gb-unit-{cars}car",
        cars=tuple(car(f"car {k}") for k in range(1, cars + 1)),
        resistance=(625.0 * cars, 18.75 * cars, 1.75 * cars),
        planned_acceleration=0.9,
        source="composed; see sources",
        sources=SOURCES,
    )
    return sanded(bare, {16 * unit + 2: fixed(0) for unit in range(units)})


SETS.register("gb-unit-8car", train)
