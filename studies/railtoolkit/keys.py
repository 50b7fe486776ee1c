"""Keys of railtoolkit files, schema 2022.05, that this project reads, with their units and bounds."""

from itertools import pairwise
from typing import Literal

from pydantic import Field, model_validator

from studies.files.strict import Foreign
from studies.files.units import range_fault


class PathKeys(Foreign):
    """A running path: sections of start [m], speed limit [km/h], gradient [per mille].

    Points of interest: station [m], name, and which end of the train is meant to pass it.
    """

    name: str
    id: str
    characteristic_sections: tuple[tuple[float, float, float], ...] = Field(
        min_length=2, max_length=5000
    )
    points_of_interest: tuple[tuple[float, str, Literal["front", "rear"]], ...] = ()

    @model_validator(mode="after")
    def _fits(self) -> "PathKeys":
        for k, (start, limit, grade) in enumerate(self.characteristic_sections):
            for key, value in (("start_m", start), ("limit_kmh", limit), ("grade_permille", grade)):
                if fault := range_fault(key, value):
                    raise ValueError(f"characteristic_sections[{k + 1}]: {value:g} {fault}")
            if limit <= 0.0:
                raise ValueError(
                    f"characteristic_sections[{k + 1}]: speed limit {limit:g} km/h must exceed 0"
                )
            if k and start <= self.characteristic_sections[k - 1][0]:
                raise ValueError(
                    f"characteristic_sections[{k + 1}]: start {start:g} m must lie beyond the one before"
                )
        first, last = (self.characteristic_sections[k][0] for k in (0, -1))
        for k, (station, name, _) in enumerate(self.points_of_interest):
            if not first <= station <= last:
                raise ValueError(
                    f"points_of_interest[{k + 1}]: {name!r} at {station:g} m lies off the line, "
                    f"which is {first:g} m to {last:g} m"
                )
        return self


class VehicleKeys(Foreign):
    """A vehicle: lengths in m, masses in t, resistance coefficients in per mille, effort as pairs of km/h and N.

    `speed_limit` in km/h; `a_braking` in m/s2, negative: the acceleration under the service brake.
    """

    name: str
    id: str
    vehicle_type: Literal["traction unit", "freight", "passenger", "multiple unit"]
    length: float = Field(gt=0.0, le=1000.0)
    mass: float = Field(gt=0.0, le=5000.0)
    load_limit: float = Field(default=0.0, ge=0.0, le=5000.0)
    mass_traction: float | None = Field(default=None, gt=0.0)
    rotation_mass: float = Field(default=1.08, ge=1.0, le=5.0)
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

    name: str
    id: str
    formation: tuple[str, ...] = Field(min_length=1, max_length=500)


class PathFile(Foreign):
    """A file of running paths."""

    paths: tuple[PathKeys, ...] = Field(min_length=1)


class StockFile(Foreign):
    """A file of rolling stock."""

    trains: tuple[TrainKeys, ...] = ()
    vehicles: tuple[VehicleKeys, ...] = Field(min_length=1)

    @model_validator(mode="after")
    def _one_of_each(self) -> "StockFile":
        ids = [vehicle.id for vehicle in self.vehicles]
        for name in ids:
            if ids.count(name) > 1:
                raise ValueError(f"vehicles: id {name!r} is there twice")
        return self
