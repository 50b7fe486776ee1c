"""A measured speed as a known shape and a drift: Kalman filter and Rauch-Tung-Striebel smoother of three states.

    v(t) = s p(t) + b(t),    db/dt = c,    dc = q dW,    z_k = v(t_k) + noise

The shape p is the speed that follows from the forces, or from the wheels, with a scale s near 1. The drift b has everything
else: gradient, resistance, sensors' offsets. A measurement beyond `OUTLIER` deviations is not used.

Time is that under way: at rest nothing drifts, for what holds a train makes up for gradient and resistance.
"""

import math
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import jit

Floats = NDArray[np.float64]

OUTLIER, FAR = 5.0, 0.1
"""Deviations, and beyond them speed [m/s], of the bound: the shape is never right to a millimetre per second."""
STARTS = {
    "rolling": np.array([4e-6, 1e-8, 4e-4]),
    "level": np.array([1e4, 4e-4, 4e-4]),
    "hill": np.array([1e4, 0.15, 4e-4]),
    "unsure": np.array([1e4, 0.15, 0.04]),
}
"""Variances of b [m2/s2], c [m2/s4] and s at the start: the shape is the speed itself, by wheels whose radius is known to
2 %; train and line are known to 2 % and 2 per mille; the same on up to 40 per mille that nobody told; or forces may be wrong
by a fifth there."""


@jit
def _moved(x, p, tau, q2):
    """State and covariance after `tau` [s], in place."""
    x[0] += tau * x[1]
    # F P F' with F = [[1, tau, 0], [0, 1, 0], [0, 0, 1]]
    for a in range(3):
        p[0, a] += tau * p[1, a]
    for a in range(3):
        p[a, 0] += tau * p[a, 1]
    p[0, 0] += q2 * tau**3 / 3.0
    p[0, 1] += q2 * tau**2 / 2.0
    p[1, 0] += q2 * tau**2 / 2.0
    p[1, 1] += q2 * tau


@jit
def _read(x, p, z, shape, r2, gain, free):
    """Take a measurement in; returns minus twice the logarithm of its likelihood, at most that of an outlier."""
    error = z - (shape * x[2] + x[0])
    spread = r2
    for a in range(3):
        gain[a] = p[a, 0] + shape * p[a, 2]
    spread += gain[0] + shape * gain[2]
    share = 1.0 / spread
    ratio = error * error * share
    far = OUTLIER * math.sqrt(spread) + FAR
    if abs(error) > far and not free:  # as Huber: it counts, but no more than one at the bound
        ratio = (2.0 * abs(error) - far) * far * share
        error = far if error > 0.0 else -far
    for a in range(3):
        x[a] += gain[a] * share * error
    for a in range(3):
        for b in range(3):
            p[a, b] -= gain[a] * share * gain[b]
    return math.log(spread) + ratio


@jit
def _begin(x, p, start):
    for a in range(3):
        x[a] = 1.0 if a == 2 else 0.0
        for b in range(3):
            p[a, b] = start[a] if a == b else 0.0


class Work(NamedTuple):
    """Where the filter computes: state (3,), covariance (3, 3), gain (3,)."""

    state: Floats
    covariance: Floats
    gain: Floats

    @classmethod
    def allocate(cls) -> "Work":
        """Empty."""
        return cls(np.zeros(3), np.zeros((3, 3)), np.zeros(3))


@jit
def likelihood(time, shape, value, part, r2, q2, start, x, p, gain):
    """Minus twice the logarithm of the likelihood, mean of measurements (instants,); nan: none there. Parts begin anew."""
    total, last, before, used = 0.0, -1, 0.0, 0
    for k in range(time.size):
        if math.isnan(value[k]) or math.isnan(shape[k]):
            continue
        free = part[k] != last
        if free:
            _begin(x, p, start)
            last = part[k]
        else:
            _moved(x, p, time[k] - before, q2)
        score = _read(x, p, value[k], shape[k], r2, gain, free)
        if not free:
            total += score
            used += 1
        before = time[k]
    return total / max(used, 1)


@jit
def _copy(x, p, state, cov, k):
    for a in range(3):
        state[k, a] = x[a]
        for b in range(3):
            cov[k, a, b] = p[a, b]


class Trace(NamedTuple):
    """What the filter did: states (instants, 3) and covariances (instants, 3, 3), predicted and corrected."""

    predicted: Floats
    predicted_covariance: Floats
    state: Floats
    covariance: Floats

    @classmethod
    def allocate(cls, count: int) -> "Trace":
        """Empty, of `count` instants."""
        return cls(*(np.zeros((count, 3, 3) if k % 2 else (count, 3)) for k in range(4)))


@jit
def _filter(time, shape, value, r2, q2, start, work, trace):
    x, p = work.state, work.covariance
    _begin(x, p, start)
    free = True
    for k in range(time.size):
        if k > 0:
            _moved(x, p, time[k] - time[k - 1], q2)
        _copy(x, p, trace.predicted, trace.predicted_covariance, k)
        if not math.isnan(value[k]):
            _read(x, p, value[k], shape[k], r2, work.gain, free)
            free = False
        _copy(x, p, trace.state, trace.covariance, k)


@jit
def _recur(back, predicted, predicted_cov, state, cov):
    for k in range(state.shape[0] - 2, -1, -1):
        for a in range(3):
            for b in range(3):
                state[k, a] += back[k, a, b] * (state[k + 1, b] - predicted[k + 1, b])
                for c in range(3):
                    for d in range(3):
                        change = cov[k + 1, c, d] - predicted_cov[k + 1, c, d]
                        cov[k, a, b] += back[k, a, c] * change * back[k, b, d]


def smoothed(
    time: Floats, shape: Floats, value: Floats, noise: float, drift: float, start: Floats
) -> tuple[Floats, Floats]:
    """Speed [m/s] and its variance after all measurements, (instants,) each, without a gap; nan in `value`: none there."""
    count = time.size
    trace = Trace.allocate(count)
    _filter(time, shape, value, noise**2, drift**2, start, Work.allocate(), trace)
    predicted, predicted_cov, state, cov = trace
    move = np.broadcast_to(np.eye(3), (count - 1, 3, 3)).copy()
    move[:, 0, 1] = np.diff(time)
    back = np.linalg.solve(predicted_cov[1:], move @ cov[:-1]).transpose(0, 2, 1)
    _recur(np.ascontiguousarray(back), predicted, predicted_cov, state, cov)
    speed = state[:, 2] * shape + state[:, 0]
    variance = cov[:, 0, 0] + 2.0 * shape * cov[:, 0, 2] + shape**2 * cov[:, 2, 2]
    return speed, np.maximum(variance, 0.0)
