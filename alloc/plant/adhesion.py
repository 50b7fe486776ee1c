"""Adhesion curves: tangential force coefficient as a function of slip velocity, by their parameters.

The laws are in `alloc.plant.adhesion_laws`. Derive your own curve from `ShapedCurve` and register it in `CURVES`.
"""

import math
from dataclasses import dataclass, replace
from typing import ClassVar, Self

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.errors import PlantError
from alloc.plant.adhesion_curve import AdhesionCurve
from alloc.plant.adhesion_laws import (
    CREEPAGE_SPEED_FLOOR,
    GROWTH_END,
    PIECEWISE,
    POLACH,
    POLACH_BY_FRICTION,
    RATIONAL,
    SLIP_RATIO,
    polach_set,
)
from alloc.plant.contact import HALF_AXES_RATIO, RATIOS, creep_stiffness, relative_stiffness
from alloc.plant.shaped_curve import ExponentialDifference
from alloc.plant.shaped_curve import (
    ShapedCurve as ShapedCurve,  # beside the registry, for curves of plug-ins
)
from alloc.registry import Registry


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
    kind: ClassVar[int] = PIECEWISE

    def __post_init__(self) -> None:
        PlantError.check(
            "adhesion curve", self, positive=("micro_slope", "top_curvature", "macro_slope")
        )
        if not 0.0 <= self.residual_ratio < 1.0:
            raise PlantError(
                f"adhesion curve: residual_ratio = {self.residual_ratio} must lie in [0, 1)"
            )

    def steepest_slope(self, peak: float) -> float:
        """Slope at the origin [s/m]."""
        return max(self.micro_slope, self.macro_slope)


@dataclass(frozen=True, kw_only=True)
class CreepCurve(AdhesionCurve):
    """Common part of Polach's curves: the contact. The local peak is the friction coefficient at rest.

    Source: Polach, Wear 258 (2005).
    """

    creep_stiffness: float | None = None
    """Creep stiffness G pi a b C11 / (4 Q) of the contact ellipse. Left out: that of the static wheel load (half the axle's)
    and the wheel radius of each axle. Source: `alloc.plant.contact`."""
    half_axes_ratio: float = HALF_AXES_RATIO
    """Half axes a / b of the contact ellipse, a along the rail. Source: `alloc.plant.contact`."""

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

    def with_parameters(self, q: NDArray[np.float64]) -> Self:
        """This curve with the creep stiffness of `q` (6,)."""
        return replace(self, creep_stiffness=float(q[4]))

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
CURVES.register("polach-by-friction", PolachByFrictionCurve)
CURVES.register("exponential-difference", ExponentialDifference)
