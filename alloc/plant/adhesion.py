"""Adhesion curves: tangential force coefficient as a function of slip velocity.

Every curve is odd in the slip velocity and takes the local `peak` from the adhesion field. For the
piecewise and the slip-ratio curve `peak` is the adhesion coefficient, the maximum over the slip velocity;
for Polach's it is the friction coefficient, whose maximum over the slip velocity lies below it.
"""

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.compilation import equation
from alloc.errors import PlantError
from alloc.plant.operations import absolute, atan, exp, maximum, where

PIECEWISE, POLACH, SLIP_RATIO = 0, 1, 2

CREEPAGE_SPEED_FLOOR = 1.0
"""Speed [m/s] below which creepage-based curves see a constant reference speed.

Creepage divides by the speed and is singular at standstill; the floor bounds the stiffness, and with it
the number of substeps. A numerical device, not a property of the rail.
"""


@equation
def parabola_curvature(peak, micro_slope, top_curvature, macro_slope, residual_ratio):
    """Curvature C of the parabola, raised where the source's would not make a curve.

    The source needs C >= g1^2 / (4 peak), else its first break point is negative and the curve jumps at the
    origin; and B > 0, that is C > g2^2 / (4 (peak - mu_inf)), else its tail grows without bound. The
    smallest C is taken that satisfies the first and leaves the tail half of the fall from the peak: the initial
    slope stays, and the curve keeps its first derivative.
    """
    for_line = 0.25 * micro_slope * micro_slope
    for_tail = 0.5 * macro_slope * macro_slope / (1.0 - residual_ratio)
    return maximum(top_curvature, maximum(for_line, for_tail) / peak)


@equation
def piecewise_coefficient(slip, peak, micro_slope, top_curvature, macro_slope, residual_ratio):
    """Line, parabola, exponential: readhesion paper (1)-(6).

    On a rail too slippery for the source's `top_curvature` the parabola is narrowed, see `parabola_curvature`.
    """
    curvature = parabola_curvature(peak, micro_slope, top_curvature, macro_slope, residual_ratio)
    magnitude = absolute(slip)
    half_width = micro_slope / (4.0 * curvature)
    line_end = peak / micro_slope - half_width  # (3)
    top = peak / micro_slope + half_width  # (4)
    tail_start = top + macro_slope / (2.0 * curvature)  # (5)
    residual = residual_ratio * peak
    drop = peak - macro_slope * macro_slope / (4.0 * curvature) - residual  # (6), B of the source
    line = micro_slope * magnitude
    parabola = peak - curvature * (magnitude - top) * (magnitude - top)
    beyond = maximum(magnitude - tail_start, 0.0)
    tail = residual + drop * exp(-beyond * macro_slope / drop)
    value = where(magnitude <= line_end, line, where(magnitude < tail_start, parabola, tail))
    return where(slip < 0.0, -value, value)


@equation
def reference_speed(speed, rim_speed):
    """Speed that slip is divided by: the larger of car and rim speed, kept away from zero."""
    return maximum(maximum(absolute(speed), absolute(rim_speed)), CREEPAGE_SPEED_FLOOR)


@equation
def polach_coefficient(
    slip, reference, peak, ratio_at_infinity, decay, adhesion_factor, slip_factor, creep_stiffness
):
    """Polach's creep force law in pure longitudinal creep (Wear 258 (2005) 992-1000, eqs. 1-9).

    Friction falls with the slip velocity as ((1 - A) exp(-B w) + A) from its value `peak` at rest.
    """
    magnitude = absolute(slip)
    friction = peak * ((1.0 - ratio_at_infinity) * exp(-decay * magnitude) + ratio_at_infinity)
    gradient = creep_stiffness * magnitude / (reference * friction)
    adhesion = adhesion_factor * gradient
    value = (
        (2.0 / math.pi)
        * friction
        * (adhesion / (1.0 + adhesion * adhesion) + atan(slip_factor * gradient))
    )
    return where(slip < 0.0, -value, value)


@equation
def slip_ratio_coefficient(slip, reference, peak, peak_slip_ratio, residual_ratio):
    """Rise 2x/(1 + x^2) to the peak at x = slip ratio / `peak_slip_ratio` = 1, then towards a residual.

    With `residual_ratio` = 1 it is flat beyond the peak, as in work on wheel slide protection.
    """
    x = absolute(slip) / (reference * peak_slip_ratio)
    rise = 2.0 * x / (1.0 + x * x)
    beyond = residual_ratio + (1.0 - residual_ratio) * rise
    value = peak * where(x <= 1.0, rise, beyond)
    return where(slip < 0.0, -value, value)


