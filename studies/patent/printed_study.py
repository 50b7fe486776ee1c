"""What the equations of JP5484215 are worth as printed: four deviations taken back, one at a time and all at once.

`greedy-literal` takes the steps of the patent on this project's equipment. Each arm puts one test or equation back as the
text has it; `greedy-printed` has all four. Starts are those of the claims, stops those of `studies.patent.braking_study`.
"""

from collections.abc import Mapping
from typing import Any

import pandas as pd

from studies.core.claims import AT_MOST, Claim, family
from studies.core.drawn_events import COMPARED, complete, paired, with_meaning
from studies.core.job import Job
from studies.core.statement import INTERVALS_OF_MEANS, POINTS, Statement
from studies.core.study import EachEvent, Study
from studies.patent import braking_study, claim_events
from studies.scenario.scenario import Scenario

CORRECTED, PRINTED = "corrected", "all as printed"
CHANGES: Mapping[str, Mapping[str, Any]] = {
    "Fig. 5: acceleration alone": {"detector": {"speed_on_kmh": 600.0}},
    "(6) without inertia": {"inertia_in_limit": False},
    "(18) without inertia": {"braking": {"inertia_in_estimate": False}},
    "(18) with the command": {"braking": {"air_force": "command"}},
}
"""Arm -> keys of `[onboard]` that take one deviation back."""
ARMS = (CORRECTED, *CHANGES, PRINTED)
KINDS = ("starts", "stops")
NUMBERS = {
    "bound_use": "bound used", "slip_time": "slip [axle s]", "damage": "wheel damage [kJ]",
    "acceleration_ratio": "acceleration over plan",
}  # fmt: skip
METHOD = f"paired by event with the corrected equipment; {INTERVALS_OF_MEANS}; after Holm over all claims"


def claims_of(kind: str, controller: str) -> tuple[Claim, ...]:
    """What is claimed of the arms in events of a kind under a controller."""

    def less(metric: str, arm: str) -> str:
        return f"{metric}@{arm} - {metric}@{CORRECTED}"

    return tuple(
        Claim(
            f"{kind}, {controller}: {arm}", f"{arm} uses less of the bound than the corrected equipment",
            less("bound_use", arm), AT_MOST, reason="the correction is there to use more",
            show=POINTS, method=METHOD,
            numbers={f"{words}, less corrected": less(metric, arm) for metric, words in NUMBERS.items()}
            | {f"{words}, corrected": f"{metric}@{CORRECTED}" for metric, words in NUMBERS.items()},
        )
        for arm in (ARMS[1:] if kind == "stops" else (*ARMS[1:3], PRINTED))  # a start has no air brake: (18) is not asked
    )  # fmt: skip


GROUPS = [(kind, controller) for kind in KINDS for controller in COMPARED]
CLAIMS = tuple(claim for group in GROUPS for claim in claims_of(*group))
"""One family."""


def printed_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements on a table of the study."""
    rows = complete(table)
    rows = rows.assign(scenario=rows["event"])
    return family(
        *(
            (
                paired(rows[(rows["kind"] == kind) & (rows["controller"] == one)], "arm", NUMBERS, ()),
                claims_of(kind, one),
            )
            for kind, one in GROUPS
        )
    )  # fmt: skip


def _name(event: str, arm: str) -> str:
    return event if arm in (CORRECTED, PRINTED) else f"{event}-{[*CHANGES].index(arm) + 1}"


def _events(seed: int, k: int) -> dict[str, tuple[Scenario, int]]:
    """A start and a stop, each with its day."""
    number = braking_study.stop_of(k)
    stop = braking_study.scenario(seed, number)
    return {
        "starts": (claim_events.scenario(seed, k), k),
        "stops": (stop, braking_study.EVENTS.draw(seed, number)["day"]),
    }


def _with(event: Scenario, keys: Mapping[str, Any], name: str) -> Scenario:
    """The event with these keys of the equipment beside its own."""
    own = dict(event.model_dump()["onboard"])
    for key, value in keys.items():
        own[key] = {**own.get(key, {}), **value} if isinstance(value, Mapping) else value
    return event.changed(name=name, onboard=own)


def cells(seed: int, k: int) -> list[Job]:
    """Start `k` and stop `k` in every arm under every controller."""
    found = []
    for event, day in _events(seed, k).values():
        for arm in ARMS:
            one = _with(event, CHANGES.get(arm, {}), _name(event.name, arm))
            rule = "greedy-printed" if arm == PRINTED else "greedy-literal"
            found += [Job(one, rule, controller, day) for controller in COMPARED]
    return found


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "kind", "event" and "arm"."""
    names = {
        _name(event.name, arm): (kind, event.name, arm)
        for k in range(events)
        for kind, (event, _) in _events(seed, k).items()
        for arm in (CORRECTED, *CHANGES)
    }
    table = with_meaning(table, names, "kind", "event", "arm")
    return table.assign(arm=table["arm"].mask(table["rule"] == "greedy-printed", PRINTED))


PRINTED_STUDY = Study(
    name="printed",
    question="what the equations of JP5484215 are worth as printed, in starts and stops",
    default_events=60,
    cells=EachEvent(cells),
    finish=meant,
    judge=printed_statements,
    claims=CLAIMS,
)
