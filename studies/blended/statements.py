"""Statements of the sweep `blended`: what the estimated speed costs and states, which rule and which controller is best."""

from collections.abc import Callable, Iterable, Mapping
from itertools import product
from typing import Literal

import pandas as pd

from alloc.metrics.registry import range_of
from studies.blended.blended_thresholds import THRESHOLDS
from studies.blended.events import HAULED, SOURCES
from studies.core.arms import Arm
from studies.core.drawn_events import paired
from studies.core.family import Claim, Part, Test, compared
from studies.core.statement import (
    CONFIDENCE,
    INTERVALS_OF_MEANS,
    Interval,
    Statement,
    column_interval,
    in_words,
)
from studies.core.verdict import LEAST_EVENTS, Numbers, decided

RULES = ("alone", "cooperative", "exact")
CONTROLLERS = ("cut-and-ramp", "perturb-observe", "mpc", "mpc-train")
ARMS = tuple(Arm(rule, controller) for rule, controller in product(RULES, CONTROLLERS))
ESTIMATE, TRUTH = SOURCES
SHARERS = RULES[1:]
PAIRS = (
    ("perturb-observe", "cut-and-ramp"), ("mpc", "cut-and-ramp"), ("mpc", "perturb-observe"), ("mpc-train", "mpc"),
)  # fmt: skip
"""Controllers of which the first is claimed to use more of the bound."""
NARROW = 0.3
"""Slip velocity [m/s] of the peak, at 15 m/s, below which a peak counts as narrow."""
NUMBERS = (
    "bound_use", "utilisation_short", "slip_time", "damage", "locked_driven", "reference_error", "reference_rms",
    "reference_bias", "reference_ratio", "reference_within", "air_of_units",
)  # fmt: skip
DRAWN = ("event", "train", "curve", "peak", "radius_error")
"""Columns of a stop that parts are made by."""
WORDS = {
    "bound_use": "bound used",
    "utilisation_short": "adhesion used where short",
    "slip_time": "slip [axle s]",
    "damage": "wheel damage [kJ]",
    "locked_driven": "locked driven wheels [axle s]",
    "air_of_units": "air over the plan of the driven cars",
}
"""Metric -> what a statement calls it."""
PARTS: dict[str, Part] = {
    "multiple units": lambda e: ~e["train"].isin(HAULED),
    "locomotives": lambda e: e["train"].isin(HAULED),
    f"a narrow peak (below {NARROW:g} m/s)": lambda e: e["peak"] < NARROW,
    "a wide peak": lambda e: e["peak"] >= NARROW,
    "wheels as believed": lambda e: e["radius_error"] == 0.0,
    "wheels unequal by 0.05 to 1 %": lambda e: e["radius_error"] > 0.0,
}
METHOD = f"paired by event; {INTERVALS_OF_MEANS}, {CONFIDENCE:.0%}; after Holm over all claims, parts after Bonferroni"
POINTS = in_words("{:+.2f} [{:+.2f}, {:+.2f}] points, n = {}", 100)
PLAIN = in_words("{:.3g} [{:.3g}, {:.3g}], n = {}")

Values = Callable[[pd.DataFrame], "pd.Series[float]"]


def arm_name(arm: Arm, source: str = ESTIMATE) -> str:
    """Name of an arm's columns."""
    return f"{arm.rule}/{arm.controller}/{source}"


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """One row per stop that succeeded in every arm: what was drawn, and numbers as ``number@rule/controller/source``."""
    failed = table["event"][table["status"] != "ok"]
    own = table[~table["event"].isin(failed)]
    own = own.assign(arm=own["rule"] + "/" + own["controller"] + "/" + own["source"])
    return paired(own.assign(scenario=own["event"]), "arm", NUMBERS, DRAWN)


