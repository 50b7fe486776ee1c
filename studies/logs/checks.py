"""What is wrong with the series of a log: gaps, sampling, constant forces, units that do not agree; remarks on it."""

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import excerpt
from studies.logs.channels import FEWEST_ROWS
from studies.logs.own_samples import BRIDGED
from studies.logs.remarks import Remark, faulty

Floats = NDArray[np.float64]

COARSE = 0.25
"""Sampling period [s] above which slips are missed."""
CONSTANT_TIME = 10.0
"""Time [s] for which a measured force never is exactly constant."""
OTHER_UNIT = 1.5
"""Factor between two speeds from which on their units differ: less than that between miles and kilometres."""


def check_instants(time: Floats) -> list[Remark]:
    """Gaps and uneven or coarse sampling of the common instants."""
    step = np.diff(time)
    period = float(np.median(step))
    wide = step > max(1.5 * period, BRIDGED)
    gaps = np.flatnonzero(wide)
    remarks = [
        Remark(
            "gap", "time", f"gap of {step[k]:.4g} s from {time[k]:.6g} s to {time[k + 1]:.6g} s",
            int(k) + 1, float(time[k]),
        )
        for k in gaps
    ]  # fmt: skip
    near = step[~wide]
    uneven = np.abs(near / period - 1.0) > 0.1
    if uneven.size and uneven.mean() > 0.01:
        remarks.append(
            Remark(
                "sampling", "time",
                f"uneven sampling: {100.0 * uneven.mean():.0f} % of the steps differ from {period:.4g} s by more than "
                f"10 % ({near.min():.4g} to {near.max():.4g} s); the times are used as they are",
            )
        )  # fmt: skip
    if period > COARSE:
        text = f"wheels every {period:.4g} s: short slips are missed"
        remarks.append(Remark("sampling", "time", text))
    return remarks


def check_constant(name: str, force: Floats, time: Floats) -> list[Remark]:
    """Whether a force has one and the same value, not zero, all the time."""
    if force.size == 0 or force[0] == 0.0 or not np.all(force == force[0]):
        return []
    if time[-1] - time[0] < CONSTANT_TIME:
        return []
    return [Remark("stuck", name, "the same value all the time: a dead channel, or a set value?")]


def check_ratio(name: str, rim: Floats, train_name: str, speed: Floats, source: str) -> None:
    """Raise where wheels and train differ all the time by a factor that no slip has: that between two units."""
    moving = np.isfinite(rim) & np.isfinite(speed) & (speed > 2.0)
    if moving.sum() < FEWEST_ROWS:
        return
    low, middle, high = np.quantile(excerpt(rim[moving] / speed[moving]), (0.25, 0.5, 0.75))
    if high - low >= 0.1 * middle or 1.0 / OTHER_UNIT < middle < OTHER_UNIT:
        return
    known = any(abs(middle / factor - 1.0) < 0.08 for factor in (3.6, 1.0 / 3.6))
    reason = (
        "km/h and m/s are mixed up"
        if known
        else "their units do not agree; say them in a mapping file"
    )
    raise faulty(
        source, name, None,
        f"{middle:.3g} times the train's speed in column {train_name!r} all the time: {reason}",
    )  # fmt: skip
