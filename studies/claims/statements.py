"""Claims (a) to (e) of JP5484215 as tests with thresholds, and the statements that a table of events yields."""

from collections.abc import Callable, Mapping, Sequence
from itertools import pairwise

import pandas as pd

from studies.claims.drawn_events import paired
from studies.claims.events import BELIEVED_SLOPE, QUANTITIES
from studies.claims.measures import EXCESS_EDGES, excess_column
from studies.core.statement import Interval, Statement, in_words
from studies.core.verdict import Numbers, Part, Test, compared

REFERENCE = "greedy"
"""Rule of which the patent's claims are claims."""
REACHED = 0.99
"""Share of the planned effort from which on the plan counts as reached."""
ABOUT_BOUND = 0.90
"""Use of its adhesion from which on a unit works at about its bound."""
ABOUT_95 = 0.92
"""Use from which on it is about 95 %: three points are what readhesion controllers differ by."""
LEAST_OVER_TIME = 1.0
"""Unit seconds [s] under a limit too high that an event needs to bear on claim (c)."""
PRESET_WRONG = 0.05
"""Share of units and time with a limit above the adhesion from which on the preset pattern does not fit the rail."""

INTERVALS = "means and paired differences: Student's t; shares: Wilson; 95 % for the whole, Bonferroni among its parts"
EFFORT, JERK, SLIP = "effort over plan", "jerk rms [m/s3]", "slip [axle s]"
"""What statements call the numbers that several of them have."""
POINTS = in_words("{:+.2f} [{:+.2f}, {:+.2f}] %, n = {}", 100)
"""A share in per cent, or a difference of shares in points."""


def pairs_of(events: pd.DataFrame) -> pd.DataFrame:
    """One row per event: what was drawn, and every number of every rule as ``number@rule``."""
    drawn = [name for name in QUANTITIES if name in events]
    numbers = events.select_dtypes("number").columns.difference([*drawn, "seed", "wall_time"])
    return paired(events, "rule", numbers, drawn)


PARTS: dict[str, Part] = {
    "summer": lambda e: e["season"] == "summer",
    "winter": lambda e: e["season"] == "winter",
    "growth along the train much below belief": lambda e: e["slope"] < 0.67 * BELIEVED_SLOPE,
    "growth along the train about as believed": lambda e: e["slope"].between(
        0.67 * BELIEVED_SLOPE, 1.33 * BELIEVED_SLOPE
    ),
    "growth along the train much above belief": lambda e: e["slope"] > 1.33 * BELIEVED_SLOPE,
    "little scatter (< 0.006)": lambda e: e["scatter"] < 0.006,
    "much scatter (>= 0.006)": lambda e: e["scatter"] >= 0.006,
    "uniform rail": lambda e: e["patch_factor"] == 1.0,
    "a patch": lambda e: e["patch_factor"] < 1.0,
    "adhesion independent of speed": lambda e: e["speed_law"] == "none",
    "adhesion falling with speed": lambda e: e["speed_law"] != "none",
    "heavier front": lambda e: e["tilt"] < -0.25,
    "even load": lambda e: e["tilt"].abs() <= 0.25,
    "heavier rear": lambda e: e["tilt"] > 0.25,
    "level line": lambda e: e["grade_permille"] == 0.0,
    "a gradient": lambda e: e["grade_permille"] > 0.0,
}
"""Name -> which events of a table with what was drawn (`studies.claims.events`) belong to it."""


def within_reach(pairs: pd.DataFrame) -> "pd.Series[bool]":
    """Events in which the adhesion of the whole allows the plan nearly all the time."""
    return pairs["reach_low@oracle"] >= 1.0


def out_of_reach(pairs: pd.DataFrame) -> "pd.Series[bool]":
    """Events in which it allows the plan hardly ever: case A."""
    return pairs["reach_high@oracle"] < 1.0


REACH_PARTS: dict[str, Part] = {
    "the plan within reach (case B)": within_reach,
    "the plan out of reach (case A)": out_of_reach,
}
"""Parts by what the adhesion of the whole allows."""


def claim_population(pairs: pd.DataFrame, claim: str) -> pd.DataFrame:
    """Rows of `pairs_of` that bear on a claim, a to e."""
    slips = pairs["unit_detections@alone"] > 0
    chosen = {
        "a": within_reach(pairs) & (pairs["held_effort@alone"] < REACHED),
        "b": out_of_reach(pairs),
        "c": pairs[f"over_time@{REFERENCE}"] >= LEAST_OVER_TIME,
        "d": slips,
        "e": pairs["over_share@preset"] > PRESET_WRONG,
    }
    return pairs[chosen[claim]]


def difference(name: str, rule: str, other: str, scale: float = 1.0) -> Test:
    """Mean paired difference of a number, `rule` less `other`; positive wanted (negative with a negative `scale`)."""
    return Test(
        lambda e: abs(scale) * (e[f"{name}@{rule}"] - e[f"{name}@{other}"]),
        wanted=1 if scale > 0.0 else -1,
    )


def reached_test() -> Test:
    """Effort over plan, at most 1, that claim (a) wants at `REACHED`."""
    return Test(lambda e: e[f"held_effort@{REFERENCE}"].clip(upper=1.0), REACHED)


def bound_test() -> Test:
    """Adhesion used by the unit that uses least, which claim (b) wants at `ABOUT_BOUND`."""
    return Test(lambda e: e[f"unit_use_low@{REFERENCE}"], ABOUT_BOUND)


def over_test() -> Test:
    """Adhesion used under limits somewhat too high, which claim (c) wants at `ABOUT_95`."""
    return Test(lambda e: e[f"use_over@{REFERENCE}"], ABOUT_95)


