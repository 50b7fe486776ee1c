"""Adhesion curves: tangential force coefficient over slip velocity, by their parameters; one's own among them.

A curve is a record with a name in `CURVES`. A run holds what it used: the `number` of the law and its `values`, so that no
class is needed to read it again.

    curve = PolachCurve(decay=0.4)
    curve(slip, peak, speed)       # coefficients
    curve.top(speed, peak)         # largest coefficient, and the slip velocity there
    own_curve("mine", lambda slip: slip * np.exp(-slip))
"""

import math
from collections.abc import Callable
from dataclasses import astuple, dataclass, field
from functools import cached_property, partial
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.backends import compiled as law
from alloc.compilation import force_inline, jit
from alloc.schema.errors import PlantError, blamed_on
from alloc.schema.parameters import PlantParameters, quantity
from alloc.schema.registry import Registry

Floats = NDArray[np.float64]
PIECEWISE, POLACH, SLIP_RATIO, RATIONAL, TABULATED, POLACH_BY_FRICTION = range(6)
BY_CREEP = (POLACH, SLIP_RATIO, POLACH_BY_FRICTION)
"""Curves over the creepage, slip over speed; the others are over the slip itself."""
KNOTS = 16_384
"""Points of a table of one's own, at equal steps of slip / (slip + that of the peak)."""
LARGEST = 20.0
"""Slip velocity [m/s] below which a curve has its peak."""
GOLDEN = 0.6180339887498949


# Compiled: by the number of the curve; `q`, its values, are the fields of its record in their order, or a `shape_table`


@force_inline
def coefficient(curve, q, slip, speed, rim, peak, contact):
    """Tangential force coefficient at this slip velocity."""
    if curve == PIECEWISE:
        return law.piecewise_coefficient(slip, peak, q[0], q[1], q[2], q[3], q[4])
    if curve == POLACH:
        stiffness = q[0] * contact
        return law.polach_coefficient(slip, speed, rim, peak, q[2], q[3], q[4], q[5], stiffness)
    if curve == POLACH_BY_FRICTION:
        return law.polach_by_friction(slip, speed, rim, peak, q[2], q[0] * contact)
    if curve == SLIP_RATIO:
        return law.slip_ratio_coefficient(slip, speed, rim, peak, q[0], q[1])
    if curve == RATIONAL:
        return law.rational_coefficient(slip, peak, q[0], q[1])
    place = abs(slip) / (abs(slip) + q[0]) * (q.size - 2)
    k = min(int(place), q.size - 3)
    value = peak * (q[1 + k] + (place - k) * (q[2 + k] - q[1 + k]))
    return value if slip >= 0.0 else -value


@jit
def top(curve, q, speed, peak, contact):
    """Largest coefficient of a driving axle at this speed, and the slip velocity [m/s] there."""
    if curve == PIECEWISE:
        return peak, law.piecewise_top(peak, q[0], q[1], q[2], q[3])
    if curve == SLIP_RATIO:
        return peak, law.slip_ratio_top(speed, q[0])
    if curve in (RATIONAL, TABULATED):
        return peak, q[0]
    # Polach's by golden section search; the bracket holds the peak of every published set
    low, width = 0.0, 0.1 * abs(speed) + 2.0
    a, b = low + (1.0 - GOLDEN) * width, low + GOLDEN * width
    at_a = coefficient(curve, q, a, speed, speed + a, peak, contact)
    at_b = coefficient(curve, q, b, speed, speed + b, peak, contact)
    for _ in range(40):
        width *= GOLDEN
        if at_a > at_b:
            b, at_b = a, at_a
            a = low + (1.0 - GOLDEN) * width
            at_a = coefficient(curve, q, a, speed, speed + a, peak, contact)
        else:
            low, a, at_a = a, b, at_b
            b = low + GOLDEN * width
            at_b = coefficient(curve, q, b, speed, speed + b, peak, contact)
    slip = low + 0.5 * width
    return coefficient(curve, q, slip, speed, speed + slip, peak, contact), slip


