"""How fast a train may be along a line: limits of line and vehicle, and braking curves to all that comes."""

import math
from bisect import bisect_right
from collections.abc import Sequence
from itertools import pairwise

import numpy as np
from numpy.typing import ArrayLike, NDArray

from studies.files.study_error import StudyError
from studies.railtoolkit.reading import Section

Floats = NDArray[np.float64]


class SpeedProfile:
    """Permitted speed by position of the train's front; computed once, then looked up.

    A limit holds for the whole train: a higher one from where the rear of a train of this `length` [m] has left the
    lower one, a lower one from where the front reaches it. Every fall of the limit, and the stop at the end, is
    preceded by the curve v^2 = v_k^2 + 2 b (s_k - s) of the constant `deceleration` b [m/s2]. In (s, v^2) all curves
    are parallel, so the lowest of those still ahead is one minimum, taken from the end of the line backwards.
    `vehicle_limit` [m/s]: of the train itself.
    """

    def __init__(
        self,
        sections: Sequence[Section],
        length: float,
        deceleration: float,
        vehicle_limit: float = math.inf,
    ) -> None:
        if not (math.isfinite(deceleration) and deceleration > 0.0):
            raise StudyError(f"deceleration = {deceleration!r} m/s2 must be finite and exceed 0")
        if not (math.isfinite(length) and length >= 0.0):
            raise StudyError(f"train length = {length!r} m must be finite and 0 or greater")
        self.deceleration = deceleration
        self.end = sections[-1].end
        first = sections[0].start
        edges = {section.start for section in sections}
        edges |= {section.start + length for section in sections[1:]}
        self.starts: list[float] = []
        """Positions [m] from which `limits` hold, growing."""
        self.limits: list[float] = []
        """[m/s]"""
        for edge in sorted(edge for edge in edges if first <= edge < self.end):
            under = (
                section.speed_limit
                for section in sections
                if section.start <= edge and section.end > edge - length
            )
            limit = min(vehicle_limit, *under)
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
        """Speed [m/s] of the lowest braking curve at `position` [m]; 0 at the end of the line and beyond."""
        ahead = bisect_right(self._fall_stations, position)
        if ahead == len(self._intercepts):
            return 0.0
        return math.sqrt(self._intercepts[ahead] - 2.0 * self.deceleration * position)

    def next_fall(self, position: float) -> tuple[float, float]:
        """Where the lowest braking curve at `position` [m] leads: station [m] and speed [m/s]."""
        ahead = min(bisect_right(self._fall_stations, position), len(self._falls) - 1)
        lowest = self._intercepts[ahead]
        while ahead + 1 < len(self._falls) and self._intercepts[ahead + 1] == lowest:
            ahead += 1
        return self._falls[ahead]

    def next_change(self, position: float) -> float:
        """Position [m] beyond `position` where the limit changes next, or the line ends."""
        following = bisect_right(self.starts, position)
        return self.starts[following] if following < len(self.starts) else self.end

    def permitted(self, positions: ArrayLike) -> Floats:
        """The lower of limit and braking curve [m/s] at `positions` [m], same shape."""
        x = np.asarray(positions, dtype=float)
        values = [min(self.limit(p), self.braking_speed(p)) for p in x.ravel().tolist()]
        return np.asarray(values).reshape(x.shape)

    def shortest_time(self) -> float:
        """Bound from below [s] of any running time: always at the limit, the whole line."""
        edges = [*self.starts, self.end]
        return sum(
            (b - a) / limit for (a, b), limit in zip(pairwise(edges), self.limits, strict=True)
        )
