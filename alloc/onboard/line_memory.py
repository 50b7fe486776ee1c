"""What a train remembers of its line and learns its resistance from: position, tunnels, gradients, samples.

In: position and speed as detected (JP H07-322414, detector 6, 16). Out: the section's weights, the gradient, and regressors
of the force that a motion needs, (2), (3), (6), (7).
"""

from __future__ import annotations

import math
from collections import deque
from dataclasses import dataclass
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.errors import OnboardError
from alloc.plant.laws import gradient_force
from alloc.plant.model import Floats

# What the train remembers of its line: open or tunnel, and gradient, by position (JP H07-322414 Figs. 2, 5).


@dataclass(frozen=True)
class LineMemory:
    """Section memory 72 and gradient memory 75.

    `stations` [m] are the starts of sections with `gradients` [%] (the source's Y: rise per run times 100), before the first
    and beyond the last the nearest holds; `tunnels`: start and end of each [m]. `offsets` [m]: where along the train the
    memory is read, relative to the position that is reported. The source reads at one position, (0.0,); the middle of every
    car is nearer to a long train, which passes a tunnel mouth gradually (not in the source): `air_shares` of the air
    resistance and `mass_shares` of the mass belong to each of `offsets`, equal ones where none are given. Without feedback,
    a change of d [m/s2] met by a train of length L at speed V changes the speed for a while. The change is d L / (2 V) if
    the memory is read at the front, d L / (8 V) if it is read in the middle.
    """

    stations: tuple[float, ...] = (0.0,)
    gradients: tuple[float, ...] = (0.0,)
    tunnels: tuple[tuple[float, float], ...] = ()
    offsets: tuple[float, ...] = (0.0,)
    air_shares: tuple[float, ...] = ()
    mass_shares: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        if len(self.stations) != len(self.gradients) or not self.stations:
            raise OnboardError(
                f"line memory: {len(self.stations)} stations and {len(self.gradients)} gradients; give as "
                "many of each, at least one"
            )
        for name in ("stations", "gradients", "offsets"):
            values = getattr(self, name)
            if not values or not np.all(np.isfinite(values)):
                raise OnboardError(f"line memory: {name} = {values} must be finite, at least one")
        if any(b < a for a, b in zip(self.stations, self.stations[1:], strict=False)):
            raise OnboardError(f"line memory: stations {self.stations} must not fall")
        for start, end in self.tunnels:
            if not start < end:
                raise OnboardError(f"line memory: tunnel from {start} to {end} m must end later")
        for name in ("air_shares", "mass_shares"):
            shares = getattr(self, name)
            if shares and not (
                len(shares) == len(self.offsets)
                and min(shares) >= 0.0
                and abs(sum(shares) - 1.0) < 1e-9
            ):
                raise OnboardError(
                    f"line memory: {name} = {shares} must be one per offset, 0 or greater, of the sum 1"
                )

    @cached_property
    def _slopes(self) -> Floats:
        """g sin(theta) [m/s2] of each section; sin(theta) = (Y/100) / sqrt(1 + (Y/100)^2), (1)."""
        return np.array([float(gradient_force(1.0, y / 100.0)) for y in self.gradients])

    @cached_property
    def _pieces(self) -> tuple[Floats, Floats, Floats]:
        """Places [m] of changes; share in tunnels (0 or 1) and g sin(theta) [m/s2] before, between and behind them."""
        mouths = [mouth for tunnel in self.tunnels for mouth in tunnel]
        places = np.unique(np.array([*self.stations, *mouths]))
        at = np.append(places[0] - 1.0, places)
        inside = np.zeros(at.size)
        for start, end in self.tunnels:
            inside[(at >= start) & (at < end)] = 1.0
        section = np.clip(np.searchsorted(self.stations, at, side="right") - 1, 0, None)
        return places, inside, self._slopes[section]

    def read(self, position: ArrayLike) -> tuple[Floats, Floats]:
        """Share in tunnels (0 or 1 where the memory is read at one point) and g sin(theta) [m/s2] at `position` [m]."""
        places, inside, slopes = self._pieces
        x = np.asarray(position, dtype=float)[..., None] + np.asarray(self.offsets)
        piece = places.searchsorted(x, side="right")
        return _over(inside[piece], self.air_shares), _over(slopes[piece], self.mass_shares)

    @cached_property
    def changes(self) -> tuple[float, ...]:
        """Positions [m] at which section or gradient change."""
        mouths = [mouth for tunnel in self.tunnels for mouth in tunnel]
        grades = zip(self.stations[1:], self.gradients, self.gradients[1:], strict=False)
        return tuple(sorted([*mouths, *(x for x, before, after in grades if before != after)]))

    def straddled(self, position: ArrayLike, length: float) -> NDArray[np.bool_]:
        """Whether one of the `changes` lies under the train, whose `length` [m] is behind `position` [m]."""
        x = np.asarray(position, dtype=float)
        changes = np.array(self.changes)
        return changes.searchsorted(x, side="right") > changes.searchsorted(
            x - length, side="right"
        )


