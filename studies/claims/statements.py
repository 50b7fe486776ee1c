"""Claims (a) to (e) of JP5484215 as tests with thresholds, and the statements that a table of events yields."""

import pandas as pd

from studies.claims.events import QUANTITIES
from studies.claims.measures import EXCESS_EDGES, excess_column
from studies.claims.parts import PARTS
from studies.core.statement import Interval, Statement, mean_interval, share_interval
from studies.core.verdict import LEAST_EVENTS, Part, Test, judge

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


def paired(events: pd.DataFrame) -> pd.DataFrame:
    """One row per event: what was drawn, and every number of every rule as column (name, rule) joined by "@"."""
    drawn = [name for name in QUANTITIES if name in events]
    numbers = [
        str(name)
        for name in events.select_dtypes("number")
        if name not in drawn and name not in ("seed", "wall_time")
    ]
    wide = pd.concat(
        {name: events.pivot(index="scenario", columns="rule", values=name) for name in numbers},
        axis=1,
    )
    wide.columns = pd.Index([f"{column[0]}@{column[1]}" for column in wide.columns])
    return wide.join(events.groupby("scenario")[drawn].first())


def within_reach(pairs: pd.DataFrame) -> "pd.Series[bool]":
    """Events in which the adhesion of the whole allows the plan nearly all the time."""
    return pairs["reach_low@oracle"] >= 1.0


def out_of_reach(pairs: pd.DataFrame) -> "pd.Series[bool]":
    """Events in which it allows the plan hardly ever: case A."""
    return pairs["reach_high@oracle"] < 1.0


def claim_population(pairs: pd.DataFrame, claim: str) -> pd.DataFrame:
    """Rows of `paired` that bear on a claim, a to e."""
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


def points(interval: Interval) -> str:
    """A share in per cent, or a difference of shares in points, with its interval."""
    return f"{100 * interval.value:+.2f} [{100 * interval.low:+.2f}, {100 * interval.high:+.2f}] %, n = {interval.count}"


def plain(interval: Interval) -> str:
    """A number with its interval."""
    return f"{interval.value:.3g} [{interval.low:.3g}, {interval.high:.3g}], n = {interval.count}"


def claim_statements(events: pd.DataFrame) -> list[Statement]:
    """One statement per claim from rows of `studies.claims.study` in which every rule succeeded."""
    pairs = paired(events)
    return [_reaches(pairs), _at_bound(pairs), _about_95(pairs), _ride(pairs), _preset(pairs)]


def _reaches(pairs: pd.DataFrame) -> Statement:
    events = claim_population(pairs, "a")
    rules = ("alone", REFERENCE, "exact", "oracle")
    test = reached_test()
    gain = difference("held_effort", REFERENCE, "alone")
    found = judge(events, test, PARTS, points, [("effort over alone", gain)])
    return Statement(
        "a",
        "redistribution reaches the planned effort where adhesion on the whole allows it and alone does not",
        found.verdict,
        {
            "effort over plan, greedy (at most 1)": found.whole,
            "effort over plan, greedy less alone": gain.interval(events),
            "effort over plan, exact less alone": difference(
                "held_effort", "exact", "alone"
            ).interval(events),
            "effort over plan, greedy (at most 1), where the oracle reaches it": test.interval(
                events[events["held_effort@oracle"] >= REACHED]
            ),
            **{
                f"share of events that reach the plan, {rule}": share_interval(
                    events[f"held_effort@{rule}"] >= REACHED
                )
                for rule in rules
            },
        },
        found.conditions,
        f"events whose whole adhesion is at or above the plan 95 % of the time, and alone below {REACHED:.0%} of it; "
        f"holds if the mean effort is {REACHED:.0%} of the plan; {INTERVALS}",
    )


def _at_bound(pairs: pd.DataFrame) -> Statement:
    events = claim_population(pairs, "b")
    test = bound_test()
    found = judge(events, test, PARTS, points)
    return Statement(
        "b",
        "in case A every unit works at about its bound",
        found.verdict,
        {
            "adhesion used by the unit that uses least, greedy": found.whole,
            "adhesion used, mean of the units, greedy": mean_interval(
                events[f"unit_use_mean@{REFERENCE}"]
            ),
            "adhesion used by the unit that uses least, greedy less alone": difference(
                "unit_use_low", REFERENCE, "alone"
            ).interval(events),
            "adhesion used by the unit that uses least, oracle": mean_interval(
                events["unit_use_low@oracle"]
            ),
            f"share of events with every unit above {ABOUT_BOUND:.0%}": share_interval(
                events[f"unit_use_low@{REFERENCE}"] >= ABOUT_BOUND
            ),
        },
        found.conditions,
        f"events whose whole adhesion is below the plan 95 % of the time; holds if the unit that uses least uses "
        f"{ABOUT_BOUND:.0%} on the mean; {INTERVALS}",
    )


