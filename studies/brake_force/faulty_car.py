"""Which car of a commuter train did not deliver the brake force that it was allocated?

Stops of an eight-car train with couplers are measured as in `studies.brake_force.measurement`. There are two kinds. In the
first, the rails are so slippery that the train's computers allocate, and a car has its brake cut out or its motors failed.
In the second, the rails are dry and the driver asks every car for its share. One car's shoes give less than they should, by
any amount.
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.driving import Controls, TrainSense, drive
from alloc.estimation.brake_force import (
    CalibrationErrors,
    Shortfalls,
    car_brake_forces,
    find_shortfalls,
    sliding_cars,
)
from alloc.event import DriverCommand, Event
from alloc.onboard.parameters import Belief, Onboard, Sensors
from alloc.plant.laws import GRAVITY
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail, logarithmic_increments
from alloc.plant.sets import find_set
from alloc.plant.train import Coupler, Train
from alloc.simulation import simulate
from studies.brake_force.findings import Row, rms
from studies.brake_force.measurement import (
    AS_PLANT,
    BELIEFS,
    Measured,
    MeasuringSystem,
    Misbelief,
    disturb,
    rail_brake_forces,
    record,
)

Floats = NDArray[np.float64]

COUPLER = Coupler(stiffness=1.5e7, damping=2.0e5)
"""Tight-lock couplers with rubber draft gear; assumed: no slack, some 5 mm under a car's whole brake."""
SYSTEM = MeasuringSystem(calibration=CalibrationErrors(0.005, 300.0, 0.005, 0.01))
"""As on the freight train; passengers are weighed by air springs, to 1 % of a car's mass (assumed)."""
DECELERATION = 0.8
INITIAL_SPEED = 20.0
SETTLED = 3.0
"""Time [s] after the command from which forces are compared: cylinders have filled, relative motion has died out."""
SLOWEST = 4.0
"""Speed [m/s] down to which forces are compared; below, the electric brake fades out."""
COMMANDED_AT = 1.0
DRY = 0.3
SLIPPERY = 0.08
"""Adhesion coefficient of the foremost axle; the stop needs 0.082, and the scatter along the rail is 0.012 (JP5484215)."""
SLIDING = 0.04
"""Adhesion coefficient under the wheels of a trailer that is to slide."""
USUAL = 0.2
"""Coefficient under the other wheels then, where it is not `SLIPPERY` too: damp rails that carry any share."""
SLID = 0.05
"""Share of the window above which a car counts as sliding."""
SHARE_SCATTER = 0.02
"""Relative standard deviation of the force of sound shoes over the allocated force; assumed."""
GREATEST_LOAD = 12e3
"""Passengers of a car [kg], at most; drawn for each."""


@dataclass(frozen=True)
class Fault:
    """What is wrong. `car`: 0 = foremost; `bogies`: cut out; `motors`: failed from the start."""

    car: int
    bogies: tuple[int, ...] = ()
    motors: bool = False


class AllocatedStop(NamedTuple):
    """A measured stop and what was allocated in it, within the window of comparison."""

    run: xr.Dataset
    measured: Measured
    window: NDArray[np.bool_]
    """Of the samples, (time,)."""
    allocated: Floats
    """Brake force at the rails [N], (time, cars)."""
    estimated: Floats
    """Of (2) with own accelerations and bare masses: at the rails [N], (time, cars)."""
    true_force: Floats
    """At the rails [N], (time, cars)."""
    sliding: NDArray[np.bool_]
    """Where the wheels of a car are found to slide, (time, cars)."""

    def shortfalls(self, all_samples: bool = False) -> Shortfalls:
        """What the cars fell short of while their wheels roll, or in `all_samples`, with the uncertainty as threshold."""
        m, w = self.measured, self.window
        constant = SYSTEM.calibration.deviation(
            m.bare_mass, m.acceleration[w].mean(axis=0), m.coupler_force[w].mean(axis=0)
        )
        sliding = None if all_samples else self.sliding[w]
        return find_shortfalls(self.allocated[w], self.estimated[w], constant, sliding=sliding)

    @property
    def true_shortfall(self) -> Floats:
        """Mean of what the cars truly fell short of while their wheels are not found to slide [N], (cars,); nan: always."""
        rolls = ~self.sliding[self.window]
        short = (self.allocated - self.true_force)[self.window]
        with np.errstate(invalid="ignore"):
            return np.asarray((short * rolls).sum(axis=0) / rolls.sum(axis=0))

    @property
    def slid(self) -> NDArray[np.bool_]:
        """Cars whose wheels are found to slide for more than `SLID` of the window, (cars,)."""
        return np.asarray(self.sliding[self.window].mean(axis=0) > SLID)


