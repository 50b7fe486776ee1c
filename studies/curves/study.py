"""Limits of the adhesion model: do the conclusions on rules and controllers stand under other adhesion curves?"""

from collections.abc import Callable
from pathlib import Path
from typing import Any

import pandas as pd

from studies.claims.events import DURATION, draw, event_name
from studies.claims.events import scenario as claim_event
from studies.claims.measures import measure
from studies.core.job import Job
from studies.core.runner import run_jobs
from studies.core.statement import Statement
from studies.core.store import Store
from studies.core.stored_events import stored_events
from studies.curves.statements import BASE, CURVES, INFORMED, RULES, curve_statements
from studies.ladder.events import polach_level
from studies.scenario.scenario import Scenario

DESCRIPTION = "whether the order of rules and of controllers stands under other adhesion curves"
DEFAULT_EVENTS = 20
EVENTS_PER_MPC = 2
"""Every so many events the MPC runs too, under one rule; its runs are the slowest."""
MPC_RULE = "exact"
KNOWN = "-known"
"""End of the name of an event whose train knows the rail's curve."""


def run(
    folder: Path,
    events: int,
    seed: int,
    jobs: int,
    on_row: Callable[[str, int, int], None] | None = None,
    duration: float = DURATION,
) -> pd.DataFrame:
    """One row per event, curve, rule and controller (among them `INFORMED`): metrics, measures, "event" and "curve".

    The events are those of the claims (`studies.claims.events`), each once on a rail of every curve, with the same peak
    of adhesion at 15 km/h. Rows that the store in `folder` holds are not run again. `duration` [s] shortens the events.
    """
    cells, meaning = [], []
    for k in range(events):
        for curve in CURVES:
            one = scenario(seed, k, curve, duration)
            meaning.append({"scenario": one.name, "event": k, "curve": curve})
            cells += [Job(one, rule, "cut-and-ramp", k) for rule in RULES]
            if k % EVENTS_PER_MPC == 0:
                cells.append(Job(one, MPC_RULE, "mpc", k))
                if curve != BASE:
                    known = informed(one)
                    cells.append(Job(known, MPC_RULE, "mpc", k))
                    meaning.append({"scenario": known.name, "event": k, "curve": curve})
    table = run_jobs(cells, Store(folder), jobs, on_row=on_row, measure=measure)
    table = table.merge(pd.DataFrame(meaning), on="scenario", how="left")
    table.loc[table["scenario"].str.endswith(KNOWN), "controller"] = INFORMED
    # where the rail has the curve that is believed in, the MPC is informed as it is
    as_it_is = table[(table["curve"] == BASE) & (table["controller"] == "mpc")]
    return pd.concat([table, as_it_is.assign(controller=INFORMED)], ignore_index=True)


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
        rail["level"] *= polach_level(adhesion) / adhesion
    belief = base.belief.model_dump() | {"curve": {"kind": "piecewise"}}
    return base.changed(name=name_of(seed, k, curve), rail=rail, belief=belief)


def stored(folder: Path, seed: int = 0) -> int:
    """Number of events, counted from the first, that a folder holds in full under the present code."""
    return stored_events(
        folder,
        lambda key: (key.scenario, key.rule),
        lambda k: {(name_of(seed, k, curve), rule) for curve in CURVES for rule in RULES},
    )


def statements(table: pd.DataFrame) -> list[Statement]:
    """One statement per conclusion: does its sign stand under every curve?"""
    return curve_statements(table[table["status"] == "ok"])


__all__ = ["DEFAULT_EVENTS", "DESCRIPTION", "run", "scenario", "statements", "stored"]
