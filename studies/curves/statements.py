"""Claims of the sweep over adhesion curves: which conclusions keep their sign, and under which curves they do not."""

from typing import Any, NamedTuple

import pandas as pd

from studies.core.claims import Claim, conjunction, quantity
from studies.core.drawn_events import Arm, paired
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Statement

CURVES: dict[str, dict[str, Any]] = {
    "piecewise": {"kind": "piecewise"},
    "flat piecewise": {"kind": "piecewise", "macro_slope": 1e-3, "residual_ratio": 0.99},
    "Polach wet": {"kind": "polach"},
    "flat slip ratio": {"kind": "slip-ratio", "peak_slip_ratio": 0.05, "residual_ratio": 1.0},
}
"""Name -> keys of `[rail.curve]`: that of every other study first, the others with a wide peak or no fall beyond it."""
BASE = "piecewise"
RULES = ("alone", "greedy", "exact")


class Pair(NamedTuple):
    """A comparison of two arms, by the name that a statement gives it."""

    name: str
    one: Arm
    other: Arm


PAIRS = (
    Pair("greedy less alone", Arm("greedy", "cut-and-ramp"), Arm("alone", "cut-and-ramp")),
    Pair("exact less greedy", Arm("exact", "cut-and-ramp"), Arm("greedy", "cut-and-ramp")),
    Pair("mpc less cut-and-ramp", Arm("exact", "mpc"), Arm("exact", "cut-and-ramp")),
    Pair("mpc less perturb-observe", Arm("exact", "mpc"), Arm("exact", "perturb-observe")),
)
METRICS = {
    "held_effort": "effort over plan",
    "utilisation": "adhesion used",
    "slip_time": "slip [axle s]",
    "damage": "wheel damage [kJ]",
    "jerk_rms": "jerk rms [m/s3]",
}
"""Metric -> what a statement calls it."""


def less(curve: str, pair: Pair, metric: str) -> str:
    """A metric's difference between the arms of `pair` by event, on rails of `curve`."""
    one, other = (f"'{metric}@{curve}/{'/'.join(arm)}'" for arm in (pair.one, pair.other))
    return f"{one} - {other}"


def _same_sign(pair: Pair, metric: str) -> Claim:
    reason = "a conclusion has the same sign on every rail"
    return Claim(
        f"{pair.name}: {METRICS[metric]}",
        f"the difference of {METRICS[metric]} has the sign that it has on the piecewise curve under every curve",
        less(BASE, pair, metric), reason=reason, alike=True,
        cases=tuple(
            Claim(f"with {curve}", mean=less(curve, pair, metric), reason=reason)
            for curve in CURVES if curve != BASE
        ),
        numbers={curve: less(curve, pair, metric) for curve in CURVES},
        method="mean of paired differences; holds if its sign is that of the piecewise curve under all, does not where one "
        f"is opposite, undecided where that has none; {INTERVALS_OF_MEANS}, {CONFIDENCE:.0%}",
    )  # fmt: skip


CLAIMS = tuple(_same_sign(pair, metric) for pair in PAIRS for metric in METRICS)


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """One row per event of rows that are ok, every metric as ``metric@curve/rule/controller``."""
    arm = table["curve"] + "/" + table["rule"] + "/" + table["controller"]
    return paired(table.assign(scenario=table["event"], arm=arm), "arm", METRICS, [])


def curve_statements(table: pd.DataFrame) -> list[Statement]:
    """One statement per pair and metric, on the rows of a table of `studies.curves.study` that succeeded."""
    events = pairs_of(table)
    return [conjunction(events, claim) for claim in CLAIMS]


def paired_difference(
    table: pd.DataFrame, curve: str, pair: Pair, metric: str
) -> "pd.Series[float]":
    """A metric's difference between the arms of `pair` by event, on rails of `curve`."""
    return quantity(pairs_of(table), less(curve, pair, metric)).astype(float)