def claim_statements(events: pd.DataFrame) -> list[Statement]:
    """One statement per claim from rows of `studies.claims.study` in which every rule succeeded."""
    pairs = pairs_of(events)
    claims = {"a": _reaches, "b": _at_bound, "c": _about_95, "d": _ride, "e": _preset}
    return [claim(claim_population(pairs, name)) for name, claim in claims.items()]


def _statement(
    name: str, claim: str, events: pd.DataFrame, test: Test, numbers: Numbers, method: str,
    others: Sequence[tuple[str, Test]] = (),
    show: Callable[[Interval], str] = POINTS,
    parts: Mapping[str, Part] = PARTS,
) -> Statement:  # fmt: skip
    method = f"{method}; {INTERVALS}"
    return compared(name, claim, events, test, parts, show, numbers, method, others)


def _less(events: pd.DataFrame, other: str, rule: str = REFERENCE, **words: str) -> Numbers:
    """Paired differences of numbers by name, `rule` less `other`; `words`: what a statement calls them."""
    return {
        f"{text}, {rule} less {other}": difference(name, rule, other).quantity(events)
        for name, text in words.items()
    }


def _reaches(events: pd.DataFrame) -> Statement:
    test, at_most = reached_test(), f"{EFFORT}, greedy (at most 1)"
    reached = {
        rule: events[f"held_effort@{rule}"] >= REACHED
        for rule in ("alone", REFERENCE, "exact", "oracle")
    }
    return _statement(
        "a", "redistribution reaches the planned effort where adhesion on the whole allows it and alone does not",
        events, test,
        {
            at_most: test.quantity(events),
            **_less(events, "alone", held_effort=EFFORT),
            **_less(events, "alone", "exact", held_effort=EFFORT),
            f"{at_most}, where the oracle reaches it": test.quantity(events[reached["oracle"]]),
            **{f"share of events that reach the plan, {rule}": met for rule, met in reached.items()},
        },
        f"events whose whole adhesion is at or above the plan 95 % of the time, and alone below {REACHED:.0%} of it; "
        f"holds if the mean effort is {REACHED:.0%} of the plan",
        [("effort over alone", difference("held_effort", REFERENCE, "alone"))],
    )  # fmt: skip


def _at_bound(events: pd.DataFrame) -> Statement:
    test, least = bound_test(), "adhesion used by the unit that uses least"
    return _statement(
        "b", "in case A every unit works at about its bound", events, test,
        {
            f"{least}, greedy": test.quantity(events),
            "adhesion used, mean of the units, greedy": events[f"unit_use_mean@{REFERENCE}"],
            **_less(events, "alone", unit_use_low=least),
            f"{least}, oracle": events["unit_use_low@oracle"],
            f"share of events with every unit above {ABOUT_BOUND:.0%}": test.quantity(events) >= ABOUT_BOUND,
        },
        "events whose whole adhesion is below the plan 95 % of the time; holds if the unit that uses least uses "
        f"{ABOUT_BOUND:.0%} on the mean",
    )  # fmt: skip


def _about_95(events: pd.DataFrame) -> Statement:
    test = over_test()
    return _statement(
        "c", "about 95 % of the adhesion is used under readhesion control when a cap is somewhat too high",
        events, test,
        {
            "adhesion used, limit up to 15 % too high": test.quantity(events),
            **{f"adhesion used, limit {low:.0%} to {high:.0%} too high": events[f"{excess_column(k)}@{REFERENCE}"]
               for k, (low, high) in enumerate(pairwise(EXCESS_EDGES))},
        },
        f"events with {LEAST_OVER_TIME:g} unit second or more under a limit of greedy above the true adhesion; holds if "
        f"{ABOUT_95:.0%} is used on the mean",
    )  # fmt: skip


def _ride(events: pd.DataFrame) -> Statement:
    own, other, peak = (
        events[f"jerk_rms@{REFERENCE}"],
        events["jerk_rms@sharing"],
        "jerk peak [m/s3]",
    )
    return _statement(
        "d", "better ride (jerk) than dynamic sharing",
        events, difference("jerk_rms", REFERENCE, "sharing", -1.0),
        {
            **_less(events, "sharing", jerk_rms=JERK),
            f"{JERK}, sharing": other,
            **_less(events, "sharing", jerk_peak=peak),
            f"{peak}, sharing": events["jerk_peak@sharing"],
            **_less(events, "sharing", limit_travel="way of the limits over plan", held_effort=EFFORT, slip_time=SLIP),
            "share of events with less jerk": own < other,
        },
        "events in which a unit slips under alone; holds if the jerk is lower on the mean, rms and peak",
        [(peak, difference("jerk_peak", REFERENCE, "sharing", -1.0))],
        in_words("{:.3g} [{:.3g}, {:.3g}], n = {}"),
    )  # fmt: skip


def _preset(events: pd.DataFrame) -> Statement:
    test, less = difference("held_effort", REFERENCE, "preset"), f"{EFFORT}, greedy less preset"
    return _statement(
        "e", "better than a preset pattern when adhesion differs from what the preset assumed, summer and winter",
        events, test,
        {
            less: test.quantity(events),
            **{f"{less}, {season}": test.quantity(events[PARTS[season](events)]) for season in ("summer", "winter")},
            **_less(events, "preset", slip_time=SLIP, damage="wheel damage [kJ]", jerk_rms=JERK),
        },
        f"events in which a limit of the preset exceeds the adhesion in {PRESET_WRONG:.0%} of units and time; holds if the "
        "effort is higher on the mean",
        [(SLIP, difference("slip_time", REFERENCE, "preset", -1.0))], parts=PARTS | REACH_PARTS,
    )  # fmt: skip