@jit
def _coefficients(curve, q, speed, peak, contact, slip, values):
    for i in range(slip.size):
        v, s = speed[i], slip[i]
        values[0, i] = coefficient(curve, q, s, v, v + s, peak[i], contact[i])


@jit
def _find_piecewise_tops(q0, q1, q2, q3, values):
    for i in range(values.shape[1]):
        values[1, i] = law.piecewise_top(values[0, i], q0, q1, q2, q3)


@jit
def _find_tops(curve, q, speed, peak, contact, values):
    for i in range(speed.size):
        values[0, i], values[1, i] = top(curve, q, speed[i], peak[i], contact[i])


def _find_each(function: Any, results: int, curve: int, q: Floats, *arguments: ArrayLike) -> Any:
    """What a compiled function finds for each element of arrays, which broadcast; (results, *shape)."""
    arrays = np.broadcast_arrays(*[np.asarray(array, dtype=float) for array in arguments])
    values = np.empty((results, arrays[0].size))
    function(curve, q, *[np.ascontiguousarray(array).ravel() for array in arrays], values)
    return values.reshape(results, *arrays[0].shape)


def find_tops(
    curve: int, q: Floats, speed: ArrayLike, peak: ArrayLike, contact: ArrayLike = 1.0
) -> Any:
    """`top` of arrays, as of a record's (ticks, axles): largest coefficients, and slip velocities [m/s] there."""
    if curve == PIECEWISE:  # no flat copies of what does not count, and no temporaries
        values = np.empty((2, *np.broadcast(speed, peak, contact).shape))
        values[0] = peak
        _find_piecewise_tops(*q[:4], values.reshape(2, -1))
        return values
    return _find_each(_find_tops, 2, curve, q, speed, peak, contact)


def steepest(curve: int, q: Floats, peak: float, contact: float = 1.0) -> float:
    """Greatest slope [s/m] over the slip velocity, at standstill, where it is greatest; the integration step needs it."""
    slip = np.append(0.0, np.geomspace(1e-6, LARGEST, 2_000))
    rise = np.diff(_find_each(_coefficients, 1, curve, q, 0.0, peak, contact, slip)[0])
    return float(np.abs(rise / np.diff(slip)).max())


# Records: a field is a key of `[rail.curve]`


@dataclass(frozen=True)
class AdhesionCurve(PlantParameters):
    """What all curves have: the number of the law and what it takes; coefficients and their top."""

    number: ClassVar[int] = -1

    @property
    def owner(self) -> str:
        """As in `Record`."""
        return "adhesion curve"

    @cached_property
    def values(self) -> Floats:
        """What the law takes: the fields in their order. What is left out bounds nothing."""
        return np.array([math.inf if value is None else value for value in astuple(self)])

    def contact(self, load: ArrayLike, radius: ArrayLike) -> Floats:
        """Creep stiffness under a wheel load [N], half an axle's, on a wheel radius [m], over that in `values`."""
        return np.ones(np.broadcast(load, radius).shape)

    def __call__(
        self, slip: ArrayLike, peak: ArrayLike, speed: ArrayLike = 0.0, contact: ArrayLike = 1.0
    ) -> Floats:
        """Tangential force coefficient at a slip velocity [m/s] where the rail offers `peak`; `speed` of the car [m/s]."""
        return _find_each(_coefficients, 1, self.number, self.values, speed, peak, contact, slip)[0]

    def top(self, speed: ArrayLike, peak: ArrayLike, contact: ArrayLike = 1.0) -> Any:
        """Largest coefficient of a driving axle at `speed` [m/s], and the slip velocity [m/s] there."""
        return find_tops(self.number, self.values, speed, peak, contact)


