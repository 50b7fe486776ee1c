"""Statements of the study `headroom`: gain of each rule over alone, by headroom and train; whether the goals are met."""

import math
from collections.abc import Mapping

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
from studies.headroom.what_makes_room import TRAINS

BASE, BOUND = "alone", "oracle"
"""What gains count from, and the rule under which an event's headroom is read: the train then is where it could be."""
SHARERS = ("preset", "sharing", "greedy", "exact", "cooperative")
RULES = (BASE, *SHARERS, BOUND)
OWN = "cooperative"
"""This project's own rule, which has goals."""
NEEDED = (BASE, OWN, BOUND)
"""Rules that its goals are judged by; controllers that live in Python run no others."""

STRATA: Mapping[str, tuple[float, float]] = {
    "0 to 1 points": (-1.0, 0.01),
    "1 to 3 points": (0.01, 0.03),
    "3 to 5 points": (0.03, 0.05),
    "above 5 points": (0.05, 1.0),
}
"""Headroom above the first bound and up to the second, as a share of the plan."""
WORTH_SHARING = 0.01
"""Headroom above which a share of it is a number that says something."""
GOAL_OF_BOUND, GOAL_OF_HEADROOM, GOAL_OF_EXCESS = 0.995, 0.8, 0.005
"""Least use of the bound and least share of the headroom, most delivery beyond the plan."""

NUMBERS = (
    "bound_use", "held_back", "plan_use", "headroom", "over_delivery", "slip_time", "damage", "jerk_rms",
)  # fmt: skip
COSTS = {
    "slip_time": "slip [axle s]",
    "damage": "wheel damage [kJ]",
    "jerk_rms": "jerk rms [m/s3]",
}
"""Metric -> what a statement calls it."""
METHOD = (
    f"paired by event; {INTERVALS_OF_MEANS}; share of headroom: ratio of means, linearised; {CONFIDENCE:.0%}, "
    "parts after Bonferroni; headroom as under the oracle with the same controller"
)
POINTS = in_words("{:+.2f} [{:+.2f}, {:+.2f}] points, n = {}", 100)
PERCENT = in_words("{:.2f} [{:.2f}, {:.2f}] %, n = {}", 100)


def pairs_of(table: pd.DataFrame, controller: str) -> pd.DataFrame:
    """One row per event under `controller`: what was drawn, every number as ``number@rule``, and its `headroom`."""
    own = table[table["controller"] == controller]
    wide = paired(own, "rule", NUMBERS, ("train", "source", "curve"))
    return wide.assign(headroom=wide[f"headroom@{BOUND}"])


def rules_of(events: pd.DataFrame) -> tuple[str, ...]:
    """Rules in the pairs of a controller."""
    return tuple(rule for rule in RULES if f"bound_use@{rule}" in events)


def in_stratum(events: pd.DataFrame, name: str) -> "pd.Series[bool]":
    """Events of a stratum."""
    low, high = STRATA[name]
    return (events["headroom"] > low) & (events["headroom"] <= high)


def _stratum(name: str) -> Part:
    return lambda events: in_stratum(events, name)


def _column(column: str, value: str) -> Part:
    return lambda events: events[column] == value


PARTS: dict[str, Part] = {
    **{f"headroom of {name}": _stratum(name) for name in STRATA},
    **{name: _column("train", name) for name in TRAINS},
    "a narrow peak (piecewise)": _column("curve", "piecewise"),
    "a wide peak (Polach)": _column("curve", "polach"),
}


def gain(events: pd.DataFrame, rule: str, metric: str = "plan_use") -> "pd.Series[float]":
    """A metric of `rule` less that of alone, event by event."""
    less: pd.Series[float] = events[f"{metric}@{rule}"] - events[f"{metric}@{BASE}"]
    return less.astype(float)


def gained(events: pd.DataFrame, rule: str) -> "pd.Series[float]":
    """Numbers whose mean is the gain over the headroom, of all events together, and whose spread is that of this ratio."""
    worth = events[events["headroom"] > WORTH_SHARING]
    gains, room = gain(worth, rule), worth["headroom"].astype(float)
    share = gains.sum() / room.sum() if len(worth) else math.nan
    numbers: pd.Series[float] = share + (gains - share * room) / room.mean()
    return numbers


def headroom_statements(table: pd.DataFrame) -> list[Statement]:
    """Per controller: what each rule gains, and the goals of this project's own; all of them are one family."""
    claims = []
    for controller in dict.fromkeys(table["controller"]):
        events = pairs_of(table, controller)
        claims += [_gain(events, rule, controller) for rule in rules_of(events) if rule in SHARERS]
        claims += [_goal_of_bound(events, controller), _goal_of_headroom(events, controller)]
    return compared(claims)


def _numbers(events: pd.DataFrame, rule: str) -> Numbers:
    strata = {name: events[in_stratum(events, name)] for name in STRATA}
    return {
        "bound used": column_interval(events, f"bound_use@{rule}"),
        **{
            f"bound used, {name}": column_interval(own, f"bound_use@{rule}")
            for name, own in strata.items()
        },
        "bound used, alone": column_interval(events, f"bound_use@{BASE}"),
        "lost by controllers at the units they limit": column_interval(events, f"held_back@{rule}"),
        "left by the sharing": 1.0 - events[f"bound_use@{rule}"] - events[f"held_back@{rule}"],
        f"share of headroom gained, above {100 * WORTH_SHARING:g} point": gained(events, rule),
        **{f"gain over plan, {name}": gain(own, rule) for name, own in strata.items()},
        "delivered beyond the plan": column_interval(events, f"over_delivery@{rule}"),
        **{f"{text}, less alone": gain(events, rule, metric) for metric, text in COSTS.items()},
    }


def _gain(events: pd.DataFrame, rule: str, controller: str) -> Claim:
    return Claim(
        f"{rule}, {controller}", f"{rule} delivers more of the plan than alone under {controller}",
        events, Test(lambda e: gain(e, rule)), PARTS, POINTS, _numbers(events, rule), METHOD,
    )  # fmt: skip


def _cost(metric: str) -> Test:
    return Test(lambda e: gain(e, OWN, metric), wanted=-1)


def _goal_of_bound(events: pd.DataFrame, controller: str) -> Claim:
    costs = [(f"{COSTS[metric]}, less alone", _cost(metric)) for metric in ("slip_time", "damage")]
    use = Test(lambda e: e[f"bound_use@{OWN}"], GOAL_OF_BOUND, within=range_of("bound_use"))
    excess = Test(
        lambda e: e[f"over_delivery@{OWN}"], GOAL_OF_EXCESS, -1, range_of("over_delivery")
    )
    return Claim(
        f"bound, {controller}",
        f"{OWN} uses {GOAL_OF_BOUND:.1%} of the bound under {controller}, at no more slip and wheel damage than alone",
        events, use, PARTS, PERCENT, _numbers(events, OWN), METHOD,
        [*costs, ("delivery beyond the plan", excess)],
    )  # fmt: skip


def _goal_of_headroom(events: pd.DataFrame, controller: str) -> Claim:
    trains = {name: part for name, part in PARTS.items() if not name.startswith("headroom")}
    return Claim(
        f"headroom gained, {controller}",
        f"{OWN} gains {GOAL_OF_HEADROOM:.0%} of a headroom above {100 * WORTH_SHARING:g} point under {controller}",
        events, Test(lambda e: gained(e, OWN), GOAL_OF_HEADROOM), trains, PERCENT,
        {name: gained(events[part(events)], OWN) for name, part in trains.items()}, METHOD,
    )  # fmt: skip