def commuter_train(seed: int) -> Train:
    """The train with couplers, its loads drawn from `seed`."""
    train = find_set("commuter-8car")
    draw = np.random.default_rng([seed, 42])
    return train.loaded(tuple(draw.uniform(0.0, GREATEST_LOAD, len(train.cars)))).coupled(COUPLER)


def allocated_stops(
    fault: Fault | None,
    seed: int,
    draws: int = 1,
    level: float = SLIPPERY,
    slides: int | None = None,
) -> list[AllocatedStop]:
    """One stop under the train's computers and the reference rule on slippery rails, measured `draws` times.

    `seed` draws loads and rail, and with the number of the measurement the sensor errors. `level`: coefficient under the
    foremost axle; `slides`: car under whose wheels it is `SLIDING`, which the computers do not know.
    """
    train = commuter_train(seed)
    failures: dict[int, float] = {}
    if fault is not None:
        cars = list(train.cars)
        if fault.motors:
            powered = [k for k, car in enumerate(cars) if car.motors is not None]
            failures = {powered.index(fault.car): 0.0}
        brake = cars[fault.car].air_brake
        assert brake is not None
        cars[fault.car] = replace(cars[fault.car], air_brake=replace(brake, cut_out=fault.bogies))
        train = replace(train, cars=tuple(cars))
    increments = tuple(logarithmic_increments(train.axle_count))
    under = [SLIDING - level if k == slides else add
             for k, add in zip(_car_of_axle(train), increments, strict=True)]  # fmt: skip
    rail = Rail(level, increments=tuple(under), scatter=0.012, seed=seed)
    event = Event(
        "stop",
        build(train, rail, failures=failures),
        DriverCommand((COMMANDED_AT,), (-DECELERATION,)),
        Onboard(belief=Belief(increments=increments), sensors=Sensors(seed=seed)),
        duration=COMMANDED_AT + (INITIAL_SPEED - 0.5 * SLOWEST) / DECELERATION,
        initial_speed=INITIAL_SPEED,
        initial_position=200.0,
        seed=seed,
    )
    run = simulate(event, "greedy-literal")
    every = SYSTEM.every(run)
    unit_car = [int(run["axle_car"].values[run["axle_unit"].values == j][0])
                for j in range(run.sizes["unit"])]  # fmt: skip
    coefficient = np.repeat(run["expected"].values[::every, None], len(train.cars), axis=1)
    coefficient[:, unit_car] = run["limit"].values[::every]
    return _measured(run, train, seed, draws, coefficient * GRAVITY)


def driven_stops(
    car: int, missing: float, seed: int, draws: int = 1, belief: Misbelief | None = None
) -> list[AllocatedStop]:
    """One stop on dry rails in which the shoes of `car` give less by the share `missing`, measured `draws` times.

    Every car brakes by air alone. Sound shoes scatter by `SHARE_SCATTER`; `seed` draws that and the loads, and with the
    number of the measurement the sensor errors. `belief`: what the estimator has wrong; None: nothing.
    """
    nominal = commuter_train(seed)
    draw = np.random.default_rng([seed, 43])
    share = 1.0 + SHARE_SCATTER * draw.standard_normal(len(nominal.cars))
    share[car] *= 1.0 - missing
    cars, pressure, gain = [], [], []
    for one, factor in zip(nominal.cars, share, strict=True):
        brake = one.air_brake
        assert brake is not None
        turning = sum(one.wheel_inertia) / one.wheel_radius**2
        wanted = DECELERATION * (one.mass + turning) / len(one.axle_positions)
        pressure += [wanted / brake.force_per_pascal] * (one.bogie_of_axle[-1] + 1)
        gain.append(wanted * len(one.axle_positions) - DECELERATION * turning)
        cars.append(
            replace(one, air_brake=replace(brake, force_per_pascal=brake.force_per_pascal * factor))
        )
    train = replace(nominal, cars=tuple(cars))
    targets = np.array(pressure)

    def driver(sense: TrainSense, controls: Controls) -> bool:
        controls.pressure[:] = targets if sense.time >= COMMANDED_AT else 0.0
        return sense.speed > 0.9 * SLOWEST

    length = sum(one.length for one in cars)
    wrong = belief or Misbelief()
    model = build(train, Rail(DRY), Line(grades=(wrong.grade,)))
    run = drive(model, driver, 60.0, "stop", INITIAL_SPEED, length, 0.01)
    decrement = np.array(gain) / np.array([one.mass for one in cars])
    return _measured(run, train, seed, draws, decrement, wrong)


