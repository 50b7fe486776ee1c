"""Adhesion curves: tangential force coefficient over slip velocity, by their parameters; a user's own shape among them.

In: validated parameters of a kind in `CURVES`. Out: the numbers that the laws of `alloc.old.plant.laws` take, the peak's
slip and coefficient, and creep stiffness from wheel load and radius.
"""

import math
from dataclasses import astuple, dataclass, replace
from functools import lru_cache
from typing import Any, ClassVar, Protocol, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.old.display import displayed
from alloc.old.errors import PlantError
from alloc.old.plant.laws import (
    CREEPAGE_SPEED_FLOOR,
    GROWTH_END,
    PIECEWISE,
    POLACH,
    POLACH_BY_FRICTION,
    RATIONAL,
    SLIP_RATIO,
    TABULATED,
    adhesion_limit,
    polach_set,
    tangential_coefficient,
)
from alloc.old.registry import Registry

# Creep stiffness of the contact of wheel and rail from wheel load and radius.
#
# Polach's law describes the contact by one number, G pi a b C11 / (4 Q), with the half axes a along and b across the
# rail. Here a b is that of a cylinder on a rail head of constant width, as in Open Rails (`Axle.cs`,
# `PolachCalculator`). It grows as sqrt(Q R), so stiffness falls as Q^-1/2. Between bodies that are curved both ways
# (Hertz) a b grows as Q^2/3, and stiffness would fall as Q^-1/3. But the contact width of worn profiles does not grow
# in that way with the load.


SHEAR_MODULUS = 8.4e10
"""Of steel [Pa], as in Polach's and Open Rails' sets."""

YOUNGS_MODULUS = 2.07e11
"""Of steel [Pa]."""

HALF_WIDTH = 6e-3
"""Half of the contact's width across the rail [m]: Open Rails' constant."""

CYLINDER = 1.52
"""Half length of a cylinder's contact over sqrt(load x radius / (length x modulus)): Hertz, Poisson's ratio 0.3."""

REFERENCE_LOAD, REFERENCE_RADIUS = 1e5, 0.5
"""Wheel load [N] and wheel radius [m] of the contact that a curve describes where no axle is named."""

HALF_AXES_RATIO = 1.137
"""a / b of the reference contact, by the same cylinder."""

RATIOS = (0.1, 2.0)
"""Ratios of the half axes for which `longitudinal_coefficient` is a fit of Kalker's table, to 9 % at its ends."""


def longitudinal_coefficient(half_axes_ratio: float) -> float:
    """Kalker's C11 over a / b: Open Rails' quadratic fit of his table."""
    return 0.32955 * half_axes_ratio**2 + 0.48538 * half_axes_ratio + 3.4992


def creep_stiffness(half_axes_ratio: float = HALF_AXES_RATIO) -> float:
    """G pi a b C11 / (4 Q) of the reference contact; 121 with the default ratio."""
    length = CYLINDER * math.sqrt(
        REFERENCE_LOAD * REFERENCE_RADIUS / (2.0 * HALF_WIDTH * YOUNGS_MODULUS)
    )
    area = math.pi * length * HALF_WIDTH
    return SHEAR_MODULUS * area * longitudinal_coefficient(half_axes_ratio) / (4.0 * REFERENCE_LOAD)


def relative_stiffness(load: ArrayLike, radius: ArrayLike) -> NDArray[np.float64]:
    """Creep stiffness under a wheel load `load` [N] of wheels of `radius` [m], over that of the reference contact."""
    load, radius = np.asarray(load, dtype=float), np.asarray(radius, dtype=float)
    return np.sqrt(REFERENCE_LOAD / load * (radius / REFERENCE_RADIUS))


# The shape of a user's own adhesion curve as a table, which the plant interpolates.


SHAPE_KNOTS = 16_384
KNOTS = np.append(np.arange(SHAPE_KNOTS) / np.arange(SHAPE_KNOTS, 0, -1), 1e6)
"""Slip over that of the peak at equal steps of slip / (slip + that of the peak); the last, infinity, as a large number."""


class Shaped(Protocol):
    """What has a shape over the slip velocity; equal ones have equal hashes."""

    def shape(self, slip: NDArray[np.float64]) -> ArrayLike:
        """Coefficient at `slip` >= 0 [m/s] to any scale."""

    def __hash__(self: object) -> int: ...


