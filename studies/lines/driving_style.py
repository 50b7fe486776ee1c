"""How a line is driven: where the train stops and for how long, its share of the effort, and how long it coasts."""

from dataclasses import dataclass, replace

from studies.files.study_error import StudyError
from studies.lines.speed_profile import SpeedProfile
from studies.railtoolkit.records import PointOfInterest, RollingStock, RunningPath

LEAST_LEG = 50.0
"""Least distance [m] between two stops."""
LONGEST_DWELL = 3600.0
COASTING_ENDS = 1.5
"""Where the way to the next braking curve grows to so many times the coasting time the train stops coasting and pulls again:
a climb has slowed it. Larger than 1, so that it does not go to and fro."""


@dataclass(frozen=True)
class DrivingStyle:
    """`effort`: share of the tractive effort that is used at most. `coasting`: time [s] before a braking curve from which the
    train rolls without effort; 0 gives the minimum running time for that effort.
    """

    effort: float = 1.0
    coasting: float = 0.0

    def __post_init__(self) -> None:
        if not 0.0 < self.effort <= 1.0:
            raise StudyError(f"effort = {self.effort!r}: give a share of the tractive effort, above 0, 1 at most")
        if not 0.0 <= self.coasting <= 3600.0:
            raise StudyError(f"coasting = {self.coasting!r} s: give a time from 0 to 3600 s")


FASTEST = DrivingStyle()


class Coasting:
    """Whether the train coasts, asked from place to place along a leg."""

    def __init__(self, style: DrivingStyle) -> None:
        self.time = style.coasting
        self.active = False

    def __call__(self, profile: SpeedProfile, position: float, speed: float) -> bool:
        """Whether the train is to coast at `position` [m] with `speed` [m/s]."""
        if self.time > 0.0:
            way = self.time * max(speed, 0.0)
            ahead = profile.braking_point(position, speed) - position
            self.active = ahead < (COASTING_ENDS * way if self.active else way)
        return self.active


@dataclass(frozen=True)
class Leg:
    """A run from stop to stop: its profile, and where it ends; the train stands there for the point's dwell."""

    profile: SpeedProfile
    stop: PointOfInterest


def legs(path: RunningPath, stock: RollingStock) -> tuple[Leg, ...]:
    """The run over a line, stop by stop; the last leg ends at the end of the line, where the run is over."""
    end = PointOfInterest(path.span[1], "end of the line", dwell=0.0)
    return tuple(
        Leg(
            SpeedProfile(
                path.sections, stock.length, stock.deceleration, stock.speed_limit, stop.station
            ),
            stop,
        )
        for stop in (*path.stops(), end)
    )


def with_stops(path: RunningPath, stops: tuple[PointOfInterest, ...]) -> RunningPath:
    """The line with these stops alone; raises `StudyError` where two are too close, or one lies off the line."""
    ordered = sorted(stops, key=lambda stop: stop.station)
    before = path.span[0]
    for stop in ordered:
        if not 0.0 <= (stop.dwell or 0.0) <= LONGEST_DWELL:
            raise StudyError(f"stop {stop.name!r}: dwell {stop.dwell:g} s must lie from 0 to {LONGEST_DWELL:g} s")
        if not before + LEAST_LEG <= stop.station <= path.span[1] - LEAST_LEG:
            raise StudyError(
                f"stop {stop.name!r} at {stop.station:g} m must lie {LEAST_LEG:g} m or more from other stops and from the "
                f"ends of the line, {path.span[0]:g} m and {path.span[1]:g} m"
            )
        before = stop.station
    named = {(stop.station, stop.name) for stop in ordered}
    rest = [replace(p, dwell=None) for p in path.points if (p.station, p.name) not in named]
    return replace(path, points=tuple(sorted([*rest, *ordered], key=lambda p: p.station)))
