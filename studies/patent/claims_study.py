"""The claims of JP5484215 put to the test by Monte Carlo: random events, every rule meets each of them."""

from collections.abc import Mapping
from itertools import pairwise

import pandas as pd

from studies.core.claims import AT_LEAST, AT_MOST, Claim, family
from studies.core.drawn_events import COMPARED, Arm, complete, paired
from studies.core.job import Job
from studies.core.statement import INTERVALS_OF_MEANS, Statement, in_words
from studies.core.study import EachEvent, Study
from studies.patent.claim_events import (
    BELIEVED_SLOPE,
    DURATION,
    EVENTS,
    EXCESS_EDGES,
    QUANTITIES,
    RANGES,
    excess_column,
    measure,
    scenario,
)

LAYERS = ("greedy-printed", "greedy-literal", "greedy-tuned", "greedy", "cooperative")
"""The patent judged in five layers: every equation as printed; its steps with corrected equations; at its best within its
words; its caps and level on what all units report; its idea, that the rear makes up for the front, on what each unit
finds."""
ARMS = tuple(Arm(rule, controller) for controller in COMPARED for rule in LAYERS)
"""Rules under their controllers of which the patent's claims are claims: each claim of each is one of the family."""

INTERVALS = (
    f"{INTERVALS_OF_MEANS}; shares: Wilson; the whole after Holm over the claims, Bonferroni among its "
    "parts"
)
EFFORT, JERK, SLIP = "effort over plan", "jerk rms [m/s3]", "slip [axle s]"
"""What statements call the numbers that several of them have."""
PEAK = "jerk peak [m/s3]"
UP_TO_PLAN = "effort_up_to_plan"
"""Effort over plan, at most 1."""
POINTS = in_words("{:+.2f} [{:+.2f}, {:+.2f}] %, n = {}", 100)
"""A share in per cent, or a difference of shares in points."""

PATENT, OWN = "JP5484215", "set by this project"
REACHED = 0.99
"""Share of the planned effort from which on the plan counts as reached: a hundredth is what a driver could notice in a
timetable."""
USED_LEAST, USED_OVER = 0.90, 0.92
"""Adhesion that a unit about at its bound uses, a tenth below it, and that is used under a cap too high: about 95 % is no
more than the three points less by which readhesion controllers differ."""
OVER_TIME = 1.0
"""Unit seconds under a limit too high that an event needs to say anything of it."""
OVER_SHARE = 0.05
"""Share of units and time with a limit above the adhesion from which on the preset does not fit the rail."""
WITHIN_REACH = "reach_low@oracle >= 1"
"""The whole allows the plan 95 % of the time: case B."""
OUT_OF_REACH = "reach_high@oracle <= 1"
"""The whole falls short of the plan 95 % of the time: case A."""


def pairs_of(events: pd.DataFrame) -> pd.DataFrame:
    """One row per event: what was drawn, and every number of every rule as ``number@rule``."""
    drawn = [name for name in QUANTITIES if name in events]
    numbers = events.select_dtypes("number").columns.difference([*drawn, "seed", "wall_time"])
    pairs = paired(events, "rule", numbers, drawn)
    efforts = pairs.filter(regex="^held_effort@").clip(upper=1.0)
    return pairs.join(efforts.rename(columns=lambda name: name.replace("held_effort", UP_TO_PLAN)))


LOW, HIGH = 0.67 * BELIEVED_SLOPE, 1.33 * BELIEVED_SLOPE
PARTS = {
    "summer": "season == summer",
    "winter": "season == winter",
    "growth along the train much below belief": f"slope < {LOW}",
    "growth along the train about as believed": f"slope >= {LOW} and slope <= {HIGH}",
    "growth along the train much above belief": f"slope > {HIGH}",
    "little scatter (< 0.006)": "scatter < 0.006",
    "much scatter (>= 0.006)": "scatter >= 0.006",
    "uniform rail": "patch_factor == 1",
    "a patch": "patch_factor < 1",
    "adhesion independent of speed": "speed_law == none",
    "adhesion falling with speed": "speed_law != none",
    "heavier front": "tilt < -0.25",
    "even load": "|tilt| <= 0.25",
    "heavier rear": "tilt > 0.25",
    "level line": "grade_permille == 0",
    "a gradient": "grade_permille > 0",
}
"""Name -> which events of a table with what was drawn (`studies.patent.claim_events`) belong to it."""
REACH_PARTS = {
    "the plan within reach (case B)": WITHIN_REACH,
    "the plan out of reach (case A)": OUT_OF_REACH,
}
"""Parts by what the adhesion of the whole allows."""


