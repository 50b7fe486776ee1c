"""What the sweep over curves, noise and computing time says: where the MPC loses adhesion to controllers without a model."""

from collections.abc import Mapping
from types import MappingProxyType

import pandas as pd

from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Statement
from studies.core.verdict import Bound, Item, decided
from studies.mismatch.rails import RAILS
from studies.mismatch.settings import (
    DELAYED,
    GIVEN,
    MIDDLE,
    NOISES,
    REFERENCE,
    SAME_BELIEF,
    SEARCHER,
    SOUGHT,
)

LOSS = 0.01
"""Share of the adhesion that may be lost to another controller and still counts as none."""
METRICS = {
    "utilisation_short": "adhesion used where short",
    "damage": "wheel damage [kJ]",
    "slip_time": "slip [axle s]",
    "torque_fluctuation": "torque fluctuation over plan",
}
"""Metric -> what a statement calls it."""
METHOD = (
    f"means of paired differences of the adhesion used where short above -{LOSS:g} in every cell; "
    f"{INTERVALS_OF_MEANS}, {CONFIDENCE:.0%} each"
)


def mismatch_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements on the rows of a table of `studies.mismatch.study` that are ok."""
    return [
        *(_sought(table, curve, other.name) for other in (REFERENCE, SEARCHER) for curve in RAILS),
        *(_given(table, setting.name) for setting in GIVEN),
        _believed(table),
    ]


def difference(
    table: pd.DataFrame, curve: str, noise: float, one: str, other: str, metric: str
) -> "pd.Series[float]":
    """A metric under setting `one` less that under `other`, by event, at one curve and noise [km/h]."""
    rows = table[(table["curve"] == curve) & (table["noise"] == noise)]
    values = [rows[rows["setting"] == name].set_index("event")[metric] for name in (one, other)]
    return (values[0] - values[1]).astype(float)


def _statement(
    table: pd.DataFrame,
    name: str,
    claim: str,
    pairs: Mapping[str, tuple[str, float, str, str]],
) -> Statement:
    """That no cell loses; `pairs`: words of a cell -> curve, noise and the two settings."""
    found = {words: difference(table, *pair, "utilisation_short") for words, pair in pairs.items()}
    essential: dict[str, Item] = {
        f"with {words}": Bound("", values, least=-LOSS) for words, values in found.items()
    }
    numbers = {
        f"{text}, {words}": difference(table, *pair, metric)
        for metric, text in METRICS.items()
        for words, pair in pairs.items()
    }
    return decided(name, claim, essential, numbers, METHOD)


def _sought(table: pd.DataFrame, curve: str, reference: str) -> Statement:
    pairs = {
        f"{setting.name}, {noise:g} km/h of noise": (curve, noise, setting.name, reference)
        for setting in (SOUGHT, DELAYED)
        for noise in NOISES
    }
    return _statement(
        table, f"{curve}: mpc, {reference}",
        f"on {curve} rail the MPC loses less than a point of adhesion to {reference}, whatever noise and computing time",
        pairs,
    )  # fmt: skip


def _given(table: pd.DataFrame, name: str) -> Statement:
    pairs = {f"{curve} rail": (curve, MIDDLE, name, REFERENCE.name) for curve in RAILS}
    return _statement(
        table, f"given slip: {name}",
        f"an MPC that holds the slip at {name} loses less than a point of adhesion to {REFERENCE.name} on every rail",
        pairs,
    )  # fmt: skip


def _believed(table: pd.DataFrame) -> Statement:
    curve = next(iter(RAILS))
    numbers = {
        f"{text}, {other.name} less {SOUGHT.name}": difference(
            table, curve, MIDDLE, other.name, SOUGHT.name, metric
        )
        for metric, text in METRICS.items()
        for other in SAME_BELIEF
    }
    same = all(bool((values == 0.0).all()) for values in numbers.values())
    return decided(
        "belief", "an MPC that seeks its slip does the same whatever curve it believes in",
        {"to the last digit": same}, MappingProxyType(numbers), "holds if no number of any event differs",
        enough=all(values.notna().any() for values in numbers.values()),
    )  # fmt: skip
