"""The speed over ground of a log that has no column of it, and where it is doubtful."""

import numpy as np
from numpy.typing import NDArray

from alloc.errors import EstimationError
from alloc.estimation.series import bridged_spans
from studies.logs.ground_speed import GroundSpeed, estimate_ground_speed
from studies.logs.remarks import Remark, faulty
from studies.logs.train_readings import TrainReadings

Floats = NDArray[np.float64]

BLIND_TIME = 2.0
"""Time [s] after which it is reported that no axle measures the speed."""
MOMENT = 0.2
"""Time [s] for which an axle that measures it in between does not count."""


def estimated_speed(
    readings: TrainReadings, source: str, noise: float = 0.0
) -> tuple[GroundSpeed, list[Remark]]:
    """As `estimate_ground_speed`, with remarks; raises `Faulty` where it cannot be estimated."""
    try:
        found = estimate_ground_speed(*readings[:6], noise)
    except EstimationError as error:
        reason = str(error).removeprefix("speed over ground: ")
        raise faulty(
            source, "speed_kmh or speed_ms", None, f"is missing and cannot be estimated: {reason}"
        ) from None
    return found, _blind(readings.time, found)


def _blind(time: Floats, found: GroundSpeed) -> list[Remark]:
    """Where no axle rolls in a way that tells the speed, for long."""
    remarks = []
    blind = np.isfinite(found.speed) & ~found.told
    for begin, end in bridged_spans(blind, lambda end, begin: time[begin] - time[end - 1] < MOMENT):
        if time[end - 1] - time[begin] < BLIND_TIME:
            continue
        worst = found.deviation[begin:end].max()
        text = (
            f"no axle tells the speed from {time[begin]:.6g} s to {time[end - 1]:.6g} s: estimated from the forces, "
            f"standard deviation up to {worst:.2g} m/s"
        )
        remarks.append(Remark("estimate", "speed", text, int(begin) + 1, float(time[begin])))
    return remarks
