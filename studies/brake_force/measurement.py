"""A measuring system on a running train: what the RTRI report's running tests record, with the errors of real sensors."""

import math
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from functools import lru_cache
from types import MappingProxyType
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray
from scipy.signal import butter, sosfilt, sosfilt_zi

from alloc.driving import Controls, TrainSense, drive
from alloc.estimation.brake_force import (
    BrakeRigging,
    CalibrationErrors,
    SmoothedForces,
    braking_window,
    car_brake_forces,
    group_brake_force,
    level_acceleration,
    rolling_mass,
    smooth_brake_forces,
)
from alloc.metrics.registry import record_period
from alloc.plant.laws import hyperbolic_speed_law, running_resistance
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import AirBrake, Train

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class MeasuringSystem:
    """Sampling and sensor errors; all assumed, of the order of good strain gauges and servo accelerometers.

    Noise is white, per sample, and drawn for every channel. `calibration`: errors that are constant over a run, drawn once
    per run and channel; offsets are those that remain after zeroing while the train coasts.
    """

    period: float = 0.02
    """Of the samples [s]."""
    cut_off: float = 15.0
    """Of the anti-aliasing filter [Hz], fourth order, alike on all channels so that they stay in step."""
    acceleration_noise: float = 0.02
    """[m/s2]"""
    coupler_noise: float = 1e3
    """[N]"""
    pressure_noise: float = 2e3
    """[Pa]"""
    speed_noise: float = 0.02
    """[m/s]"""
    calibration: CalibrationErrors = field(
        default_factory=lambda: CalibrationErrors(0.005, 300.0, 0.005, 0.005)
    )

    def every(self, run: xr.Dataset) -> int:
        """Recorded instants per sample."""
        return max(1, round(self.period / record_period(run)))

    def sampled(self, run: xr.Dataset, values: Floats) -> Floats:
        """`values` (time, channels) of a run after anti-aliasing filter and sampling, without sensor errors."""
        sections = butter(4, self.cut_off * 2.0 * record_period(run), output="sos")
        start = sosfilt_zi(sections)[..., None] * values[0]
        return np.asarray(sosfilt(sections, values, axis=0, zi=start)[0][:: self.every(run)])


class Measured(NamedTuple):
    """What was recorded of a run."""

    time: Floats
    """[s], (time,)"""
    speed: Floats
    """Of the foremost car [m/s], (time,)."""
    acceleration: Floats
    """Of each car [m/s2], (time, cars)."""
    coupler_force: Floats
    """[N], (time, cars - 1), tension positive."""
    pressure: Floats
    """Of the foremost cylinder of each car [Pa], (time, cars)."""
    bare_mass: Floats
    """As weighed [kg], (cars,)."""
    mass: Floats
    """With what the wheelsets add [kg], (cars,)."""
    resistance: Floats
    """Running resistance of each car by its formula [N], (time, cars)."""
    axle_speed: Floats
    """At the rims [m/s], (time, axles)."""


def turning_inertia(train: Train) -> tuple[Floats, Floats]:
    """Inertia [kg m2] of each car's wheelsets together, and its wheel radius [m]; two (cars,)."""
    return (
        np.array([sum(car.wheel_inertia) for car in train.cars]),
        np.array([car.wheel_radius for car in train.cars]),
    )


def record(run: xr.Dataset, train: Train, system: MeasuringSystem) -> Measured:
    """What `system` would record of a run of a train with couplers on level, dry track if its sensors had no errors."""
    group_car = [k for k, car in enumerate(train.cars) if car.air_brake is not None
                 for _ in range(car.bogie_of_axle[-1] + 1)]  # fmt: skip
    first_group = [group_car.index(k) for k in range(len(train.cars))]
    bare = np.array([car.mass for car in train.cars])
    speed = system.sampled(run, run["car_speed"].values[:, :1])[:, 0]
    return Measured(
        time=run["time"].values[:: system.every(run)],
        speed=speed,
        acceleration=system.sampled(run, run["car_acceleration"].values),
        coupler_force=system.sampled(run, run["coupler_force"].values),
        pressure=system.sampled(run, run["cylinder_pressure"].values[:, first_group]),
        bare_mass=bare,
        mass=rolling_mass(bare, *turning_inertia(train)),
        resistance=resistance_of_cars(train, speed),
        axle_speed=system.sampled(run, run["rim_speed"].values),
    )


def disturb(exact: Measured, train: Train, system: MeasuringSystem, seed: int) -> Measured:
    """The same with sensor errors drawn from `seed`."""
    draw = np.random.default_rng([seed, 41]).standard_normal
    errors = system.calibration
    a, force, pressure = exact.acceleration, exact.coupler_force, exact.pressure
    bare = exact.bare_mass * (1.0 + errors.mass * draw(exact.bare_mass.size))
    offsets = errors.acceleration_offset * draw(a.shape[1])
    gains = 1.0 + errors.coupler_gain * draw(force.shape[1])
    zeros = errors.coupler_offset * draw(force.shape[1])
    # noise after what is constant: that must not depend on how long the run is
    speed = np.abs(exact.speed + system.speed_noise * draw(exact.speed.shape))
    return Measured(
        time=exact.time,
        speed=speed,
        acceleration=a + offsets + system.acceleration_noise * draw(a.shape),
        coupler_force=gains * force + zeros + system.coupler_noise * draw(force.shape),
        pressure=pressure + system.pressure_noise * draw(pressure.shape),
        bare_mass=bare,
        mass=rolling_mass(bare, *turning_inertia(train)),
        resistance=resistance_of_cars(train, speed),
        axle_speed=exact.axle_speed + system.speed_noise * draw(exact.axle_speed.shape),
    )


