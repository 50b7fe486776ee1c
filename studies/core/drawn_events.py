"""Events that are drawn at random, quantity by quantity, arms that meet them, and the rows that belong to one."""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

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


def paired(
    table: pd.DataFrame, arm: str, numbers: Iterable[str], drawn: Iterable[str]
) -> pd.DataFrame:
    """One row per event: what was drawn, and every number as ``number@value`` of the column `arm`."""
    wide = table.pivot(index="scenario", columns=arm, values=list(numbers))
    wide.columns = pd.Index(["@".join(column) for column in wide.columns])
    return wide.join(table.groupby("scenario")[list(drawn)].first())
