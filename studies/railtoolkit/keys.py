"""Keys of railtoolkit files, schemas 2022.05 and 2024.07, that this project reads, with their units and bounds."""

import math
from collections import Counter
from collections.abc import Sequence
from itertools import pairwise
from typing import Any, ClassVar, Literal

from pydantic import Field, model_validator

from studies.files.strict import Foreign
from studies.files.units import range_fault
from studies.railtoolkit.records import Measure

MOST_SECTIONS = 20_000
LONGEST_LINE = 2e6
"""[m]; a train runs it in a day."""
VERSIONS = ("2022.05", "2024.07")
"""Versions of both schemas; that of rolling stock is the same in both."""


def check_line(rows: Sequence[tuple[float, float, float]], where: str) -> None:
    """Raise `ValueError` unless rows of start [m], limit [km/h] and gradient [per mille] make a line; `where`: their key."""
    for k, (start, limit, grade) in enumerate(rows):
        for key, value in (("start_m", start), ("limit_kmh", limit), ("grade_permille", grade)):
            if (fault := range_fault(key, value)) is not None:
                raise ValueError(f"{where}[{k + 1}]: {value:g} {fault}")
        if limit <= 0.0:
            raise ValueError(f"{where}[{k + 1}]: speed limit {limit:g} km/h must exceed 0")
        if k and start <= rows[k - 1][0]:
            raise ValueError(
                f"{where}[{k + 1}]: start {start:g} m must lie beyond the one before, {rows[k - 1][0]:g} m; "
                "give the sections in the order in which the train meets them, positions growing"
            )
    length = rows[-1][0] - rows[0][0]
    if length > LONGEST_LINE:
        raise ValueError(f"{where}: the line is {length:g} m long; give {LONGEST_LINE:g} m at most")


def check_points(
    points: Sequence[tuple[float, str]], ends: tuple[float, float], where: str
) -> None:
    """Raise `ValueError` unless points, each a station [m] and a name, lie on the line between its `ends` [m]."""
    first, last = ends
    for k, (station, name) in enumerate(points):
        if not first <= station <= last:
            raise ValueError(
                f"{where}[{k + 1}]: {name!r} at {station:g} m lies off the line, which is {first:g} m to {last:g} m"
            )


class PathKeys(Foreign):
    """A running path of 2022.05: sections of start [m], speed limit [km/h], gradient [per mille].

    Points of interest: station [m], name, and which end of the train is meant to pass it.
    """

    unused: ClassVar[frozenset[str]] = frozenset({"UUID"})

    name: str
    id: str
    characteristic_sections: tuple[tuple[float, float, float], ...] = Field(
        min_length=2, max_length=MOST_SECTIONS
    )
    points_of_interest: tuple[tuple[float, str, Literal["front", "rear"]], ...] = ()

    @model_validator(mode="after")
    def _fits(self) -> "PathKeys":
        rows = self.rows()
        check_line(rows, "characteristic_sections")
        places = [point[:2] for point in self.points_of_interest]
        check_points(places, (rows[0][0], rows[-1][0]), "points_of_interest")
        return self

    @property
    def title(self) -> str:
        """What the path calls itself."""
        return self.name

    def rows(self) -> Sequence[tuple[float, float, float]]:
        """Sections as start [m], limit [km/h] and gradient [per mille]; the last one marks the end."""
        return self.characteristic_sections

    def points(self) -> Sequence[tuple[float, str, Measure]]:
        """Points of interest as station [m], name and measure."""
        return self.points_of_interest


class CharacteristicSection(Foreign):
    """A section of 2024.07: start [m], and what changes there: speed limit [km/h], gradient [per mille]."""

    position: float
    speed: float | None = Field(default=None, gt=0.0)
    resistance: float | None = None

    @model_validator(mode="after")
    def _says_something(self) -> "CharacteristicSection":
        if self.speed is None and self.resistance is None:
            raise ValueError("speed and resistance are missing; give at least one")
        return self


class MeasuredPoint(Foreign):
    """A point of interest of 2024.07: station [m], name, and which part of the train is meant to pass it."""

    position: float
    label: str
    measure: Measure