def _car_of_axle(train: Train) -> list[int]:
    return [k for k, car in enumerate(train.cars) for _ in car.axle_positions]


def _measured(
    run: xr.Dataset,
    train: Train,
    seed: int,
    draws: int,
    decrement: Floats,
    belief: Misbelief | None = None,
) -> list[AllocatedStop]:
    """Measure a run so many times; what is allocated, `decrement` [m/s2] per car, follows the mass as weighed."""
    exact = record(run, train, SYSTEM)
    true = SYSTEM.sampled(run, rail_brake_forces(run))
    stops = []
    for k in range(draws):
        m = disturb(exact, train, SYSTEM, 1000 * seed + k)
        m = m if belief is None else belief.applied(m, 1000 * seed + k)
        estimated = car_brake_forces(m.acceleration, m.coupler_force, m.bare_mass, m.resistance)
        window = (m.time >= COMMANDED_AT + SETTLED) & (m.speed >= SLOWEST)
        allocated = np.broadcast_to(decrement * m.bare_mass, estimated.shape)
        sliding = sliding_cars(m.axle_speed, _car_of_axle(train), SYSTEM.period)
        stops.append(AllocatedStop(run, m, window, allocated, estimated, true, sliding))
    return stops


# Numbers of a passenger train's stops: whether a car that does not deliver its share is found, and no other accused.

SHORTFALLS = (0.0, 0.025, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3)
"""Shares of its force that the faulty car does not deliver, in dry stops."""
SOUND = 0.05
"""A car that truly falls short by less than this share of its allocated force is sound: to accuse it is wrong."""
WHOLE = 0.01
"""A car whose true shortfall is below this share delivers its force, except for what nobody measures."""
DRAWS = 10
"""Measurements of each stop of the passenger train, with sensor errors of their own."""
FEW_DRAWS = 3
"""Of each stop of the error budget."""


def allocated_rows(seed: int, draws: int = DRAWS) -> list[Row]:
    """Stops of the passenger train under allocation: sound, and with each kind of fault."""
    draw = np.random.default_rng([seed, 44])
    cars = commuter_train(seed).cars
    motor = int(draw.choice([k for k, car in enumerate(cars) if car.motors is not None]))
    # the lead car is not among them: its wheels slide on these rails all the time, so it is not judged
    trailer = int(draw.choice([k for k, car in enumerate(cars) if k and car.motors is None]))
    faults: dict[str, Fault | None] = {
        "sound": None,
        "trailer, brake cut out": Fault(trailer, (0, 1)),
        "trailer, one bogie cut out": Fault(trailer, (0,)),
        "motor car, motors failed": Fault(motor, (), True),
        "motor car, motors failed and brake cut out": Fault(motor, (0, 1), True),
    }
    rows = []
    for kind, fault in faults.items():
        stops = allocated_stops(fault, seed, draws=draws)
        row = _accusations(stops, None if fault is None else fault.car)
        calls = int(stops[0].run.attrs["rule_calls"])
        rows.append({"part": "allocated", "kind": kind, "rule_calls": calls} | row)
    return rows


