"""Real lines and trains from railtoolkit files, schema 2022.05: running paths and rolling stock."""

from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any, Literal

import yaml
from pydantic import Field, model_validator

from alloc.plant.rail import Line
from alloc.plant.train import Train
from studies.errors import StudyError, unknown
from studies.strict import Foreign, parse

SCHEMA_VERSION = "2022.05"
RUNNING_PATH = "https://railtoolkit.org/schema/running-path.json"
ROLLING_STOCK = "https://railtoolkit.org/schema/rolling-stock.json"


class PathKeys(Foreign):
    """A running path: sections of start [m], speed limit [km/h], gradient [per mille]."""

    name: str
    id: str
    characteristic_sections: tuple[tuple[float, float, float], ...] = Field(min_length=2)

    @model_validator(mode="after")
    def _fits(self) -> "PathKeys":
        for k, (start, limit, _) in enumerate(self.characteristic_sections):
            if limit <= 0.0:
                raise ValueError(f"section {k + 1}: speed limit {limit:g} km/h must exceed 0")
            if k and start <= self.characteristic_sections[k - 1][0]:
                raise ValueError(
                    f"section {k + 1}: start {start:g} m must lie beyond the one before"
                )
        return self


class VehicleKeys(Foreign):
    """A vehicle: lengths in m, masses in t, resistance coefficients in per mille, effort as pairs of km/h and N."""

    name: str
    id: str
    vehicle_type: Literal["traction unit", "freight", "passenger", "multiple unit"]
    length: float = Field(gt=0.0)
    mass: float = Field(gt=0.0)
    mass_traction: float | None = Field(default=None, gt=0.0)
    rotation_mass: float = Field(default=1.08, ge=1.0)
    base_resistance: float = Field(default=0.0, ge=0.0)
    rolling_resistance: float = Field(default=0.0, ge=0.0)
    air_resistance: float = Field(default=0.0, ge=0.0)
    tractive_effort: tuple[tuple[float, float], ...] | None = Field(default=None, min_length=2)

    @model_validator(mode="after")
    def _fits(self) -> "VehicleKeys":
        if self.mass_traction is not None and self.mass_traction > self.mass * (1.0 + 1e-9):
            raise ValueError(f"mass_traction = {self.mass_traction} exceeds mass = {self.mass}")
        pairs = self.tractive_effort or ()
        if any(speed < 0.0 or effort < 0.0 for speed, effort in pairs):
            raise ValueError("tractive_effort must hold values of 0 or greater")
        if any(b[0] <= a[0] for a, b in pairwise(pairs)):
            raise ValueError("tractive_effort: speeds must grow")
        if self.powered and (not pairs or self.mass_traction is None):
            missing = "tractive_effort" if not pairs else "mass_traction"
            raise ValueError(f"{missing} is missing for a {self.vehicle_type}")
        return self

    @property
    def powered(self) -> bool:
        """Whether the vehicle drives."""
        return self.vehicle_type in ("traction unit", "multiple unit")


class TrainKeys(Foreign):
    """A train: the vehicles' ids from front to rear."""

    name: str
    id: str
    formation: tuple[str, ...] = Field(min_length=1)


class _PathFile(Foreign):
    paths: tuple[PathKeys, ...] = Field(min_length=1)


class _StockFile(Foreign):
    trains: tuple[TrainKeys, ...] = ()
    vehicles: tuple[VehicleKeys, ...] = Field(min_length=1)


@dataclass(frozen=True)
class Section:
    """A stretch of line of one gradient: start, end [m], grade as rise per run."""

    start: float
    end: float
    grade: float


@dataclass(frozen=True)
class RunningPath:
    """The first running path of a file."""

    name: str
    sections: tuple[Section, ...]

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


def read_path(path: str | Path) -> RunningPath:
    """Read a running path; raises `StudyError` naming file, key and reason.

    The gradient of a section holds to the start of the next one; the last entry only marks the end of the line.
    """
    found = parse(_PathFile, _document(path, RUNNING_PATH, "running path"), str(path)).paths[0]
    rows = found.characteristic_sections
    sections = tuple(
        Section(row[0], following[0], 1e-3 * row[2]) for row, following in pairwise(rows)
    )
    return RunningPath(found.name, sections)


def read_train(path: str | Path) -> Train:
    """Read the first train of a rolling-stock file; raises `StudyError` naming file, key and reason.

    A file without trains is taken as one train of its first vehicle. See `studies.railtoolkit_train` for what the format
    leaves open and what is assumed.
    """
    from studies.railtoolkit_train import build_formation

    content = parse(_StockFile, _document(path, ROLLING_STOCK, "rolling stock"), str(path))
    vehicles = {vehicle.id: vehicle for vehicle in content.vehicles}
    train = content.trains[0] if content.trains else None
    formation = train.formation if train else (content.vehicles[0].id,)
    for member in formation:
        if member not in vehicles:
            raise StudyError(
                f"{path}: key 'trains[1].formation': {unknown('vehicle', member, vehicles)}"
            )
    name = train.name if train else content.vehicles[0].name
    members = [vehicles[member] for member in formation]
    if not any(vehicle.powered for vehicle in members):
        raise StudyError(f"{path}: key 'trains[1].formation': no vehicle of the train has traction")
    return build_formation(name, members, f"railtoolkit file {Path(path).name}")


def _document(path: str | Path, schema: str, what: str) -> dict[str, Any]:
    try:
        text = Path(path).read_text(encoding="utf-8")
    except FileNotFoundError:
        raise StudyError(f"{what} file {str(path)!r} does not exist") from None
    except (OSError, UnicodeDecodeError) as error:
        raise StudyError(f"{what} file {str(path)!r} cannot be read: {error}") from None
    try:
        content = yaml.safe_load(text)
    except yaml.YAMLError as error:
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
