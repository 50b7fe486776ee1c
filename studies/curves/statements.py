"""What the sweep over adhesion curves says: which conclusions keep their sign, and under which curves they do not."""

from typing import Any, NamedTuple

import pandas as pd

from studies.core.arms import Arm, arm_difference
from studies.core.statement import CONFIDENCE, Interval, Statement
from studies.core.verdict import LEAST_EVENTS, decided

CURVES: dict[str, dict[str, Any]] = {
    "piecewise": {"kind": "piecewise"},
    "flat piecewise": {"kind": "piecewise", "macro_slope": 1e-3, "residual_ratio": 0.99},
    "Polach wet": {"kind": "polach"},
    "flat slip ratio": {"kind": "slip-ratio", "peak_slip_ratio": 0.05, "residual_ratio": 1.0},
}
"""Name -> keys of `[rail.curve]`: that of every other study first, the others with a wide peak or no fall beyond it."""
BASE = "piecewise"
RULES = ("alone", "greedy", "exact")
INFORMED = "informed mpc"
"""The MPC on a train that believes in the rail's own curve; all others believe in the piecewise one."""


class Pair(NamedTuple):
    """A comparison of two arms, by the name that a statement gives it."""

    name: str
    one: Arm
    other: Arm


PAIRS = (
    Pair("greedy less alone", Arm("greedy", "cut-and-ramp"), Arm("alone", "cut-and-ramp")),
    Pair("exact less greedy", Arm("exact", "cut-and-ramp"), Arm("greedy", "cut-and-ramp")),
    Pair("mpc less cut-and-ramp", Arm("exact", "mpc"), Arm("exact", "cut-and-ramp")),
    Pair("informed mpc less cut-and-ramp", Arm("exact", INFORMED), Arm("exact", "cut-and-ramp")),
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


def paired_difference(table: pd.DataFrame, curve: str, pair: Pair, metric: str) -> Interval:
    """Mean over events of a metric's difference between the arms of `pair`, on rails of `curve`."""
    return arm_difference(table[table["curve"] == curve], pair.one, pair.other, metric)


def sign(interval: Interval) -> int:
    """1 or -1 where the whole interval lies on one side of zero, else 0."""
    if interval.low > 0.0:
        return 1
    return -1 if interval.high < 0.0 else 0


def _statement(table: pd.DataFrame, pair: Pair, metric: str) -> Statement:
    found = {curve: paired_difference(table, curve, pair, metric) for curve in CURVES}
    signs = {curve: sign(interval) for curve, interval in found.items()}
    base, direction = signs[BASE], {1: "more", -1: "less", 0: "neither more nor less"}
    return decided(
        f"{pair.name}: {METRICS[metric]}",
        f"{direction[base]} {METRICS[metric]}, as on the piecewise curve, under every curve",
        {f"the other way round with {curve}": s * base >= 0 for curve, s in signs.items()},
        found,
        "mean of paired differences; holds if its sign is that of the piecewise curve under all, does not where one is "
        f"opposite; Student's t, {CONFIDENCE:.0%}",
        {f"{direction[s]} with {curve}": s == base or s * base < 0 for curve, s in signs.items()},
        enough=min(interval.count for interval in found.values()) >= LEAST_EVENTS,
    )