@dataclass(frozen=True)
class PiecewiseCurve(AdhesionCurve):
    """Line, parabola, exponential.

    Source: readhesion paper (1)-(6).
    """

    number = PIECEWISE
    micro_slope: float = quantity(5.0, "s/m", above=0.0)
    """Slope g1 at the origin."""
    top_curvature: float = quantity(40.0, "(s/m)^2", above=0.0)
    """Curvature C at the peak."""
    macro_slope: float = quantity(0.05, "s/m", above=0.0)
    """Slope g2 beyond the peak."""
    residual_ratio: float = quantity(0.9, "1", most=0.999)
    """Coefficient at infinite slip over the peak. Source: assumed: a trial calibration of the paper's findings."""
    constant_residual: float | None = quantity(None, "1", above=0.0)
    """Coefficient mu_inf at infinite slip, at every peak; at most `residual_ratio` of the peak counts. Left out: that
    ratio of every peak. Source: readhesion paper (1)."""


# Creep stiffness of Polach's law, G pi a b C11 / (4 Q) with the half axes a along and b across the rail. Here a b is that
# of a cylinder on a rail head of constant width, as in Open Rails (`Axle.cs`, `PolachCalculator`): it grows as sqrt(Q R), so
# the stiffness falls as Q^-1/2.

SHEAR_MODULUS, YOUNGS_MODULUS = 8.4e10, 2.07e11
"""Of steel [Pa], as in Polach's and Open Rails' sets."""
HALF_WIDTH = 6e-3
"""Half of the contact's width across the rail [m]: Open Rails."""
CYLINDER = 1.52
"""Half length of a cylinder's contact over sqrt(load x radius / (length x modulus)): Hertz, Poisson's ratio 0.3."""
WHEEL_LOAD, WHEEL_RADIUS = 1e5, 0.5
"""Wheel load [N] and radius [m] of the contact that a curve describes where no axle is named."""


@dataclass(frozen=True)
class CreepCurve(AdhesionCurve):
    """Polach's curves from wet to dry: B, kA, kS follow from the local friction coefficient, `laws.polach_by_friction`.

    What the rail offers is that coefficient at rest, a little above the greatest tangential one.

    Source: Polach, Wear 258 (2005), Table 3; Open Rails.
    """

    number = POLACH_BY_FRICTION
    creep_stiffness: float | None = quantity(None, "1", above=0.0)
    """Creep stiffness G pi a b C11 / (4 Q). Left out: that of each axle's wheel load and radius."""
    half_axes_ratio: float = quantity(1.137, "1", least=0.1, most=2.0)
    """Half axes a / b of the contact ellipse, a along the rail. Source: Hertz, for a cylinder of the reference contact."""
    ratio_at_infinity: float = quantity(0.40, "1")
    """Friction at infinite slip over that at rest, A."""

    @cached_property
    def values(self) -> Floats:
        """As in `AdhesionCurve`; where no creep stiffness is given, that of the reference contact."""
        cross = 2.0 * HALF_WIDTH * YOUNGS_MODULUS
        area = math.pi * HALF_WIDTH * CYLINDER * math.sqrt(WHEEL_LOAD * WHEEL_RADIUS / cross)
        ratio = self.half_axes_ratio
        c11 = 0.32955 * ratio**2 + 0.48538 * ratio + 3.4992  # Open Rails' fit of Kalker's table
        stiffness = SHEAR_MODULUS * area * c11 / (4.0 * WHEEL_LOAD)
        return np.array([self.creep_stiffness or stiffness, *astuple(self)[1:]])

    def contact(self, load: ArrayLike, radius: ArrayLike) -> Floats:
        """As in `AdhesionCurve`: 1 where the creep stiffness is given."""
        if self.creep_stiffness is not None:
            return super().contact(load, radius)
        load, radius = np.asarray(load, dtype=float), np.asarray(radius, dtype=float)
        return np.asarray(np.sqrt(WHEEL_LOAD / load * (radius / WHEEL_RADIUS)))


@dataclass(frozen=True)
class PolachCurve(CreepCurve):
    """Polach's curve with one set for every friction coefficient; by default his set for wet rail, 0.30.

    Source: Polach, Wear 258 (2005), (1)-(9), Table 3.
    """

    number = POLACH
    decay: float = quantity(0.20, "s/m", least=1e-9)
    """Decay B of the friction over the slip velocity."""
    adhesion_factor: float = quantity(0.30, "1", above=0.0)
    """Reduction kA of the creep stiffness in the area of adhesion."""
    slip_factor: float = quantity(0.10, "1", above=0.0)
    """Reduction kS of the creep stiffness in the area of slip."""


