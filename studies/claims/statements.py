"""Claims (a) to (e) of JP5484215 as tests with thresholds, and the statements that a table of events yields."""

from collections.abc import Callable, Iterator, Mapping
from dataclasses import replace
from itertools import pairwise

import pandas as pd

from alloc.metrics.registry import EITHER_WAY
from studies.claims.measures import EXCESS_EDGES, excess_column
from studies.claims.quantities import BELIEVED_SLOPE, QUANTITIES
from studies.claims.thresholds import POPULATIONS, REACHED, THRESHOLDS, bears, threshold_test
from studies.core.arms import COMPARED, Arm
from studies.core.drawn_events import paired
from studies.core.family import Claim, Part, compared
from studies.core.statement import INTERVALS_OF_MEANS, Interval, Statement, in_words, mean_interval
from studies.core.verdict import Numbers

LAYERS = ("greedy-literal", "greedy-tuned", "greedy", "cooperative")
"""The patent judged in four layers: as printed, called at the foremost unit's slip; at its best within its words; its caps
and its level on what all units report; its idea, that the rear makes up for the front, on what each unit finds itself."""
ARMS = tuple(Arm(rule, controller) for controller in COMPARED for rule in LAYERS)
"""Rules under their controllers of which the patent's claims are claims: each claim of each is one of the family."""

INTERVALS = (
    f"{INTERVALS_OF_MEANS}; shares: Wilson; the whole after Holm over the claims, Bonferroni among its "
    "parts"
)
EFFORT, JERK, SLIP = "effort over plan", "jerk rms [m/s3]", "slip [axle s]"
"""What statements call the numbers that several of them have."""
UP_TO_PLAN = "effort_up_to_plan"
"""Effort over plan, at most 1."""
POINTS = in_words("{:+.2f} [{:+.2f}, {:+.2f}] %, n = {}", 100)
"""A share in per cent, or a difference of shares in points."""


def pairs_of(events: pd.DataFrame) -> pd.DataFrame:
    """One row per event: what was drawn, and every number of every rule as ``number@rule``."""
    drawn = [name for name in QUANTITIES if name in events]
    numbers = events.select_dtypes("number").columns.difference([*drawn, "seed", "wall_time"])
    pairs = paired(events, "rule", numbers, drawn)
    efforts = pairs.filter(regex="^held_effort@").clip(upper=1.0)
    return pairs.join(efforts.rename(columns=lambda name: name.replace("held_effort", UP_TO_PLAN)))


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


def population(pairs: pd.DataFrame, claim: str, rule: str) -> pd.DataFrame:
    """Rows of `pairs_of` that bear on a claim, a to e, about `rule`."""
    for name in POPULATIONS[claim]:
        pairs = pairs[bears(name, rule, pairs)]
    return pairs


REACH_PARTS: dict[str, Part] = {
    "the plan within reach (case B)": lambda e: bears("a within reach", "", e),
    "the plan out of reach (case A)": lambda e: bears("b out of reach", "", e),
}
"""Parts by what the adhesion of the whole allows."""


def claim_statements(events: pd.DataFrame) -> list[Statement]:
    """One statement per claim and arm from rows of `studies.claims.study` in which every rule succeeded."""
    return compared([one for arm in ARMS for one in _claims(events, arm)])


def statement_name(claim: str, arm: Arm) -> str:
    """The claim's own name, with its arm where there are several."""
    return claim if len(ARMS) == 1 else f"{claim}: {' under '.join(arm)}"


def _claims(events: pd.DataFrame, arm: Arm) -> Iterator[Claim]:
    """The five claims about a rule under a controller; where it is not the only one, their names say so."""
    pairs = pairs_of(events[events["controller"] == arm.controller])
    claims = {"a": _reaches, "b": _at_bound, "c": _about_95, "d": _ride, "e": _preset}
    for name, claim in claims.items():
        found = claim(population(pairs, name, arm.rule), arm.rule)
        yield replace(found, name=statement_name(name, arm))


def _claim(
    name: str, claim: str, events: pd.DataFrame, rule: str, numbers: Numbers, method: str, besides: str = "",
    show: Callable[[Interval], str] = POINTS,
    parts: Mapping[str, Part] = PARTS,
) -> Claim:  # fmt: skip
    """`besides`: what a statement calls that which the claim implies besides."""
    others = [(besides, threshold_test(f"{name} besides", rule))] if besides else []
    method = f"{method}; {INTERVALS}"
    return Claim(
        name, claim, events, threshold_test(name, rule), parts, show, numbers, method, others
    )


def _less(events: pd.DataFrame, rule: str, other: str, **words: str) -> Numbers:
    """Paired differences of numbers by name, `rule` less `other`; `words`: what a statement calls them."""
    return {
        f"{text}, {rule} less {other}": events[f"{name}@{rule}"] - events[f"{name}@{other}"]
        for name, text in words.items()
    }


