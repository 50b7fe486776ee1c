"""The RTRI report's running tests of a freight train, made on the plant: locomotive and 5, locomotive and 17 wagons.

Cylinders fill in the order in which the brake pipe's wave reaches them (their dead time in the plant). Wagons differ in the
friction of their shoes, as the report says of its own (3.2.2); the measuring system, whose errors are drawn, does not know.
"""

import math
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.driving import Controls, TrainSense, drive
from alloc.estimation.brake_force import (
    BrakeRigging,
    SmoothedForces,
    braking_window,
    car_brake_forces,
    group_brake_force,
    smooth_brake_forces,
)
from alloc.plant.laws import hyperbolic_speed_law
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import AirBrake, Train
from studies.brake_force.beliefs import FrictionBelief, Misbelief
from studies.brake_force.measurement import (
    Measured,
    MeasuringSystem,
    disturb,
    record,
    true_brake_forces,
)

Floats = NDArray[np.float64]


def _brake_of_a_wagon() -> tuple[AirBrake, int]:
    """The brake of every wagon of the report's trains, and its axles; sources in the set's file."""
    wagon = find_set("freight-5").cars[-1]
    assert wagon.air_brake is not None
    return wagon.air_brake, len(wagon.axle_positions)


BRAKED_AT = 2.0
"""Time [s] of the driver's command; the report's time 0."""
SHOE_SCATTER = 0.05
"""Relative standard deviation of shoe friction between cars; assumed (the report speaks of scatter, without numbers)."""
DRY = 0.3
"""Coefficient of adhesion: dry rails, on which no wheel slides."""
LONGEST = 90.0
"""Time [s] after which a test ends at the latest."""
STOP_SPEED = 0.3
"""Speed [m/s] of the foremost car below which a test ends, the train being about to stand."""
SYSTEM = MeasuringSystem()
BRAKE, AXLES = _brake_of_a_wagon()
STEP, EMERGENCY = 350e3, BRAKE.maximum_pressure
"""Pressures of the cylinders in the third service step and in emergency [Pa]. Assumed."""
CYLINDERS, PISTON_AREA, EFFICIENCY = 2, math.pi / 4.0 * 0.254**2, 0.9
"""Of a wagon's rigging: a cylinder per bogie, since bogies are cut out one by one, of 10 inches, a usual size. Assumed."""
STANDSTILL_FRICTION = 0.25
"""Of the shoes at standstill. Assumed."""
LEVER_RATIO = (
    AXLES * BRAKE.force_per_pascal / (CYLINDERS * EFFICIENCY * PISTON_AREA * STANDSTILL_FRICTION)
)
"""4.9; it follows from the brake force."""
RIGGING = BrakeRigging(CYLINDERS, LEVER_RATIO, EFFICIENCY, PISTON_AREA)


@dataclass(frozen=True)
class BrakeTest:
    """A running test. `cars_braked`: wagons whose brakes work, in wagons; a half is a bogie of every wagon cut out."""

    title: str
    wagons: int
    speed: float
    """[km/h]"""
    pressure: float
    """Of the cylinders [Pa]."""
    locomotive_only: bool = False
    cars_braked: float | None = None
    """None: all."""


TESTS: dict[str, BrakeTest] = {
    "locomotive": BrakeTest("only the locomotive braked", 5, 25.0, STEP, locomotive_only=True),
    "all": BrakeTest("locomotive and wagons braked", 5, 25.0, STEP),
    "4 wagons": BrakeTest("one wagon cut out", 5, 25.0, STEP, cars_braked=4.0),
    "3 wagons": BrakeTest("two wagons cut out", 5, 25.0, STEP, cars_braked=3.0),
    "2.5 wagons": BrakeTest("one bogie of every wagon cut out", 5, 25.0, STEP, cars_braked=2.5),
    "emergency": BrakeTest("emergency brake of 18 cars", 17, 75.0, EMERGENCY),
}
"""Tests of the report: 3.2.1, 3.2.2, 3.2.3 (Table 2; "all" is its first line) and 3.3."""


def train_of_test(test: BrakeTest, seed: int) -> Train:
    """The train of a test on the day `seed`: shoe friction of each car, and which wagons are cut out, are drawn.

    The same day has the same wagons in every test of the same length.
    """
    draw = np.random.default_rng([seed, 40])
    train = find_set(f"freight-{test.wagons}")
    scatter = 1.0 + SHOE_SCATTER * draw.standard_normal(len(train.cars))
    order = 1 + draw.permutation(test.wagons)
    braked = test.wagons if test.cars_braked is None else test.cars_braked
    cars = []
    for k, (car, factor) in enumerate(zip(train.cars, scatter, strict=True)):
        assert car.air_brake is not None
        cut: tuple[int, ...] = ()
        if k > 0 and braked % 1.0:
            cut = (0,)
        elif k in order[: test.wagons - int(braked)]:
            cut = (0, 1)
        gain = car.air_brake.force_per_pascal * factor
        brake = replace(car.air_brake, force_per_pascal=gain, cut_out=cut)
        cars.append(replace(car, air_brake=brake))
    return replace(train, cars=tuple(cars))


