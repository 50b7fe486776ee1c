"""Limits of the adhesion model: do the conclusions on rules and controllers stand under other adhesion curves?"""

from typing import Any, NamedTuple

import pandas as pd

from studies.core.claims import Claim, conjunction, quantity
from studies.core.drawn_events import START_SPEED, Arm, paired, rail_offering, with_meaning
from studies.core.job import Job
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Statement
from studies.core.study import EachEvent, Study
from studies.patent.claim_events import DURATION, draw, event_name, measure
from studies.patent.claim_events import scenario as claim_event
from studies.scenario.scenario import Scenario

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


def less(curve: str, pair: Pair, metric: str) -> str:
    """A metric's difference between the arms of `pair` by event, on rails of `curve`."""
    one, other = (f"'{metric}@{curve}/{'/'.join(arm)}'" for arm in (pair.one, pair.other))
    return f"{one} - {other}"


def _same_sign(pair: Pair, metric: str) -> Claim:
    reason = "a conclusion has the same sign on every rail"
    return Claim(
        f"{pair.name}: {METRICS[metric]}",
        f"the difference of {METRICS[metric]} has the sign that it has on the piecewise curve under every curve",
        less(BASE, pair, metric), reason=reason, alike=True,
        cases=tuple(
            Claim(f"with {curve}", mean=less(curve, pair, metric), reason=reason)
            for curve in CURVES if curve != BASE
        ),
        numbers={curve: less(curve, pair, metric) for curve in CURVES},
        method="mean of paired differences; holds if its sign is that of the piecewise curve under all, does not where one "
        f"is opposite, undecided where that has none; {INTERVALS_OF_MEANS}, {CONFIDENCE:.0%}",
    )  # fmt: skip


CLAIMS = tuple(_same_sign(pair, metric) for pair in PAIRS for metric in METRICS)


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """One row per event of rows that are ok, every metric as ``metric@curve/rule/controller``; nan where a run failed."""
    arm = table["curve"] + "/" + table["rule"] + "/" + table["controller"]
    arms = dict.fromkeys("/".join(one) for pair in PAIRS for one in (pair.one, pair.other))
    wanted = [f"{metric}@{curve}/{one}" for metric in METRICS for curve in CURVES for one in arms]
    found = paired(table.assign(scenario=table["event"], arm=arm), "arm", METRICS, [])
    return found.reindex(columns=wanted)


def curve_statements(table: pd.DataFrame) -> list[Statement]:
    """One statement per pair and metric, on the rows of a table of `studies.ladder.curves_study` that succeeded."""
    events = pairs_of(table)
    return [conjunction(events, claim) for claim in CLAIMS]


def paired_difference(
    table: pd.DataFrame, curve: str, pair: Pair, metric: str
) -> "pd.Series[float]":
    """A metric's difference between the arms of `pair` by event, on rails of `curve`."""
    return quantity(pairs_of(table), less(curve, pair, metric)).astype(float)


SEEKING = ("perturb-observe", "mpc")
"""Controllers that search for the peak, whatever curve the train believes in."""
SEEKING_RULE = "exact"


def name_of(seed: int, k: int, curve: str) -> str:
    """Name of event `k` on a rail of `curve`."""
    return f"{event_name(seed, k)}-{curve.replace(' ', '-')}"


def scenario(seed: int, k: int, curve: str, duration: float = DURATION) -> Scenario:
    """Event `k` of the claims on a rail of `curve`; the train believes in the piecewise curve on all of them."""
    base = claim_event(seed, k, duration)
    rail: dict[str, Any] = base.rail.model_dump() | {"curve": CURVES[curve]}
    if CURVES[curve]["kind"] == "polach":  # its level is the friction coefficient, above the peak
        adhesion = draw(seed, k)["level"]
        key = "level" if rail["law_factor"] is None else "law_factor"
        train = base.event(0).model.train
        offering = rail_offering(CURVES[curve], adhesion, START_SPEED, train)
        rail[key] *= offering["level"] / adhesion
    belief = base.belief.model_dump() | {"curve": {"kind": "piecewise"}}
    return base.changed(name=name_of(seed, k, curve), rail=rail, belief=belief)


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` of the claims on a rail of every curve, with the same peak of adhesion at 15 km/h."""
    found = []
    for curve in CURVES:
        one = scenario(seed, k, curve, duration)
        found += [Job(one, rule, "cut-and-ramp", k, measure) for rule in RULES]
        found += [Job(one, SEEKING_RULE, name, k, measure) for name in SEEKING]
    return found


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event" and "curve"."""
    names = {name_of(seed, k, curve): (k, curve) for k in range(events) for curve in CURVES}
    return with_meaning(table, names, "event", "curve")


CURVE_STUDY = Study(
    name="curves",
    question="whether the order of rules and of controllers stands under other adhesion curves",
    default_events=20,
    cells=EachEvent(cells),
    finish=meant,
    judge=lambda table: curve_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
