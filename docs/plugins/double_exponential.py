"""An adhesion curve of one's own: mu = c exp(-a v_s) - d exp(-b v_s), common in work on locomotives."""

from dataclasses import dataclass

import numpy as np

from alloc.plant.adhesion import CURVES, ShapedCurve


@dataclass(frozen=True)
class DoubleExponential(ShapedCurve):
    """Keys of `[rail.curve]` beside `kind = "double-exponential"`: a, b [s/m], c, d; wet rail by default."""

    a: float = 0.54
    b: float = 1.2
    c: float = 0.29
    d: float = 0.29

    def shape(self, slip):
        """Coefficient at a slip velocity of 0 or more [m/s]; the rail's level scales its peak."""
        return self.c * np.exp(-self.a * slip) - self.d * np.exp(-self.b * slip)


CURVES.register("double-exponential", DoubleExponential)
