"""Smoother behind the reference speed's filter, for series that are there as a whole: Rauch, Tung and Striebel's.

    x_s(k) = x(k) + C (x_s(k+1) - x_p(k+1)),    P_s(k) = P(k) + C (P_s(k+1) - P_p(k+1)) C',    C = P F' P_p^-1

with x_p, P_p predicted and x, P corrected. What an axle tells as it rolls again so corrects the time for which all slid.

Source: Rauch, Tung, Striebel, Maximum likelihood estimates of linear dynamic systems, AIAA Journal 3 (1965) 1445.
"""

import numpy as np
from numpy.typing import NDArray

from alloc.compilation import jit
from alloc.onboard.reference_speed import FORCE, MASS, SPEED
from alloc.records import ByReference
from studies.logs.logged_computers import FilterTrace

Floats = NDArray[np.float64]

CHUNK = 100_000
"""Instants whose matrices are solved at a time."""


def smooth(step: Floats, trace: FilterTrace) -> tuple[Floats, Floats]:
    """States (instants, 4) and covariances (instants, 4, 4) after all instants are known; `step` [s] to each instant."""
    count = step.size
    gain = np.empty((count - 1, 4, 4))
    for begin in range(0, count - 1, CHUNK):
        now = slice(begin, min(begin + CHUNK, count - 1))
        after = slice(now.start + 1, now.stop + 1)
        moved = np.broadcast_to(np.eye(4), (now.stop - now.start, 4, 4)).copy()
        moved[:, SPEED, FORCE] = step[after]
        moved[:, SPEED, MASS] = step[after] * trace.acting[after]
        # C' = P_p^-1 F P: both covariances are symmetric
        turned = np.linalg.solve(trace.predicted_covariance[after], moved @ trace.covariance[now])
        gain[now] = turned.transpose(0, 2, 1)
    state, covariance = trace.state.copy(), trace.covariance.copy()
    _recur(gain, ByReference(trace), state, covariance)
    return state, covariance


@jit
def _recur(gain, trace, state, covariance):
    """The recursion; `state` and `covariance` hold what the filter had, the last instant of which stays."""
    for t in range(gain.shape[0] - 1, -1, -1):
        for a in range(4):
            for b in range(4):
                state[t, a] += gain[t, a, b] * (state[t + 1, b] - trace.predicted[t + 1, b])
                for c in range(4):
                    for d in range(4):
                        change = covariance[t + 1, c, d] - trace.predicted_covariance[t + 1, c, d]
                        covariance[t, a, b] += gain[t, a, c] * change * gain[t, b, d]