def _over(values: Floats, shares: tuple[float, ...]) -> Floats:
    """Mean of `values` (..., offsets) by `shares`, the plain mean where there are none; (...)."""
    if shares:
        found: Floats = values @ np.array(shares)
        return found
    return np.add.reduce(values, axis=-1) / values.shape[-1]


# Position and speed as the train has them: the position and speed detector 6, 16 of JP H07-322414 (paragraph 0022).


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

    def count(self, position: float, speed: float, wheel_speed: Floats) -> _Count:
        """A count that begins here."""
        return _Count(self, position, wheel_speed)


@dataclass(frozen=True)
class CoilCounter:
    """Distance by the number of coils of the track that the train has passed, one every `spacing` [m]; paragraph 0022.

    The source's way where no motor turns, as in magnetic levitation: a sensor counts "ground coils", and the speed is the
    distance differentiated. The position is that of the last coil, and the error of up to `spacing` does not grow. The speed
    is the mean between the last two coils, and less where the next one is overdue. It is not a reset of a count of wheels,
    which is the `stations` of `Odometer`. The train runs forward.
    """

    spacing: float

    def __post_init__(self) -> None:
        OnboardError.check("coil counter", self, positive=("spacing",), infinite=())

    def count(self, position: float, speed: float, wheel_speed: Floats) -> _CoilCount:
        """A count that begins here."""
        return _CoilCount(self.spacing, position, speed)


@dataclass(frozen=True)
class PositionDetector:
    """What position and speed the train gets: by an `odometer` or by coils, or the true ones where there is neither.

    `delay` [s]: both are late by it. `speed_noise` [m/s]: standard deviation of the speed, white, drawn from `seed`.
    """

    odometer: Odometer | CoilCounter | None = None
    delay: float = 0.0
    speed_noise: float = 0.0
    seed: int = 0

    def __post_init__(self) -> None:
        nonnegative = ("delay", "speed_noise")
        OnboardError.check("detector", self, nonnegative=nonnegative, infinite=())


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
        self._count: _Count | _CoilCount | None = None

    def read(
        self, time: float, position: float, speed: float, wheel_speed: Floats
    ) -> tuple[float, float]:
        """Position [m] and speed [m/s] as the train has them now; until signals come, those of the first instant.

        In: the true ones at `time` [s], and the speed of each axle's tread [m/s], (axles,).
        """
        signal = (position, speed)
        if self._odometer is not None:
            if self._count is None:
                self._count = self._odometer.count(position, speed, wheel_speed)
            signal = self._count.read(time, position, wheel_speed, self._period)
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

    def __init__(self, odometer: Odometer, position: float, wheel_speed: Floats) -> None:
        self._odometer = odometer
        if odometer.axles and max(odometer.axles) >= len(wheel_speed):
            raise OnboardError(
                f"odometer: axles = {odometer.axles} must lie below {len(wheel_speed)}, the number of axles"
            )
        self._axles = list(odometer.axles) or slice(None)
        self._counted = len(odometer.axles) or len(wheel_speed)
        passed = [place for place in odometer.stations if place <= position]
        come = position - passed[-1] if passed else 0.0
        self._passed = len(passed)
        self._position = position + self._residual() + odometer.scale_error * come
        self._speed = self._turning(wheel_speed)

    def _turning(self, wheel_speed: Floats) -> float:
        wheels = float(np.add.reduce(wheel_speed[self._axles])) / self._counted
        return (1.0 + self._odometer.scale_error) * wheels

    def _residual(self) -> float:
        """Error of the position at the last station passed [m]."""
        return (
            self._odometer.residuals[self._passed - 1]
            if self._odometer.residuals and self._passed
            else 0.0
        )

    def read(
        self, time: float, position: float, wheel_speed: Floats, period: float
    ) -> tuple[float, float]:
        speed = self._turning(wheel_speed)
        if time > 0.0:
            self._position += 0.5 * (speed + self._speed) * period
        self._speed = speed
        stations = self._odometer.stations
        while self._passed < len(stations) and stations[self._passed] <= position:
            self._passed += 1
            since = position - stations[self._passed - 1]
            self._position = position + self._residual() + self._odometer.scale_error * since
        return self._position, speed


