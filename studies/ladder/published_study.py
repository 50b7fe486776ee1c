"""Others' readhesion controllers on the events of the ladder, beside the rungs that their sources put them above."""

from collections.abc import Mapping
from typing import NamedTuple

import pandas as pd

from studies.core.claims import Claim, family
from studies.core.drawn_events import complete, paired
from studies.core.job import Job
from studies.core.statement import Statement
from studies.core.study import EachEvent, Study
from studies.ladder.events import DURATION, EVENTS, measure, scenario
from studies.ladder.ladder_study import (
    DRAWN,
    METRICS,
    PARTS,
    PERCENT,
    RULE,
    SECONDS,
    better,
    yardstick,
)

PUBLISHED = ("fuzzy-creep", "fuzzy-tracking", "swarm-tracking", "swarm-slip", "cubature-seeking")
"""Built after abstracts of others; each file in `alloc/onboard/controllers` says what had to be assumed."""
COMPARED = ("cut-and-ramp", "pi-creep", "perturb-observe", "steepest-gradient")
"""Rungs of the ladder that they are put beside."""
ARMS = (*COMPARED, *PUBLISHED)
BAR = 0.90
"""Share of the adhesion that Applied Sciences 15(19), 10524 states for its cubature filter with extremum seeking."""


class Above(NamedTuple):
    """That one controller is better than another in a metric, and who says so."""

    name: str
    other: str
    metric: str
    better: int
    """1: more, -1: less."""
    source: str


SAID = (
    Above("fuzzy-creep", "pi-creep", "utilisation_short", 1, "Tian, Daniel, Meehan 2014"),
    Above("swarm-slip", "pi-creep", "utilisation_short", 1, "Zirek, Onat 2020"),
    *(
        Above(name, other, metric, better, "arXiv 2406.13650")
        for name in ("fuzzy-tracking", "swarm-tracking")
        for other in ("perturb-observe", "steepest-gradient")
        for metric, better in (("utilisation_short", 1), ("search_time", -1))
    ),
)
"""What the sources put their controllers above, in the metric that is nearest to their words."""


def published_claims(parts: Mapping[str, str] = PARTS) -> tuple[Claim, ...]:
    """What is claimed of others' controllers over events with these parts."""
    return (
        *(yardstick(BAR, name, parts) for name in PUBLISHED),
        *(
            better(
                f"{METRICS[one.metric]}: {one.name}, {one.other}",
                f"{one.name} has {'more' if one.better > 0 else 'less'} {METRICS[one.metric]} than {one.other} "
                f"({one.source})",
                one.metric, one.name, one.other, parts, one.better > 0,
                PERCENT if one.metric == "utilisation_short" else SECONDS, one.source,
            )
            for one in SAID
        ),
    )  # fmt: skip


CLAIMS = published_claims()


def published_statements(
    table: pd.DataFrame, claims: tuple[Claim, ...] = CLAIMS, drawn: tuple[str, ...] = DRAWN
) -> list[Statement]:
    """Statements on a table of events under `ARMS` in which no controller failed; parts divide by what was `drawn`."""
    return family((paired(table, "controller", list(METRICS), drawn), claims))


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` of the ladder in every arm."""
    one = scenario(seed, k, duration)
    return [Job(one, RULE, controller, k, measure) for controller in ARMS]


PUBLISHED_STUDY = Study(
    name="published",
    question="readhesion controllers of others on the ladder's events: adhesion used, search time, slip, damage",
    default_events=30,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: published_statements(complete(table)),
    claims=CLAIMS,
)
