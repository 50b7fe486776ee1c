"""How fast a train may be along a line: limits of line and vehicle, and braking curves to all that comes."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from heapq import heappop, heappush
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from studies.files.study_error import StudyError
from studies.railtoolkit.records import Section

Floats = NDArray[np.float64]


class SpeedProfile:
    """Permitted speed by position of the train's front up to a stop; computed once, then looked up.

    A limit holds for the whole train: a higher one from where the rear of a train of this `length` [m] has left the
    lower one, a lower one from where the front reaches it. Every fall of the limit, and the stop at the end, is
    preceded by the curve v^2 = v_k^2 + 2 b (s_k - s) of the constant `deceleration` b [m/s2]. In (s, v^2) all curves
    are parallel, so the lowest of those still ahead is one minimum, taken from the end of the line backwards.
    `vehicle_limit` [m/s]: of the train itself. `end` [m]: where it stops; the end of the line by default.
    """

    def __init__(
        self,
        sections: Sequence[Section],
        length: float,
        deceleration: float,
        vehicle_limit: float = math.inf,
        end: float | None = None,
    ) -> None:
        if not (math.isfinite(deceleration) and deceleration > 0.0):
            raise StudyError(f"deceleration = {deceleration!r} m/s2 must be finite and exceed 0")
        if not (math.isfinite(length) and length >= 0.0):
            raise StudyError(f"train length = {length!r} m must be finite and 0 or greater")
        self.deceleration = deceleration
        self.end = sections[-1].end if end is None else end
        self.starts: list[float] = []
        """Positions [m] from which `limits` hold, growing."""
        self.limits: list[float] = []
        """[m/s]"""
        for edge, lowest in _lowest_under(sections, length):
            if edge >= self.end:
                break
            limit = min(vehicle_limit, lowest)
            if not math.isfinite(limit):
                raise StudyError(f"no speed limit at {edge:g} m, neither of line nor of vehicle")
            if not self.limits or limit != self.limits[-1]:
                self.starts.append(edge)
                self.limits.append(limit)
        falls = [
            (start, after)
            for start, (before, after) in zip(self.starts[1:], pairwise(self.limits), strict=True)
            if after < before
        ]
        falls.append((self.end, 0.0))
        self._falls = falls
        self._fall_stations = [station for station, _ in falls]
        intercepts = [speed**2 + 2.0 * deceleration * station for station, speed in falls]
        self._intercepts = np.minimum.accumulate(intercepts[::-1])[::-1].tolist()

    def limit(self, position: float) -> float:
        """Limit [m/s] for a train whose front is at `position` [m], without braking curves."""
        return self.limits[max(bisect_right(self.starts, position) - 1, 0)]

    def braking_speed(self, position: float) -> float:
        """Speed [m/s] of the lowest braking curve at `position` [m]; 0 at the stop and beyond."""
        ahead = bisect_right(self._fall_stations, position)
        if ahead == len(self._intercepts):
            return 0.0
        return math.sqrt(self._intercepts[ahead] - 2.0 * self.deceleration * position)

    def braking_point(self, position: float, speed: float) -> tuple[float, float]:
        """Where [m] a train that goes on at `speed` [m/s] meets the first braking curve, and where [m] that ends."""
        double, met, leads = 2.0 * self.deceleration, math.inf, self.end
        for ahead in range(bisect_right(self._fall_stations, position), len(self._falls)):
            station, after = self._falls[ahead]
            begins = station - (speed**2 - after**2) / double
            if after < speed and begins < met:
                met, leads = begins, station
            if station - speed**2 / double > met:
                break  # curves of what comes later are met later
        return met, leads

    def next_fall(self, position: float) -> tuple[float, float]:
        """Where the lowest braking curve at `position` [m] leads: station [m] and speed [m/s]."""
        ahead = min(bisect_right(self._fall_stations, position), len(self._falls) - 1)
        lowest = self._intercepts[ahead]
        while ahead + 1 < len(self._falls) and self._intercepts[ahead + 1] == lowest:
            ahead += 1
        return self._falls[ahead]

    def next_change(self, position: float) -> float:
        """Position [m] beyond `position` where the limit changes next, or the train stops."""
        following = bisect_right(self.starts, position)
        return self.starts[following] if following < len(self.starts) else self.end

    def permitted(self, positions: ArrayLike) -> Floats:
        """The lower of limit and braking curve [m/s] at `positions` [m], same shape."""
        x = np.asarray(positions, dtype=float)
        values = [min(self.limit(p), self.braking_speed(p)) for p in x.ravel().tolist()]
        return np.asarray(values).reshape(x.shape)

    def shortest_time(self, start: float = -math.inf) -> float:
        """Bound from below [s] of any running time from `start` [m]: always at the limit, the whole way."""
        edges = [max(edge, start) for edge in (*self.starts, self.end)]
        return sum(
            (b - a) / limit for (a, b), limit in zip(pairwise(edges), self.limits, strict=True)
        )


def _lowest_under(sections: Sequence[Section], length: float) -> list[tuple[float, float]]:
    """Positions [m] of the front at which the lowest limit [m/s] under the train may change, and that limit."""
    edges = {section.start for section in sections}
    edges |= {section.start + length for section in sections[1:]}
    found, under, entered = [], list[tuple[float, float]](), 0
    for edge in sorted(edges):
        while entered < len(sections) and sections[entered].start <= edge:
            heappush(under, (sections[entered].speed_limit, sections[entered].end))
            entered += 1
        while under[0][1] <= edge - length and len(under) > 1:
            heappop(under)  # its end, and with it its limit, lies behind the rear
        found.append((edge, under[0][0]))
    return found
