"""What populations of random events have in common: draws, and keys of scenarios made of them.

An event follows from its seed and its number, so more events extend fewer. What is drawn is assumed where no source is
named: half of the draws is weather.
"""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from alloc.laws import speed_law
from alloc.plant.curves import CURVES, CreepCurve
from alloc.plant.rail import SPEED_LAWS
from alloc.plant.rows import level_for
from alloc.plant.train import Train
from alloc.schema.units import unit_of_key
from studies.files.scenario import Scenario

Keys = dict[str, Any]
"""A table of a scenario file."""
Drawn = Mapping[str, Any]
Arms = Mapping[str, Keys]
"""Changes of the equipment, by words."""

START_SPEED = 15.0 / 3.6
"""Speed at which the rail of a start offers its drawn level, whatever its curve [m/s]."""
SHAPES = {
    "piecewise": ("residual_ratio",),
    "slip-ratio": ("peak_slip_ratio", "residual_ratio"),
    "rational": ("peak_slip", "steepness"),
}
"""Parameters that are drawn for an adhesion curve; others have none."""


class Draw:
    """The random numbers of event `k`; `stream` keeps populations apart."""

    def __init__(self, seed: int, k: int, *stream: int) -> None:
        self.generator = np.random.default_rng([seed, k, *stream])

    def uniform(self, low: float, high: float) -> float:
        """Uniform."""
        return float(self.generator.uniform(low, high))

    def log_uniform(self, low: float, high: float) -> float:
        """Uniform in its logarithm."""
        # of `math`: NumPy's differ in the last bit, and so would the events
        return math.exp(self.uniform(math.log(low), math.log(high)))

    def mixture(self, share: float, low: float, high: float, otherwise: float) -> float:
        """Uniform in this share of the events, `otherwise` in the others."""
        return self.uniform(low, high) if self.generator.random() < share else otherwise

    def choose(self, values: Sequence[str], shares: Sequence[float] | None = None) -> str:
        """One of these, equally likely or by their shares."""
        return str(self.generator.choice(list(values), p=shares))


def drawn_event(base: Scenario, name: str, title: str, **keys: Any) -> Scenario:
    """An event of a population: `base` with other keys, meant for no case, and the same on all days."""
    return base.changed(name=name, title=title, case=None, variation=None, **keys)


def drop_tiny(key: str, size: float) -> float:
    """0 where a draw is smaller than any size that files know."""
    return size if abs(size) >= unit_of_key(key).least else 0.0


SENSORS = ("speed_noise_kmh", "speed_quantum_kmh", "radius_error", "load_error")
"""Errors of sensors that a population may draw."""


def signal_keys(d: Drawn) -> Keys:
    """Keys of sensors and telegrams; of the sensors those that are drawn."""
    return {
        "sensors": {key: drop_tiny(key, d[key]) for key in SENSORS if key in d},
        "telegrams": {"jitter_s": 0.03, "loss": drop_tiny("", d["telegram_loss"])},
    }


def car_loads(d: Drawn, cars: int) -> list[float]:
    """Pay load of each car [t], growing along the train."""
    along = d["load_t"] * (1.0 + d["tilt"] * np.linspace(-1.0, 1.0, cars))
    return [drop_tiny("_t", load) for load in along.tolist()]


def line_keys(d: Drawn, start: float = -1000.0) -> Keys:
    """A line with the drawn gradient from `start` [m] on."""
    grade = drop_tiny("_permille", d["grade_permille"])
    return {"sections": [{"start_m": start, "grade_permille": grade}]}


def failure_keys(d: Drawn, units: int, begin: float = 0.0) -> list[Keys]:
    """The drawn failure of one of so many units, counted from `begin` [s]."""
    failed = {"unit": 1 + int(d["failed_place"] * units), "time_s": begin + d["failed_at_s"]}
    return [failed] if d["fails"] else []


def receptivity_keys(d: Drawn) -> Keys:
    """A line that takes up the drawn share of the regenerated power on average, the more swinging the less it is."""
    swing = 0.6 * (1.0 - d["receptivity"])
    return {"mean": d["receptivity"], "amplitude": swing, "period_s": 7.0}


def level_keys(coefficient: float, law: str, speed: float = START_SPEED) -> Keys:
    """Level of a rail with this coefficient at `speed` [m/s], which follows a speed law or "none"."""
    if law == "none":
        return {"level": coefficient}
    coefficient_by_law = float(speed_law(speed, *SPEED_LAWS[law]))
    return {"law_factor": coefficient / coefficient_by_law, "speed_law": law}


def stretch(factor: float, start: float, end: float) -> list[Keys]:
    """A stretch of rail [m] with so much of the coefficient; none where the factor is 1."""
    if factor == 1.0:
        return []
    return [{"factor": factor, "start_m": start, "end_m": end, "edge_m": 4.0}]


def spell(factor: float, begin: float, lasts: float, fade: float) -> list[Keys]:
    """A time [s] in which the rail has so much of the coefficient; none where the factor is 1."""
    if factor == 1.0:
        return []
    return [{"factor": factor, "begin_s": begin, "until_s": begin + lasts, "fade_s": fade}]


def patch_keys(d: Drawn, begin: float = 0.0) -> list[Keys]:
    """The drawn patch, counted from `begin` [m]."""
    start = begin + d["patch_start_m"]
    return stretch(d["patch_factor"], start, start + d["patch_length_m"])


def curve_keys(kind: str, d: Drawn) -> Keys:
    """An adhesion curve with what was drawn of its shape."""
    return {"kind": kind} | {name: d[name] for name in SHAPES.get(kind, ())}


def rail_keys(curve: Drawn, adhesion: float, train: Train, speed: float = START_SPEED) -> Keys:
    """Level and curve of a rail that offers `adhesion` to `train` at `speed` [m/s].

    The level of Polach's curves is the friction coefficient, above their peak; the level of other curves is the peak.
    """
    law = CURVES[curve["kind"]](**{key: x for key, x in curve.items() if key != "kind"})
    creep = isinstance(law, CreepCurve)
    level = level_for(law, adhesion, speed, train) if creep else adhesion
    return {"level": float(level), "curve": dict(curve)}
