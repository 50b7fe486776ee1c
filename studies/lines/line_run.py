"""A train run over a real line in minimum time: simulated on the plant, and what people ask of it afterwards."""

import json
import math
from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import xarray as xr

from alloc.driving import drive
from alloc.plant.model import Model, build
from alloc.plant.rail import Rail
from studies.files.study_error import StudyError
from studies.lines.distance_steps import run_by_distance
from studies.lines.minimum_time import MinimumTimeDriver
from studies.lines.speed_profile import SpeedProfile
from studies.lines.train_forces import TrainForces
from studies.railtoolkit.reading import PointOfInterest, RollingStock, RunningPath
from studies.railtoolkit.vehicles import BRAKED_FALL

ADHESION = 0.5
"""Adhesion coefficient of the rail, assumed: the files say nothing of it and mean the effort to be what the rail carries.
Dry rail with sand reaches 0.35 to 0.45."""
CONTROL_PERIOD = 0.1
"""Control period [s]; twice or half of it changes the running time of 100 km by less than 0.1 s."""
LONGEST = 1.2
"""Bound of the simulated time over the running time by distance steps; the two differ by less than 1 %."""


@dataclass(frozen=True)
class Passing:
    """When [s] and how fast [m/s] a point of interest is passed; None if the train stops short of it."""

    point: PointOfInterest
    time: float | None
    speed: float | None


@dataclass(frozen=True)
class LineRun:
    """A run over a line, and its inputs."""

    path: RunningPath
    stock: RollingStock
    profile: SpeedProfile
    run: xr.Dataset
    """As `alloc.driving.drive` records it; its attributes hold the numbers below."""
    running_time: float
    """From the first motion to the stop [s]."""
    stop_error: float
    """How far beyond the end of the line the train stops [m]."""
    passings: tuple[Passing, ...]
    distance_time: float
    """Running time [s] that a program with distance steps of 20 m gives for it."""

    def energy(self) -> dict[str, float]:
        """Where the energy of the run goes [J]: done by the motors, lost by resistance and gradient, shoes and creep."""
        last = self.run.isel(time=-1)
        return {
            "motors": float(last["motor_work"]),
            "resistance_and_gradient": float(last["resistance_work"]),
            "brake_shoes": float(last["shoe_work"]),
            "creep": float(last["friction_work"].sum()),
        }


def line_model(path: RunningPath, stock: RollingStock, adhesion: float = ADHESION) -> Model:
    """The plant's model of this train on this line.

    Raises `StudyError` if the effort asks for more than the `adhesion`, or the line falls more than the brake is made for.
    """
    steepest = min(path.sections, key=lambda section: section.grade)
    if steepest.grade < -BRAKED_FALL:
        raise StudyError(
            f"line {path.name!r}: falls by {-1e3 * steepest.grade:g} per mille at {steepest.start:g} m; the brake "
            f"assumed for a_braking holds on {1e3 * BRAKED_FALL:g} per mille at most"
        )
    model = build(stock.train, Rail(adhesion), path.line(), span=path.span)
    s = model.structure
    for unit, table in enumerate(s.drive_table):
        axles = s.axle_unit == unit
        effort = float((s.gear[axles] / s.radius[axles]).sum() * table.max())
        needed = effort / float(s.static_load[axles].sum())
        if needed >= adhesion:
            raise StudyError(
                f"{stock.train.source}: tractive_effort needs an adhesion coefficient of {needed:.2f} on the axles that "
                f"mass_traction loads; a line run has {adhesion:g}"
            )
    return model


def run_line(
    path: RunningPath,
    stock: RollingStock,
    period: float = CONTROL_PERIOD,
    on_progress: Callable[[float], None] | None = None,
) -> LineRun:
    """Run the whole line from standstill to a stop at its end; raises `StudyError` where the train cannot climb."""
    model = line_model(path, stock)
    start, end = path.span
    profile = SpeedProfile(path.sections, stock.length, stock.deceleration, stock.speed_limit)
    driver = MinimumTimeDriver(model, profile)
    quick = run_by_distance(TrainForces(model), profile, start)
    longest = LONGEST * quick.running_time + 60.0
    # one step a period: the plant divides it as far as it needs to be stable
    run = drive(
        model, driver, longest, path.name, 0.0, start, period, step=period, on_progress=on_progress
    )
    last = float(run["position"][-1])
    if driver.stalled:
        raise StudyError(f"line {path.name!r}: the train rolls back at {last:.0f} m")
    if abs(last - end) > 1.0:
        raise StudyError(
            f"line {path.name!r}: the train is at {last:.0f} m of {end:.0f} m after {longest:.0f} s"
        )
    passings = tuple(passing(run, point, stock.length) for point in path.points)
    run.attrs |= {
        "line": path.name,
        "running_time_s": driver.running_time,
        "deceleration": stock.deceleration,
        "points_of_interest": json.dumps(
            [{"name": p.point.name, "time_s": p.time, "speed": p.speed} for p in passings]
        ),
    }
    return LineRun(
        path, stock, profile, run, driver.running_time, last - end, passings, quick.running_time
    )


def passing(run: xr.Dataset, point: PointOfInterest, length: float) -> Passing:
    """When a train of this `length` [m] passes `point` in `run`: between two instants it accelerates evenly."""
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
