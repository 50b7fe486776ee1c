"""The sander trials of RSSB T1107 on the plant: a brake application on rail of friction 0.02, by number and kind of sanders.

Read: demand, speed, friction, five distances, two four-car units with sanders at axle 3, sand throughout the stop. Not read
and assumed: that both units sand, the second sander's place, the rates, the slide protection and its use of adhesion.
"""

import argparse
import math
import sys
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal, NamedTuple, get_args

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from alloc.event import DriverCommand, Event
from alloc.metrics.use import damage, distance, locked_time
from alloc.onboard.brakes import Sanding, SlideProtection
from alloc.onboard.parameters import Braking, Onboard, ReferenceSpeed
from alloc.plant.adhesion import POLACH_WET, AdhesionCurve, SlipRatioCurve
from alloc.plant.laws import GRAVITY
from alloc.plant.model import build, level_for
from alloc.plant.rail import Rail, sanded_peak
from alloc.plant.sets import find_set
from alloc.plant.train import Sander, Train
from alloc.rules import AllocationProblem, find_rule
from alloc.simulation import simulate
from studies.core.drawn_events import DrawnEvents, uniform

INITIAL_SPEED = 55.0 * 0.44704
DEMAND = -0.9
FRICTION = 0.02
CARS_PER_UNIT, AXLES_PER_UNIT = 4, 16
PLACES = {"one": (2,), "two": (2, 6)}
"""Axles of a unit ahead of which sand is laid, 0 = foremost: 3, and 3 and 7."""
FULL_BRAKE = 1.2
"""Deceleration at full pressure [m/s2]."""
FIXED_RATE, GREATEST_RATE = 2.0 / 60.0, 6.0 / 60.0
"""Sand per rail [kg/s]: of a sander of fixed rate, and at most of one of variable rate; sources in the set's file."""
VARIABLE_AMOUNT = 4.5e-3
"""Sand per rail that a sander of variable rate keeps to as long as its rate allows [kg/m]."""
DISTANCES = {
    "none": 1200.0,
    "one fixed": 800.0,
    "two fixed": 650.0,
    "one variable": 600.0,
    "two variable": 400.0,
}
"""Sanders of a unit and stopping distance [m]; without sanders it is longer than that."""
DURATIONS = {"none": 130.0, "one fixed": 95.0, "two fixed": 80.0, "one variable": 80.0, "two variable": 60.0}  # fmt: skip
"""Time [s] longer than a stop of about these distances."""
CURVES: dict[str, AdhesionCurve] = {"slip-ratio": SlipRatioCurve(), "polach": POLACH_WET}
STEP = 1e-3
RECORD_PERIOD = 0.1
"""Time [s] between records, whose adhesion limits take as long as their run; at the end of a stop it is less than 3 cm."""
Source = Literal["estimate", "truth"]
"""Speed that slide protection measures slip from."""
SOURCES: tuple[Source, ...] = get_args(Source)
SOURCE: Source = "estimate"
"""Where nothing else is said."""
END_SPEED = 1.0 / 3.6
"""Speed [m/s] to which stops are measured; the rest is 5 cm."""


class SandLaw(NamedTuple):
    """The three numbers of the law of sand, as in `alloc.plant.rail.Rail`."""

    sanded_coefficient: float
    sand_saturation: float
    sand_decay: float


def sanders(kind: str, units: int = 2) -> dict[int, Sander]:
    """Sanders of a row of `DISTANCES` by the number of their axle in the train."""
    if kind == "none":
        return {}
    number, rate = kind.split()
    one = Sander(0, FIXED_RATE) if rate == "fixed" else Sander(0, GREATEST_RATE, VARIABLE_AMOUNT)
    places = [AXLES_PER_UNIT * unit + axle for unit in range(units) for axle in PLACES[number]]
    return dict.fromkeys(places, one)


def sanded(train: Train, sanders: dict[int, Sander]) -> Train:
    """The train with these sanders alone, each by the number of its axle in the train (0 = foremost) in place of its own."""
    cars, first = [], 0
    for car in train.cars:
        axles = range(first, first + len(car.axle_positions))
        own = tuple(replace(sanders[i], axle=i - first) for i in axles if i in sanders)
        cars.append(replace(car, sanders=own))
        first = axles.stop
    return replace(train, cars=tuple(cars))


def coupled_units(units: int = 2) -> Train:
    """One unit of the trials, or both, as they come: a sander of fixed rate at the third axle of each."""
    both = find_set("gb-unit-8car")
    cars = CARS_PER_UNIT * units
    share = cars / len(both.cars)
    a, b, c = both.resistance
    return replace(
        both,
        name=f"gb-unit-{cars}car",
        cars=both.cars[:cars],
        resistance=(share * a, share * b, share * c),
    )


@lru_cache
def _level(curve: str, adhesion: float) -> float:
    """Level that offers the units `adhesion` at the initial speed; all their axles are alike."""
    return level_for(CURVES[curve], adhesion, INITIAL_SPEED, coupled_units())


