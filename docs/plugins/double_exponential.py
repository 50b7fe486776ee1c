"""An adhesion curve of one's own: mu = c exp(-a v_s) - d exp(-b v_s), common in work on locomotives."""

from dataclasses import dataclass

import numpy as np

from alloc.plant.adhesion import CURVES, ShapedCurve


@dataclass(frozen=True)
class DoubleExponential(ShapedCurve):
    """c exp(-a v_s) - d exp(-b v_s); wet rail by default. Source: usual in work on locomotives."""

    a: float = 0.54
    """Decay over the slip velocity beyond the peak [s/m]."""
    b: float = 1.2
    """Decay over the slip velocity before it [s/m]."""
    c: float = 0.29
    """Coefficient of the first term."""
    d: float = 0.29
    """Coefficient of the second term."""

    def shape(self, slip):
        """Coefficient at a slip velocity of 0 or more [m/s]; the rail's level scales its peak."""
        return self.c * np.exp(-self.a * slip) - self.d * np.exp(-self.b * slip)


CURVES.register("double-exponential", DoubleExponential)