class _CoilCount:
    """The count of coils every `spacing`; until two are passed, the `speed` of the first instant."""

    def __init__(self, spacing: float, position: float, speed: float) -> None:
        self._spacing, self._speed = spacing, speed
        self._count, self._before = math.floor(position / spacing), position
        self._passed: float | None = None
        """Instant of the last coil [s]; it lies between periods."""

    def read(
        self, time: float, position: float, wheel_speed: Floats, period: float
    ) -> tuple[float, float]:
        count = math.floor(position / self._spacing)
        if count > self._count:
            beyond = (position - count * self._spacing) / (position - self._before)
            passed = time - beyond * period
            if self._passed is not None:
                self._speed = (count - self._count) * self._spacing / (passed - self._passed)
            self._count, self._passed = count, passed
        self._before = position
        speed = self._speed
        if self._passed is not None and speed * (time - self._passed) > self._spacing:
            speed = self._spacing / (time - self._passed)
        return self._count * self._spacing, speed


# The force that a motion needs, linear in its weights: JP H07-322414 (2), (3), (6), (7) without the factor K_i.
#
# F = (W1 or W2) V^2 + W3 (a + g sin(theta)), W1 in the open, W2 in tunnels. Beyond the source: + A + B V, the rest of a
# running resistance, where five weights are used instead of three.
#
# W3 represents two masses of a train that are not equal: gravity pulls its mass M, while acceleration moves M and the
# equivalent mass of its turning wheelsets, M_r. Where M_r is known (it does not change with the load) M_r a is computed
# separately and W3 is M.


WEIGHTS = ("W1", "W2", "W3")
"""Air resistance in the open and in tunnels [kg/m], mass [kg]: the source's weights, K1, K2 and K3/g of its claim 2."""
EXTENDED_WEIGHTS = (*WEIGHTS, "A", "B")
"""Also constant [N] and linear [N s/m] running resistance; not in the source."""


class Motion(NamedTuple):
    """A motion, measured or commanded; numbers or arrays of one shape."""

    speed: ArrayLike
    """V or V_c [m/s]."""
    acceleration: ArrayLike
    """a or a_c [m/s2]."""
    slope: ArrayLike
    """g sin(theta) [m/s2], positive uphill."""
    tunnel: ArrayLike
    """0 open, 1 tunnel; the train's share in tunnels where the memory is read at several points."""


