"""How much faster than its train each car of a coupled train runs, by the accelerations of all cars.

    du_k/dt = a_k - sum_j m_j a_j / M - mean of that - u_k / T

A car stays within the slack of its couplers, so the difference of its acceleration has no mean, and what a sensor adds for
long is forgotten within T = `FORGOTTEN`. A gradient acts on all cars alike. Wheels of a locomotive slip against the
locomotive, not against the train.
"""

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import usual_period

Floats = NDArray[np.float64]

FORGOTTEN = 60.0
"""Time [s] within which an error of an acceleration is forgotten, and with it that slack was run out: less would make wheels
that pull slip by that way again."""
UNSURE, UNKNOWN = 0.0015, 0.003
"""Standard deviation of the mean speed of a car over a start of 15 s [m/s], by accelerations at 10 ms, and by the train's
speed in its place: some 2 and 4 cm of slack."""
SLOWEST = 0.05
"""Time between two instants [s] above which the impacts that run slack out are missed."""


def speeds_against_train(
    time: Floats, part: NDArray[np.int64], rate: Floats, mass: Floats
) -> Floats:
    """Speed of each car less the train's [m/s], (instants, cars); nan where a car's acceleration lacks in a part.

    `rate` (instants, cars) [m/s2], `mass` (cars,) [kg].
    """
    from scipy.signal import lfilter  # slow to import, and needed for coupled trains alone

    apart = rate - (rate @ mass / mass.sum())[:, None]
    own = np.full(apart.shape, np.nan)
    if usual_period(time) > SLOWEST:
        return own
    for number in np.unique(part):
        inside = part == number
        if inside.sum() < 2 or not np.isfinite(apart[inside]).all():
            continue
        step = usual_period(time[inside])
        values = apart[inside] - apart[inside].mean(axis=0)
        gained = np.zeros(values.shape)
        gained[1:] = 0.5 * (values[1:] + values[:-1]) * step
        own[inside] = lfilter([1.0], [1.0, -np.exp(-step / FORGOTTEN)], gained, axis=0)
    return own
