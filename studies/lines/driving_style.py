"""How a line is driven: where the train stops and for how long, its share of the effort, and how long it coasts."""

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

from alloc.display import displayed
from studies.files.study_error import StudyError, unknown
from studies.files.units import is_number
from studies.lines.speed_profile import SpeedProfile
from studies.railtoolkit.records import PointOfInterest, RollingStock, RunningPath

LEAST_LEG = 50.0
"""Least distance [m] between two stops."""
LONGEST_DWELL = 3600.0
USUAL_DWELL = 30.0
"""Time [s] at a stop of which nothing else is said: of local trains."""
SLOWEST_COASTING = 0.7
"""Share of the speed at which coasting began down to which it goes on; a train that a climb slows more pulls again."""


@displayed
@dataclass(frozen=True)
class DrivingStyle:
    """`effort`: share of the tractive effort that is used at most.

    `coasting`: time [s] before a braking curve from which the train rolls without effort; 0 gives the minimum running time.
    """

    effort: float = 1.0
    coasting: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.effort <= 1.0:
            raise StudyError(
                f"effort = {self.effort!r}: give a share of the tractive effort, above 0, 1 at most"
            )
        if not 0.0 <= self.coasting <= 3600.0:
            raise StudyError(f"coasting = {self.coasting!r} s: give a time from 0 to 3600 s")


FASTEST = DrivingStyle()


class Coasting:
    """Whether the train coasts, asked from place to place along a leg; once before each braking curve."""

    def __init__(self, style: DrivingStyle) -> None:
        self.time = style.coasting
        self._slowest: float | None = None
        """Speed [m/s] at which it ends; None before it has begun."""
        self._over = False
        self._curve = -math.inf
        """End of the braking curve before which it coasts [m]."""

    def __call__(self, profile: SpeedProfile, position: float, speed: float) -> bool:
        """Whether the train is to coast at `position` [m] with `speed` [m/s]."""
        if self.time == 0.0:
            return False
        met, curve = profile.braking_point(position, speed)
        if curve != self._curve:
            self._slowest, self._over, self._curve = None, False, curve
        if self._slowest is None and met - position < self.time * speed:
            self._slowest = SLOWEST_COASTING * speed
        self._over = self._over or (self._slowest is not None and speed < self._slowest)
        return self._slowest is not None and not self._over


@displayed
@dataclass(frozen=True)
class Leg:
    """A run from stop to stop: its profile, and where it ends; the train stands there for the point's dwell."""

    profile: SpeedProfile
    stop: PointOfInterest


def legs(path: RunningPath, stock: RollingStock) -> tuple[Leg, ...]:
    """The run over a line, stop by stop; the last leg ends at the end of the line, where the run is over.

    Raises `StudyError` where two stops are too close, or one lies off the line.
    """
    first, last = path.span
    found, before = [], first
    for stop in path.stops():
        place = stop.front_position(stock.length)
        if not 0.0 <= (stop.dwell or 0.0) <= LONGEST_DWELL:
            raise StudyError(
                f"stop {stop.name!r}: dwell {stop.dwell:g} s must lie from 0 to {LONGEST_DWELL:g} s"
            )
        if not before + LEAST_LEG <= place <= last - LEAST_LEG:
            raise StudyError(
                f"stop {stop.name!r}: the front stands at {place:g} m; that must be {LEAST_LEG:g} m or more from "
                f"other stops and from the ends of the line, {first:g} m and {last:g} m"
            )
        found.append((place, stop))
        before = place
    found.append((last, PointOfInterest(last, "end of the line", dwell=0.0)))
    return tuple(
        Leg(
            SpeedProfile(path.sections, stock.length, stock.deceleration, stock.speed_limit, place),
            stop,
        )
        for place, stop in found
    )


def with_stops(path: RunningPath, wanted: Sequence[str], dwell: float | None) -> RunningPath:
    """The line with stops at the `wanted` points alone, each a name or a station [m]; or at "all" points, or at "none".

    `dwell` [s]: how long it stands, in place of what the points say. Raises `StudyError` with the nearest name.
    """
    by_name = {point.name: point for point in path.points}
    chosen: list[PointOfInterest] = []
    for item in wanted:
        if item == "all":
            chosen += path.points
        elif item in by_name:
            chosen.append(by_name[item])
        elif is_number(item):
            chosen.append(PointOfInterest(float(item), f"{float(item):g} m"))
        elif item != "none":
            raise StudyError(
                f"{unknown('stop', item, [*by_name, 'all', 'none'])}; or give a station in m"
            )
    stops = {
        (point.station, point.name): replace(point, dwell=_dwell(point, dwell)) for point in chosen
    }
    rest = [replace(p, dwell=None) for p in path.points if (p.station, p.name) not in stops]
    points = sorted([*rest, *stops.values()], key=lambda point: point.station)
    return replace(path, points=tuple(points))


def _dwell(point: PointOfInterest, dwell: float | None) -> float:
    usual = USUAL_DWELL if point.dwell is None else point.dwell
    return usual if dwell is None else dwell
