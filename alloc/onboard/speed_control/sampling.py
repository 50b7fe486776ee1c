"""Samples that resistance is learnt from: force and regressors of one control period, low-pass filtered alike."""

import math
from typing import NamedTuple

import numpy as np

from alloc.errors import OnboardError
from alloc.plant.model import Floats


class Regression(NamedTuple):
    """One sample of F = W Z."""

    regressor: Floats
    """Z, (weights,)."""
    target: float
    """F [N], less what turns the wheelsets where that is known."""
    feedback: float
    """I_FB / K_i [N], the error of claims 4 and 6."""
    acceleration: float
    """a [m/s2] alone, which the source prints as Z3."""


SETTLED = 3.0
"""Number of time constants after which the noise in the filter's output is filtered as well as possible."""


class RegressionFilter:
    """First-order low-pass of `time_constant` [s] over samples every `period` [s]; 0 s: none.

    A linear filter over both sides of F = W Z leaves W as it is, and takes the noise out of a = dV/dt. It starts anew,
    from zero on both sides, where the section changes, so that no sample mixes the open and a tunnel.
    """

    def __init__(self, time_constant: float, period: float) -> None:
        if not (math.isfinite(time_constant) and time_constant >= 0.0 and period > 0.0):
            raise OnboardError(
                f"regression filter: time_constant = {time_constant!r} must be 0 or greater, "
                f"period = {period!r} greater than 0"
            )
        self._share = 1.0 if time_constant == 0.0 else -math.expm1(-period / time_constant)
        self._wait = math.ceil(SETTLED * time_constant / period)
        self._state: Floats | None = None
        self._section: object = None
        self._count = 0

    def add(self, sample: Regression, section: object) -> Regression | None:
        """The filtered sample after this one, which belongs to `section` (open or tunnel); None until it has settled."""
        raw = np.array([*sample.regressor, sample.target, sample.feedback, sample.acceleration])
        if self._state is None or section != self._section:
            self._state, self._section, self._count = np.zeros_like(raw), section, 0
        self._state = self._state + self._share * (raw - self._state)
        self._count += 1
        if self._count <= self._wait:
            return None
        *_, target, feedback, acceleration = (float(value) for value in self._state)
        return Regression(self._state[:-3].copy(), target, feedback, acceleration)

    def restart(self) -> None:
        """Forget what went before, after samples that were left out."""
        self._state = None