class NamedPathKeys(Foreign):
    """A running path of 2024.07, whose sections and points have named keys.

    The schema leaves open which value applies where a section lacks one of its two values; here it is that of the section
    before. Before the first value the line is level, and has no limit of its own.
    """

    unused: ClassVar[frozenset[str]] = frozenset({"UUID", "name"})

    id: str
    description: str = ""
    characteristic_sections: tuple[CharacteristicSection, ...] = Field(
        min_length=2, max_length=MOST_SECTIONS
    )
    points_of_interest: tuple[MeasuredPoint, ...] = ()

    @model_validator(mode="after")
    def _fits(self) -> "NamedPathKeys":
        rows = self.rows()
        check_line(rows, "characteristic_sections")
        places = [(point.position, point.label) for point in self.points_of_interest]
        check_points(places, (rows[0][0], rows[-1][0]), "points_of_interest")
        return self

    @property
    def title(self) -> str:
        """What the path calls itself."""
        return self.description or self.id

    def rows(self) -> Sequence[tuple[float, float, float]]:
        """Sections as start [m], limit [km/h] and gradient [per mille]; the last one marks the end."""
        limit, grade = math.inf, 0.0
        found = []
        for section in self.characteristic_sections:
            limit = limit if section.speed is None else section.speed
            grade = grade if section.resistance is None else section.resistance
            found.append((section.position, limit, grade))
        return found

    def points(self) -> Sequence[tuple[float, str, Measure]]:
        """Points of interest as station [m], name and measure."""
        return [(point.position, point.label, point.measure) for point in self.points_of_interest]


class VehicleKeys(Foreign):
    """A vehicle: lengths in m, masses in t, resistance coefficients in per mille, effort as pairs of km/h and N.

    `speed_limit` in km/h; `a_braking` in m/s2, negative: the acceleration under the service brake.
    """

    unused: ClassVar[frozenset[str]] = frozenset({"UUID", "picture", "power_type"})

    name: str
    id: str
    vehicle_type: Literal["traction unit", "freight", "passenger", "multiple unit"]
    length: float = Field(gt=0.0, le=1000.0)
    mass: float = Field(gt=0.0, le=5000.0)
    load_limit: float = Field(default=0.0, ge=0.0, le=5000.0)
    mass_traction: float | None = Field(default=None, gt=0.0)
    rotation_mass: float | None = Field(default=None, ge=1.0, le=5.0)
    base_resistance: float = Field(default=0.0, ge=0.0, le=1000.0)
    rolling_resistance: float = Field(default=0.0, ge=0.0, le=1000.0)
    air_resistance: float = Field(default=0.0, ge=0.0, le=1000.0)
    speed_limit: float | None = Field(default=None, gt=0.0, le=600.0)
    a_braking: float | None = Field(default=None, lt=0.0, ge=-5.0)
    tractive_effort: tuple[tuple[float, float], ...] | None = Field(
        default=None, min_length=2, max_length=5000
    )

    @model_validator(mode="after")
    def _fits(self) -> "VehicleKeys":
        if self.mass_traction is not None and self.mass_traction > self.mass * (1.0 + 1e-9):
            raise ValueError(f"mass_traction = {self.mass_traction} exceeds mass = {self.mass}")
        pairs = self.tractive_effort or ()
        if not all(0.0 <= speed <= 600.0 and 0.0 <= effort <= 1e7 for speed, effort in pairs):
            raise ValueError("tractive_effort must hold speeds from 0 to 600 km/h and 0 to 1e7 N")
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

    unused: ClassVar[frozenset[str]] = frozenset({"UUID"})

    name: str
    id: str
    formation: tuple[str, ...] = Field(min_length=1, max_length=500)


class File(Foreign):
    """A file: it says which schema it follows."""

    unused: ClassVar[frozenset[str]] = frozenset({"schema", "schema_version"})

    @model_validator(mode="after")
    def _one_of_each(self) -> "File":
        for key in type(self).model_fields:
            ids: Counter[Any] = Counter(item.id for item in getattr(self, key))
            for name, count in ids.items():
                if count > 1:
                    often = "twice" if count == 2 else f"{count} times"
                    raise ValueError(f"{key}: id {name!r} is there {often}; give each its own")
        return self


class PathFile(File):
    """A file of running paths, 2022.05."""

    paths: tuple[PathKeys, ...] = Field(min_length=1)


class NamedPathFile(File):
    """A file of running paths, 2024.07."""

    paths: tuple[NamedPathKeys, ...] = Field(min_length=1)


class StockFile(File):
    """A file of rolling stock."""

    trains: tuple[TrainKeys, ...] = ()
    vehicles: tuple[VehicleKeys, ...] = Field(min_length=1)
