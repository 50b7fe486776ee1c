"""What sharing gains where there is something to gain: every rule meets the same random events with headroom."""

from collections.abc import Iterable, Mapping, Sequence

import pandas as pd

from studies.core.claims import AT_LEAST, AT_MOST, Claim, family, quantity
from studies.core.controllers import check_controller, is_hosted
from studies.core.drawn_events import COMPARED, complete, paired
from studies.core.job import Job
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Statement, in_words
from studies.core.study import EachEvent, Study
from studies.patent.headroom_events import DURATION, EVENTS, TRAINS, measure, scenario

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


def _between(name: str) -> str:
    low, high = STRATA[name]
    return f"headroom > {low:g} and headroom <= {high:g}"


def in_stratum(events: pd.DataFrame, name: str) -> "pd.Series[bool]":
    """Events of a stratum."""
    found: pd.Series[bool] = quantity(events, _between(name))
    return found


BY_TRAIN_AND_PEAK = {
    **{name: f"train == '{name}'" for name in TRAINS},
    "a narrow peak (piecewise)": "curve == piecewise",
    "a wide peak (Polach)": "curve == polach",
}
PARTS = {f"headroom of {name}": _between(name) for name in STRATA} | BY_TRAIN_AND_PEAK


def more(rule: str, metric: str = "plan_use") -> str:
    """A metric of `rule` less that of alone."""
    return f"{metric}@{rule} - {metric}@{BASE}"


def gain(events: pd.DataFrame, rule: str, metric: str = "plan_use") -> "pd.Series[float]":
    """A metric of `rule` less that of alone, event by event."""
    return quantity(events, more(rule, metric)).astype(float)


def share_gained(rule: str) -> str:
    """The mean gain over the mean headroom, of events with a headroom that is worth sharing."""
    return f"{more(rule)} per headroom if headroom > {WORTH_SHARING}"


def _numbers(rule: str) -> dict[str, str]:
    return {
        "bound used": f"bound_use@{rule}",
        **{f"bound used, {name}": f"bound_use@{rule} if {_between(name)}" for name in STRATA},
        "bound used, alone": f"bound_use@{BASE}",
        "lost by controllers at the units they limit": f"held_back@{rule}",
        "left by the sharing": f"1 - bound_use@{rule} - held_back@{rule}",
        f"share of headroom gained, above {100 * WORTH_SHARING:g} point": share_gained(rule),
        **{f"gain over plan, {name}": f"{more(rule)} if {_between(name)}" for name in STRATA},
        "delivered beyond the plan": f"over_delivery@{rule}",
        **{f"{text}, less alone": more(rule, metric) for metric, text in COSTS.items()},
    }


def claims_of(controller: str, rules: Iterable[str] = RULES) -> list[Claim]:
    """What is claimed under a controller: what each of these rules gains, and the goals of this project's own."""
    gains = [
        Claim(
            f"{rule}, {controller}", f"{rule} delivers more of the plan than alone under {controller}", more(rule),
            reason="sharing is there to deliver more", parts=PARTS, show=POINTS, numbers=_numbers(rule), method=METHOD,
        )
        for rule in rules if rule in SHARERS
    ]  # fmt: skip
    costs = [
        Claim(f"{COSTS[metric]}, less alone", mean=more(OWN, metric), side=AT_MOST,
              reason="what is won is not paid for elsewhere")
        for metric in ("slip_time", "damage")
    ]  # fmt: skip
    excess = Claim(
        "delivery beyond the plan", mean=f"over_delivery@{OWN}", side=AT_MOST, value=GOAL_OF_EXCESS,
        reason="what exceeds the plan is no use of the bound",
    )  # fmt: skip
    return [
        *gains,
        Claim(
            f"bound, {controller}",
            f"{OWN} uses {GOAL_OF_BOUND:.1%} of the bound under {controller}, at no more slip and wheel damage than alone",
            f"bound_use@{OWN}", AT_LEAST, GOAL_OF_BOUND, reason="goal of this project", parts=PARTS, show=PERCENT,
            besides=(*costs, excess), numbers=_numbers(OWN), method=METHOD,
        ),
        Claim(
            f"headroom gained, {controller}",
            f"{OWN} gains {GOAL_OF_HEADROOM:.0%} of a headroom above {100 * WORTH_SHARING:g} point under {controller}",
            share_gained(OWN), AT_LEAST, GOAL_OF_HEADROOM, reason="goal of this project", parts=BY_TRAIN_AND_PEAK,
            show=PERCENT, method=METHOD,
            numbers={
                name: f"{more(OWN)} per headroom if {part} and headroom > {WORTH_SHARING}"
                for name, part in BY_TRAIN_AND_PEAK.items()
            },
        ),
    ]  # fmt: skip


def headroom_claims(controllers: Iterable[str] = COMPARED) -> list[Claim]:
    """What is claimed under these controllers."""
    return [claim for controller in controllers for claim in claims_of(controller)]


def headroom_statements(table: pd.DataFrame) -> list[Statement]:
    """Per controller: what each rule gains, and the goals of this project's own; all of them are one family."""
    found = {one: pairs_of(table, one) for one in dict.fromkeys(table["controller"])}
    return family(*((events, claims_of(one, rules_of(events))) for one, events in found.items()))


def cells(
    seed: int, k: int, duration: float = DURATION, controllers: Sequence[str] = COMPARED
) -> list[Job]:
    """Event `k` under every controller and rule; under a controller that lives in Python, under the rules of the goals."""
    for controller in controllers:
        check_controller(controller)
    one = scenario(seed, k, duration)
    return [
        Job(one, rule, controller, k, measure)
        for controller in controllers
        for rule in (NEEDED if is_hosted(controller) else RULES)
    ]


HEADROOM = Study(
    name="headroom",
    question="what each rule gains over alone by how much there is to gain, and what it costs",
    default_events=60,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: headroom_statements(complete(table)),
    claims=headroom_claims,
)
