"""Averaging of estimated brake forces over a stop, with the uncertainty of the mean (RTRI report, 3.2.3).

The mean of (2) over a window of N samples has errors of three origins:

- Noise of the sensors is independent from sample to sample: s^2 / N. s^2 is computed from second differences, which a slowly
  changing force does not enter. The mean of (x_(k-1) - 2 x_k + x_(k+1))^2 is 6 s^2 (Gasser, Sroka and Jennen-Steinmetz 1986,
  Biometrika 73; its variance is 35 s^4 / 9 N, so 18 N / 35 degrees of freedom). A change of the force itself within the
  window does not make its mean uncertain. The scatter of batch means would count it, however they are detrended.
- Relative motion matters where another car's acceleration stands for that of a stretch, as in (5). The error at an instant
  is dP/dt with the relative momentum P = sum m_k (v_k - v_1), so that of the mean is (P_end - P_start) / T. It falls with
  1/T, not with its root. Errors of neighbouring batches have opposite signs, since what one gains the next one loses (with B
  batches the scatter overestimates by sqrt(B)). P is the difference between the integral of the estimate and the integral of
  a smooth force. With its mean square about a polynomial, and independent ends, the variance is 2 P^2 / T^2.
- An error that stays constant over the stop is not in the series: `alloc.estimation.brake_shortfall.CalibrationErrors`.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.special import stdtrit

from alloc.display import displayed
from alloc.errors import EstimationError
from alloc.estimation.finite_series import finite_series

Floats = NDArray[np.float64]

BUILT_UP = 0.632
"""Share of the steady cylinder pressure from which the report averages: dead time and one time constant have passed."""
TREND = 4
"""Degree of the polynomial in time that a force follows while it builds up and friction rises with falling speed."""


def braking_window(
    pressure: ArrayLike, speed: ArrayLike, steady: float | None = None, standstill: float = 0.5
) -> slice:
    """Samples from 63.2 % of the steady cylinder pressure to standstill, the report's window.

    `pressure` (time,) [Pa] of one cylinder, `speed` (time,) [m/s]. `steady` [Pa]: its final value; None: the median of the
    last quarter before standstill. `standstill` [m/s]: speed below which the train counts as stopped; a train that is never
    that slow gives no window. Raises `EstimationError` where there is none.
    """
    p = finite_series("pressure", pressure, (None,))
    v = finite_series("speed", speed, p.shape)
    slow = np.flatnonzero(v <= standstill)
    if not slow.size:
        raise EstimationError(
            f"averaging: the speed stays above {standstill:g} m/s (least {v.min():.3g}); there is no "
            "standstill to average to, so pass a higher `standstill`"
        )
    end = int(slow[0])
    if end == 0:
        raise EstimationError("averaging: the train stands at the first sample already")
    final = float(np.median(p[(3 * end) // 4 : end])) if steady is None else steady
    if not (math.isfinite(final) and final > 0.0):
        raise EstimationError(f"averaging: steady pressure {final!r} must exceed 0; is it braked?")
    built = np.flatnonzero(p[:end] >= BUILT_UP * final)
    if not built.size:
        raise EstimationError(
            f"averaging: the pressure does not reach {BUILT_UP:.1%} of {final:g} Pa before standstill"
        )
    return slice(int(built[0]), end)


@displayed
@dataclass(frozen=True, eq=False)
class SeriesMean:
    """Mean of one or several series with its uncertainty; fields are (series,), or scalars in arrays for one."""

    mean: Floats
    noise: Floats
    """Standard deviation of the mean due to errors that are independent from sample to sample."""
    motion: Floats
    """The same due to relative motion; 0 where every car has its own acceleration."""
    freedom: float
    """Degrees of freedom from which `noise` was estimated."""

    @property
    def deviation(self) -> Floats:
        """Standard deviation of the mean, without errors that are constant over the stop."""
        return np.hypot(self.noise, self.motion)

    def interval(
        self, confidence: float = 0.95, constant: ArrayLike = 0.0
    ) -> tuple[Floats, Floats]:
        """Lower and upper end of the confidence interval; `constant`: deviation of errors that averaging does not remove."""
        deviation = np.hypot(self.deviation, constant)
        freedom = effective_freedom(self.freedom, self.noise, deviation)
        half = stdtrit(freedom, 0.5 + 0.5 * confidence) * deviation
        return self.mean - half, self.mean + half


def effective_freedom(freedom: ArrayLike, estimated: Floats, whole: Floats) -> Floats:
    """Degrees of freedom of a deviation `whole` whose part `estimated` has `freedom`, while the rest is known.

    Welch (1947, Biometrika 34) and Satterthwaite (1946, Biometrics 2).
    """
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.asarray(freedom) * np.nan_to_num((whole / estimated) ** 4, nan=1.0, posinf=1e9)


def stop_mean(
    values: ArrayLike, moving: bool = False, batch: int = 1, trend: int = TREND
) -> SeriesMean:
    """Mean of a series (time,) of equally spaced samples, or of several (time, series), with its uncertainty.

    `moving`: another car's acceleration stands for that of the stretch, so the error contains relative motion; `trend`:
    degree of the polynomial from which the integral of the series deviates by it. `batch`: samples after which noise is
    independent, 1 for white noise; the mean's deviation is that of the means of such batches. Raises `EstimationError` where
    the series is too short.
    """
    x = finite_series("values", values, (None,), (None, None))
    if batch < 1 or trend < 0:
        raise EstimationError(
            f"averaging: batch = {batch} must be 1 or more, trend = {trend} 0 or more"
        )
    count, least = x.shape[0] // batch, trend + 3 if moving else 3
    if count < least:
        raise EstimationError(
            f"averaging: {x.shape[0]} samples are not {least} batches of {batch}; take a longer window"
        )
    # what does not fill a batch is left out of the noise at the start, where the force changes most
    parts = x[x.shape[0] - count * batch :].reshape(count, batch, *x.shape[1:]).mean(axis=1)
    bends = np.square(np.diff(parts, 2, axis=0)).mean(axis=0) / 6.0
    motion = _relative_motion(x, trend) if moving else np.zeros(x.shape[1:])
    return SeriesMean(
        np.asarray(x.mean(axis=0)),
        np.asarray(np.sqrt(bends / count)),
        motion,
        max((count - 2) * 18.0 / 35.0, 1.0),
    )


def _relative_motion(values: Floats, trend: int) -> Floats:
    """Deviation of the mean by a momentum that the ends of the window cut off, (series,)."""
    momentum = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
    samples = momentum.shape[0]
    # the integral of a force that is a polynomial is one of a degree more
    powers = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, samples), trend + 2))[0]
    beside = momentum - powers @ (powers.T @ momentum)
    variance = np.square(beside).sum(axis=0) / (samples - trend - 2)
    return np.asarray(np.sqrt(2.0 * variance) / values.shape[0])
