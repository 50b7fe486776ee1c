"""What a reading of the train's speed does to the estimate: a Kalman update, or, where it is odd, learning anew."""

import math

from alloc.compilation import inlined_jit

SPEED, FORCE, SLIP, MASS = range(4)
"""States."""

COMMON_ERROR = 0.7
"""Correlation of the errors of speed and unknown force where the force has changed unnoticed."""


@inlined_jit
def take_reading(f, p, slip, innovation, variance):
    """Kalman update with a measurement of v + `slip` c."""
    row = (
        p[0, 0] + slip * p[0, 2], p[1, 0] + slip * p[1, 2],
        p[2, 0] + slip * p[2, 2], p[3, 0] + slip * p[3, 2],
    )  # fmt: skip
    inverse = 1.0 / (row[0] + slip * row[2] + variance)
    for i in range(4):
        f[i] += row[i] * inverse * innovation
        for k in range(4):
            p[i, k] -= row[i] * inverse * row[k]


@inlined_jit
def _forget(o, p, innovation):
    """The force was another than believed for some time, a gradient for one: speed and force are both wrong by it."""
    p[0, 0] = max(p[0, 0], innovation**2)
    p[1, 1] = max(p[1, 1], o.unknown_force**2)
    p[0, 1] = p[1, 0] = COMMON_ERROR * math.sqrt(p[0, 0] * p[1, 1])
    for i in range(2):
        for j in range(2, 4):
            p[i, j] = p[j, i] = 0.0


@inlined_jit
def believe(o, k, slip, innovation, variance, trusted):
    """Take a reading; where it is odd and `trusted`, gradient and speed are learnt anew, else it is left."""
    p = k.covariance
    odd = innovation**2 > 9.0 * (p[0, 0] + variance)
    if odd and trusted:
        _forget(o, p, innovation)
    if trusted or not odd:
        take_reading(k.state, p, slip, innovation, variance)
