"""Cubature Kalman filter (Arasaratnam and Haykin, 2009) in memory that is there already.

2 n points at +-sqrt(n) times the columns of a square root of the covariance carry mean and covariance through a model that
need not be linear. What is measured here are elements of the state, so their correction is the linear filter's, one
by one. Square roots are Cholesky's.
"""

import math
from typing import Any

from alloc.compilation import called

LEAST_VARIANCE = 1e-14
"""Below it a direction of the state counts as known: rounding must not make a square root of a negative number."""


@called
def lower_root(covariance, root):
    """Fill `root` (n, n) with the lower Cholesky factor of `covariance` (n, n)."""
    n = covariance.shape[0]
    for c in range(n):
        for r in range(n):
            total = covariance[r, c]
            for i in range(c):
                total -= root[r, i] * root[c, i]
            if r < c:
                root[r, c] = 0.0
            elif r == c:
                root[r, c] = math.sqrt(max(total, LEAST_VARIANCE))
            else:
                root[r, c] = total / root[c, c]


def prediction(model: Any) -> Any:
    """Compiled prediction under `model(points, i, inputs)`, which moves row `i` of `points` by one period."""

    @called
    def predict(state, covariance, root, points, walk, inputs):
        """Carry `state` (n,) and `covariance` (n, n) one period on; `walk` (n,): variances that the model's errors add.

        `root` (n, n) and `points` (2 n, n) are room to work in.
        """
        n = state.size
        lower_root(covariance, root)
        for i in range(2 * n):
            side = math.sqrt(n) if i < n else -math.sqrt(n)
            for a in range(n):
                points[i, a] = state[a] + side * root[a, i % n]
            model(points, i, inputs)
        for a in range(n):
            state[a] = 0.0
            for i in range(2 * n):
                state[a] += points[i, a] / (2 * n)
        for a in range(n):
            for b in range(n):
                total = walk[a] if a == b else 0.0
                for i in range(2 * n):
                    total += (points[i, a] - state[a]) * (points[i, b] - state[b]) / (2 * n)
                covariance[a, b] = total

    return predict


@called
def correct(state, covariance, root, a, measured, variance):
    """Correct by a measurement of element `a` with the error variance `variance`; returns the innovation."""
    n = state.size
    told = measured - state[a]
    total = covariance[a, a] + variance
    for b in range(n):
        root[0, b] = covariance[b, a]
    for b in range(n):
        state[b] += root[0, b] / total * told
        for c in range(n):
            covariance[b, c] -= root[0, b] * root[0, c] / total
    return told
