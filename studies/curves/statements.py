"""Statements of the sweep over adhesion curves: which conclusions keep their sign, and under which curves they do not."""

from typing import Any, NamedTuple

import pandas as pd

from studies.core.arms import Arm, arm_difference
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Statement
from studies.core.verdict import Bound, agreement, decide, intervals_of, sides_of, unmet

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


def curve_statements(table: pd.DataFrame) -> list[Statement]:
    """One statement per pair and metric, on the rows of a table of `studies.curves.study` that succeeded."""
    return [_statement(table, pair, metric) for pair in PAIRS for metric in METRICS]


def paired_difference(
    table: pd.DataFrame, curve: str, pair: Pair, metric: str
) -> "pd.Series[float]":
    """A metric's difference between the arms of `pair` by event, on rails of `curve`."""
    return arm_difference(table[table["curve"] == curve], pair.one, pair.other, metric)


def _statement(table: pd.DataFrame, pair: Pair, metric: str) -> Statement:
    found = {curve: paired_difference(table, curve, pair, metric) for curve in CURVES}
    bounds = [Bound("", values, least=0.0) for values in found.values()]
    rows = sides_of(bounds)
    signs = dict(zip(CURVES, rows[0], strict=True))
    base, direction = signs[BASE], {1: "more", -1: "less", 0: "neither more nor less"}

    def verdict(row: tuple[int, ...]) -> str:
        first, *others = row
        return decide(
            # without a sign on the piecewise curve there is none to keep
            [first != 0 or None, *(s * first >= 0 for s in others)],
            [s == first for s in others],
            enough=all(bound.enough for bound in bounds),
        )

    return Statement(
        f"{pair.name}: {METRICS[metric]}",
        f"{direction[base]} {METRICS[metric]}, as on the piecewise curve, under every curve",
        verdict(rows[0]),
        intervals_of(found),
        tuple(
            unmet(f"with {curve}: {'the other way round' if s * base < 0 else direction[s]}")
            for curve, s in signs.items() if s != base
        ),
        "mean of paired differences; holds if its sign is that of the piecewise curve under all, does not where one is "
        f"opposite, undecided where that has none; {INTERVALS_OF_MEANS}, {CONFIDENCE:.0%}",
        agreement=agreement(rows, verdict),
    )  # fmt: skip