def regressor(motion: Motion, weights: int = 3) -> Floats:
    """Regressors Z (..., weights) of `motion`; 3 or 5 weights, in the order of `EXTENDED_WEIGHTS`.

    Z1 = V^2 in the open, Z2 = V^2 in tunnels, Z3 = a + g sin(theta), and 1 and V. The source prints Z3 = a below its
    (5); (2), (3), (6) and (7) make it a + g sin(theta).
    """
    if weights not in (len(WEIGHTS), len(EXTENDED_WEIGHTS)):
        raise OnboardError(f"running resistance: weights = {weights!r} must be 3 or 5")
    speed, acceleration, slope, tunnel = (np.asarray(value, dtype=float) for value in motion)
    square = speed * speed
    pull = acceleration + slope + 0.0 * speed
    found = np.empty((*np.broadcast_shapes(square.shape, tunnel.shape, pull.shape), weights))
    found[..., 0], found[..., 1], found[..., 2] = square * (1.0 - tunnel), square * tunnel, pull
    if weights == len(EXTENDED_WEIGHTS):
        found[..., 3], found[..., 4] = 1.0, speed
    return found


def compensation_force(weights: ArrayLike, motion: Motion) -> Floats:
    """Running resistance F_d = F_V + F_g [N] of claims 1 and 2: `weights` (K1, K2, K3/g, ...), measured `motion`.

    The acceleration does not enter: the feedback makes the force for it.
    """
    weights = np.asarray(weights, dtype=float)
    return regressor(motion._replace(acceleration=0.0), weights.size) @ weights


def feedforward_force(weights: ArrayLike, motion: Motion, rotating_mass: float = 0.0) -> Floats:
    """Force [N] of (2) and (3) for the commanded `motion`, claims 3 to 5; `rotating_mass` M_r [kg]."""
    weights = np.asarray(weights, dtype=float)
    own = rotating_mass * np.asarray(motion.acceleration, dtype=float)
    return regressor(motion, weights.size) @ weights + own


# Samples that resistance is learnt from: force and regressors of one control period, low-pass filtered alike.


class Regression(NamedTuple):
    """One sample of F = W Z."""

    regressor: Floats
    """Z, (weights,)."""
    target: float
    """F [N], less what turns the wheelsets where that is known."""
    feedback: float
    """I_FB / K_i [N], the error of claims 4 and 6."""
    acceleration: float
    """a [m/s2] alone, which the source prints as Z3."""


SETTLED = 3.0
"""Number of time constants after which the noise in the filter's output is filtered as well as possible."""


class RegressionFilter:
    """First-order low-pass of `time_constant` [s] over samples every `period` [s]; 0 s: none.

    A linear filter over both sides of F = W Z leaves W as it is, and takes the noise out of a = dV/dt. It starts anew,
    from zero on both sides, where the section changes, so that no sample mixes the open and a tunnel.
    """

    def __init__(self, time_constant: float, period: float) -> None:
        if not (math.isfinite(time_constant) and time_constant >= 0.0 and period > 0.0):
            raise OnboardError(
                f"regression filter: time_constant = {time_constant!r} must be 0 or greater, "
                f"period = {period!r} greater than 0"
            )
        self._share = 1.0 if time_constant == 0.0 else -math.expm1(-period / time_constant)
        self._wait = math.ceil(SETTLED * time_constant / period)
        self._state: Floats | None = None
        self._section: object = None
        self._count = 0

    def add(self, sample: Regression, section: object) -> Regression | None:
        """The filtered sample after this one, which belongs to `section` (open or tunnel); None until it has settled."""
        raw = np.array([*sample.regressor, sample.target, sample.feedback, sample.acceleration])
        if self._state is None or section != self._section:
            self._state, self._section, self._count = np.zeros_like(raw), section, 0
        self._state = self._state + self._share * (raw - self._state)
        self._count += 1
        if self._count <= self._wait:
            return None
        *_, target, feedback, acceleration = (float(value) for value in self._state)
        return Regression(self._state[:-3].copy(), target, feedback, acceleration)

    def restart(self) -> None:
        """Forget what went before, after samples that were left out."""
        self._state = None
