"""Data of JP5484215 embodiment 2 (par. 0063, 0064) from a recorded run: one increment per slip that a unit detects."""

from typing import Literal, NamedTuple, get_args

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.errors import EstimationError

Reference = Literal["received", "held"]

TELEGRAM_DELAY = 0.1
"""Time [s] from a unit's detection to its receipt by the foremost unit: latency 0.05 and half of the telegrams' period."""
HOLD_TIME = 5.0
"""Age [s] beyond which the foremost unit's held estimate is no longer in use, `alloc.onboard.Onboard.hold_time`."""


class IncrementDatum(NamedTuple):
    """What the foremost unit makes of one telegram."""

    unit: int
    """Unit that slipped, counted from 0 at the front; never 0 itself."""
    time: float
    """Instant of its detection [s]."""
    increment: float
    """Its coefficient minus the foremost unit's."""


def increment_data(
    run: xr.Dataset,
    reference: Reference = "received",
    delay: float = TELEGRAM_DELAY,
    hold_time: float = HOLD_TIME,
) -> list[IncrementDatum]:
    """Increments that a run yields, in order of time: estimate of unit j at its detection minus the foremost one's.

    `reference` "received": the estimate of the foremost unit (B1 of JP5484215) when it receives the telegram, `delay` [s]
    later, as par. 0064 says. Where it does not slip then, that is what it delivers and not what its rail could carry: the
    datum is too high. "held": its estimate at its own last detection, the coefficient that (5) adds the increments to; no
    datum where that is older than `hold_time` [s]. The foremost unit is unit 0. A run in which it fails does not say who
    takes over, so leave such out.
    Raises `EstimationError` for an unknown reference or a time below 0.
    """
    if reference not in get_args(Reference):
        raise EstimationError(
            f"increment data: reference = {reference!r} must be one of {', '.join(get_args(Reference))}"
        )
    given = {"delay": delay, "hold_time": hold_time}
    EstimationError.check("increment data", given, nonnegative=given)
    time = run["time"].values
    estimate = run["coefficient_estimate"].values
    demand = run["driver_command"].values != 0.0
    onsets = detections(run)
    first = [k for k in onsets[0] if demand[k]]
    data: list[IncrementDatum] = []
    for unit, own in enumerate(onsets):
        for k in own if unit else ():
            if not demand[k]:
                continue
            received = int(np.searchsorted(time, time[k] + delay - 1e-9))
            if received >= time.size:  # the run ends before the telegram arrives
                continue
            at = received
            if reference == "held":
                earlier = [j for j in first if j <= received]
                if not earlier or time[received] - time[earlier[-1]] > hold_time:
                    continue
                at = earlier[-1]
            data.append(
                IncrementDatum(unit, float(time[k]), float(estimate[k, unit] - estimate[at, 0]))
            )
    return sorted(data, key=lambda datum: (datum.time, datum.unit))


def detections(run: xr.Dataset) -> list[NDArray[np.int64]]:
    """Recorded instants (indices) at which the slip signal of each unit goes on."""
    signal = run["slipping"].values.astype(bool)
    before = np.vstack([np.zeros((1, signal.shape[1]), dtype=bool), signal[:-1]])
    return [np.flatnonzero(on) for on in (signal & ~before).T]


def true_increments(run: xr.Dataset) -> NDArray[np.float64]:
    """Increments that were true in a run, (units,): mean adhesion coefficient of a unit's axles minus that of unit 0's.

    For judging what was learnt; nobody on board knows it.
    """
    unit = run["axle_unit"].values
    limit = run["adhesion_limit"].values.mean(axis=0)
    mean = np.array([limit[unit == j].mean() for j in range(run.sizes["unit"])])
    return mean - mean[0]
