"""Rules and controllers in drawn blended stops, with the estimated reference speed and with the true one."""

from collections.abc import Iterable, Mapping
from itertools import product

import pandas as pd

from studies.core.claims import AT_LEAST, AT_MOST, Claim, conjunction, family, how_many
from studies.core.drawn_events import Arm, paired, with_meaning
from studies.core.job import Job
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, POINTS, Statement, in_words
from studies.core.study import EachEvent, Study
from studies.stops.blended_events import (
    DURATION,
    EVENTS,
    HAULED,
    SOURCES,
    event_name,
    measure,
    peak_of,
    scenario,
)

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
LOST, MORE_DAMAGE, ERROR, WITHIN = 0.01, 0.2, 0.2, 0.95
"""Most of the bound that is lost to the estimate, most wheel damage more, largest error of the speed [m/s], and least share
of the errors within two deviations."""
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
PARTS = {
    "multiple units": " and ".join(f"train != '{name}'" for name in HAULED),
    "locomotives": " or ".join(f"train == '{name}'" for name in HAULED),
    f"a narrow peak (below {NARROW:g} m/s)": f"peak < {NARROW}",
    "a wide peak": f"peak >= {NARROW}",
    "wheels as believed": "radius_error == 0",
    "wheels unequal by 0.05 to 1 %": "radius_error > 0",
}
METHOD = f"paired by event; {INTERVALS_OF_MEANS}, {CONFIDENCE:.0%}; after Holm over all claims, parts after Bonferroni"
PLAIN = in_words("{:.3g} [{:.3g}, {:.3g}], n = {}")
PAGE = "docs/reference-speed.md"


def arm_name(arm: Arm, source: str = ESTIMATE) -> str:
    """Name of an arm's columns."""
    return f"{arm.rule}/{arm.controller}/{source}"


def over_rules(metric: str, controller: str, source: str = ESTIMATE) -> str:
    """Column of a metric's mean over the rules under a controller."""
    return f"mean {metric}@{controller}/{source}"


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """One row per stop that succeeded in every arm: what was drawn, and numbers as ``number@rule/controller/source``.

    Beside them the means over the rules (`over_rules`), and whether wheels locked under any rule.
    """
    failed = table["event"][table["status"] != "ok"]
    own = table[~table["event"].isin(failed)]
    own = own.assign(arm=own["rule"] + "/" + own["controller"] + "/" + own["source"])
    pairs = paired(own.assign(scenario=own["event"]), "arm", NUMBERS, DRAWN)
    more = {}
    for controller, source in product(CONTROLLERS, SOURCES):
        for metric in NUMBERS:
            columns = [f"{metric}@{arm_name(Arm(rule, controller), source)}" for rule in RULES]
            more[over_rules(metric, controller, source)] = pairs[columns].astype(float).mean(axis=1)
            if metric == "locked_driven":
                more[_locked(controller, source)] = (pairs[columns].astype(float) > 0.0).any(axis=1)
    return pairs.join(pd.DataFrame(more))


def _locked(controller: str, source: str = ESTIMATE) -> str:
    return f"any lock@{controller}/{source}"


def less(metric: str, one: str, other: str) -> str:
    """A metric of an arm less that of another, both by their column names."""
    return f"{metric}@{one} - {metric}@{other}"


def _by_part(words: str, text: str) -> dict[str, str]:
    return {f"{words}, {name}": f"{text} if {part}" for name, part in PARTS.items()}


def _differences(one: str, other: str, words: str) -> dict[str, str]:
    return {f"{text}, {words}": less(metric, one, other) for metric, text in WORDS.items()}


def _of_controller(controller: str) -> Iterable[Claim]:
    """What the estimated speed costs under a controller, and whether it says how wrong it is."""

    def own(metric: str, source: str = ESTIMATE) -> str:
        return over_rules(metric, controller, source)

    lost = f"{own('bound_use', TRUTH)} - {own('bound_use')}"
    damage = f"{own('damage')} beyond {own('damage', TRUTH)}"
    error, within, ratio = (own(f"reference_{name}") for name in ("error", "within", "ratio"))
    return [
        Claim(
            f"estimate: {controller}", f"the estimated speed costs {controller} at most a point of the bound", lost, AT_MOST,
            LOST, reason="a hundredth of the bound is what the choice of a controller or a rule is about", parts=PARTS,
            show=POINTS, method=METHOD,
            numbers={
                "bound lost": lost, **_by_part("bound lost", lost), "bound lost, worst stop": f"largest of {lost}",
                **{
                    f"{text}, {rule}, less true speed": less(
                        metric, arm_name(Arm(rule, controller)), arm_name(Arm(rule, controller), TRUTH)
                    )
                    for rule in RULES for metric, text in WORDS.items()
                },
            },
        ),
        Claim(
            f"damage: {controller}", f"the estimated speed costs {controller} at most a fifth more wheel damage",
            damage, AT_MOST, MORE_DAMAGE,
            reason="slip that is measured wrongly costs no more than a fifth of the wheel damage", source=PAGE, parts=PARTS,
            show=in_words("{:+.0f} [{:+.0f}, {:+.0f}] %, n = {}", 100), method=METHOD,
            numbers={
                "wheel damage over that with the true speed, less 1": damage,
                "wheel damage [kJ]": own("damage"), "wheel damage [kJ], true speed": own("damage", TRUTH),
            },
        ),
        Claim(
            f"error: {controller}", f"the largest error of the speed under {controller} is at most 0.2 m/s on the mean",
            error, AT_MOST, ERROR, reason="largest error of an event [m/s], on the mean: half the slip of a wide peak",
            source=PAGE, parts=PARTS, show=PLAIN, method=METHOD,
            numbers={
                "largest error [m/s]": error, **_by_part("largest error [m/s]", error),
                "root mean square of the error [m/s]": own("reference_rms"),
                "mean error [m/s]": own("reference_bias"), "worst stop [m/s]": f"largest of {error}",
            },
        ),
        Claim(
            f"deviation: {controller}", f"under {controller} 95 % of the errors are within two stated deviations",
            within, AT_LEAST, WITHIN, reason="two deviations contain 95 % of normal errors", parts=PARTS,
            show=in_words("{:.0f} [{:.0f}, {:.0f}] %, n = {}", 100), method=METHOD,
            numbers={
                "share within two deviations": within, **_by_part("share within two deviations", within),
                "error over deviation, root mean square over stops": f"root mean square of {ratio}",
                "error over deviation, median stop": f"median of {ratio}",
            },
        ),
    ]  # fmt: skip