@equation
def tangential_coefficient(kind, q, slip, speed, rim_speed, peak):
    """Coefficient of the curve `kind` with its parameters `q` (6,); elementwise in the other arguments."""
    if kind == PIECEWISE:
        return piecewise_coefficient(slip, peak, q[0], q[1], q[2], q[3])
    elif kind == POLACH:
        reference = reference_speed(speed, rim_speed)
        return polach_coefficient(slip, reference, peak, q[0], q[1], q[2], q[3], q[4])
    else:
        reference = reference_speed(speed, rim_speed)
        return slip_ratio_coefficient(slip, reference, peak, q[0], q[1])


@equation
def polach_driving(slip, speed, peak, q):
    """Polach coefficient of an axle that drives: the rim speed is what slip is divided by."""
    reference = reference_speed(speed, speed + slip)
    return polach_coefficient(slip, reference, peak, q[0], q[1], q[2], q[3], q[4])


@equation
def polach_peak(peak, speed, q):
    """Largest Polach coefficient over the slip velocity, and where it lies (golden section search).

    The curve rises from zero to its maximum and falls; where creepage still grows far beyond, it recovers a little.
    The bracket (0, one tenth of the speed plus 2 m/s) holds the maximum of every published set and ends before that.
    """
    golden = 0.6180339887498949
    low = 0.0 * (peak + speed)
    high = low + 0.1 * absolute(speed) + 2.0
    inner_low, inner_high = high - golden * (high - low), low + golden * (high - low)
    for _ in range(60):
        left = polach_driving(inner_low, speed, peak, q) > polach_driving(
            inner_high, speed, peak, q
        )
        low = where(left, low, inner_low)
        high = where(left, inner_high, high)
        inner_low = high - golden * (high - low)
        inner_high = low + golden * (high - low)
    top = 0.5 * (low + high)
    return polach_driving(top, speed, peak, q), top


@equation
def adhesion_limit(kind, q, peak, speed):
    """Adhesion coefficient of a driving axle (maximum over the slip velocity), and the slip velocity [m/s] there."""
    if kind == PIECEWISE:
        curvature = parabola_curvature(peak, q[0], q[1], q[2], q[3])
        return peak * 1.0, peak / q[0] + q[0] / (4.0 * curvature)
    elif kind == POLACH:
        return polach_peak(peak, speed, q)
    else:
        # slip / reference = x: the reference is v + slip when driving, or its floor at low speed
        ratio = q[0]
        slip = maximum(ratio * CREEPAGE_SPEED_FLOOR, absolute(speed) * ratio / (1.0 - ratio))
        return peak * 1.0, slip + 0.0 * peak


@dataclass(frozen=True)
class AdhesionCurve:
    """Common part of the curves: an identifier and a parameter vector for the equations.

    `q` is a (6,) vector, `steepest_slope(peak)` a bound on d mu / d slip velocity [s/m].
    """

    kind: ClassVar[int] = -1

    @property
    def q(self) -> NDArray[np.float64]:
        """Parameters as the equations take them, (6,)."""
        raise NotImplementedError

    def steepest_slope(self, peak: float) -> float:
        """Upper bound of the slope over all slip velocities and speeds [s/m], for the stable step."""
        raise NotImplementedError

    def coefficient(
        self, slip: ArrayLike, peak: ArrayLike, speed: ArrayLike = 0.0
    ) -> NDArray[np.float64]:
        """Tangential force coefficient; `slip` and car `speed` in m/s, all arguments broadcast."""
        slip, peak, speed = (np.asarray(a, dtype=float) for a in (slip, peak, speed))
        value: NDArray[np.float64] = tangential_coefficient(
            self.kind, self.q, slip, speed, speed + slip, peak
        )
        return value

    def limit(
        self, peak: ArrayLike, speed: ArrayLike = 0.0
    ) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Adhesion coefficient and the slip velocity [m/s] of the curve's maximum, driving at `speed` >= 0 [m/s]."""
        peak, speed = np.asarray(peak, dtype=float), np.asarray(speed, dtype=float)
        coefficient, slip = adhesion_limit(self.kind, self.q, peak, speed)
        return np.asarray(coefficient), np.asarray(slip)


