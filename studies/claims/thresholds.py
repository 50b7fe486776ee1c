"""The thresholds of claims (a) to (e) of JP5484215, and of which events bear on each.

They are frozen: a seed whose events were judged by others says so in its report. `tests/studies/claim_thresholds.json`
records every change with its reason.
"""

from collections.abc import Mapping

import pandas as pd

from alloc.metrics.registry import UNLIMITED, range_of
from studies.claims.measures import RANGES
from studies.core.family import Test
from studies.core.threshold import Threshold

REACHED = 0.99
"""Share of the planned effort from which on the plan counts as reached."""
PATENT = "JP5484215"
OWN = "set by this project"

TABLE = (
    Threshold("a", "effort_up_to_plan", "at least", REACHED,
              "the plan is reached: a hundredth is what a driver could notice in a timetable",
              f"{PATENT}: planned effort; the hundredth {OWN}"),
    Threshold("a besides", "held_effort", "at least", 0.0,
              "redistribution gives more than no redistribution", PATENT, less="alone"),
    Threshold("a within reach", "reach_low", "at least", 1.0,
              "the whole allows the plan 95 % of the time: case B", f"{PATENT}: case B; 95 % {OWN}", rule="oracle"),
    Threshold("a short alone", "held_effort", "at most", REACHED,
              "without redistribution the plan is missed", OWN, rule="alone"),
    Threshold("b", "unit_use_low", "at least", 0.90,
              "every unit about at its bound: the least used within a tenth of it",
              f"{PATENT}: about the bound; a tenth {OWN}"),
    Threshold("b out of reach", "reach_high", "at most", 1.0,
              "the whole falls short of the plan 95 % of the time: case A", f"{PATENT}: case A; 95 % {OWN}", rule="oracle"),
    Threshold("c", "use_over", "at least", 0.92,
              "about 95 %: readhesion controllers differ by three points", f"{PATENT}: about 95 %; three points {OWN}"),
    Threshold("c over", "over_time", "at least", 1.0,
              "unit seconds under a limit too high that an event needs to say anything of it", OWN),
    Threshold("d", "jerk_rms", "at most", 0.0, "a better ride is less jerk", PATENT, less="sharing"),
    Threshold("d besides", "jerk_peak", "at most", 0.0, "a better ride has no higher peaks", OWN, less="sharing"),
    Threshold("d slips", "unit_detections", "at least", 1.0, "without slip the rules do not differ", OWN, rule="alone"),
    Threshold("e", "held_effort", "at least", 0.0, "better is more effort", PATENT, less="preset"),
    Threshold("e besides", "slip_time", "at most", 0.0, "more effort for more slip is not better", OWN, less="preset"),
    Threshold("e preset wrong", "over_share", "at least", 0.05,
              "share of units and time with a limit above the adhesion: the preset does not fit the rail",
              f"{PATENT}: adhesion other than assumed; share {OWN}", rule="preset"),
)  # fmt: skip
"""Every threshold that decides a verdict, and then the events that it is made from."""
THRESHOLDS: Mapping[str, Threshold] = {row.name: row for row in TABLE}
POPULATIONS = {
    "a": ("a within reach", "a short alone"),
    "b": ("b out of reach",),
    "c": ("c over",),
    "d": ("d slips",),
    "e": ("e preset wrong",),
}
"""Claim -> which thresholds all an event must pass to bear on it."""


def quantity(row: Threshold, rule: str, events: pd.DataFrame) -> "pd.Series[float]":
    """What a threshold is for, by event, with `rule` under test."""
    values = events[f"{row.metric}@{row.rule or rule}"]
    return values - events[f"{row.metric}@{row.less}"] if row.less else values


def threshold_test(name: str, rule: str) -> Test:
    """The test of a threshold with `rule` under test."""
    row = THRESHOLDS[name]
    return Test(
        lambda events: quantity(row, rule, events),
        row.value,
        1 if row.direction == "at least" else -1,
        UNLIMITED if row.less else RANGES.get(row.metric, range_of(row.metric)),
    )


def bears(name: str, rule: str, events: pd.DataFrame) -> "pd.Series[bool]":
    """Which events pass a threshold, one by one."""
    row = THRESHOLDS[name]
    values = quantity(row, rule, events)
    return values >= row.value if row.direction == "at least" else values <= row.value
