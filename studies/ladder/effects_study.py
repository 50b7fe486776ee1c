"""What effects that the shipped trains leave out do to the ranking of rules and controllers.

Each effect is switched on alone in the drawn starts with headroom (`studies.patent.headroom_study`), and every arm meets the
same starts: motors in parallel on one inverter, direct-current series motors, and a torque that lags by 50 and 100 ms.
"""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from studies.core.claims import AT_LEAST, Claim, family
from studies.core.drawn_events import Arm, complete, paired, with_meaning
from studies.core.job import Job
from studies.core.statement import INTERVALS_OF_MEANS, POINTS
from studies.core.study import EachEvent, Study
from studies.patent import headroom_study

NONE = "none"
EFFECTS: Mapping[str, Mapping[str, Any]] = {
    NONE: {},
    "induction": {"kind": "induction"},
    "series": {"kind": "series"},
    "lag 50 ms": {"torque_lag_s": 0.05},
    "lag 100 ms": {"torque_lag_s": 0.1},
}
"""Effect -> keys of `[motors]`."""
ARMS = (
    *(Arm("alone", controller) for controller in ("cut-and-ramp", "perturb-observe", "mpc")),
    *(Arm(rule, "perturb-observe") for rule in ("greedy", "cooperative")),
    Arm("oracle", "perturb-observe"),
)
ORDERS = (
    (ARMS[1], ARMS[0]), (ARMS[2], ARMS[1]), (ARMS[4], ARMS[1]), (ARMS[4], ARMS[3]),
)  # fmt: skip
"""Arms of which the first is claimed to use no less than the second, as it does without the effects."""
NUMBERS = {
    "bound_use": "bound used",
    "equal_torque_use": "used of the bound of equal torques",
    "slip_time": "slip [axle s]",
    "damage": "wheel damage [kJ]",
    "severe_work": "share of the damage above 200 N",
}
"""Metric -> what a statement calls it."""
METHOD = f"paired by start; {INTERVALS_OF_MEANS}; after Holm over all claims"


def column(metric: str, arm: Arm, effect: str) -> str:
    """Column of a metric of an arm under an effect."""
    return f"{metric}@{arm.rule}/{arm.controller}/{effect}"


def _order(effect: str, one: Arm, other: Arm) -> Claim:
    name = f"{effect}: {' under '.join(one)} before {' under '.join(other)}"
    own, base = column("bound_use", one, effect), column("bound_use", other, effect)
    return Claim(
        name, "the order of the two is that without the effect", f"{own} - {base}", AT_LEAST,
        reason="an order that the effect turns round was one of the plant left out", show=POINTS, method=METHOD,
        numbers={
            f"{words}, {' under '.join(arm)}": column(metric, arm, effect)
            for arm in (one, other) for metric, words in NUMBERS.items()
        } | {f"{words}, difference": f"{column(metric, one, effect)} - {column(metric, other, effect)}"
             for metric, words in NUMBERS.items()},
    )  # fmt: skip


CLAIMS = tuple(_order(effect, *pair) for effect in EFFECTS for pair in ORDERS)
"""One family."""


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """One row per start that succeeded in every arm, with numbers as ``number@rule/controller/effect``."""
    rows = complete(table.assign(scenario=table["event"]))
    arm = rows["rule"] + "/" + rows["controller"] + "/" + rows["effect"]
    return paired(rows.assign(arm=arm), "arm", NUMBERS, ())


def cells(seed: int, k: int, duration: float = headroom_study.DURATION) -> list[Job]:
    """Start `k` in every arm under every effect."""
    event = headroom_study.scenario(seed, k, duration)
    return [
        Job(event.changed(name=_name(event.name, effect), motors=keys or None), *arm, k)
        for effect, keys in EFFECTS.items()
        for arm in ARMS
    ]


def _name(event: str, effect: str) -> str:
    return event if effect == NONE else f"{event}-{effect.replace(' ', '-')}"


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event" and "effect"."""
    names = {
        _name(event, effect): (event, effect)
        for event in (headroom_study.event_name(seed, k) for k in range(events))
        for effect in EFFECTS
    }
    return with_meaning(table, names, "event", "effect")


EFFECTS_STUDY = Study(
    name="effects",
    question="motors in parallel and lags: what they do to the ranking of rules and controllers",
    default_events=60,
    cells=EachEvent(cells),
    finish=meant,
    judge=lambda table: family((pairs_of(table), CLAIMS)),
    claims=CLAIMS,
)