class TestResult(NamedTuple):
    """A test as it was measured, and what was truly so, at the same instants."""

    test: BrakeTest
    train: Train
    measured: Measured
    true_force: Floats
    """Of the brakes of each car [N], (time, cars)."""
    window: slice
    """The report's: 63.2 % of the steady pressure to standstill."""
    friction: FrictionBelief = FrictionBelief()
    """What theory believes of the shoes' friction."""

    def believed(self, belief: Misbelief, seed: int) -> "TestResult":
        """The same stop as an estimator sees it that has something wrong; `seed` draws its pressure sensors."""
        measured = belief.applied(self.measured, seed)
        window = _window(self.test, measured)
        return self._replace(measured=measured, window=window, friction=belief.friction)


def run_test(name: str, seed: int, grade: float = 0.0) -> TestResult:
    """Make a test on the plant, at a `grade` (rise per run), and measure it; `seed` draws wagons and sensor errors."""
    test = TESTS[name]
    train = train_of_test(test, seed)
    run = drive_test(test, train, grade)
    measured = disturb(record(run, train, SYSTEM), train, SYSTEM, seed)
    true = SYSTEM.sampled(run, true_brake_forces(run, train))
    return TestResult(test, train, measured, true, _window(test, measured))


def _window(test: BrakeTest, measured: Measured) -> slice:
    # the wagons' pressure, measured on the first; where they are not braked the locomotive's
    pressure = measured.pressure[:, 0 if test.locomotive_only else 1]
    return braking_window(pressure, measured.speed)


def drive_test(test: BrakeTest, train: Train, grade: float = 0.0) -> xr.Dataset:
    """The recorded run of a test; the plant's cylinders know when the brake pipe's wave reaches them."""
    pressure = np.array(
        [
            0.0 if test.locomotive_only and k > 0 else test.pressure
            for k, car in enumerate(train.cars)
            for _ in range(car.bogie_of_axle[-1] + 1)
        ]
    )

    def driver(sense: TrainSense, controls: Controls) -> bool:
        controls.pressure[:] = pressure if sense.time >= BRAKED_AT - 1e-9 else 0.0
        return sense.speed > STOP_SPEED

    length = sum(car.length for car in train.cars)
    line = Line(grades=(grade,))
    model = build(train, Rail(DRY), line, span=(0.0, length + LONGEST * test.speed / 3.6))
    return drive(model, driver, LONGEST, test.title, test.speed / 3.6, length, 0.01)


class Estimates(NamedTuple):
    """Brake forces [N] after the report, all (time,)."""

    locomotive: Floats
    """(3), from its own acceleration."""
    wagons: Floats
    """(5): sum of all wagons, their acceleration being that of the first."""
    wagon: Floats
    """(9): the first wagon alone."""
    wagons_own: Floats
    """Sum of (4) over the wagons, each with its own acceleration: the report's remedy."""
    theory: Floats
    """(7): one wagon, from the pressure measured on the first."""


def estimate(result: TestResult) -> Estimates:
    """What the report computes of what was measured; forces are those at the brakes, running resistance subtracted."""
    m = result.measured
    a, couplers, drag = m.acceleration, m.coupler_force, m.resistance
    own = car_brake_forces(a, couplers, m.mass, drag)
    fall = 1.0 - hyperbolic_speed_law(m.speed, *BRAKE.friction)
    friction = STANDSTILL_FRICTION * result.friction.level * (1.0 - result.friction.fall * fall)
    return Estimates(
        locomotive=group_brake_force(a[:, 0], m.mass[0], None, couplers[:, 0], drag[:, 0]),
        wagons=group_brake_force(
            a[:, 1], m.mass[1:].sum(), couplers[:, 0], None, drag[:, 1:].sum(axis=1)
        ),
        wagon=group_brake_force(a[:, 1], m.mass[1], couplers[:, 0], couplers[:, 1], drag[:, 1]),
        wagons_own=own[:, 1:].sum(axis=1),
        theory=RIGGING.force(m.pressure[:, 1], friction),
    )


def smooth(result: TestResult) -> SmoothedForces:
    """Brake force of every car from its own acceleration, smoothed."""
    m = result.measured
    return smooth_brake_forces(
        m.acceleration, m.coupler_force, m.mass, SYSTEM.period, SYSTEM.acceleration_noise,
        SYSTEM.coupler_noise, resistance=m.resistance,
    )  # fmt: skip
