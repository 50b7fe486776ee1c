"""Events that are drawn at random, quantity by quantity, arms that meet them, and the rows that belong to one."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from alloc.plant.adhesion import CURVES, AdhesionCurve, CreepCurve
from alloc.plant.model import level_for
from alloc.plant.train import Train
from studies.files.units import stated
from studies.scenario.scenario import Scenario, shipped_scenario

COMPARED = ("cut-and-ramp", "perturb-observe")
"""Default controllers for a comparison of rules: one waits for a slip signal, one limits torque without any. Rules differ in
what they need to act."""


class Arm(NamedTuple):
    """A rule under a controller."""

    rule: str
    controller: str


class Quantity(NamedTuple):
    """A drawn quantity: distribution and reason in words, and the draw, which may read what was drawn before it."""

    distribution: str
    reason: str
    draw: Callable[[np.random.Generator, dict[str, Any]], Any]


def uniform(low: float, high: float, words: str, reason: str) -> Quantity:
    """Uniform from `low` to `high`; `words` follow: unit, or what the ends mean."""
    text = f"uniform, {low:g} ... {high:g}{words}"
    return Quantity(text, reason, lambda g, _: float(g.uniform(low, high)))


def log_uniform(low: float, high: float, words: str, reason: str) -> Quantity:
    """Uniform in its logarithm from `low` to `high`; `words` follow."""
    return Quantity(
        f"uniform in its logarithm, {low:g} ... {high:g}{words}", reason,
        lambda g, _: float(math.exp(g.uniform(math.log(low), math.log(high)))),
    )  # fmt: skip


def sometimes(
    share: float, low: float, high: float, words: str, otherwise: float, reason: str
) -> Quantity:
    """Uniform in this share of the events, `otherwise` in the others."""
    return Quantity(
        f"{otherwise:g} in {1.0 - share:.0%}, else uniform, {low:g} ... {high:g}{words}", reason,
        lambda g, _: float(g.uniform(low, high)) if g.random() < share else otherwise,
    )  # fmt: skip


def in_turn(values: Sequence[str], words: str, reason: str, after: int = 1) -> Quantity:
    """Each of these, in its turn, for `after` events; their order follows from their number."""
    return Quantity(words, reason, lambda _, d: values[d["number"] // after % len(values)])


def one_of(values: Sequence[str], words: str, reason: str, shares: Sequence[float] | None = None) -> Quantity:  # fmt: skip
    """One of these, equally likely or by their shares."""
    return Quantity(words, reason, lambda g, _: str(g.choice(list(values), p=shares)))


@dataclass(frozen=True)
class DrawnEvents:
    """Events by what is drawn for them. They follow from seed and number, so a longer study extends a shorter one."""

    name: str
    """Beginning of every event's name."""
    quantities: Mapping[str, Quantity]
    """In the order of drawing."""
    stream: tuple[int, ...] = ()
    """Numbers that distinguish the draws from those of other studies."""
    numbered: bool = False
    """Whether the number is among what is drawn: other quantities take turns by it."""

    def draw(self, seed: int, k: int) -> dict[str, Any]:
        """The quantities of event `k`."""
        generator = np.random.default_rng([seed, k, *self.stream])
        drawn: dict[str, Any] = {"number": k} if self.numbered else {}
        for name, quantity in self.quantities.items():
            drawn[name] = quantity.draw(generator, drawn)
        return drawn

    def event_name(self, seed: int, k: int) -> str:
        """Name of event `k`."""
        return f"{self.name}-{seed}-{k:04d}"

    def table(self, seed: int, events: int) -> pd.DataFrame:
        """What was drawn, one row per event, with the scenario's name to join on."""
        drawn = [
            {"scenario": self.event_name(seed, k), **self.draw(seed, k)} for k in range(events)
        ]
        return pd.DataFrame(drawn)

    def joined(self, table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
        """The rows with what was drawn for their events."""
        return table.merge(self.table(seed, events), on="scenario")


def complete(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of the events in which nothing failed: only those can be paired."""
    failed = table["scenario"][table["status"] != "ok"]
    return table[~table["scenario"].isin(failed)]


def with_meaning(
    table: pd.DataFrame, meanings: Mapping[str, tuple[Any, ...]], *columns: str
) -> pd.DataFrame:
    """The rows with what the name of their scenario stands for, in these columns."""
    found = [meanings[name] for name in table["scenario"]]
    return table.join(pd.DataFrame(found, columns=list(columns), index=table.index))


def with_parts(
    table: pd.DataFrame, parts: Mapping[str, tuple[Any, ...]], *columns: str
) -> pd.DataFrame:
    """The rows with "event", and what stands behind its name in that of their scenario, in these columns."""
    names = table["scenario"].str.extract(r"(?P<event>[a-z-]+-\d+-\d{4,})(?P<part>.*)")
    meanings = {
        scenario: (event, *parts[part])
        for scenario, event, part in zip(
            table["scenario"], names["event"], names["part"], strict=True
        )
    }
    return with_meaning(table, meanings, "event", *columns)


def paired(
    table: pd.DataFrame, arm: str, numbers: Iterable[str], drawn: Iterable[str]
) -> pd.DataFrame:
    """One row per event: what was drawn, and every number as ``number@value`` of the column `arm`."""
    wide = table.pivot(index="scenario", columns=arm, values=list(numbers))
    wide.columns = pd.Index(["@".join(column) for column in wide.columns])
    return wide.join(table.groupby("scenario")[list(drawn)].first())


# Scenarios of drawn events: the keys that all populations have in common, and rails of drawn adhesion curves.
#
# A population says what is drawn, in its order, and what is its own; what several of them draw stands here once.

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