def driven_rows(
    seed: int, shortfalls: Sequence[float] = SHORTFALLS, draws: int = DRAWS
) -> list[Row]:
    """Dry stops of the passenger train in which one car, drawn, falls short by each of these shares."""
    car = int(np.random.default_rng([seed, 45]).integers(len(commuter_train(seed).cars)))
    rows = []
    for missing in shortfalls:
        row = _accusations(driven_stops(car, missing, seed, draws), car if missing else None)
        rows.append({"part": "driven", "missing": missing} | row)
    return rows


def sliding_rows(seed: int, draws: int = DRAWS) -> list[Row]:
    """Stops in which a trailer, drawn, slides on rails that carry the others: all brakes sound, or another one's cut out."""
    draw = np.random.default_rng([seed, 47])
    trailers = [k for k, car in enumerate(commuter_train(seed).cars) if car.motors is None]
    slides, faulty = (int(k) for k in draw.permutation(trailers)[:2])
    rows = []
    for kind, fault in (("sound", None), ("another's brake cut out", Fault(faulty, (0, 1)))):
        stops = allocated_stops(fault, seed, draws, USUAL, slides)
        row = _accusations(stops, None if fault is None else faulty)
        blamed = [slides in stop.shortfalls().accused for stop in stops]
        blindly = [slides in stop.shortfalls(all_samples=True).accused for stop in stops]
        of_slides = {"sliding_accused": float(np.mean(blamed)), "accused_blindly": float(np.mean(blindly)),
                     "slides": bool(stops[0].slid[slides])}  # fmt: skip
        rows.append({"part": "sliding", "kind": kind} | row | of_slides)
    return rows


def budget_dry_rows(
    seed: int, beliefs: Sequence[str] = tuple(BELIEFS), draws: int = FEW_DRAWS
) -> list[Row]:
    """Dry stops, sound and with a tenth missing on one car, by estimators that have resistance or gradient wrong."""
    car = int(np.random.default_rng([seed, 45]).integers(len(commuter_train(seed).cars)))
    rows = []
    for belief in (AS_PLANT, *beliefs):
        one = BELIEFS.get(belief, Misbelief())
        if one in (Misbelief(friction=one.friction), Misbelief(pressure_gain=one.pressure_gain,
                   pressure_offset=one.pressure_offset)) and belief != AS_PLANT:  # fmt: skip
            continue  # neither friction nor pressures are read for it
        for missing in (0.0, 0.1):
            stops = driven_stops(car, missing, seed, draws, one)
            row = _accusations(stops, car if missing else None)
            rows.append({"part": "budget dry", "belief": belief, "missing": missing} | row)
    return rows


def _accusations(stops: Sequence[AllocatedStop], faulty: int | None) -> Row:
    """Shares of the measurements in which the faulty car is found, is the first named, and others are accused."""
    said = []
    threshold, error = [], []
    for stop in stops:
        shortfalls, w = stop.shortfalls(), stop.window
        accused, allocated = shortfalls.accused, stop.allocated[w].mean(axis=0)
        sound = stop.true_shortfall < SOUND * allocated
        others = [k for k in accused if k != faulty]
        judged = np.isfinite(shortfalls.shortfall)
        said.append(
            {
                "found": faulty in accused,
                "first": accused.size > 0 and accused[0] == faulty,
                "wrong": np.any(sound[others]),
                "whole": np.any((stop.true_shortfall < WHOLE * allocated)[others]),
                "others_short": np.any(~sound[others]),
                "not_judged": np.mean(~judged),
            }
        )
        threshold.append(float(np.mean((shortfalls.threshold / allocated)[judged])))
        missed = (shortfalls.shortfall - stop.true_shortfall) / shortfalls.deviation
        error.append(missed[judged])
    shortfall = stops[0].true_shortfall / stops[0].allocated[stops[0].window].mean(axis=0)
    return {
        "car": -1 if faulty is None else faulty,
        "true_share": np.nan if faulty is None else float(shortfall[faulty]),
        "error_in_deviations": rms(np.concatenate(error)),
        "shortfall_covered": float(np.mean(np.abs(np.concatenate(error)) < 1.96)),
        "threshold": float(np.mean(threshold)),
        **{name: float(np.mean([one[name] for one in said])) for name in said[0]},
    }
