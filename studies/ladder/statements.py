"""Statements of the ladder: published yardsticks, each rung against the one below, weaknesses ascribed to searching."""

from collections.abc import Mapping, Sequence
from itertools import pairwise

import pandas as pd

from alloc.metrics.registry import range_of
from studies.core.drawn_events import paired
from studies.core.family import Claim, Part, Test, compared
from studies.core.statement import (
    CONFIDENCE,
    INTERVALS_OF_MEANS,
    Statement,
    column_interval,
    in_words,
)
from studies.core.verdict import Numbers

LADDER = (
    "none", "table", "cut-and-ramp", "pi-creep", "perturb-observe", "steepest-gradient", "mpc",
)  # fmt: skip
"""Controllers from the simplest on."""
LOCOMOTIVE = "locomotive and wagons"
SEARCHING = ("perturb-observe", "steepest-gradient")
"""Creep controllers that look for the peak; pi-creep is the same loop without search."""
YARDSTICKS = {
    0.90: "what adaptive trackers of the adhesion's peak are published with",
    0.95: "what JP5484215 expects of readhesion control on its own",
}
"""Share of adhesion used, and whose it is."""
NOTICED = 0.01
"""Fluctuation of torque, as a share of the plan's, above which a search is visible in it."""
STUDENT = f"{INTERVALS_OF_MEANS}, {CONFIDENCE:.0%}, after Holm over all claims"
PERCENT = in_words("{:.1f} % [{:.1f}, {:.1f}] (n = {})", 100)
SECONDS = in_words("{:.2f} s [{:.2f}, {:.2f}] (n = {})")

METRICS = {
    "utilisation_short": "adhesion used where short",
    "search_time": "search time [s]",
    "unfinished_searches": "share of searches unfinished",
    "torque_fluctuation": "torque fluctuation over plan",
    "slip_time": "slip [axle s]",
    "damage": "wheel damage [kJ]",
    "jerk_rms": "jerk rms [m/s3]",
    "effort_ratio": "effort over plan",
}
"""Metric -> what a statement calls it."""

PARTS: dict[str, Part] = {
    "one inverter per car": lambda e: e["train"] == "one inverter per car",
    "one inverter per axle": lambda e: e["train"] == "one inverter per axle",
    "a locomotive without free axle": lambda e: e["train"] == LOCOMOTIVE,
    "a narrow peak (piecewise)": lambda e: e["curve"] == "piecewise",
    "a wide peak (Polach)": lambda e: e["curve"] == "polach",
    "even rail": lambda e: (e["scatter"] == 0.0) & (e["patch_factor"] == 1.0),
    "scatter or a patch": lambda e: (e["scatter"] > 0.0) | (e["patch_factor"] < 1.0),
}
"""Parts of the events, by what was drawn."""


def ladder_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements on a table of `studies.ladder.study`, of events in which no controller failed."""
    numbers = [*METRICS, "wrong_steps_still", "wrong_steps_changing"]
    drawn = ("train", "curve", "scatter", "patch_factor")
    events = paired(table, "controller", numbers, drawn)
    claims = [
        *(yardstick(events, bar, name) for bar in YARDSTICKS for name in LADDER[1:]),
        *(_rung(events, below, name) for below, name in pairwise(LADDER)),
        *(_slow(events, name) for name in SEARCHING),
        *(_restless(events, name) for name in SEARCHING),
        *(_misled(events, name) for name in SEARCHING),
    ]
    return compared(claims)


def difference(events: pd.DataFrame, metric: str, name: str, other: str) -> "pd.Series[float]":
    """A metric of controller `name` less that of `other`, event by event."""
    values: pd.Series[float] = events[f"{metric}@{name}"] - events[f"{metric}@{other}"]
    return values.astype(float)


def _less(events: pd.DataFrame, metric: str, name: str, others: Sequence[str]) -> Numbers:
    return {
        f"{METRICS[metric]}, less {other}": difference(events, metric, name, other)
        for other in others
    }


def yardstick(
    events: pd.DataFrame, bar: float, name: str, parts: Mapping[str, Part] = PARTS
) -> Claim:
    """The claim that `name` uses more than `bar` of the adhesion where a unit is short of it."""
    return Claim(
        f"{bar:.0%}: {name}", f"{name} uses {bar:.0%} of the adhesion where a unit is short of it ({YARDSTICKS[bar]})",
        events, Test(lambda e: e[f"utilisation_short@{name}"], bar, within=range_of("utilisation_short")), parts, PERCENT,
        {text: column_interval(events, f"{metric}@{name}") for metric, text in METRICS.items()},
        f"mean over events above {bar:.0%}; {STUDENT}, parts after Bonferroni",
    )  # fmt: skip


def _rung(events: pd.DataFrame, below: str, name: str) -> Claim:
    return Claim(
        f"rung: {name}", f"{name} uses more of the adhesion where a unit is short of it than {below}",
        events, Test(lambda e: difference(e, "utilisation_short", name, below)), PARTS, PERCENT,
        {f"{text}, less {below}": difference(events, metric, name, below) for metric, text in METRICS.items()},
        f"mean of paired differences above 0; {STUDENT}, parts after Bonferroni",
    )  # fmt: skip


def _slow(events: pd.DataFrame, name: str) -> Claim:
    return Claim(
        f"slow: {name}", f"{name} searches longer than the MPC, which predicts (arXiv 2406.13650: slow search)",
        events, Test(lambda e: difference(e, "search_time", name, "mpc")), PARTS, SECONDS,
        _less(events, "search_time", name, ("mpc", "pi-creep", "cut-and-ramp")),
        f"mean of paired differences above 0; {STUDENT}; unfinished searches count until they end",
    )  # fmt: skip


def _restless(events: pd.DataFrame, name: str) -> Claim:
    test = Test(lambda e: difference(e, "torque_fluctuation", name, "pi-creep"), NOTICED)
    return Claim(
        f"restless: {name}", f"{name} lets the torque fluctuate about the peak (arXiv 2406.13650)",
        events, test, PARTS, PERCENT,
        _less(events, "torque_fluctuation", name, ("pi-creep", "cut-and-ramp", "mpc")),
        f"rms about the 1 s mean, more than pi-creep's, the same loop without search, by {NOTICED:.0%} of the plan's "
        f"torque; {STUDENT}",
    )  # fmt: skip


def _misled(events: pd.DataFrame, name: str) -> Claim:
    changing, still = f"wrong_steps_changing@{name}", f"wrong_steps_still@{name}"
    test = Test(lambda e: (e[changing] - e[still]).astype(float))
    # without a free axle slip is not known, and no step can be called an answer to another
    free = events[events["train"] != LOCOMOTIVE]
    return Claim(
        f"misled: {name}", f"{name} steps away from the peak more often while the rail changes (arXiv 2406.13650)",
        free, test, PARTS, PERCENT,
        {
            "share of steps away from the peak, rail changing": free[changing],
            "share of steps away from the peak, rail still": free[still],
            "difference": test.quantity(free),
        },
        "steps of the mean slip over 0.3 s, of units off the peak by 30 %; the rail changes by 1 % or more; trains "
        f"with a free axle; paired by event, {STUDENT}",
    )  # fmt: skip