def _about_95(pairs: pd.DataFrame) -> Statement:
    events = claim_population(pairs, "c")
    test = over_test()
    found = judge(events, test, PARTS, points)
    classes = {
        f"adhesion used, limit {EXCESS_EDGES[k]:.0%} to {EXCESS_EDGES[k + 1]:.0%} too high": mean_interval(
            events[f"{excess_column(k)}@{REFERENCE}"]
        )
        for k in range(len(EXCESS_EDGES) - 1)
    }
    return Statement(
        "c",
        "about 95 % of the adhesion is used under readhesion control when a cap is somewhat too high",
        found.verdict,
        {"adhesion used, limit up to 15 % too high": found.whole, **classes},
        found.conditions,
        f"events with {LEAST_OVER_TIME:g} unit second or more under a limit of greedy above the true adhesion; holds if "
        f"{ABOUT_95:.0%} is used on the mean; {INTERVALS}",
    )


def _ride(pairs: pd.DataFrame) -> Statement:
    events = claim_population(pairs, "d")
    test = difference("jerk_rms", REFERENCE, "sharing", -1.0)
    peak = difference("jerk_peak", REFERENCE, "sharing", -1.0)
    found = judge(events, test, PARTS, plain, [("jerk peak [m/s3]", peak)])
    return Statement(
        "d",
        "better ride (jerk) than dynamic sharing",
        found.verdict,
        {
            "jerk rms [m/s3], greedy less sharing": found.whole,
            "jerk rms [m/s3], sharing": mean_interval(events["jerk_rms@sharing"]),
            "jerk peak [m/s3], greedy less sharing": peak.interval(events),
            "jerk peak [m/s3], sharing": mean_interval(events["jerk_peak@sharing"]),
            "way of the limits over plan, greedy less sharing": difference(
                "limit_travel", REFERENCE, "sharing", -1.0
            ).interval(events),
            "effort over plan, greedy less sharing": difference(
                "held_effort", REFERENCE, "sharing"
            ).interval(events),
            "slip [axle s], greedy less sharing": difference(
                "slip_time", REFERENCE, "sharing", -1.0
            ).interval(events),
            "share of events with less jerk": share_interval(
                events[f"jerk_rms@{REFERENCE}"] < events["jerk_rms@sharing"]
            ),
        },
        found.conditions,
        f"events in which a unit slips under alone; holds if the jerk is lower on the mean, rms and peak; {INTERVALS}",
    )


def _preset(pairs: pd.DataFrame) -> Statement:
    events = claim_population(pairs, "e")
    test = difference("held_effort", REFERENCE, "preset")
    slip = difference("slip_time", REFERENCE, "preset", -1.0)
    found = judge(events, test, {**PARTS, **REACH_PARTS}, points, [("slip [axle s]", slip)])
    seasons = {
        f"effort over plan, greedy less preset, {name}": test.interval(events[PARTS[name](events)])
        for name in ("summer", "winter")
    }
    return Statement(
        "e",
        "better than a preset pattern when adhesion differs from what the preset assumed, summer and winter",
        found.verdict,
        {
            "effort over plan, greedy less preset": found.whole,
            **seasons,
            "slip [axle s], greedy less preset": slip.interval(events),
            "wheel damage [kJ], greedy less preset": difference(
                "damage", REFERENCE, "preset", -1.0
            ).interval(events),
            "jerk rms [m/s3], greedy less preset": difference(
                "jerk_rms", REFERENCE, "preset", -1.0
            ).interval(events),
        },
        found.conditions,
        f"events in which a limit of the preset exceeds the adhesion in {PRESET_WRONG:.0%} of units and time; holds if the "
        f"effort is higher on the mean; {INTERVALS}",
    )


REACH_PARTS: dict[str, Part] = {
    "the plan within reach (case B)": within_reach,
    "the plan out of reach (case A)": out_of_reach,
}
"""Parts by what the adhesion of the whole allows."""

__all__ = ["LEAST_EVENTS", "REACH_PARTS", "claim_population", "claim_statements", "paired"]
