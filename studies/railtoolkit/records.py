"""A line and a train as a line run needs them, from whatever file they come."""

import math
from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import Literal

from alloc.display import displayed
from alloc.plant.rail import Line
from alloc.plant.train import Train

Measure = Literal["front", "middle", "rear"]
SHARE_BEHIND: dict[Measure, float] = {"front": 0.0, "middle": 0.5, "rear": 1.0}
"""How far behind the front each point of the train is, as a share of its length."""


@displayed
@dataclass(frozen=True)
class Section:
    """A stretch of line of one gradient and one speed limit: start, end [m], grade as rise per run, limit [m/s]."""

    start: float
    """[m]"""
    end: float
    """[m]"""
    grade: float
    """Rise per run, positive uphill."""
    speed_limit: float = math.inf
    """[m/s]"""


@displayed
@dataclass(frozen=True)
class PointOfInterest:
    """A point of the line [m] that the train's front, middle or rear is to pass; with a dwell [s] the front stops there."""

    station: float
    """Its place on the line [m]."""
    name: str
    measure: Measure = "front"
    dwell: float | None = None
    """Time for which the front stops there [s]; None: the train passes."""

    def front_position(self, length: float) -> float:
        """Where the front of a train of this `length` [m] is when it passes."""
        return self.station + SHARE_BEHIND[self.measure] * length


@displayed
@dataclass(frozen=True)
class RunningPath:
    """A line, run from its start to its end."""

    name: str
    sections: tuple[Section, ...]
    points: tuple[PointOfInterest, ...] = ()
    source: str = ""

    @property
    def span(self) -> tuple[float, float]:
        """Start and end of the line [m]."""
        return self.sections[0].start, self.sections[-1].end

    def line(
        self, tunnels: tuple[tuple[float, float], ...] = (), tunnel_factor: float = 1.0
    ) -> Line:
        """The plant's line; running paths have no tunnels, so these are arguments."""
        return Line(
            stations=tuple(section.start for section in self.sections),
            grades=tuple(section.grade for section in self.sections),
            tunnels=tunnels,
            tunnel_factor=tunnel_factor,
        )

    def steepest(self) -> Section:
        """The steepest climb; the first one where several are equal."""
        return max(self.sections, key=lambda section: section.grade)

    def stops(self) -> tuple[PointOfInterest, ...]:
        """Points at which the train stops, in order."""
        return tuple(
            sorted((p for p in self.points if p.dwell is not None), key=lambda p: p.station)
        )


def sections(rows: Sequence[tuple[float, float, float]]) -> tuple[Section, ...]:
    """Sections from rows of start [m], limit [km/h], gradient [per mille]; the last row only marks the end of the line."""
    return tuple(
        Section(start, following[0], 1e-3 * grade, limit / 3.6)
        for (start, limit, grade), following in pairwise(rows)
    )


@displayed
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
