"""Rails of five adhesion curves that offer the same peak to the same train."""

from dataclasses import dataclass
from typing import Any

import numpy as np

from alloc.plant.adhesion import CURVES, POLACH_DRY, POLACH_WET, ShapedCurve
from alloc.plant.environment import level_for
from alloc.plant.train import Train
from studies.ladder.events import REFERENCE_SPEED


@dataclass(frozen=True)
class ExponentialDifference(ShapedCurve):
    """c exp(-a v) - d exp(-b v) over the slip velocity v [m/s], common in work on locomotives; wet rail by default.

    Its peak is at 1.2 m/s, beyond the greatest slip that the MPC would hold.
    """

    a: float = 0.54
    """Decay beyond the peak [s/m]."""
    b: float = 1.2
    """Decay before it [s/m]."""
    c: float = 0.29
    """Size of the first term, to any scale."""
    d: float = 0.29
    """Size of the second term."""

    def shape(self, slip: Any) -> Any:
        """Coefficient at a slip velocity of 0 or more [m/s], to any scale."""
        return self.c * np.exp(-self.a * slip) - self.d * np.exp(-self.b * slip)


CURVES.register("exponential-difference", ExponentialDifference)

RAILS: dict[str, dict[str, Any]] = {
    "piecewise": {"kind": "piecewise"},
    "Polach dry": {"kind": "polach-dry"},
    "Polach wet": {"kind": "polach-wet"},
    "slip ratio": {"kind": "slip-ratio"},
    "double exponential": {"kind": "exponential-difference"},
}
"""Name -> keys of `[rail.curve]`. Peaks at 0.05 m/s, at 0.05 to 0.6 m/s moving with speed, and at 1.2 m/s."""
BY_FRICTION = {"Polach dry": POLACH_DRY, "Polach wet": POLACH_WET}
"""Curves whose level is the friction coefficient, above the peak."""


def curve_keys(curve: str, residual_ratio: float) -> dict[str, Any]:
    """Keys of the curve called `curve`; `residual_ratio` is the piecewise one's."""
    return RAILS[curve] | ({"residual_ratio": residual_ratio} if curve == "piecewise" else {})


def level_of(curve: str, adhesion: float, train: Train) -> float:
    """Level of a rail of this curve that offers `adhesion` to `train` at `REFERENCE_SPEED`."""
    law = BY_FRICTION.get(curve)
    return adhesion if law is None else level_for(law, adhesion, REFERENCE_SPEED, train)