def blended_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements on a table of `studies.blended.study`."""
    events = pairs_of(table)
    claims = [
        *(_estimate(events, controller) for controller in CONTROLLERS),
        *(_damage(events, controller) for controller in CONTROLLERS),
        *(_error(events, controller) for controller in CONTROLLERS),
        *(_deviation(events, controller) for controller in CONTROLLERS),
        *(_sharing(events, Arm(*names)) for names in product(SHARERS, CONTROLLERS)),
        *(_controller(events, *pair) for pair in PAIRS),
    ]
    return [*compared(claims), *(_locked(events, controller) for controller in CONTROLLERS)]


def less(metric: str, one: str, other: str) -> Values:
    """A metric of an arm less that of another, both by their column names."""
    return lambda e: (e[f"{metric}@{one}"] - e[f"{metric}@{other}"]).astype(float)


def over_rules(metric: str, controller: str, source: str = ESTIMATE) -> Values:
    """Mean of a metric over the rules under a controller."""
    columns = [f"{metric}@{arm_name(Arm(rule, controller), source)}" for rule in RULES]
    return lambda e: e[columns].astype(float).mean(axis=1)


def more_damage(controller: str) -> Values:
    """Numbers whose mean is the ratio of the wheel damage of all stops to that with the true speed, less 1."""

    def ratio(e: pd.DataFrame) -> "pd.Series[float]":
        own, true = (over_rules("damage", controller, source)(e) for source in SOURCES)
        whole = own.sum() / true.sum() if len(e) else float("nan")
        found: pd.Series[float] = whole - 1.0 + (own - whole * true) / true.mean()
        return found

    return ratio


def _test(name: str, quantity: Values, metric: str = "") -> Test:
    row = THRESHOLDS[name]
    wanted: Literal[-1, 1] = 1 if row.direction == "at least" else -1
    return Test(quantity, row.value, wanted, range_of(metric))


def _claim(
    name: str, claim: str, events: pd.DataFrame, test: Test, numbers: Numbers, show: Callable[[Interval], str] = POINTS
) -> Claim:  # fmt: skip
    return Claim(name, claim, events, test, PARTS, show, numbers, METHOD)


def _differences(events: pd.DataFrame, one: str, other: str, words: str) -> Numbers:
    return {f"{text}, {words}": less(metric, one, other)(events) for metric, text in WORDS.items()}


def _absolute(events: pd.DataFrame, arms: Mapping[str, str]) -> dict[str, Interval]:
    """The bound that arms use; `arms`: words -> column name."""
    return {f"bound used, {text}": column_interval(events, f"bound_use@{arm}") for text, arm in arms.items()}  # fmt: skip


def _estimate(events: pd.DataFrame, controller: str) -> Claim:
    own, true = (over_rules("bound_use", controller, source) for source in SOURCES)
    lost = true(events) - own(events)
    return _claim(
        f"estimate: {controller}", f"the estimated speed costs {controller} at most a point of the bound",
        events, _test("estimate", lambda e: true(e) - own(e)),
        {
            "bound lost": lost,
            **{f"bound lost, {name}": lost[part(events)] for name, part in PARTS.items()},
            "bound lost, worst stop": float(lost.max()),
            **{
                f"{text}, {arm.rule}, less true speed": less(metric, arm_name(arm), arm_name(arm, TRUTH))(events)
                for arm in ARMS if arm.controller == controller
                for metric, text in WORDS.items()
            },
        },
    )  # fmt: skip


def _damage(events: pd.DataFrame, controller: str) -> Claim:
    return _claim(
        f"damage: {controller}", f"the estimated speed costs {controller} at most a fifth more wheel damage",
        events, _test("damage", more_damage(controller)),
        {
            "wheel damage over that with the true speed, less 1": more_damage(controller)(events),
            "wheel damage [kJ]": over_rules("damage", controller)(events),
            "wheel damage [kJ], true speed": over_rules("damage", controller, TRUTH)(events),
        },
        in_words("{:+.0f} [{:+.0f}, {:+.0f}] %, n = {}", 100),
    )  # fmt: skip


def _error(events: pd.DataFrame, controller: str) -> Claim:
    largest = over_rules("reference_error", controller)
    return _claim(
        f"error: {controller}", f"the largest error of the speed under {controller} is at most 0.2 m/s on the mean",
        events, _test("error", largest),
        {
            "largest error [m/s]": largest(events),
            **{f"largest error [m/s], {name}": largest(events[part(events)]) for name, part in PARTS.items()},
            "root mean square of the error [m/s]": over_rules("reference_rms", controller)(events),
            "mean error [m/s]": over_rules("reference_bias", controller)(events),
            "worst stop [m/s]": float(largest(events).max()),
        },
        PLAIN,
    )  # fmt: skip


def _deviation(events: pd.DataFrame, controller: str) -> Claim:
    within = over_rules("reference_within", controller)
    ratio = over_rules("reference_ratio", controller)(events)
    return _claim(
        f"deviation: {controller}", f"under {controller} 95 % of the errors are within two stated deviations",
        events, _test("deviation", within),
        {
            "share within two deviations": within(events),
            **{f"share within two deviations, {name}": within(events[part(events)]) for name, part in PARTS.items()},
            "error over deviation, root mean square over stops": float((ratio**2).mean() ** 0.5),
            "error over deviation, median stop": float(ratio.median()),
        },
        in_words("{:.0f} [{:.0f}, {:.0f}] %, n = {}", 100),
    )  # fmt: skip


def _sharing(events: pd.DataFrame, arm: Arm) -> Claim:
    own, base = arm_name(arm), arm_name(Arm("alone", arm.controller))
    return _claim(
        f"sharing: {arm.rule}, {arm.controller}", f"{arm.rule} uses more of the bound than alone under {arm.controller}",
        events, _test("sharing", less("bound_use", own, base)),
        _absolute(events, {arm.rule: own, "alone": base}) | dict(_differences(events, own, base, "less alone")),
    )  # fmt: skip


def _controller(events: pd.DataFrame, one: str, other: str) -> Claim:
    own, base = (over_rules("bound_use", controller) for controller in (one, other))
    true = (over_rules("bound_use", controller, TRUTH)(events) for controller in (one, other))
    pairs = {rule: (arm_name(Arm(rule, one)), arm_name(Arm(rule, other))) for rule in RULES}
    return _claim(
        f"controller: {one} less {other}", f"{one} uses more of the bound than {other}, on the mean over the rules",
        events, _test("controller", lambda e: own(e) - base(e)),
        {
            f"bound used, less {other}": own(events) - base(events),
            f"bound used, less {other}, both with the true speed": next(true) - next(true),
            **{
                f"{text}, {rule}, less {other}": less(metric, *pair)(events)
                for rule, pair in pairs.items()
                for metric, text in WORDS.items()
            },
        },
    )  # fmt: skip


def _locked(events: pd.DataFrame, controller: str) -> Statement:
    """Whether no driven wheel locks in any stop under any rule, and how it is with the true speed."""
    locked = {source: _stops_with_locks(events, controller, source) for source in SOURCES}
    own = locked[ESTIMATE]
    return decided(
        f"locked: {controller}", f"no driven wheel locks above 5 km/h under {controller}, with any rule",
        {f"in {int(own.sum())} of {len(events)} stops": not own.any()},
        {
            "share of stops with locked driven wheels": own,
            "share of stops with locked driven wheels, true speed": locked[TRUTH],
            WORDS["locked_driven"]: over_rules("locked_driven", controller)(events),
        },
        "holds if it does in every stop", enough=len(events) >= LEAST_EVENTS,
    )  # fmt: skip


def _stops_with_locks(events: pd.DataFrame, controller: str, source: str) -> "pd.Series[bool]":
    columns: Iterable[str] = (
        f"locked_driven@{arm_name(Arm(rule, controller), source)}" for rule in RULES
    )
    return (events[list(columns)].astype(float) > 0.0).any(axis=1)
