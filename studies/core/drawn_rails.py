"""Rails of drawn adhesion curves: which numbers of a curve are drawn, and the level that offers a train so much adhesion."""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

from alloc.plant.adhesion import CURVES, AdhesionCurve, CreepCurve
from alloc.plant.model import level_for
from alloc.plant.train import Train
from studies.core.drawn_events import Quantity, log_uniform, uniform


def curve_of(keys: Mapping[str, Any]) -> AdhesionCurve:
    """The adhesion curve of these keys."""
    return CURVES[keys["kind"]](**{key: value for key, value in keys.items() if key != "kind"})


def rail_offering(
    curve: Mapping[str, Any], adhesion: float, speed: float, train: Train
) -> dict[str, Any]:
    """Keys "level" and "curve" of a rail whose curve, by its keys, offers `adhesion` to `train` at `speed` [m/s].

    The level of Polach's curves is the friction coefficient, above the peak; that of the others is the peak.
    """
    law = curve_of(curve)
    level = level_for(law, adhesion, speed, train) if isinstance(law, CreepCurve) else adhesion
    return {"level": level, "curve": dict(curve)}


SHAPE_QUANTITIES: Mapping[str, Quantity] = MappingProxyType({
    "residual_ratio": uniform(0.3, 0.98, " of the peak (piecewise, slip ratio)", "steep to flat behind the peak"),
    "peak_slip": log_uniform(0.03, 0.8, " m/s (rational)", "the slips that the search is bound to"),
    "peak_slip_ratio": log_uniform(0.01, 0.1, " (slip ratio)", "the same by the speed"),
    "steepness": log_uniform(1.5, 20.0, " (rational)", "from the piecewise curve's shape to Polach's"),
})  # fmt: skip
"""What is drawn of a curve's shape, in the order of drawing."""
_DRAWN_KEYS = {
    "piecewise": ("residual_ratio",),
    "slip-ratio": ("peak_slip_ratio", "residual_ratio"),
    "rational": ("peak_slip", "steepness"),
}


def drawn_curve(kind: str, drawn: Mapping[str, Any]) -> dict[str, Any]:
    """Keys of a curve of this kind with what was drawn of its shape; of the others nothing is drawn."""
    return {"kind": kind} | {name: drawn[name] for name in _DRAWN_KEYS.get(kind, ())}