def _sharing(rule: str, controller: str) -> Claim:
    own, base = (arm_name(Arm(one, controller)) for one in (rule, "alone"))
    return Claim(
        f"sharing: {rule}, {controller}", f"{rule} uses more of the bound than alone under {controller}",
        less("bound_use", own, base), reason="sharing is there to use more", parts=PARTS, show=POINTS, method=METHOD,
        numbers={f"bound used, {rule}": f"bound_use@{own}", "bound used, alone": f"bound_use@{base}"}
        | _differences(own, base, "less alone"),
    )  # fmt: skip


def _controller(one: str, other: str) -> Claim:
    own, base, own_true, base_true = (
        over_rules("bound_use", controller, source) for source in SOURCES for controller in (one, other)
    )  # fmt: skip
    return Claim(
        f"controller: {one} less {other}", f"{one} uses more of the bound than {other}, on the mean over the rules",
        f"{own} - {base}", reason="better is more of the bound", parts=PARTS, show=POINTS, method=METHOD,
        numbers={
            f"bound used, less {other}": f"{own} - {base}",
            f"bound used, less {other}, both with the true speed": f"{own_true} - {base_true}",
            **{
                words: text for rule in RULES for words, text in _differences(
                    arm_name(Arm(rule, one)), arm_name(Arm(rule, other)), f"{rule}, less {other}"
                ).items()
            },
        },
    )  # fmt: skip


FAMILY = (
    *(claim for kind in zip(*map(_of_controller, CONTROLLERS), strict=True) for claim in kind),
    *(_sharing(*names) for names in product(SHARERS, CONTROLLERS)),
    *(_controller(*pair) for pair in PAIRS),
)
NO_LOCKS: Mapping[str, Claim] = {
    controller: Claim(
        f"locked: {controller}", f"no driven wheel locks above 5 km/h under {controller}, with any rule",
        _locked(controller), AT_MOST, exact=True, reason="a locked wheel is flattened within seconds",
        show=how_many("in", "stops"),
        numbers={
            "share of stops with locked driven wheels": _locked(controller),
            "share of stops with locked driven wheels, true speed": _locked(controller, TRUTH),
            WORDS["locked_driven"]: over_rules("locked_driven", controller),
        },
        method="holds if it does in every stop",
    )
    for controller in CONTROLLERS
}  # fmt: skip
CLAIMS = (*FAMILY, *NO_LOCKS.values())
"""What is claimed; the first are one family."""


def blended_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements on a table of `studies.stops.blended_study`."""
    events = pairs_of(table)
    return [*family((events, FAMILY)), *(conjunction(events, claim) for claim in NO_LOCKS.values())]


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Stop `k` under every rule and controller, with the estimated speed and with the true one, the same day."""
    day = EVENTS.draw(seed, k)["day"]
    return [
        Job(one, *arm, day, measure)
        for one in (scenario(seed, k, source, duration) for source in SOURCES)
        for arm in ARMS
    ]


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event", "source" of the reference speed, "peak" [m/s] at 15 m/s, and what was drawn."""
    names = {event_name(seed, k, source): (k, source) for k in range(events) for source in SOURCES}
    table = with_meaning(table, names, "event", "source")
    drawn = EVENTS.table(seed, events).drop(columns="scenario").rename(columns={"number": "event"})
    # a failed unit is a pair of numbers, which no table of numbers holds
    drawn = drawn.assign(
        failed=drawn["failed"].notna(), peak=[peak_of(seed, k) for k in range(events)]
    )
    return table.merge(drawn, on="event")


BLENDED = Study(
    name="blended",
    question="drawn stops with motors and air brakes: rules, controllers, and the cost of an estimated reference speed",
    default_events=42,
    cells=EachEvent(cells),
    finish=meant,
    judge=blended_statements,
    claims=CLAIMS,
)