@lru_cache(maxsize=32)
def shape_table(curve: Shaped) -> NDArray[np.float64]:
    """Slip velocity of the peak [m/s], then the shape over the peak's at `KNOTS`; raises `PlantError` for no such curve."""
    owner = f"adhesion curve {type(curve).__name__}"
    slip = np.concatenate([[0.0], np.geomspace(1e-4, 20.0, 20_000)])
    values = np.asarray(curve.shape(slip), dtype=float)
    if values.shape != slip.shape or not np.all(np.isfinite(values)) or values.min() < -1e-9:
        raise PlantError(
            f"{owner}: shape must give a finite value, 0 or greater, per slip velocity"
        )
    top = int(values.argmax())
    if not 0 < top < slip.size - 1 or abs(values[0]) > 1e-6 * values[top]:
        raise PlantError(f"{owner}: shape must rise from 0 to one maximum below 20 m/s")
    at_knots = np.asarray(curve.shape(slip[top] * KNOTS), dtype=float)
    table = np.concatenate([[slip[top]], at_knots / values[top]])
    table.flags.writeable = False
    return table


# What all adhesion curves have in common.


@displayed
@dataclass(frozen=True)
class AdhesionCurve:
    """Common part of the curves: `kind` names the law in compiled code, the fields are its parameters."""

    kind: ClassVar[int] = -1

    @property
    def q(self) -> NDArray[np.float64]:
        """Parameters as the equations take them, (6,): the fields in their order, then zeros."""
        return np.append(astuple(self), np.zeros(6))[:6]

    def contact(self, load: ArrayLike, radius: ArrayLike) -> NDArray[np.float64]:
        """Creep stiffness over that in `q` under the wheel load `load` [N], half an axle's, of wheels of `radius` [m].

        1 where it depends on neither.
        """
        return np.ones(np.broadcast(load, radius).shape)

    def on(self, load: float, radius: float) -> Self:
        """This curve under the wheel load `load` [N], half an axle's, of wheels of `radius` [m]."""
        return self

    def steepest_slope(self, peak: float) -> float:
        """Upper bound of d mu / d slip velocity over all slip velocities and speeds [s/m], for the stable step.

        For the creep stiffness in `q`.
        """
        raise NotImplementedError

    def coefficient(
        self,
        slip: ArrayLike,
        peak: ArrayLike,
        speed: ArrayLike = 0.0,
        contact: ArrayLike = 1.0,
    ) -> NDArray[np.float64]:
        """Tangential force coefficient; `slip` and car `speed` in m/s; all arguments broadcast.

        `contact`: that of the axle, see there."""
        slip, peak, speed, contact = (
            np.asarray(a, dtype=float) for a in (slip, peak, speed, contact)
        )
        return tangential_coefficient(self.kind, self.q, slip, speed, speed + slip, peak, contact)

    def limit(
        self, peak: ArrayLike, speed: ArrayLike = 0.0, contact: ArrayLike = 1.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Adhesion coefficient and the slip velocity [m/s] of the curve's maximum, driving at `speed` >= 0 [m/s]."""
        peak, speed, contact = (np.asarray(a, dtype=float) for a in (peak, speed, contact))
        coefficient, slip = adhesion_limit(self.kind, self.q, peak, speed, contact)
        return np.asarray(coefficient), np.asarray(slip)


# Adhesion curves that are given by their shape alone.


@dataclass(frozen=True)
class ShapedCurve(AdhesionCurve):
    """Base class of a user's own curve: a subclass gives its `shape`; level, sign and table follow.

    The adhesion field gives the peak, so only ratios of the shape count. It depends on the slip velocity alone. The plant
    interpolates it linearly between the knots of `alloc.old.plant.adhesion`, to about 1e-5 of the peak.
    """

    kind: ClassVar[int] = TABULATED

    def shape(self, slip: NDArray[np.float64]) -> ArrayLike:
        """Coefficient at `slip` >= 0 [m/s] to any scale: 0 at 0, one maximum below 20 m/s, finite."""
        raise NotImplementedError

    @property
    def q(self) -> NDArray[np.float64]:
        """Slip velocity of the peak [m/s], then the shape over slip / (slip + that), 0 to 1."""
        return shape_table(self)

    def steepest_slope(self, peak: float) -> float:
        """Greatest slope between knots [s/m]."""
        table = self.q
        return float(peak * np.max(np.abs(np.diff(table[1:]) / np.diff(table[0] * KNOTS))))


@dataclass(frozen=True)
class ExponentialDifference(ShapedCurve):
    """c exp(-a v) - d exp(-b v) over the slip velocity v, common in work on locomotives; wet rail by default.

    Its peak is at 1.2 m/s, beyond the greatest slip that the MPC would hold.

    Source: the form and its usual values are those of work on readhesion control of locomotives; no single document.
    """

    a: float = 0.54
    """Decay beyond the peak [s/m]."""
    b: float = 1.2
    """Decay before the peak [s/m]; above `a`."""
    c: float = 0.29
    """Size of the first term, to any scale."""
    d: float = 0.29
    """Size of the second term; that of the first, so that no slip has no force."""

    def shape(self, slip: Any) -> Any:
        """Coefficient at a slip velocity of 0 or more [m/s], to any scale."""
        return self.c * np.exp(-self.a * slip) - self.d * np.exp(-self.b * slip)


# Adhesion curves: tangential force coefficient as a function of slip velocity, by their parameters.
#
# The laws are in `alloc.old.plant.laws`. Derive your own curve from `ShapedCurve` and register it in `CURVES`.


ShapedCurve = ShapedCurve


@dataclass(frozen=True)
class PiecewiseCurve(AdhesionCurve):
    """Curve of the readhesion paper, (1)-(6).

    The residual at infinite slip is not printed. This project chose 0.9 of the peak, the value that a trial calibration of
    the paper's findings suggests.

    Source: readhesion paper (1)-(6).
    """

    micro_slope: float = 5.0
    """Slope g1 at the origin [s/m]."""
    top_curvature: float = 40.0
    """Curvature C at the peak [(s/m)^2]."""
    macro_slope: float = 0.05
    """Slope g2 beyond the peak [s/m]."""
    residual_ratio: float = 0.9
    """Coefficient at infinite slip over the peak, below 1. Source: assumed: a trial calibration of the paper's findings."""
    constant_residual: float | None = None
    """Coefficient mu_inf at infinite slip, the same at every peak; where it exceeds `residual_ratio` of the peak, that
    counts. Left out: `residual_ratio` of every peak. Source: readhesion paper (1)."""
    kind: ClassVar[int] = PIECEWISE

    def __post_init__(self) -> None:
        given = () if self.constant_residual is None else ("constant_residual",)
        PlantError.check(
            "adhesion curve", self, positive=("micro_slope", "top_curvature", "macro_slope", *given)
        )
        if not 0.0 <= self.residual_ratio < 1.0:
            raise PlantError(
                f"adhesion curve: residual_ratio = {self.residual_ratio} must lie in [0, 1)"
            )

    @property
    def q(self) -> NDArray[np.float64]:
        """As in `AdhesionCurve`; a constant mu_inf that is left out bounds nothing."""
        *shape, most = astuple(self)
        return np.array([*shape, math.inf if most is None else most, 0.0])

    def steepest_slope(self, peak: float) -> float:
        """Slope at the origin [s/m]."""
        return max(self.micro_slope, self.macro_slope)

    def residual(self, peak: float) -> float:
        """Coefficient at infinite slip, mu_inf."""
        return float(min(self.q[3] * peak, self.q[4]))


@dataclass(frozen=True, kw_only=True)
class CreepCurve(AdhesionCurve):
    """Common part of Polach's curves: the contact. The local peak is the friction coefficient at rest.

    Source: Polach, Wear 258 (2005).
    """

    creep_stiffness: float | None = None
    """Creep stiffness G pi a b C11 / (4 Q) of the contact ellipse. Left out: that of the static wheel load (half the axle's)
    and the wheel radius of each axle. Source: `alloc.old.plant.adhesion`."""
    half_axes_ratio: float = HALF_AXES_RATIO
    """Half axes a / b of the contact ellipse, a along the rail. Source: `alloc.old.plant.adhesion`."""

    def __post_init__(self) -> None:
        given = () if self.creep_stiffness is None else ("creep_stiffness",)
        PlantError.check("adhesion curve", self, positive=(*given, "half_axes_ratio"))
        if not RATIOS[0] <= self.half_axes_ratio <= RATIOS[1]:
            raise PlantError(
                f"adhesion curve: half_axes_ratio = {self.half_axes_ratio} must lie in [{RATIOS[0]}, {RATIOS[1]}]"
            )

    def _parameters(self, ratio: float, *shape: float) -> NDArray[np.float64]:
        """Parameters as the laws take them; `shape`: B, kA and kS, where the friction coefficient does not give them."""
        decay, adhesion_factor, slip_factor = shape or (0.0, 0.0, 0.0)
        stiffness = self.creep_stiffness or creep_stiffness(self.half_axes_ratio)
        end = GROWTH_END / max(decay, 1e-9)
        return np.array([ratio, decay, adhesion_factor, slip_factor, stiffness, end])

    def contact(self, load: ArrayLike, radius: ArrayLike) -> NDArray[np.float64]:
        """As in `AdhesionCurve`: 1 where the creep stiffness is given."""
        if self.creep_stiffness is not None:
            return super().contact(load, radius)
        return relative_stiffness(load, radius)

    def on(self, load: float, radius: float) -> Self:
        """As in `AdhesionCurve`: the creep stiffness is given."""
        return replace(self, creep_stiffness=float(self.q[4] * self.contact(load, radius)))

    def steepest_slope(self, peak: float) -> float:
        """Slope at the origin at the lowest reference speed [s/m]."""
        _, adhesion_factor, slip_factor, _ = polach_set(self.kind, self.q, peak)
        factor = 2.0 / math.pi * (adhesion_factor + slip_factor)
        return float(factor * self.q[4] / CREEPAGE_SPEED_FLOOR)


@dataclass(frozen=True)
class PolachCurve(CreepCurve):
    """Polach's curve with one set A, B, kA, kS for every friction coefficient; the default is his set for wet rail, 0.30.

    Source: Polach, Wear 258 (2005), Table 3.
    """

    ratio_at_infinity: float = 0.40
    """Friction at infinite slip over that at rest, A."""
    decay: float = 0.20
    """Decay B of the friction over the slip velocity [s/m]."""
    adhesion_factor: float = 0.30
    """Reduction kA of the creep stiffness in the area of adhesion."""
    slip_factor: float = 0.10
    """Reduction kS of the creep stiffness in the area of slip."""
    kind: ClassVar[int] = POLACH

    def __post_init__(self) -> None:
        super().__post_init__()
        PlantError.check(
            "adhesion curve",
            self,
            positive=("adhesion_factor", "slip_factor"),
            nonnegative=("decay", "ratio_at_infinity"),
        )

    @property
    def q(self) -> NDArray[np.float64]:
        """Parameters (6,): A, B, kA, kS, creep stiffness (of the reference contact if None), end of growth."""
        return self._parameters(
            self.ratio_at_infinity, self.decay, self.adhesion_factor, self.slip_factor
        )


@dataclass(frozen=True)
class DryPolachCurve(PolachCurve):
    """Polach's curve with his set for dry rail, whose friction coefficient is 0.55."""

    decay: float = 0.60
    adhesion_factor: float = 1.00
    slip_factor: float = 0.40


@dataclass(frozen=True)
class RigPolachCurve(PolachCurve):
    """Polach's curve as a full-scale brake rig found wet wheels: its peak is below 1 % slip, at less the faster they turn.

    The contact keeps all of its theoretical stiffness, and friction falls as in his dry set. The rig's curves are not
    public, so the set meets what their abstract says, no more.

    Source: Wheel-Rail Adhesion Test Based on Full Scale Roller Rig, Resilience and Sustainable Transportation Systems
    (ASCE, 2020); the values are this project's.
    """

    decay: float = 0.60
    adhesion_factor: float = 1.00
    slip_factor: float = 1.00


@dataclass(frozen=True)
class PolachByFrictionCurve(CreepCurve):
    """Polach's curves over the local friction coefficient, from wet to dry: Open Rails' interpolation, see `polach_set`.

    Source: Polach, Wear 258 (2005), Table 3; Open Rails.
    """

    ratio_at_infinity: float = 0.40
    """Friction at infinite slip over that at rest, A."""
    kind: ClassVar[int] = POLACH_BY_FRICTION

    def __post_init__(self) -> None:
        super().__post_init__()
        PlantError.check("adhesion curve", self, nonnegative=("ratio_at_infinity",))

    @property
    def q(self) -> NDArray[np.float64]:
        """Parameters (6,): those of `PolachCurve`, without those that follow from the friction coefficient."""
        return self._parameters(self.ratio_at_infinity)


@dataclass(frozen=True)
class SlipRatioCurve(AdhesionCurve):
    """Curve by slip ratio with its peak at `peak_slip_ratio`; flat beyond it if `residual_ratio` is 1.

    Source: assumed.
    """

    peak_slip_ratio: float = 0.05
    """Slip ratio of the peak, below 1."""
    residual_ratio: float = 1.0
    """Coefficient far beyond the peak over that of the peak, 0 to 1."""
    kind: ClassVar[int] = SLIP_RATIO

    def __post_init__(self) -> None:
        PlantError.check("adhesion curve", self, positive=("peak_slip_ratio",))
        if not self.peak_slip_ratio < 1.0 or not 0.0 <= self.residual_ratio <= 1.0:
            raise PlantError(
                "adhesion curve: peak_slip_ratio must lie in (0, 1) and residual_ratio in [0, 1], got "
                f"{self.peak_slip_ratio} and {self.residual_ratio}"
            )

    def steepest_slope(self, peak: float) -> float:
        """Slope at the origin at the lowest reference speed [s/m]."""
        return 2.0 * peak / (self.peak_slip_ratio * CREEPAGE_SPEED_FLOOR)


@dataclass(frozen=True)
class RationalCurve(AdhesionCurve):
    """Curve with the slip velocity of its peak and its steepness: n x / (1 + (n - 2) x + x^2), x = slip / `peak_slip`.

    After Kiencke and Daiss (1994) for tyres. With steepness 2 its rise is that of `SlipRatioCurve`. With about 1.7 it is
    within 2 % of the piecewise curve, with 15 to 50 of Polach's on wet rail.

    Source: Kiencke and Daiss (1994), for tyres; the values are assumed.
    """

    peak_slip: float = 0.06
    """Slip velocity of the peak [m/s]."""
    steepness: float = 2.0
    """Slope n at the origin over peak / `peak_slip`."""
    kind: ClassVar[int] = RATIONAL

    def __post_init__(self) -> None:
        PlantError.check("adhesion curve", self, positive=("peak_slip", "steepness"))

    def steepest_slope(self, peak: float) -> float:
        """Slope at the origin, or at the inflection point before the peak if the steepness is below 2 [s/m]."""
        n = self.steepness
        # the second derivative is zero where x^3 - 3 x + 2 - n = 0
        x = 0.0 if n >= 2.0 else 2.0 * math.cos((math.acos(0.5 * n - 1.0) + 4.0 * math.pi) / 3.0)
        below = 1.0 + x * (x + n - 2.0)
        return peak / self.peak_slip * (n * (1.0 - x * x) / (below * below))


# A = mu_inf / mu_0, B [s/m], kA, kS: Polach, Wear 258 (2005), Table 3 (measurements with locomotives).
POLACH_DRY = DryPolachCurve()
POLACH_WET = PolachCurve()

CURVES: Registry[type[AdhesionCurve]] = Registry("adhesion curve", "readhesion.curves", PlantError)
"""Adhesion curves by name, one class each; its fields are the keys of `[rail.curve]`."""
CURVES.register("piecewise", PiecewiseCurve)
CURVES.register("polach", PolachCurve)
CURVES.register("slip-ratio", SlipRatioCurve)
CURVES.register("rational", RationalCurve)
CURVES.register("polach-wet", PolachCurve)
CURVES.register("polach-dry", DryPolachCurve)
CURVES.register("polach-rig", RigPolachCurve)
CURVES.register("polach-by-friction", PolachByFrictionCurve)
CURVES.register("exponential-difference", ExponentialDifference)