def rail(law: SandLaw, curve: str = "slip-ratio", level: float = FRICTION, **others: Any) -> Rail:
    """Rail whose adhesion coefficient peaks at `level`, and at that of the law under much sand, whatever the curve."""
    sanded = law._replace(sanded_coefficient=_level(curve, law.sanded_coefficient))
    return Rail(level=_level(curve, level), curve=CURVES[curve], **sanded._asdict(), **others)


def brake_event(
    train: Train,
    rail: Rail,
    duration: float,
    onboard: Onboard | None = None,
    demand: float = DEMAND,
    initial_speed: float = INITIAL_SPEED,
) -> Event:
    """`train` brakes on `rail` until it nearly stands."""
    return Event(
        name=f"{train.name} brakes",
        model=build(train, rail, span=(0.0, 3000.0)),
        command=DriverCommand((0.0,), (demand,)),
        onboard=onboard or equipment(),
        duration=duration,
        initial_speed=initial_speed,
        step=STEP,
        record_period=RECORD_PERIOD,
        target_speed=END_SPEED,
    )


def equipment(source: Source = SOURCE, shares: tuple[float, ...] | None = None) -> Onboard:
    """Fuzzy slide protection, measuring slip from the estimated speed or the true one; sand throughout."""
    protection = SlideProtection(law="fuzzy")
    return Onboard(
        rise_time=0.01,  # asked for at once: the cylinders are all the delay
        braking=Braking(slide_protection=protection, car_shares=shares),
        reference=ReferenceSpeed(source=source),
        sanding=Sanding(delay=0.0, begin=0.0, least_speed=0.0),
    )


def stop(
    kind: str, law: SandLaw, units: int = 2, curve: str = "slip-ratio", source: Source = SOURCE
) -> dict[str, float]:
    """Measures of a row of `DISTANCES`."""
    train = sanded(coupled_units(units), sanders(kind, units))
    return measured_stop(brake_event(train, rail(law, curve), DURATIONS[kind], equipment(source)))


def measured_stop(event: Event) -> dict[str, float]:
    """Distance [m] (nan for a train that still runs), Q [kJ], locked axle-seconds, and sand laid on both rails [kg].

    There are no motors, so rule and controller have nothing to do.
    """
    run = simulate(event, "alone", "none", until_speed=END_SPEED)
    period = float(run["time"].values[1] - run["time"].values[0])
    sand = 2.0 * period * float(run["sand_rate"].sum()) if "sand_rate" in run else 0.0
    return {
        "distance": distance(run),
        "damage": damage(run),
        "locked_time": locked_time(run),
        "sand": sand,
    }


FITTED = ("one fixed", "two fixed", "two variable")
TOLERANCE = 0.05
"""Share of its distance by which a row may be missed."""
LOW, HIGH = SandLaw(0.05, 1e-3, 1e-3), SandLaw(0.4, 0.1, 0.5)
"""Bounds of the law: sanded rail carries no more than dry rail."""
CALIBRATED = SandLaw(*(getattr(Rail(0.1), name) for name in SandLaw._fields))
"""The set in use."""
EVALUATIONS = 12


def distances(
    law: SandLaw, units: int = 2, curve: str = "slip-ratio", source: Source = SOURCE,
    kinds: Sequence[str] = tuple(DISTANCES),
) -> dict[str, float]:  # fmt: skip
    """Stopping distances [m] of the trial's rows."""
    return {kind: stop(kind, law, units, curve, source)["distance"] for kind in kinds}


def calibrate(
    units: int = 2, curve: str = "slip-ratio", source: Source = SOURCE,
    fitted: Sequence[str] = FITTED, start: SandLaw = CALIBRATED,
) -> SandLaw:  # fmt: skip
    """The law whose distances of the `fitted` rows are nearest to the trial's, by least squares of their logarithms."""

    def law(point: NDArray[np.float64]) -> SandLaw:
        return SandLaw(*np.exp(point).tolist())

    def misses(point: NDArray[np.float64]) -> list[float]:
        found = distances(law(point), units, curve, source, fitted)
        return [math.log(found[kind] / DISTANCES[kind]) for kind in fitted]

    bounds = (np.log(LOW), np.log(HIGH))
    # differences far above what valves that switch make of a small change
    found = least_squares(
        misses, np.log(start), bounds=bounds, diff_step=0.02, xtol=1e-3, ftol=1e-3, max_nfev=EVALUATIONS,
    )  # fmt: skip
    return law(found.x)


