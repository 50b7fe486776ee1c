"""Position and speed as the train has them: the position and speed detector 6, 16 of JP H07-322414 (paragraph 0022)."""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from alloc.errors import OnboardError

if TYPE_CHECKING:
    from alloc.onboard.driver import TrainSense

GREATEST_SCALE = 0.5
"""Share by which no wheel's radius is wrong."""


@dataclass(frozen=True)
class Odometer:
    """Distance and speed by the turns of wheels, as the source has them from the motor's; not in the source: its errors.

    `scale_error`: share by which the assumed wheel radius is too large; distance and speed are too large by the same share.
    Creep of the counted wheels adds to it: `axles` by their number from the front, the mean of all where none is named. When
    the front passes one of `stations` [m], which must increase, the position is set to that of the station, off by its entry
    of `residuals` [m] (none: without error). A station behind the start of the run counts, because the train has come from
    it. Without any, the run begins at its true position.
    """

    scale_error: float = 0.0
    stations: tuple[float, ...] = ()
    residuals: tuple[float, ...] = ()
    axles: tuple[int, ...] = ()

    def __post_init__(self) -> None:
        if not abs(self.scale_error) <= GREATEST_SCALE:
            raise OnboardError(
                f"odometer: scale_error = {self.scale_error!r} must lie within -{GREATEST_SCALE:g} and {GREATEST_SCALE:g}"
            )
        for name in ("stations", "residuals"):
            if not np.all(np.isfinite(getattr(self, name))):
                raise OnboardError(f"odometer: {name} = {getattr(self, name)} must be finite")
        if any(not b > a for a, b in zip(self.stations, self.stations[1:], strict=False)):
            raise OnboardError(f"odometer: stations {self.stations} must grow")
        if self.residuals and len(self.residuals) != len(self.stations):
            raise OnboardError(
                f"odometer: {len(self.stations)} stations and {len(self.residuals)} residuals; give as many of each, "
                "or no residuals"
            )
        if any(axle < 0 for axle in self.axles):
            raise OnboardError(f"odometer: axles = {self.axles} count from 0")


@dataclass(frozen=True)
class PositionDetector:
    """What position and speed the train gets: by an `odometer`, or the true ones where there is none.

    `delay` [s]: both are late by it. `speed_noise` [m/s]: standard deviation of the speed, white, drawn from `seed`.
    """

    odometer: Odometer | None = None
    delay: float = 0.0
    speed_noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        OnboardError.check("detector", self, nonnegative=("delay", "speed_noise"))
        OnboardError.check_finite("detector", self, ("delay", "speed_noise"))


class Detection:
    """A `detector` at work in one run; ask it once per `period` [s]."""

    def __init__(self, detector: PositionDetector, period: float) -> None:
        self._odometer, self._noise_size = detector.odometer, detector.speed_noise
        self._noise = np.random.default_rng(detector.seed)
        whole = math.ceil(detector.delay / period - 1e-9)
        self._signals: deque[tuple[float, float]] = deque(maxlen=whole + 1)
        self._newer = whole - detector.delay / period
        """Share of the sample after the oldest one that is kept: delays lie between periods too."""
        self._period = period
        self._count: _Count | None = None

    def read(self, sense: TrainSense) -> tuple[float, float]:
        """Position [m] and speed [m/s] as the train has them now; until signals come, those of the first instant."""
        signal = (sense.position, sense.speed)
        if self._odometer is not None:
            if self._count is None:
                self._count = _Count(self._odometer, sense)
            signal = self._count.read(sense, self._period)
        self._signals.append(signal)
        position, speed = self._signals[0]
        if self._newer > 0.0 and len(self._signals) == self._signals.maxlen:
            later = self._signals[1]
            position += self._newer * (later[0] - position)
            speed += self._newer * (later[1] - speed)
        if self._noise_size > 0.0:
            speed += self._noise_size * float(self._noise.standard_normal())
        return position, speed


class _Count:
    """The count of one odometer."""

    def __init__(self, odometer: Odometer, sense: TrainSense) -> None:
        self._odometer = odometer
        if odometer.axles and max(odometer.axles) >= len(sense.wheel_speed):
            raise OnboardError(
                f"odometer: axles = {odometer.axles} must lie below {len(sense.wheel_speed)}, the number of axles"
            )
        self._axles = list(odometer.axles) or slice(None)
        self._counted = len(odometer.axles) or len(sense.wheel_speed)
        passed = [place for place in odometer.stations if place <= sense.position]
        come = sense.position - passed[-1] if passed else 0.0
        self._passed = len(passed)
        self._position = sense.position + self._residual() + odometer.scale_error * come
        self._speed = self._turning(sense)

    def _turning(self, sense: TrainSense) -> float:
        wheels = float(np.add.reduce(sense.wheel_speed[self._axles])) / self._counted
        return (1.0 + self._odometer.scale_error) * wheels

    def _residual(self) -> float:
        """Error of the position at the last station passed [m]."""
        return (
            self._odometer.residuals[self._passed - 1]
            if self._odometer.residuals and self._passed
            else 0.0
        )

    def read(self, sense: TrainSense, period: float) -> tuple[float, float]:
        speed = self._turning(sense)
        if sense.time > 0.0:
            self._position += 0.5 * (speed + self._speed) * period
        self._speed = speed
        stations = self._odometer.stations
        while self._passed < len(stations) and stations[self._passed] <= sense.position:
            self._passed += 1
            since = sense.position - stations[self._passed - 1]
            self._position = sense.position + self._residual() + self._odometer.scale_error * since
        return self._position, speed
