"""Rails of five adhesion curves that offer the same peak to the same train."""

from typing import Any

RAILS: dict[str, dict[str, Any]] = {
    "piecewise": {"kind": "piecewise"},
    "Polach dry": {"kind": "polach-dry"},
    "Polach wet": {"kind": "polach-wet"},
    "slip ratio": {"kind": "slip-ratio"},
    "double exponential": {"kind": "exponential-difference"},
}
"""Name -> keys of `[rail.curve]`. Peaks at 0.05 m/s, at 0.05 to 0.6 m/s moving with speed, and at 1.2 m/s."""


def curve_keys(curve: str, residual_ratio: float) -> dict[str, Any]:
    """Keys of the curve called `curve`; `residual_ratio` is the piecewise one's."""
    return RAILS[curve] | ({"residual_ratio": residual_ratio} if curve == "piecewise" else {})