def statement_name(claim: str, arm: Arm) -> str:
    """The claim's own name, with its arm where there are several."""
    return claim if len(ARMS) == 1 else f"{claim}: {' under '.join(arm)}"


def less(rule: str, other: str, **words: str) -> dict[str, str]:
    """Paired differences of numbers by name, `rule` less `other`; `words`: what a statement calls them."""
    return {f"{text}, {rule} less {other}": f"{name}@{rule} - {name}@{other}" for name, text in words.items()}  # fmt: skip


def claims_of(arm: Arm) -> Mapping[str, Claim]:
    """The five claims about a rule under a controller, over `pairs_of` events under that controller."""
    rule = arm.rule
    at_most = f"{EFFORT}, {rule} (at most 1)"
    least, use = "adhesion used by the unit that uses least", f"unit_use_low@{rule}"
    more = f"held_effort@{rule} - held_effort@preset"
    text = f"{EFFORT}, {rule} less preset"
    over = f"use_over@{rule}"

    def name(claim: str) -> str:
        return statement_name(claim, arm)

    return {
        "a": Claim(
            name("a"), "redistribution reaches the planned effort where adhesion on the whole allows it and alone does not",
            f"{UP_TO_PLAN}@{rule}", AT_LEAST, REACHED, reason="the plan is reached",
            source=f"{PATENT}: planned effort; the hundredth {OWN}",
            only=f"{WITHIN_REACH} and held_effort@alone <= {REACHED}", parts=PARTS, show=POINTS,
            besides=(Claim("effort over alone", mean=f"held_effort@{rule} - held_effort@alone",
                           reason="redistribution gives more than no redistribution", source=PATENT),),
            numbers={
                at_most: f"{UP_TO_PLAN}@{rule}",
                **less(rule, "alone", held_effort=EFFORT), **less("exact", "alone", held_effort=EFFORT),
                f"{at_most}, where the oracle reaches it": f"{UP_TO_PLAN}@{rule} if held_effort@oracle >= {REACHED}",
                **{f"share of events that reach the plan, {one}": f"held_effort@{one} >= {REACHED}"
                   for one in dict.fromkeys(("alone", rule, "exact", "oracle"))},
            },
            method="events whose whole adhesion is at or above the plan 95 % of the time, and alone below "
            f"{REACHED:.0%} of it; holds if the mean effort is {REACHED:.0%} of the plan; {INTERVALS}",
        ),
        "b": Claim(
            name("b"), "in case A every unit works at about its bound", use, AT_LEAST, USED_LEAST,
            reason="every unit about at its bound: the least used within a tenth of it",
            source=f"{PATENT}: about the bound; a tenth {OWN}",
            only=OUT_OF_REACH, parts=PARTS, show=POINTS,
            numbers={
                f"{least}, {rule}": use, f"adhesion used, mean of the units, {rule}": f"unit_use_mean@{rule}",
                **less(rule, "alone", unit_use_low=least), f"{least}, oracle": "unit_use_low@oracle",
                f"share of events with every unit above {USED_LEAST:.0%}": f"{use} >= {USED_LEAST}",
            },
            method="events whose whole adhesion is below the plan 95 % of the time; holds if the unit that uses least uses "
            f"{USED_LEAST:.0%} on the mean; {INTERVALS}",
        ),
        "c": Claim(
            name("c"), "about 95 % of the adhesion is used under readhesion control when a cap is somewhat too high",
            over, AT_LEAST, USED_OVER, reason="about 95 %: readhesion controllers differ by three points",
            source=f"{PATENT}: about 95 %; three points {OWN}",
            only=f"over_time@{rule} >= {OVER_TIME:g}", parts=PARTS, show=POINTS,
            numbers={
                "adhesion used, limit up to 15 % too high": over,
                **{f"adhesion used, limit {low:.0%} to {high:.0%} too high": f"{excess_column(k)}@{rule}"
                   for k, (low, high) in enumerate(pairwise(EXCESS_EDGES))},
            },
            method=f"events with {OVER_TIME:g} unit second or more under a limit of {rule} above the true adhesion; "
            f"holds if {USED_OVER:.0%} is used on the mean; {INTERVALS}",
        ),
        "d": Claim(
            name("d"), "better ride (jerk) than dynamic sharing", f"jerk_rms@{rule} - jerk_rms@sharing", AT_MOST,
            reason="a better ride is less jerk", source=PATENT, only="unit_detections@alone >= 1", parts=PARTS,
            besides=(Claim(PEAK, mean=f"jerk_peak@{rule} - jerk_peak@sharing", side=AT_MOST,
                           reason="a better ride has no higher peaks"),),
            numbers={
                **less(rule, "sharing", jerk_rms=JERK), f"{JERK}, sharing": "jerk_rms@sharing",
                **less(rule, "sharing", jerk_peak=PEAK), f"{PEAK}, sharing": "|jerk_peak@sharing|",
                **less(rule, "sharing", limit_travel="way of the limits over plan", held_effort=EFFORT, slip_time=SLIP),
                "share of events with less jerk": f"jerk_rms@{rule} < jerk_rms@sharing",
            },
            method="events in which a unit slips under alone; holds if the jerk is lower on the mean, rms and peak; "
            f"{INTERVALS}",
            show=in_words("{:.3g} [{:.3g}, {:.3g}], n = {}"),
        ),
        "e": Claim(
            name("e"), "better than a preset pattern when adhesion differs from what the preset assumed, summer and winter",
            more, AT_LEAST, reason="better is more effort", source=PATENT,
            only=f"over_share@preset >= {OVER_SHARE}", parts=PARTS | REACH_PARTS, show=POINTS,
            besides=(Claim(SLIP, mean=f"slip_time@{rule} - slip_time@preset", side=AT_MOST,
                           reason="more effort for more slip is not better"),),
            numbers={
                text: more, **{f"{text}, {season}": f"{more} if season == {season}" for season in ("summer", "winter")},
                **less(rule, "preset", slip_time=SLIP, damage="wheel damage [kJ]", jerk_rms=JERK),
            },
            method=f"events in which a limit of the preset exceeds the adhesion in {OVER_SHARE:.0%} of units and time; "
            f"holds if the effort is higher on the mean; {INTERVALS}",
        ),
    }  # fmt: skip


CLAIMS = tuple(claim for arm in ARMS for claim in claims_of(arm).values())
"""What is claimed; none of it changes without a record."""


def claim_statements(events: pd.DataFrame) -> list[Statement]:
    """One statement per claim and arm from rows of `studies.patent.claims_study` in which every rule succeeded."""
    pairs = {one: pairs_of(events[events["controller"] == one]) for one in COMPARED}
    groups = ((pairs[arm.controller], claims_of(arm).values()) for arm in ARMS)
    return family(*groups, ranges=RANGES)


RULES = ("alone", "preset", "sharing", *LAYERS, "exact", "oracle")


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` under every rule and controller, with the seed `k` for all of them, so that they meet the same event."""
    one = scenario(seed, k, duration)
    return [Job(one, rule, controller, k, measure) for controller in COMPARED for rule in RULES]


CLAIM_STUDY = Study(
    name="claims",
    question="claims (a) to (e) of JP5484215 over random events, all rules paired",
    default_events=240,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: claim_statements(complete(table)),
    claims=CLAIMS,
)