def _vector(*values: float) -> NDArray[np.float64]:
    q = np.zeros(6)
    q[: len(values)] = values
    return q


@dataclass(frozen=True)
class PiecewiseCurve(AdhesionCurve):
    """Curve of the readhesion paper, (1)-(6); slopes in s/m, curvature in (s/m)^2.

    The paper prints g1 = 5, C = 40, g2 = 0.05; the residual at infinite slip is not printed. The default 0.9
    of the peak is this project's choice, the value a trial calibration of the paper's findings points to.
    """

    micro_slope: float = 5.0
    top_curvature: float = 40.0
    macro_slope: float = 0.05
    residual_ratio: float = 0.9
    kind: ClassVar[int] = PIECEWISE

    def __post_init__(self) -> None:
        PlantError.check(
            "adhesion curve", self, positive=("micro_slope", "top_curvature", "macro_slope")
        )
        if not 0.0 <= self.residual_ratio < 1.0:
            raise PlantError(
                f"adhesion curve: residual_ratio = {self.residual_ratio} must lie in [0, 1)"
            )

    @property
    def q(self) -> NDArray[np.float64]:
        """Parameters as the equations take them, (6,)."""
        return _vector(self.micro_slope, self.top_curvature, self.macro_slope, self.residual_ratio)

    def steepest_slope(self, peak: float) -> float:
        """Slope at the origin [s/m]."""
        return max(self.micro_slope, self.macro_slope)


@dataclass(frozen=True)
class PolachCurve(AdhesionCurve):
    """Polach's curve; `creep_stiffness` lumps G pi a b c11 / (4 Q) of the contact ellipse."""

    ratio_at_infinity: float = 0.40
    decay: float = 0.20
    adhesion_factor: float = 0.30
    slip_factor: float = 0.10
    creep_stiffness: float = 186.0
    kind: ClassVar[int] = POLACH

    def __post_init__(self) -> None:
        PlantError.check(
            "adhesion curve",
            self,
            positive=("adhesion_factor", "slip_factor", "creep_stiffness"),
            nonnegative=("decay", "ratio_at_infinity"),
        )

    @property
    def q(self) -> NDArray[np.float64]:
        """Parameters as the equations take them, (6,)."""
        return _vector(
            self.ratio_at_infinity,
            self.decay,
            self.adhesion_factor,
            self.slip_factor,
            self.creep_stiffness,
        )

    def steepest_slope(self, peak: float) -> float:
        """Slope at the origin at the lowest reference speed [s/m]."""
        factor = 2.0 / math.pi * (self.adhesion_factor + self.slip_factor)
        return factor * self.creep_stiffness / CREEPAGE_SPEED_FLOOR


@dataclass(frozen=True)
class SlipRatioCurve(AdhesionCurve):
    """Curve by slip ratio with its peak at `peak_slip_ratio`; flat beyond it if `residual_ratio` is 1."""

    peak_slip_ratio: float = 0.05
    residual_ratio: float = 1.0
    kind: ClassVar[int] = SLIP_RATIO

    def __post_init__(self) -> None:
        PlantError.check("adhesion curve", self, positive=("peak_slip_ratio",))
        if not self.peak_slip_ratio < 1.0 or not 0.0 <= self.residual_ratio <= 1.0:
            raise PlantError(
                "adhesion curve: peak_slip_ratio must lie in (0, 1) and residual_ratio in [0, 1], got "
                f"{self.peak_slip_ratio} and {self.residual_ratio}"
            )

    @property
    def q(self) -> NDArray[np.float64]:
        """Parameters as the equations take them, (6,)."""
        return _vector(self.peak_slip_ratio, self.residual_ratio)

    def steepest_slope(self, peak: float) -> float:
        """Slope at the origin at the lowest reference speed [s/m]."""
        return 2.0 * peak / (self.peak_slip_ratio * CREEPAGE_SPEED_FLOOR)


# A = mu_inf / mu_0, B [s/m], kA, kS: Polach, Wear 258 (2005), Table 3 (measurements with locomotives).
POLACH_DRY = PolachCurve(0.40, 0.60, 1.00, 0.40)
POLACH_WET = PolachCurve(0.40, 0.20, 0.30, 0.10)

__all__ = [
    "POLACH_DRY",
    "POLACH_WET",
    "AdhesionCurve",
    "PiecewiseCurve",
    "PolachCurve",
    "SlipRatioCurve",
    "adhesion_limit",
    "tangential_coefficient",
]
