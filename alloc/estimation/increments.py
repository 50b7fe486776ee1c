"""From slides per axle to the growth of adhesion along the train: JP5484215 (13) to (15), with its sampling error."""

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.stats import norm

from alloc.display import displayed
from alloc.errors import EstimationError
from alloc.estimation.slide_counts import LEAD_AXLES, SIGMA, SlideCounts
from alloc.plant.equations import hyperbolic_speed_law
from alloc.plant.rail import SPEED_LAWS

Floats = NDArray[np.float64]


@displayed
@dataclass(frozen=True, eq=False)
class AxleShifts:
    """k_j sigma of each axle: difference between its mean coefficient and the lead car's, (axles,)."""

    shift: Floats
    """[-]; nan for axles without information: no slide at all, or at least twice the lead car's mean."""
    covariance: Floats
    """Covariance of `shift` due to counting alone, (axles, axles)."""

    @property
    def deviation(self) -> Floats:
        """Standard error of each shift, (axles,)."""
        return np.sqrt(np.diag(self.covariance))


def axle_shifts(counts: SlideCounts) -> AxleShifts:
    """Solve (14) for every axle: k_j = -Phi^-1(fr_j / (2 fr_avg)).

    Counts are Poisson, so their variance is the count itself; the covariance follows by linearisation, with the
    lead car's mean, which all axles share, included.
    """
    slides = counts.slides.astype(float)
    ratio = slides / (2.0 * counts.lead_mean)
    usable = (ratio > 0.0) & (ratio < 1.0)
    k = np.full(slides.size, np.nan)
    k[usable] = -norm.ppf(ratio[usable])
    steepness = ratio / norm.pdf(k)  # -dk over the relative change of the ratio
    lead = np.arange(slides.size) < LEAD_AXLES
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.diag(1.0 / slides) - lead[None, :] / (LEAD_AXLES * counts.lead_mean)
        jacobian = np.where(slides > 0.0, -SIGMA * steepness[:, None] * change, 0.0)
        covariance = jacobian * slides @ jacobian.T
    covariance[~usable, :] = covariance[:, ~usable] = np.nan
    return AxleShifts(SIGMA * k, covariance)


@displayed
@dataclass(frozen=True, eq=False)
class IncrementFit:
    """slope ln j + offset fitted to the shifts, offset such that the lead car's mean is zero, as (15)."""

    slope: float
    offset: float
    slope_deviation: float
    """Standard error of the slope due to counting; that of the offset is `LEAD_LOG_MEAN` times it."""
    axles: int

    def increments(self, axle_count: int | None = None) -> Floats:
        """Increment of each axle, (axle_count,)."""
        j = np.arange(1, (self.axles if axle_count is None else axle_count) + 1)
        return self.slope * np.log(j) + self.offset

    def band(self, confidence: float = 0.95) -> tuple[Floats, Floats]:
        """Lower and upper edge of the fitted curve at this confidence, two (axles,).

        One parameter is free, so the band is valid for all axles at once.
        """
        j = np.arange(1, self.axles + 1)
        width = norm.ppf(0.5 + 0.5 * confidence) * self.slope_deviation
        half = width * np.abs(np.log(j) - LEAD_LOG_MEAN)
        return self.increments() - half, self.increments() + half


LEAD_LOG_MEAN = float(np.log(np.arange(1, LEAD_AXLES + 1)).mean())
"""Mean of ln 1 to ln 4, 0.7945."""


def fit_increments(shifts: AxleShifts) -> IncrementFit:
    """Fit slope and intercept by least squares, each axle weighted with its own counting error, then shift as (15).

    The slope's error takes the correlation of the axles into account. It does not contain the bias: small counts enter (14)
    through a curved function (with 250 slides per lead axle and 64 axles: -0.8 %, half a standard error). Raises
    `EstimationError` where fewer than three axles carry information.
    """
    usable = np.flatnonzero(np.isfinite(shifts.shift))
    if usable.size < 3:
        raise EstimationError(
            f"increments: {usable.size} axles with a usable count; at least 3 are needed for a line through them"
        )
    log = np.log(usable + 1.0)
    weight = 1.0 / np.diag(shifts.covariance)[usable]
    centred = log - np.average(log, weights=weight)
    gain = weight * centred / (weight @ centred**2)
    slope = float(gain @ shifts.shift[usable])
    variance = gain @ shifts.covariance[np.ix_(usable, usable)] @ gain
    return IncrementFit(slope, -slope * LEAD_LOG_MEAN, float(np.sqrt(variance)), shifts.shift.size)


def unit_increments(per_axle: Floats, axle_unit: NDArray[np.int64]) -> Floats:
    """Increment of each traction unit over the foremost one: mean over its own axles minus that of unit 1, (units,).

    `axle_unit` (axles,): unit of each axle from the front, -1 for none; works for 1C4M, 1C2M and 1C1M alike.
    """
    units = int(axle_unit.max()) + 1
    mean = np.array([per_axle[axle_unit == j].mean() for j in range(units)])
    return mean - mean[0]


def conventional_increments(
    per_axle: Floats, speed: float, law: str = "curtius-kniffler"
) -> Floats:
    """Increments on a conventional line at `speed` [m/s], (axles,), from those of the Shinkansen.

    JP5484215 par. 0057 corrects (15) by the difference of the planned curves, which grows with speed, and prints no formula.
    The assumption here is that increments are a share of the coefficient, so they grow by the ratio of the curves. The lead
    car's mean stays zero, as (15) demands; a difference added to every axle would violate that.
    """
    if law not in SPEED_LAWS:
        raise EstimationError(
            f"increments: law = {law!r} is unknown; choose from {', '.join(SPEED_LAWS)}"
        )
    EstimationError.check("increments", {"speed": speed}, nonnegative=("speed",))
    conventional, shinkansen = (
        hyperbolic_speed_law(speed, *SPEED_LAWS[name]) for name in (law, "shinkansen")
    )
    return per_axle * (conventional / shinkansen)
