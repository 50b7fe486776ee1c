"""Speed command over time, with bounded acceleration: the speed command unit 1 and 11 of JP H07-322414."""

import math
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from numpy.typing import ArrayLike

from alloc.errors import OnboardError
from alloc.plant.model import Floats


@dataclass(frozen=True)
class SpeedCommand:
    """Target `speeds` [m/s] from each of `times` [s] on, reached with `acceleration` [m/s2] up or down.

    Before the first time the command is `initial` [m/s]. Raises `OnboardError` for what is no command.
    """

    times: tuple[float, ...]
    speeds: tuple[float, ...]
    acceleration: float
    initial: float = 0.0

    def __post_init__(self) -> None:
        if len(self.times) != len(self.speeds) or not self.times:
            raise OnboardError(
                f"speed command: {len(self.times)} times and {len(self.speeds)} speeds; give as many of each"
            )
        if any(not b > a for a, b in zip(self.times, self.times[1:], strict=False)):
            raise OnboardError(f"speed command: times {self.times} must grow")
        for name, values in (
            ("times", self.times), ("speeds", self.speeds), ("initial", (self.initial,)),
        ):  # fmt: skip
            if not all(math.isfinite(value) and value >= 0.0 for value in values):
                raise OnboardError(f"speed command: {name} = {values} must be finite, 0 or greater")
        if not (math.isfinite(self.acceleration) and self.acceleration > 0.0):
            raise OnboardError(
                f"speed command: acceleration = {self.acceleration!r} must be finite and greater than 0"
            )

    @cached_property
    def _ramps(self) -> tuple[Floats, Floats, Floats]:
        """Beginnings [s] of constant acceleration, speeds [m/s] there and accelerations [m/s2]."""
        ramps = [(-math.inf, self.initial, 0.0)]
        speed = self.initial
        ends = [*self.times[1:], math.inf]
        for begin, end, target in zip(self.times, ends, self.speeds, strict=True):
            rate = math.copysign(self.acceleration, target - speed) if target != speed else 0.0
            ramps.append((begin, speed, rate))
            arrived = begin + abs(target - speed) / self.acceleration
            if rate and arrived < end:
                ramps.append((arrived, target, 0.0))
            speed = target if arrived <= end else speed + rate * (end - begin)
        begin, at, rates = np.array(ramps).T
        return begin, at, rates

    def at(self, time: ArrayLike) -> tuple[Floats, Floats]:
        """Commanded speed V_c [m/s] and acceleration a_c [m/s2] at `time` [s], of its shape."""
        begin, at, rates = self._ramps
        time = np.asarray(time, dtype=float)
        k = np.searchsorted(begin, time + 1e-9, side="right") - 1
        since = np.where(np.isinf(begin[k]), 0.0, time - begin[k])
        return at[k] + rates[k] * np.maximum(since, 0.0), rates[k]
