"""Scenarios of drawn events: the keys that all populations have in common, and rails of drawn adhesion curves.

A population says what is drawn, in its order, and what is its own; what several of them draw stands here once.
"""

from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np

from alloc.plant.adhesion import CURVES, AdhesionCurve, CreepCurve
from alloc.plant.model import level_for
from alloc.plant.train import Train
from studies.core.drawn_events import Quantity, log_uniform, sometimes, uniform
from studies.files.units import stated
from studies.scenario.loading import shipped_scenario
from studies.scenario.scenario import Scenario

Keys = dict[str, Any]
Drawn = Mapping[str, Any]
START_SPEED = 15.0 / 3.6
"""Speed at which rails of starts offer their drawn level, whatever their curve and speed law [m/s]."""
TWO_PEAKS = ("piecewise", "polach")
"""A peak at 0.05 m/s with a fall behind it, and one at 0.2 ... 0.6 m/s, wide and moving with speed."""

# what several populations draw

SPEED_NOISE = uniform(0.0, 0.04, " km/h", "twice the scenario scattered-rail at most")
LOAD_ERROR = uniform(0.0, 0.05, "", "assumed: pressure of air springs")
TELEGRAM_LOSS = uniform(0.0, 0.05, "", "the scenario scattered-rail at most")
UPHILL = sometimes(
    0.4, 5.0, 20.0, " per mille uphill", 0.0, "most stations are level; 20 per mille as in gradient-start"
)  # fmt: skip
TILT = uniform(
    -0.8, 0.8, ": the load's growth from the middle to the rear end, over its mean",
    "assumed: passengers gather near stairs at one end of the platform",
)  # fmt: skip
RESIDUAL_RATIO = uniform(
    0.5, 0.9, " of the peak at infinite slip (piecewise only)",
    "readhesion paper leaves it open; at 0.9 adhesion is used whatever the wheels do",
)  # fmt: skip
BAD_PATCH = sometimes(
    0.3, 0.6, 0.9, " times the coefficient", 1.0, "assumed: leaves, oil or a leaking drain do not lie everywhere"
)  # fmt: skip
SCATTER_SHARE = sometimes(
    0.5, 0.01, 0.06, " of the coefficient, correlated over 20 m", 0.0,
    "JP5484215 par. on (12)-(15): 0.012 over all its measurements; one stretch of one day scatters less",
)  # fmt: skip
CONDITIONING = sometimes(
    0.4, 0.05, 0.3, " of the coefficient, where wheels ahead slid much", 0.0, "wheels that slip clean the rail"
)  # fmt: skip
SHAPE_QUANTITIES: Mapping[str, Quantity] = MappingProxyType({
    "residual_ratio": uniform(0.3, 0.98, " of the peak (piecewise, slip ratio)", "steep to flat behind the peak"),
    "peak_slip": log_uniform(0.03, 0.8, " m/s (rational)", "the slips that the search is bound to"),
    "peak_slip_ratio": log_uniform(0.01, 0.1, " (slip ratio)", "the same by the speed"),
    "steepness": log_uniform(1.5, 20.0, " (rational)", "from the piecewise curve's shape to Polach's"),
})  # fmt: skip
"""What is drawn of a curve's shape, in the order of drawing."""
_SHAPE_KEYS = {
    "piecewise": ("residual_ratio",),
    "slip-ratio": ("peak_slip_ratio", "residual_ratio"),
    "rational": ("peak_slip", "steepness"),
}


# scenarios


def drawn_scenario(
    base: str | Scenario, name: str, title: str, duration: float, rail: Keys, d: Drawn = MappingProxyType({}),
    onboard: Drawn = MappingProxyType({}), **changes: Any,
) -> Scenario:  # fmt: skip
    """A shipped scenario of `duration` [s] changed to a drawn event, in which nothing else is drawn.

    Signals are as drawn in `d`, where it has them: noise of speeds, error of loads, lost telegrams. `onboard` and `changes`
    are the event's own keys.
    """
    start = shipped_scenario(base) if isinstance(base, str) else base
    return start.changed(
        name=name, title=title, case=None, duration_s=duration, variation=None, rail=rail,
        **({"onboard": own} if (own := _signals(d, onboard)) else {}), **changes,
    )  # fmt: skip