def main(arguments: Sequence[str] | None = None) -> int:
    """Calibrate, and print the law and all distances under it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--units", type=int, default=2)
    parser.add_argument("--curve", default="slip-ratio")
    parser.add_argument("--source", default=SOURCE, choices=SOURCES)
    given = parser.parse_args(arguments)
    law = calibrate(given.units, given.curve, given.source)
    print(law)
    for kind, metres in distances(law, given.units, given.curve, given.source).items():
        role = "fitted" if kind in FITTED else "predicted"
        print(f"{kind:14s} {metres:7.1f} m, trial {DISTANCES[kind]:6.0f}, {role}")
    return 0


# Where the same sand stops eight cars soonest, and how the brake force is shared among them: events and arms.

AMOUNT, RATE = 4 * VARIABLE_AMOUNT, 4 * GREATEST_RATE
"""Sand of the whole train per rail [kg/m, kg/s]: that of two units with two sanders of variable rate each."""
DURATION = 85.0
"""Time [s] longer than any stop here."""
AXLES = 2 * AXLES_PER_UNIT
AXLES_PER_CAR = 4
USUAL = "axles 3 and 7 of each unit"
PLACEMENTS: dict[str, tuple[int, ...]] = {
    "axle 1": (0,),
    "axle 1 of each unit": (0, 16),
    "axle 3 of each unit": (2, 18),
    "axles 1 and 5 of each unit": (0, 4, 16, 20),
    USUAL: (2, 6, 18, 22),
    "axle 1 of each car": tuple(range(0, AXLES, AXLES_PER_CAR)),
    "axle 1 of cars 1 to 4": (0, 4, 8, 12),
    "axle 1 of cars 1 and 4": (0, 12),
    "axle 1 of car 5": (16,),
}
"""Axles ahead of which the sand is laid in equal parts, 0 = foremost of the train."""
SHARINGS = ("equal", "raised", "by sand")
"""How the brake force is shared. First: as planned. Second: raised where sand is believed to carry more than the plan, as
far as the other cars are believed to carry less. Third: in addition, no car is asked for more than it is believed to
carry."""
PLACED_ON = ("slip-ratio", "polach")
"""Curves that events take turns with."""
EVENTS = DrawnEvents(
    "sanders",
    {
        "level": uniform(0.02, 0.06, "", "very low to low adhesion, where slide protection works throughout"),
        "scatter": uniform(0.0, 0.2, " of the level", "standard deviation along the rail"),
        "speed": uniform(60.0, 120.0, " km/h", "about the 55 mph of the trial"),
        "wear": uniform(0.7, 1.3, " of the calibrated saturation", "how much sand is needed is known least"),
    },
    stream=(13,),
)  # fmt: skip


def placed(axles: tuple[int, ...]) -> Train:
    """Eight cars whose sand is laid in equal parts ahead of these axles."""
    one = Sander(0, RATE / len(axles), AMOUNT / len(axles))
    return sanded(coupled_units(), dict.fromkeys(axles, one))


def caps(train: Train, level: float, speed: float) -> list[float]:
    """Mean adhesion coefficient that each car's axles are believed to find at `speed` [m/s], by the calibrated law."""
    law, sanders, found, amount = CALIBRATED, iter(train.sanders), [], 0.0
    for car in train.cars:
        own = {one.axle for one in car.sanders}
        axles = []
        for axle in range(len(car.axle_positions)):
            if axle in own:
                sander = next(sanders)
                amount += min(sander.amount or float("inf"), sander.rate / speed)
            axles.append(
                float(sanded_peak(level, amount, law.sanded_coefficient, law.sand_saturation))
            )
            amount *= 1.0 - law.sand_decay
        found.append(sum(axles) / len(axles))
    return found


def shares(train: Train, level: float, speed: float, sharing: str) -> tuple[float, ...] | None:
    """Brake force asked of each car over the plan, see `SHARINGS`: the exact level over what cars are believed to carry."""
    if sharing == "equal":
        return None
    planned = -DEMAND / GRAVITY
    problem = AllocationProblem(
        cap=caps(train, level, speed),
        expected=planned,
        limit_max=[FULL_BRAKE / GRAVITY] * len(train.cars),
    )
    least = 1.0 if sharing == "raised" else 0.0
    return tuple(max(float(x) / planned, least) for x in find_rule("exact")(problem).limit)


def place_row(
    axles: tuple[int, ...],
    sharing: str,
    drawn: dict[str, Any],
    curve: str,
    seed: int,
    source: Source = SOURCE,
) -> dict[str, float]:
    """One stop: `drawn` as in `EVENTS`; the train believes the mean level and the calibrated law."""
    train, speed = placed(axles), drawn["speed"] / 3.6
    law = CALIBRATED._replace(sand_saturation=CALIBRATED.sand_saturation * drawn["wear"])
    scatter = drawn["scatter"] * drawn["level"]
    own = rail(law, curve, drawn["level"], scatter=scatter, seed=seed)
    onboard = equipment(source, shares(train, drawn["level"], speed, sharing))
    return measured_stop(brake_event(train, own, DURATION, onboard, initial_speed=speed))


NOMINAL: dict[str, Any] = {"level": 0.02, "scatter": 0.0, "speed": 3.6 * INITIAL_SPEED, "wear": 1.0}
"""The trial's rail and speed."""


if __name__ == "__main__":
    sys.exit(main())