def resistance_of_cars(train: Train, speed: Floats) -> Floats:
    """Running resistance [N] of each car at `speed` (time,) [m/s], (time, cars), by the train's formula."""
    return np.stack(
        [running_resistance(speed, a, b, c, 1.0) for a, b, c in _resistance(train)], axis=1
    )


@lru_cache(maxsize=8)
def _resistance(train: Train) -> Floats:
    """A, B, C of each car, (cars, 3), as the plant shares them."""
    return build(train, Rail(0.3)).structure.car_resistance


def rail_brake_forces(run: xr.Dataset) -> Floats:
    """True brake force [N] of each car at the rails, (time, cars)."""
    of_car = run["axle_car"].values[None, :] == np.arange(run.sizes["car"])[:, None]
    return np.asarray(-run["rail_force"].values @ of_car.T)


def true_brake_forces(run: xr.Dataset, train: Train) -> Floats:
    """True force [N] of the brakes of each car, as a force at the rims of wheels that roll, (time, cars)."""
    inertia, radius = turning_inertia(train)
    return rail_brake_forces(run) - inertia / radius**2 * run["car_acceleration"].values


# Possible errors of the estimator: its friction law, resistance, gradient and pressure sensors, apart from the plant.
#
# Plant and estimator share their formulas, and the locomotive's 60 kN is an input of the plant. So an agreement of the
# two shows that the estimator is consistent, not that a real train would agree with it. These arms separate them: the
# plant is unchanged (except for the gradient, which it has), and the estimator reads a stop with one thing wrong.


class FrictionBelief(NamedTuple):
    """Friction law that the estimator believes in, relative to the plant's."""

    level: float = 1.0
    """Factor of the coefficient."""
    fall: float = 1.0
    """Factor of what the coefficient loses from standstill to the speed."""


RIGHT_FRICTION = FrictionBelief()


@dataclass(frozen=True)
class Misbelief:
    """One thing, or several, that the estimator has wrong."""

    friction: FrictionBelief = RIGHT_FRICTION
    resistance: float = 1.0
    """Factor of the running resistance."""
    grade: float = 0.0
    """Rise per run of the line, which the estimator takes for level."""
    from_speeds: bool = True
    """Whether accelerations are derived from speeds; an accelerometer on the car body reads those of level track."""
    pressure_gain: float = 0.0
    """Relative standard deviation of a pressure sensor's gain, drawn for each car."""
    pressure_offset: float = 0.0
    """Standard deviation of its zero [Pa], drawn for each car."""

    def applied(self, measured: Measured, seed: int) -> Measured:
        """Inputs of an estimator with this belief; `seed` draws the pressure sensors."""
        draw = np.random.default_rng([seed, 46]).standard_normal((2, measured.pressure.shape[1]))
        pressure = measured.pressure * (1.0 + self.pressure_gain * draw[0])
        a = measured.acceleration
        return measured._replace(
            pressure=pressure + self.pressure_offset * draw[1],
            resistance=self.resistance * measured.resistance,
            acceleration=a if self.from_speeds else level_acceleration(a, self.grade),
        )


AS_PLANT = "as the plant"
BELIEFS: Mapping[str, Misbelief] = MappingProxyType(
    {
        **{f"friction {x:+.0%}": Misbelief(FrictionBelief(1.0 + x)) for x in (-0.2, -0.1, 0.1, 0.2)},
        **{f"friction's fall with speed {x:+.0%}": Misbelief(FrictionBelief(fall=1.0 + x)) for x in (-0.2, 0.2)},
        **{f"resistance {x:+.0%}": Misbelief(resistance=1.0 + x) for x in (-0.2, -0.1, 0.1, 0.2)},
        **{f"gradient {x:+g} per mille, by speeds": Misbelief(grade=1e-3 * x) for x in (-2, 2, 10)},
        "gradient +10 per mille, by accelerometers": Misbelief(grade=0.01, from_speeds=False),
        "pressure sensors 5 %, 10 kPa": Misbelief(pressure_gain=0.05, pressure_offset=10e3),
        "pressure sensors 10 %, 20 kPa": Misbelief(pressure_gain=0.1, pressure_offset=20e3),
    }
)  # fmt: skip
"""Arms of the error budget. Steeper falling gradients are not among them: the locomotive alone would not stop the train."""


# The RTRI report's running tests of a freight train, made on the plant: locomotive and 5, locomotive and 17 wagons.
#
# Cylinders fill in the order in which the brake pipe's wave reaches them (their dead time in the plant). Wagons differ
# in the friction of their shoes, as the report says of its own (3.2.2); the measuring system, whose errors are drawn,
# does not know.


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

    def by_wheel(self) -> "TestResult":
        """The same stop with the speed of the foremost wheel in place of the car's, as the report has it (3.1)."""
        m = self.measured
        speed = np.abs(m.axle_speed[:, 0])
        # what the estimator believes of the resistance stays
        ratio = resistance_of_cars(self.train, speed) / resistance_of_cars(self.train, m.speed)
        measured = m._replace(speed=speed, resistance=ratio * m.resistance)
        return self._replace(measured=measured, window=_window(self.test, measured))


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
