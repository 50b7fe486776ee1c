"""Rails of five adhesion curves that offer the same peak to the same train."""

from typing import Any

from alloc.plant.adhesion import POLACH_DRY, POLACH_WET
from alloc.plant.environment import level_for
from alloc.plant.train import Train
from studies.ladder.events import REFERENCE_SPEED

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
