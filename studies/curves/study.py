"""Limits of the adhesion model: do the conclusions on rules and controllers stand under other adhesion curves?"""

from typing import Any

import pandas as pd

from studies.claims.events import DURATION, draw, event_name
from studies.claims.events import scenario as claim_event
from studies.claims.measures import measure
from studies.core.drawn_scenarios import START_SPEED, rail_offering
from studies.core.job import Job
from studies.core.study import EachEvent, Study
from studies.curves.statements import CLAIMS, CURVES, RULES, curve_statements
from studies.scenario.scenario import Scenario

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
    meaning = table["scenario"].map(names)
    return table.assign(event=meaning.str[0].astype(int), curve=meaning.str[1])


CURVE_STUDY = Study(
    name="curves",
    question="whether the order of rules and of controllers stands under other adhesion curves",
    default_events=20,
    cells=EachEvent(cells),
    finish=meant,
    judge=lambda table: curve_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
