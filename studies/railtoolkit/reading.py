"""Real lines and trains from railtoolkit files, schema 2022.05: running paths and rolling stock."""

import math
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import yaml

from alloc.plant.rail import Line
from alloc.plant.train import Train
from studies.files.small_file import small_text
from studies.files.strict import parse
from studies.files.study_error import StudyError, unknown
from studies.railtoolkit.keys import PathFile, StockFile, VehicleKeys
from studies.railtoolkit.vehicles import build_formation

SCHEMA_VERSION = "2022.05"
RUNNING_PATH = "https://railtoolkit.org/schema/running-path.json"
ROLLING_STOCK = "https://railtoolkit.org/schema/rolling-stock.json"


@dataclass(frozen=True)
class Section:
    """A stretch of line of one gradient and one speed limit: start, end [m], grade as rise per run, limit [m/s]."""

    start: float
    end: float
    grade: float
    speed_limit: float = math.inf


@dataclass(frozen=True)
class PointOfInterest:
    """A point of the line [m] that the train's front or rear is to pass."""

    station: float
    name: str
    measure: Literal["front", "rear"] = "front"

    def front_position(self, length: float) -> float:
        """Where the front of a train of this `length` [m] is when it passes."""
        return self.station + (length if self.measure == "rear" else 0.0)


@dataclass(frozen=True)
class RunningPath:
    """The first running path of a file."""

    name: str
    sections: tuple[Section, ...]
    points: tuple[PointOfInterest, ...] = ()

    @property
    def span(self) -> tuple[float, float]:
        """Start and end of the line [m]."""
        return self.sections[0].start, self.sections[-1].end

    def line(
        self, tunnels: tuple[tuple[float, float], ...] = (), tunnel_factor: float = 1.0
    ) -> Line:
        """The plant's line; running paths know no tunnels, so they come from outside."""
        return Line(
            stations=tuple(section.start for section in self.sections),
            grades=tuple(section.grade for section in self.sections),
            tunnels=tunnels,
            tunnel_factor=tunnel_factor,
        )

    def steepest(self) -> Section:
        """The steepest climb; the first one where several are equal."""
        return max(self.sections, key=lambda section: section.grade)


@dataclass(frozen=True)
class RollingStock:
    """A train that can run a line by itself: with its load, its brake and what it is allowed."""

    train: Train
    speed_limit: float
    """Of its slowest vehicle [m/s]; inf if none has one."""
    deceleration: float
    """Under the service brake, in total: with resistance and gradient [m/s2], > 0."""

    @property
    def length(self) -> float:
        """[m]"""
        return sum(car.length for car in self.train.cars)


def read_path(path: str | Path) -> RunningPath:
    """Read a running path; raises `StudyError` naming file, key and reason.

    Gradient and speed limit of a section hold to the start of the next one; the last entry only marks the end of the line.
    """
    found = parse(PathFile, _document(path, RUNNING_PATH, "running path"), str(path)).paths[0]
    rows = found.characteristic_sections
    sections = tuple(
        Section(row[0], following[0], 1e-3 * row[2], row[1] / 3.6)
        for row, following in pairwise(rows)
    )
    points = tuple(PointOfInterest(*row) for row in found.points_of_interest)
    return RunningPath(found.name, sections, points)


def read_train(path: str | Path) -> Train:
    """Read the first train of a rolling-stock file, empty and without air brake.

    A file without trains is taken as one train of its first vehicle. See `studies.railtoolkit.vehicles` for
    what the format leaves open and what is assumed. Raises `StudyError` naming file, key and reason.
    """
    name, members = _formation(path)
    return build_formation(name, members, _source(path))


def read_rolling_stock(path: str | Path, load_share: float = 1.0) -> RollingStock:
    """Read the first train of a file as one that runs a line: loaded, and braked to its `a_braking`.

    `load_share` of the vehicles' `load_limit`, 0 to 1. Of several vehicles with an `a_braking` or a `speed_limit` the
    least one counts. Raises `StudyError` naming file, key and reason, as where no driving vehicle has an `a_braking`.
    """
    if not 0.0 <= load_share <= 1.0:
        raise StudyError(f"load_share = {load_share!r} must lie between 0 and 1")
    name, members = _formation(path)
    braking = [-vehicle.a_braking for vehicle in members if vehicle.a_braking is not None]
    if not braking:
        driving = next(vehicle.id for vehicle in members if vehicle.powered)
        raise StudyError(
            f"{path}: key 'vehicles.a_braking' of vehicle {driving!r} is missing; a train that is to stop needs it"
        )
    limits = [v.speed_limit / 3.6 for v in members if v.speed_limit is not None]
    train = build_formation(name, members, _source(path), load_share, min(braking))
    return RollingStock(train, min(limits, default=math.inf), min(braking))


def _source(path: str | Path) -> str:
    return f"railtoolkit file {Path(path).name}"


def _formation(path: str | Path) -> tuple[str, list[VehicleKeys]]:
    """Name and vehicles, front to rear, of the first train of a file."""
    content = parse(StockFile, _document(path, ROLLING_STOCK, "rolling stock"), str(path))
    vehicles = {vehicle.id: vehicle for vehicle in content.vehicles}
    train = content.trains[0] if content.trains else None
    formation = train.formation if train else (content.vehicles[0].id,)
    for member in formation:
        if member not in vehicles:
            raise StudyError(
                f"{path}: key 'trains[1].formation': {unknown('vehicle', member, vehicles)}"
            )
    members = [vehicles[member] for member in formation]
    if not any(vehicle.powered for vehicle in members):
        raise StudyError(f"{path}: key 'trains[1].formation': no vehicle of the train has traction")
    return train.name if train else content.vehicles[0].name, members


def _document(path: str | Path, schema: str, what: str) -> dict[str, Any]:
    text = small_text(str(path), what)
    try:
        content = yaml.safe_load(text)
    except (yaml.YAMLError, ValueError, RecursionError) as error:
        reason = " ".join(str(error).split())
        raise StudyError(f"{what} file {str(path)!r} is not YAML: {reason}") from None
    if not isinstance(content, dict):
        raise StudyError(f"{path}: not a railtoolkit {what}: no keys at the top")
    for key, wanted in (("schema", schema), ("schema_version", SCHEMA_VERSION)):
        if key not in content:
            raise StudyError(f"{path}: key {key!r} is missing; a railtoolkit {what} has {wanted!r}")
        if str(content[key]) != wanted:
            raise StudyError(f"{path}: key {key!r} = {content[key]!r}: must be {wanted!r}")
    return content