@dataclass(frozen=True)
class DryPolachCurve(PolachCurve):
    """Polach's curve with his set for dry rail, whose friction coefficient is 0.55."""

    decay: float = quantity(0.60, "s/m", least=1e-9)
    adhesion_factor: float = quantity(1.00, "1", above=0.0)
    slip_factor: float = quantity(0.40, "1", above=0.0)


@dataclass(frozen=True)
class SlipRatioCurve(AdhesionCurve):
    """Curve by slip ratio, flat beyond its peak where `residual_ratio` is 1.

    Source: assumed.
    """

    number = SLIP_RATIO
    peak_slip_ratio: float = quantity(0.05, "1", above=0.0, most=0.999)
    """Slip ratio of the peak."""
    residual_ratio: float = quantity(1.0, "1", most=1.0)
    """Coefficient far beyond the peak over that of the peak."""


@dataclass(frozen=True)
class RationalCurve(AdhesionCurve):
    """n x / (1 + (n - 2) x + x^2), x = slip / `peak_slip`: with n = 1.7 near the piecewise curve, with 15 to 50 Polach's.

    Source: Kiencke and Daiss (1994), for tyres; the values are assumed.
    """

    number = RATIONAL
    peak_slip: float = quantity(0.06, "m/s", above=0.0)
    """Slip velocity of the peak."""
    steepness: float = quantity(2.0, "1", above=0.0)
    """Slope n at the origin over peak / `peak_slip`."""


# Curves of one's own


def shape_table(shape: Callable[[Floats], ArrayLike], owner: str) -> Floats:
    """Slip velocity of the peak of `shape(slip)`, then the shape over its peak at `KNOTS` values of slip / (slip + that).

    Raises `PlantError` for a shape that does not rise from 0 to one maximum.
    """
    slip = np.append(0.0, np.geomspace(1e-4, LARGEST, 20_000))
    with blamed_on(owner, shape):
        values = np.asarray(shape(slip), dtype=float)
    if values.shape != slip.shape or not np.all(np.isfinite(values)) or values.min() < -1e-9:
        raise PlantError(f"{owner}: give a finite value, 0 or greater, for every slip velocity")
    best = int(values.argmax())
    rises = np.all(np.diff(values[: best + 1]) > -1e-9 * values[best])
    if not (0 < best < slip.size - 1 and rises and abs(values[0]) <= 1e-6 * values[best]):
        raise PlantError(f"{owner}: it must rise from 0 to one maximum below {LARGEST:g} m/s")
    places = np.append(np.arange(KNOTS) / np.arange(KNOTS, 0, -1), 1e6)
    return np.append(slip[best], np.asarray(shape(slip[best] * places)) / values[best])


@dataclass(frozen=True)
class ShapedCurve(AdhesionCurve):
    """Base of curves given by a `shape` over the slip velocity; the rail gives the peak, so only ratios of it count."""

    number = TABULATED

    def shape(self, slip: Floats) -> ArrayLike:
        """Coefficient at slip velocities of 0 or more [m/s], to any scale."""
        raise NotImplementedError

    @cached_property
    def values(self) -> Floats:
        """A `shape_table`, which raises `PlantError`."""
        return shape_table(self.shape, f"{self.owner} {type(self).__name__}")


