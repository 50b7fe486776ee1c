"""A train run over a real line: simulated on the plant, with the results that users need."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from alloc.display import displayed
from alloc.driving import drive
from alloc.event import MOST_AXLE_RECORDS, longest_duration
from alloc.plant.model import Model, build
from alloc.plant.rail import Rail
from alloc.plant.train import Car, Train
from studies.files.study_error import StudyError
from studies.lines.speed_profile import (
    FASTEST,
    DrivingStyle,
    Leg,
    MinimumTimeDriver,
    legs,
    run_by_distance,
)
from studies.railtoolkit.vehicles import BRAKED_FALL, PointOfInterest, RollingStock, RunningPath

# A train with one wheelset under each car that does not drive, in place of all of them: for runs of hours.


def lumped(train: Train) -> Train:
    """The same train for a line run, whose wheels do not slip: masses, inertias and brake forces of each car are kept.

    All wheelsets of a car that rolls have the same speed, so one wheelset represents them. Those of driving cars are
    unchanged.
    """
    cars = tuple(car if car.motors else _on_one_wheelset(car) for car in train.cars)
    return replace(train, cars=cars)


def _on_one_wheelset(car: Car) -> Car:
    brake, axles = car.air_brake, len(car.axle_positions)
    if brake is not None:
        brake = replace(brake, force_per_pascal=axles * brake.force_per_pascal, cut_out=())
    return replace(
        car,
        axle_positions=(0.5 * car.length,),
        bogie_of_axle=(0,),
        wheel_inertia=(sum(car.wheel_inertia),),
        driven=(False,),
        air_brake=brake,
        axle_load_share=None,
        sanders=(),
    )


ADHESION = 0.5
"""Adhesion coefficient of the rail, assumed: the files do not state it, and their effort is meant to be within adhesion. Dry
rail with sand reaches 0.35 to 0.45."""
CONTROL_PERIOD = 0.1
"""Control period [s]; doubling or halving it changes the running time of 100 km by less than 0.1 s."""
LONGEST = 1.1
"""Bound of the simulated time over the running time by distance steps; these two differ by less than 1 %."""
MOST_AXLE_STEPS = 3e9
"""Integration steps times wheelsets: ten times the bound of other runs, for a heavy train on a hundred kilometres."""
PAD_WEAR = 0.3e-6
"""Volume that brake pads or blocks lose per work [m3/MJ], assumed: of the order of organic material. It turns work into a
quantity that workshops use; ratios between runs do not depend on it."""


@displayed
@dataclass(frozen=True)
class Passing:
    """Time [s] and speed [m/s] at a point of interest; None if the train stops short of it."""

    point: PointOfInterest
    time: float | None
    """[s]"""
    speed: float | None
    """[m/s]"""


@displayed
@dataclass(frozen=True)
class Stop:
    """A stop of the run: arrival and departure [s], and how far beyond its place the train stood [m]."""

    point: PointOfInterest
    arrival: float
    """[s]"""
    departure: float
    """[s]"""
    error: float
    """Distance by which the train stopped beyond its place [m]."""


@displayed
@dataclass(frozen=True)
class LineRun:
    """A run over a line, and its inputs."""

    path: RunningPath
    stock: RollingStock
    style: DrivingStyle
    legs: tuple[Leg, ...]
    run: xr.Dataset
    """Recorded run of `alloc.driving.drive`; its attributes contain the numbers below."""
    running_time: float
    """Time from the first motion to the last stop, with the stops between [s]."""
    stops: tuple[Stop, ...]
    """Stops; the last one is the end of the line."""
    passings: tuple[Passing, ...]
    distance_time: float | None
    """Running time [s] that a program with distance steps of 20 m gives; None where its mass point at the front stalls."""

    def permitted(self, positions: ArrayLike) -> NDArray[np.float64]:
        """The lower of limit and braking curve [m/s] at `positions` [m], with the curves to the stops."""
        x = np.asarray(positions, dtype=float)
        leg = np.searchsorted([leg.profile.end for leg in self.legs[:-1]], x, side="left")
        found = np.zeros(x.shape)
        for k, one in enumerate(self.legs):
            found[leg == k] = one.profile.permitted(x[leg == k])
        return found

    def energy(self) -> dict[str, float]:
        """Energy balance of the run [J]: the work of the motors, which is the sum of all other terms.

        The other terms are lost by resistance and gradient, recovered by the electric brake, and lost in brake shoes and by
        creep.
        """
        work = np.diff(self.run["motor_work"].values)
        last = self.run.isel(time=-1)
        return {
            "motors": float(work[work > 0.0].sum()),
            "resistance_and_gradient": float(last["resistance_work"]),
            "electric_brake": float(np.abs(work[work < 0.0]).sum()),
            "brake_shoes": float(last["shoe_work"]),
            "creep": float(last["friction_work"].sum()),
        }

    def pad_wear(self) -> float:
        """Volume that all brake pads or blocks lose [m3]."""
        return PAD_WEAR * 1e-6 * self.energy()["brake_shoes"]


def line_model(path: RunningPath, stock: RollingStock, adhesion: float = ADHESION) -> Model:
    """The plant's model of this train on this line.

    Raises `StudyError` if the effort asks for more than the `adhesion`, or the line falls more steeply than the brake is
    designed for.
    """
    steepest = min(path.sections, key=lambda section: section.grade)
    if steepest.grade < -BRAKED_FALL:
        raise StudyError(
            f"line {path.name!r}: falls by {-1e3 * steepest.grade:g} per mille at {steepest.start:g} m; the brake "
            f"assumed for a_braking holds on {1e3 * BRAKED_FALL:g} per mille at most"
        )
    if not any(car.motors for car in stock.train.cars):
        raise StudyError(f"train {stock.train.name!r} has no motors to run a line with")
    model = build(lumped(stock.train), Rail(adhesion), path.line(), span=path.span)
    s = model.structure
    for unit in range(model.layout.units):
        axles = s.axle_unit == unit
        greatest = max(s.drive_table[unit].max(), s.brake_table[unit].max())
        effort = float((s.gear[axles] / s.radius[axles]).sum() * greatest)
        needed = effort / float(s.static_load[axles].sum())
        if needed >= adhesion:
            raise StudyError(
                f"train {stock.train.name!r}: the effort needs an adhesion coefficient of {needed:.2f} on the driven axles; "
                f"a line run has {adhesion:g}"
            )
    return model


def run_line(
    path: RunningPath,
    stock: RollingStock,
    style: DrivingStyle = FASTEST,
    period: float = CONTROL_PERIOD,
    on_progress: Callable[[float], None] | None = None,
) -> LineRun:
    """Run the whole line from standstill to a stop at its end; raises `StudyError` where the train cannot climb."""
    start, end = path.span
    route = legs(path, stock)
    model = line_model(path, stock)
    _check_size(path, model, period, route[-1].profile.shortest_time())
    driver = MinimumTimeDriver(model, route, style)
    spread = run_by_distance(driver.forces, path.sections, route, style=style, spread=True)
    longest = LONGEST * spread.running_time + 60.0
    _check_size(path, model, period, longest)
    records = longest / period * model.layout.axles
    every = math.ceil(records / (0.999 * MOST_AXLE_RECORDS))  # so that long trains fit into memory
    # one step a period: the plant divides it as far as it needs to be stable
    run = drive(
        model, driver, longest, path.name, 0.0, start, period, step=period,
        record_period=every * period, on_progress=on_progress, most_axle_steps=MOST_AXLE_STEPS,
    )  # fmt: skip
    last = float(run["position"][-1])
    if driver.stalled:
        raise StudyError(f"line {path.name!r}: the train rolls back at {last:.0f} m")
    if len(driver.halts) < len(route) or abs(driver.halts[-1].position - end) > 1.0:
        raise StudyError(
            f"line {path.name!r}: the train is at {last:.0f} m of {end:.0f} m after {longest:.0f} s"
        )
    stops = tuple(
        Stop(leg.stop, halt.arrival, halt.departure, halt.position - leg.profile.end)
        for leg, halt in zip(route, driver.halts, strict=True)
    )
    passings = tuple(
        passing(run, point, stock.length) for point in path.points if point.dwell is None
    )
    run.attrs |= {
        "line": path.name,
        "running_time_s": driver.running_time,
        "deceleration": stock.deceleration,
        "points_of_interest": json.dumps(
            [{"name": p.point.name, "time_s": p.time, "speed": p.speed} for p in passings]
        ),
    }
    return LineRun(
        path,
        stock,
        style,
        route,
        run,
        driver.running_time,
        stops,
        passings,
        _as_point(driver, path, route),
    )


def _check_size(path: RunningPath, model: Model, period: float, duration: float) -> None:
    """Raise `StudyError` where a run of `duration` [s] would take hours of computing."""
    allowed = longest_duration(model, period, math.inf, MOST_AXLE_STEPS)
    if duration > allowed:
        raise StudyError(
            f"line {path.name!r}: a run of {duration:.3g} s and more with {model.layout.axles} wheelsets is too large, "
            f"{allowed:.3g} s are the most; give a shorter line or train"
        )


def _as_point(driver: MinimumTimeDriver, path: RunningPath, route: tuple[Leg, ...]) -> float | None:
    """Running time [s] as timetable programs calculate it; None where their mass point cannot climb what the train can."""
    try:
        return run_by_distance(driver.forces, path.sections, route, style=driver.style).running_time
    except StudyError:
        return None


def passing(run: xr.Dataset, point: PointOfInterest, length: float) -> Passing:
    """Time and speed at which a train of this `length` [m] passes `point` in `run`, interpolated with even acceleration."""
    position, speed, time = (run[name].values for name in ("position", "speed", "time"))
    place = point.front_position(length)
    if place > position[-1] + 0.1:  # the stop may be some millimetres short of the end
        return Passing(point, None, None)
    reached = np.maximum.accumulate(position)
    k = min(int(np.searchsorted(reached, place, side="right")) - 1, position.size - 2)
    way, step = place - position[k], time[k + 1] - time[k]
    rate = (speed[k + 1] - speed[k]) / step
    root = math.sqrt(max(speed[k] ** 2 + 2.0 * rate * way, 0.0))
    # the root of v t + a t^2 / 2 = way that stays finite as a vanishes
    later = 2.0 * way / (speed[k] + root) if way > 0.0 else 0.0
    return Passing(point, float(time[k] + min(later, step)), float(root))
