"""A user's own line as a TOML file: sections with speed limit and gradient, and points to pass or to stop at."""

from typing import Literal

from pydantic import Field, model_validator

from studies.files.strict import Strict, parse, read_toml
from studies.railtoolkit.reading import read_path
from studies.railtoolkit.vehicles import (
    MOST_SECTIONS,
    PointOfInterest,
    RunningPath,
    check_line,
    check_points,
    sections,
)


class LimitedSectionKeys(Strict):
    """A stretch of line: `[[sections]]`. Source: the line's."""

    start_m: float
    """Position where it begins; sections stand in growing order."""
    limit_kmh: float
    """Speed limit."""
    grade_permille: float = 0.0
    """Gradient, positive uphill."""


class PointKeys(Strict):
    """A point that a part of the train passes: `[[points]]`. Source: the line's."""

    station_m: float
    """Position of the point, on the line."""
    name: str
    """Name of the point."""
    measure: Literal["front", "middle", "rear"] = "front"
    """Part of the train that is meant to pass it."""
    dwell_s: float | None = Field(default=None, ge=0.0)
    """Time for which the front stops there. Left out: the train passes without stopping."""

    def point(self) -> PointOfInterest:
        """The point of the line."""
        return PointOfInterest(self.station_m, self.name, self.measure, self.dwell_s)


class LineFileKeys(Strict):
    """The file: the line's name, where its figures come from, and where the last section ends. Source: the line's."""

    name: str = Field(min_length=1)
    """Name of the line."""
    source: str = ""
    """Where its figures come from."""
    end_m: float
    """Position where the last section ends."""
    sections: tuple[LimitedSectionKeys, ...] = Field(min_length=1, max_length=MOST_SECTIONS)
    """Stretches of constant speed limit and gradient."""
    points: tuple[PointKeys, ...] = Field(default=(), max_length=1000)
    """Points to pass or to stop at. Left out: none."""

    @model_validator(mode="after")
    def _fits(self) -> "LineFileKeys":
        rows = self.rows()
        check_line(rows, "sections")
        places = [(point.station_m, point.name) for point in self.points]
        check_points(places, (rows[0][0], rows[-1][0]), "points")
        return self

    def rows(self) -> list[tuple[float, float, float]]:
        """Sections as start [m], limit [km/h] and gradient [per mille]; the last one marks the end."""
        rows = [(one.start_m, one.limit_kmh, one.grade_permille) for one in self.sections]
        return [*rows, (self.end_m, *rows[-1][1:])]

    def path(self) -> RunningPath:
        """The line."""
        points = tuple(point.point() for point in self.points)
        return RunningPath(self.name, sections(self.rows()), points, self.source)


def read_line(path: str) -> RunningPath:
    """The line of a TOML file, or of a railtoolkit file; raises `StudyError` naming the file and the key."""
    if not path.lower().endswith(".toml"):
        return read_path(path)
    data = read_toml(
        path, "line", "give the path of a line in TOML, or of a railtoolkit running path"
    )
    return parse(LineFileKeys, data, path).path()