def used(values: "pd.Series[float]") -> Interval:
    """Mean of what is used of something: 1 at most."""
    return mean_interval(values, within=EITHER_WAY)


def _share(name: str) -> str:
    return f"{THRESHOLDS[name].value:.0%}"


def _reaches(events: pd.DataFrame, rule: str) -> Claim:
    at_most = f"{EFFORT}, {rule} (at most 1)"
    effort = events[f"{UP_TO_PLAN}@{rule}"]
    reached = {
        one: events[f"held_effort@{one}"] >= REACHED
        for one in dict.fromkeys(("alone", rule, "exact", "oracle"))
    }
    return _claim(
        "a", "redistribution reaches the planned effort where adhesion on the whole allows it and alone does not",
        events, rule,
        {
            at_most: used(effort),
            **_less(events, rule, "alone", held_effort=EFFORT),
            **_less(events, "exact", "alone", held_effort=EFFORT),
            f"{at_most}, where the oracle reaches it": used(effort[reached["oracle"]]),
            **{f"share of events that reach the plan, {one}": met for one, met in reached.items()},
        },
        f"events whose whole adhesion is at or above the plan 95 % of the time, and alone below "
        f"{_share('a short alone')} of it; holds if the mean effort is {_share('a')} of the plan", "effort over alone",
    )  # fmt: skip


def _at_bound(events: pd.DataFrame, rule: str) -> Claim:
    least = "adhesion used by the unit that uses least"
    use = events[f"unit_use_low@{rule}"]
    return _claim(
        "b", "in case A every unit works at about its bound", events, rule,
        {
            f"{least}, {rule}": used(use),
            f"adhesion used, mean of the units, {rule}": used(events[f"unit_use_mean@{rule}"]),
            **_less(events, rule, "alone", unit_use_low=least),
            f"{least}, oracle": used(events["unit_use_low@oracle"]),
            f"share of events with every unit above {_share('b')}": use >= THRESHOLDS["b"].value,
        },
        "events whose whole adhesion is below the plan 95 % of the time; holds if the unit that uses least uses "
        f"{_share('b')} on the mean",
    )  # fmt: skip


def _about_95(events: pd.DataFrame, rule: str) -> Claim:
    return _claim(
        "c", "about 95 % of the adhesion is used under readhesion control when a cap is somewhat too high",
        events, rule,
        {
            "adhesion used, limit up to 15 % too high": used(events[f"use_over@{rule}"]),
            **{f"adhesion used, limit {low:.0%} to {high:.0%} too high": used(events[f"{excess_column(k)}@{rule}"])
               for k, (low, high) in enumerate(pairwise(EXCESS_EDGES))},
        },
        f"events with {THRESHOLDS['c over'].value:g} unit second or more under a limit of {rule} above the true adhesion; "
        f"holds if {_share('c')} is used on the mean",
    )  # fmt: skip


def _ride(events: pd.DataFrame, rule: str) -> Claim:
    own, other = (events[f"jerk_rms@{one}"] for one in (rule, "sharing"))
    peak = "jerk peak [m/s3]"
    return _claim(
        "d", "better ride (jerk) than dynamic sharing", events, rule,
        {
            **_less(events, rule, "sharing", jerk_rms=JERK),
            f"{JERK}, sharing": other,
            **_less(events, rule, "sharing", jerk_peak=peak),
            f"{peak}, sharing": events["jerk_peak@sharing"],
            **_less(events, rule, "sharing", limit_travel="way of the limits over plan", held_effort=EFFORT, slip_time=SLIP),
            "share of events with less jerk": own < other,
        },
        "events in which a unit slips under alone; holds if the jerk is lower on the mean, rms and peak",
        peak, in_words("{:.3g} [{:.3g}, {:.3g}], n = {}"),
    )  # fmt: skip


def _preset(events: pd.DataFrame, rule: str) -> Claim:
    more = events[f"held_effort@{rule}"] - events["held_effort@preset"]
    text = f"{EFFORT}, {rule} less preset"
    return _claim(
        "e", "better than a preset pattern when adhesion differs from what the preset assumed, summer and winter",
        events, rule,
        {
            text: more,
            **{f"{text}, {season}": more[PARTS[season](events)] for season in ("summer", "winter")},
            **_less(events, rule, "preset", slip_time=SLIP, damage="wheel damage [kJ]", jerk_rms=JERK),
        },
        f"events in which a limit of the preset exceeds the adhesion in {_share('e preset wrong')} of units and time; holds "
        "if the effort is higher on the mean",
        SLIP, parts=PARTS | REACH_PARTS,
    )  # fmt: skip
