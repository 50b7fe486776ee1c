"""Averaging of estimated brake forces over a stop, with the uncertainty of the mean (RTRI report, 3.2.3)."""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.stats import t as student

from alloc.errors import EstimationError
from alloc.estimation.finite_series import finite_series

Floats = NDArray[np.float64]

BUILT_UP = 0.632
"""Share of the steady cylinder pressure from which the report averages: dead time and one time constant have passed."""
BATCHES = 10
"""Batches of a mean; 10 to 30 are usual, few where correlation lasts long against the window."""


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


@dataclass(frozen=True, eq=False)
class SeriesMean:
    """Mean of one or several series with its uncertainty; fields are (series,), or scalars in arrays for one."""

    mean: Floats
    deviation: Floats
    """Standard deviation of the mean, by batch means."""
    freedom: int
    """Degrees of freedom from which the deviation was estimated."""

    def interval(self, confidence: float = 0.95) -> tuple[Floats, Floats]:
        """Lower and upper end of the confidence interval, by Student's t."""
        half = student.ppf(0.5 + 0.5 * confidence, self.freedom) * self.deviation
        return self.mean - half, self.mean + half


def batch_mean(values: ArrayLike, batches: int = BATCHES, trend: int = 0) -> SeriesMean:
    """Mean of a correlated series (time,) or of several (time, series), and its deviation by batch means.

    The series is cut into equal batches; if a batch is long against the correlation, their means are all but independent and
    their scatter, over the root of their number, is that of the whole mean (Law and Kelton, Simulation Modeling and
    Analysis, 9.5.3). Oscillation, whose halves cancel, makes it smaller than counting independent samples would.
    `trend`: degree of the polynomial in time about which the batches scatter; a force that itself changes within the window
    would else count as uncertain. Raises `EstimationError` where the series is too short.
    """
    x = finite_series("values", values, (None,), (None, None))
    freedom = batches - 1 - trend
    if trend < 0 or freedom < 1:
        raise EstimationError(
            f"averaging: batches = {batches} must exceed trend + 1, trend = {trend} be 0 or more"
        )
    size = x.shape[0] // batches
    if size < 1:
        raise EstimationError(
            f"averaging: {x.shape[0]} samples do not fill {batches} batches; take a longer window"
        )
    # what does not fill a batch is left out of the scatter at the start, where the transient is
    parts = x[x.shape[0] - size * batches :].reshape(batches, size, *x.shape[1:]).mean(axis=1)
    powers = np.linalg.qr(np.vander(np.linspace(-1.0, 1.0, batches), trend + 1))[0]
    scatter = np.square(parts - powers @ (powers.T @ parts)).sum(axis=0) / freedom
    return SeriesMean(np.asarray(x.mean(axis=0)), np.asarray(np.sqrt(scatter / batches)), freedom)
