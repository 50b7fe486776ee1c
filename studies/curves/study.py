"""Limits of the adhesion model: do the conclusions on rules and controllers stand under other adhesion curves?"""

from typing import Any

import pandas as pd

from alloc.plant.adhesion import POLACH_WET
from alloc.plant.environment import level_for
from studies.claims.events import DURATION, REFERENCE_SPEED
from studies.claims.events import scenario as claim_event
from studies.claims.measures import measure
from studies.claims.quantities import draw, event_name
from studies.core.job import Job
from studies.core.study import EachEvent, Study
from studies.curves.statements import BASE, CURVES, INFORMED, RULES, curve_statements
from studies.scenario.scenario import Scenario

EVENTS_PER_MPC = 2
"""Every so many events the MPC runs too, under one rule; its runs are the slowest."""
MPC_RULE = "exact"
KNOWN = "-known"
"""End of the name of an event whose train knows the rail's curve."""


def name_of(seed: int, k: int, curve: str) -> str:
    """Name of event `k` on a rail of `curve`."""
    return f"{event_name(seed, k)}-{curve.replace(' ', '-')}"


def informed(event: Scenario) -> Scenario:
    """The same event for a train that believes in the rail's own curve."""
    belief = event.belief.model_dump() | {"curve": event.rail.curve.model_dump()}
    return event.changed(name=event.name + KNOWN, belief=belief)


def scenario(seed: int, k: int, curve: str, duration: float = DURATION) -> Scenario:
    """Event `k` of the claims on a rail of `curve`; the train believes in the piecewise curve on all of them."""
    base = claim_event(seed, k, duration)
    rail: dict[str, Any] = base.rail.model_dump() | {"curve": CURVES[curve]}
    if CURVES[curve]["kind"] == "polach":  # its level is the friction coefficient, above the peak
        adhesion = draw(seed, k)["level"]  # "level" may be a factor on a law of speed
        train = base.event(0).model.train
        rail["level"] *= level_for(POLACH_WET, adhesion, REFERENCE_SPEED, train) / adhesion
    belief = base.belief.model_dump() | {"curve": {"kind": "piecewise"}}
    return base.changed(name=name_of(seed, k, curve), rail=rail, belief=belief)


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` of the claims on a rail of every curve, with the same peak of adhesion at 15 km/h."""
    found = []
    for curve in CURVES:
        one = scenario(seed, k, curve, duration)
        found += [Job(one, rule, "cut-and-ramp", k, measure) for rule in RULES]
        if k % EVENTS_PER_MPC == 0:
            found.append(Job(one, MPC_RULE, "mpc", k, measure))
            if curve != BASE:
                found.append(Job(informed(one), MPC_RULE, "mpc", k, measure))
    return found


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event" and "curve"; an MPC that knows the rail's curve has a name of its own."""
    names = {name_of(seed, k, curve): (k, curve) for k in range(events) for curve in CURVES}
    meaning = table["scenario"].str.removesuffix(KNOWN).map(names)
    table = table.assign(event=meaning.str[0].astype(int), curve=meaning.str[1])
    table.loc[table["scenario"].str.endswith(KNOWN), "controller"] = INFORMED
    # where the rail has the curve that is believed in, the MPC is informed as it is
    as_it_is = table[(table["curve"] == BASE) & (table["controller"] == "mpc")]
    return pd.concat([table, as_it_is.assign(controller=INFORMED)], ignore_index=True)


CURVE_STUDY = Study(
    name="curves",
    question="whether the order of rules and of controllers stands under other adhesion curves",
    default_events=20,
    cells=EachEvent(cells),
    finish=meant,
    judge=lambda table: curve_statements(table[table["status"] == "ok"]),
)
