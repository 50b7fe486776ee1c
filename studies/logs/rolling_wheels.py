"""What wheels that roll freely say of their radius and of their delay.

A wheel that nothing pulls or brakes turns as the train runs, so its measured speed u is

    u(t) / v(t) - 1 = e - d a(t) / v(t)

with the train's speed v and acceleration a. The error e is that of the wheel's radius, or of a speed's scale, and d is the
time by which the wheel is recorded later than the train. The fit is robust: a wheel that comes back from a slide rolls
freely too, and does not yet turn as the train runs.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from alloc.estimation.series import mean_rate, spans, usual_period

Floats = NDArray[np.float64]

FREE = 0.003
"""Force over load below which a wheel rolls freely: on the poorest rail, three times as much is all that there is."""
SLOWEST = 5.0
"""Speed [m/s] from which on it tells its radius."""
SPAN, LEAST = 0.5, 1.0
"""Time [s] for which it must roll at a stretch, and in all."""
RATE_TIME = 0.5
"""Time [s] over which the train's acceleration is taken."""
MOST = 20_000
"""Instants of a long log that enter the fit, or up to twice as many."""
WIDTH = 0.002
"""Error, as a share, from which on a value counts less in the fit."""
NEAR, MOST_OFF = 0.005, 0.3
"""Distance from the fit, as a share, up to which a value agrees with it, and share of the values that need not."""
TOGETHER = 0.2
"""Time [s] within which errors are those of one value."""
LASTING = 3.0
"""Ratio of the stated deviation of speeds over what all values may have in common of it, as by rounding."""
VARIES = 0.02
"""Change of a / v [1/s], root mean square, from which on a delay can be told from a radius."""


class Rolling(NamedTuple):
    """What a wheel that rolls freely says."""

    error: float
    """By which it is faster than the train, as a share."""
    deviation: float
    late: float
    """Time [s] by which it is recorded later; 0 where that cannot be told."""
    late_deviation: float


def rolling_wheel(
    time: Floats,
    speed: Floats,
    rim: Floats,
    share: Floats,
    deviation: Floats,
    rim_deviation: float,
) -> Rolling | None:
    """What an axle says by its `rim` speed [m/s] and the `share` of its force in its load, (instants,) each.

    `speed` of the train [m/s] with its standard `deviation` (instants,), and `rim_deviation`, that of the wheel's. None
    where it does not roll long enough, or not as the train runs.
    """
    free = (np.abs(share) < FREE) & (speed > SLOWEST) & np.isfinite(rim)
    stretches = spans(free)
    short = time[stretches[:, 1] - 1] - time[stretches[:, 0]] < SPAN
    for begin, end in stretches[short].tolist():
        free[begin:end] = False
    period = usual_period(time)
    lasts = float(free.sum()) * period
    if lasts < LEAST:
        return None
    # of a long log, instants from all over tell as much
    some = np.flatnonzero(free)[:: max(int(free.sum()) // MOST, 1)]
    rate = mean_rate(time, speed, RATE_TIME, at=time[some])
    some, rate = some[np.isfinite(rate)], rate[np.isfinite(rate)]
    if some.size == 0:
        return None
    y, x = rim[some] / speed[some] - 1.0, -rate / speed[some]
    varies = float(np.std(x)) > VARIES
    columns = np.stack([np.ones_like(x), x], axis=1) if varies else np.ones((x.size, 1))
    start = np.zeros(columns.shape[1])
    start[0] = np.median(y)
    unsure = float(np.median(np.hypot(deviation[some], rim_deviation) / speed[some]))
    width = max(WIDTH, unsure)
    found = least_squares(
        lambda b: columns @ b - y, start, jac=lambda _: columns, loss="cauchy", f_scale=width
    )
    rest = y - columns @ found.x
    near = np.abs(rest) < max(NEAR, 3.0 * width)
    if near.mean() < 1.0 - MOST_OFF:
        return None
    count = max(lasts * float(near.mean()) / TOGETHER, 3.0)
    inverse = np.linalg.inv(columns[near].T @ columns[near] / near.sum())
    spread = float(np.sqrt(np.mean(rest[near] ** 2) / count))
    error = math.hypot(spread * math.sqrt(inverse[0, 0]), unsure / LASTING)
    if not varies:
        return Rolling(float(found.x[0]), error, 0.0, 0.0)
    return Rolling(
        float(found.x[0]), error, float(found.x[1]), spread * math.sqrt(float(inverse[1, 1]))
    )
