"""Adhesion curves that are given by their shape alone."""

from dataclasses import dataclass
from typing import Any, ClassVar

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.plant.adhesion_curve import AdhesionCurve
from alloc.plant.adhesion_laws import TABULATED
from alloc.plant.shape_table import KNOTS, shape_table


@dataclass(frozen=True)
class ShapedCurve(AdhesionCurve):
    """Base class of a user's own curve: a subclass gives its `shape`; level, sign and table follow.

    The adhesion field gives the peak, so only ratios of the shape count. It depends on the slip velocity alone. The plant
    interpolates it linearly between the knots of `alloc.plant.shape_table`, to about 1e-5 of the peak.
    """

    kind: ClassVar[int] = TABULATED

    def shape(self, slip: NDArray[np.float64]) -> ArrayLike:
        """Coefficient at `slip` >= 0 [m/s] to any scale: 0 at 0, one maximum below 20 m/s, finite."""
        raise NotImplementedError

    @property
    def q(self) -> NDArray[np.float64]:
        """Slip velocity of the peak [m/s], then the shape over slip / (slip + that), 0 to 1."""
        return shape_table(self)

    def steepest_slope(self, peak: float) -> float:
        """Greatest slope between knots [s/m]."""
        table = self.q
        return float(peak * np.max(np.abs(np.diff(table[1:]) / np.diff(table[0] * KNOTS))))


@dataclass(frozen=True)
class ExponentialDifference(ShapedCurve):
    """c exp(-a v) - d exp(-b v) over the slip velocity v, common in work on locomotives; wet rail by default.

    Its peak is at 1.2 m/s, beyond the greatest slip that the MPC would hold.

    Source: the form and its usual values are those of work on readhesion control of locomotives; no single document.
    """

    a: float = 0.54
    """Decay beyond the peak [s/m]."""
    b: float = 1.2
    """Decay before the peak [s/m]; above `a`."""
    c: float = 0.29
    """Size of the first term, to any scale."""
    d: float = 0.29
    """Size of the second term; that of the first, so that no slip has no force."""

    def shape(self, slip: Any) -> Any:
        """Coefficient at a slip velocity of 0 or more [m/s], to any scale."""
        return self.c * np.exp(-self.a * slip) - self.d * np.exp(-self.b * slip)
