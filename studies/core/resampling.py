"""Means over events with what decides on them: of the events as drawn, and of bootstrap resamples of them.

These intervals are Student's t. Each must contain its threshold exactly where the p-value after Holm says so, and each of
the resamples needs one. Those beside printed means are `studies.core.mean_limits`.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.special import stdtr

from studies.core.mean_limits import half_width
from studies.core.statement import share_limits

RESAMPLES = 1000
"""Shares of them, as 0.95, are known to 0.007."""
SEED = 0
"""Of the resamples: the same table gives the same shares."""
AT_ONCE = 4_000_000
"""Events times resamples in memory."""

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class Means:
    """Means of several quantities. The first row of each is of the events as drawn, the others are of resamples."""

    mean: Floats
    """Shape (1 + RESAMPLES, quantities)."""
    deviation: Floats
    count: Floats
    """Events that bear on the quantity."""
    share: NDArray[np.bool_]
    """Which quantities are shares of events."""

    def limits(self, level: Any) -> tuple[Floats, Floats]:
        """Limits of intervals of this two-sided level, by Student's t, of shares after Wilson; nan for one event."""
        with np.errstate(all="ignore"):
            half = half_width(self.deviation, self.count, 1.0 - level)
            low, high = share_limits(self.mean, self.count, 1.0 - level)
        return np.where(self.share, low, self.mean - half), np.where(
            self.share, high, self.mean + half
        )

    def p_value(self, threshold: Floats) -> Floats:
        """Two-sided p-values by Student's t of the means against thresholds, one for each quantity."""
        with np.errstate(all="ignore"):
            t = (self.mean - threshold) / (self.deviation / np.sqrt(self.count))
            p: Floats = 2.0 * stdtr(self.count - 1.0, -np.abs(t))
        return np.where((self.deviation == 0.0) & (self.mean == threshold), 1.0, p)


def resampled(quantities: Sequence["pd.Series[Any]"]) -> Means:
    """Means of quantities, one number per event each; nan where the event does not bear on the quantity.

    Events are distinguished by the index, and drawn with all their quantities: as many as there are, with replacement.
    """
    share = np.array([values.dtype == bool for values in quantities])
    columns = [values.astype(float).rename(k) for k, values in enumerate(quantities)]
    table = pd.concat(columns, axis=1).to_numpy()
    known = ~np.isnan(table)
    with np.errstate(all="ignore"):  # what is infinite has no interval
        centre = np.where(known, table, 0.0).sum(axis=0) / known.sum(axis=0)
        off = np.where(known, table - centre, 0.0)  # about the mean squares do not cancel
        moments = np.concatenate([known, off, off**2], axis=1)
        sums = np.concatenate([weights @ moments for weights in _weights(len(table))])
        count, first, second = np.split(sums, 3, axis=1)
        shift = first / count
        variance = (second / count - shift**2) * count / (count - 1.0)
    return Means(centre + shift, np.sqrt(np.maximum(variance, 0.0)), count, share)


def _weights(events: int) -> Any:
    """How often each event counts: once as drawn, then by resample, some resamples at a time."""
    yield np.ones((1, events))
    generator, each = np.random.default_rng(SEED), np.full(events, 1.0 / max(events, 1))
    step = max(1, AT_ONCE // max(events, 1))
    for start in range(0, RESAMPLES, step):
        shape = (min(step, RESAMPLES - start), events)
        drawn = generator.multinomial(events, each, shape[0]) if events else np.zeros(shape)
        yield drawn.astype(float)