def _signals(d: Drawn, onboard: Drawn) -> Keys:
    """Keys of sensors and telegrams, with what else is on board."""
    sensors = dict(onboard.get("sensors", {}))
    if "speed_noise_kmh" in d:
        sensors = {"speed_noise_kmh": stated("_kmh", d["speed_noise_kmh"])} | sensors
    if "load_error" in d:
        sensors["load_error"] = d["load_error"]
    keys: Keys = {"sensors": sensors} if sensors else {}
    if "telegram_loss" in d:
        keys["telegrams"] = {"jitter_s": 0.03, "loss": stated("", d["telegram_loss"])}
    return keys | {name: one for name, one in onboard.items() if name != "sensors"}


def graded(d: Drawn, start: float = -1000.0) -> Keys:
    """Keys of a line with the drawn gradient from `start` [m] on."""
    grade = stated("_permille", d["grade_permille"])
    return {"sections": [{"start_m": start, "grade_permille": grade}]}


def uneven(scatter: float, *patches: Keys | None) -> Keys:
    """Keys of a rail with scatter, correlated over 20 m, and those of the patches that there are."""
    found = [one for one in patches if one is not None]
    return {"scatter": scatter, "scatter_length_m": 20.0, "patches": found}


def stretch(factor: float, start: float, end: float, edge: float = 4.0) -> Keys | None:
    """Keys of a stretch of rail [m] with so much of the coefficient; none where it has all of it."""
    return (
        {"factor": factor, "start_m": start, "end_m": end, "edge_m": edge}
        if factor != 1.0
        else None
    )


def drawn_patch(d: Drawn, begin: float = 0.0) -> Keys | None:
    """The drawn patch, counted from `begin` [m]."""
    start = begin + d["patch_start_m"]
    return stretch(d["patch_factor"], start, start + d["patch_length_m"])


def drawn_drop(d: Drawn, fade: float, begin: float = 0.0) -> Keys | None:
    """The drawn drop of adhesion for a time, counted from `begin` [s]."""
    if d["drop_factor"] == 1.0:
        return None
    start = begin + d["drop_begin_s"]
    until = start + d["drop_length_s"]
    return {"factor": d["drop_factor"], "begin_s": start, "until_s": until, "fade_s": fade}


def tilted_loads(d: Drawn, cars: int) -> tuple[float, ...]:
    """Pay load [t] of each car, drawn on the mean and growing along the train."""
    loads = d["load_t"] * (1.0 + d["tilt"] * np.linspace(-1.0, 1.0, cars))
    return tuple(stated("_t", load) for load in loads.tolist())


# rails


def curve_of(keys: Drawn) -> AdhesionCurve:
    """The adhesion curve of these keys."""
    return CURVES[keys["kind"]](**{key: value for key, value in keys.items() if key != "kind"})


def rail_offering(curve: Drawn, adhesion: float, speed: float, train: Train) -> Keys:
    """Keys "level" and "curve" of a rail whose curve, by its keys, offers `adhesion` to `train` at `speed` [m/s].

    The level of Polach's curves is the friction coefficient, above the peak; that of the others is the peak.
    """
    law = curve_of(curve)
    level = level_for(law, adhesion, speed, train) if isinstance(law, CreepCurve) else adhesion
    return {"level": level, "curve": dict(curve)}


def drawn_curve(kind: str, drawn: Drawn) -> Keys:
    """Keys of a curve of this kind with what was drawn of its shape; of the others nothing is drawn."""
    return {"kind": kind} | {name: drawn[name] for name in _SHAPE_KEYS.get(kind, ())}