@dataclass(frozen=True)
class ExponentialDifference(ShapedCurve):
    """c exp(-a v) - d exp(-b v) over the slip velocity v, usual in work on locomotives; by default its peak is at 1.2 m/s.

    Source: no single document.
    """

    a: float = quantity(0.54, "s/m", above=0.0)
    """Decay beyond the peak."""
    b: float = quantity(1.2, "s/m", above=0.0)
    """Decay before the peak, above `a`."""
    c: float = quantity(0.29, "1", above=0.0)
    """Size of the first term, to any scale."""
    d: float = quantity(0.29, "1", above=0.0)
    """Size of the second term; that of the first, so that no slip has no force."""

    def shape(self, slip: Floats) -> Floats:
        """As in `ShapedCurve`."""
        return self.c * np.exp(-self.a * slip) - self.d * np.exp(-self.b * slip)


@dataclass(frozen=True)
class Shoulder(ShapedCurve):
    """tanh(v / a) / (1 + f (v / b)^2 / (1 + (v / b)^1.2)): a steep rise, a broad shoulder, a slow algebraic fall.

    Source: this project, as a shape that no published curve has.
    """

    rise: float = quantity(0.1, "m/s", above=0.0)
    """Slip velocity a of the rise."""
    width: float = quantity(0.5, "m/s", above=0.0)
    """Slip velocity b from which it falls."""
    fall: float = quantity(0.6, "1", above=0.0)
    """How far it falls, f."""

    def shape(self, slip: Floats) -> Floats:
        """As in `ShapedCurve`."""
        far = slip / self.width
        return np.tanh(slip / self.rise) / (1.0 + self.fall * far**2 / (1.0 + far**1.2))


@dataclass(frozen=True)
class Burckhardt(ShapedCurve):
    """1 - exp(-c v) - d v, down to a floor: the usual form for tyres, over the slip velocity v.

    Source: Burckhardt (1993), for tyres and over the slip ratio; the values are assumed.
    """

    rise: float = quantity(20.0, "s/m", above=0.0)
    """Exponent c of the rise."""
    fall: float = quantity(0.3, "s/m", above=0.0)
    """Slope d of the fall."""
    floor: float = quantity(0.35, "1", above=0.0, most=0.999)
    """Least share that the fall leaves."""

    def shape(self, slip: Floats) -> Floats:
        """As in `ShapedCurve`."""
        return (1.0 - np.exp(-self.rise * slip)) * np.maximum(1.0 - self.fall * slip, self.floor)


@dataclass(frozen=True)
class TabulatedCurve(ShapedCurve):
    """A curve of one's own as `own_curve` makes it; equal ones have equal tables."""

    name: str
    memory: bytes = field(repr=False)
    """Its `shape_table`."""

    @cached_property
    def values(self) -> Floats:
        """As in `ShapedCurve`."""
        return np.frombuffer(self.memory).copy()


def own_curve(name: str, shape: Callable[[Floats], ArrayLike] | ArrayLike) -> TabulatedCurve:
    """A curve of this name by a function of the slip velocity [m/s], or by points (n, 2): slip velocity, coefficient.

    Raises `PlantError` where it does not rise from 0 to one maximum, or points do not go on.
    """
    owner = f"adhesion curve {name}"
    if not callable(shape):
        points = np.atleast_2d(np.asarray(shape, dtype=float))
        if points.ndim != 2 or points.shape[1] != 2 or not np.all(np.diff(points[:, 0]) > 0.0):
            raise PlantError(f"{owner}: give points (n, 2) with growing slip velocities")
        shape = partial(np.interp, xp=points[:, 0], fp=points[:, 1])
    return TabulatedCurve(name, shape_table(shape, owner).tobytes())


POLACH_WET, POLACH_DRY = PolachCurve(), DryPolachCurve()

CURVES: Registry[Any] = Registry("adhesion curve")
"""Adhesion curves by the name that files give them: a class, whose fields are keys, or a curve that has none."""
for _name, _class in {
    "piecewise": PiecewiseCurve, "polach": PolachCurve, "slip-ratio": SlipRatioCurve, "rational": RationalCurve,
    "polach-wet": PolachCurve, "polach-dry": DryPolachCurve, "polach-by-friction": CreepCurve,
    "exponential-difference": ExponentialDifference, "shoulder": Shoulder, "burckhardt": Burckhardt,
}.items():  # fmt: skip
    CURVES.register(_name, _class)
