"""What is said of others' readhesion controllers: the share of adhesion used, and what their sources put them above."""

from collections.abc import Mapping
from typing import NamedTuple

import pandas as pd

from studies.core.drawn_events import paired
from studies.core.family import Claim, Part, Test, compared
from studies.core.statement import Statement
from studies.ladder.statements import (
    METRICS,
    PARTS,
    PERCENT,
    SECONDS,
    STUDENT,
    difference,
    yardstick,
)

PUBLISHED = ("fuzzy-creep", "fuzzy-tracking", "swarm-tracking", "swarm-slip", "cubature-seeking")
"""Built after abstracts of others; each file in `alloc/onboard/controllers` says what had to be assumed."""
COMPARED = ("cut-and-ramp", "pi-creep", "perturb-observe", "steepest-gradient")
"""Rungs of the ladder that they are put beside."""
ARMS = (*COMPARED, *PUBLISHED)
DRAWN = ("train", "curve", "scatter", "patch_factor")
"""What `PARTS` ask of an event."""
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


def published_statements(
    table: pd.DataFrame, parts: Mapping[str, Part] = PARTS, drawn: tuple[str, ...] = DRAWN
) -> list[Statement]:
    """Statements on a table of events under `ARMS` in which no controller failed; `parts` divide by what was `drawn`."""
    events = paired(table, "controller", list(METRICS), drawn)
    return compared([
        *(yardstick(events, BAR, name, parts) for name in PUBLISHED),
        *(above(events, one, parts) for one in SAID),
    ])  # fmt: skip


def above(events: pd.DataFrame, one: Above, parts: Mapping[str, Part]) -> Claim:
    """The claim that a controller is better than another, by paired differences."""
    text = METRICS[one.metric]
    way = "more" if one.better > 0 else "less"
    test = Test(
        lambda e: difference(e, one.metric, one.name, one.other), wanted=1 if one.better > 0 else -1
    )
    return Claim(
        f"{text}: {one.name}, {one.other}", f"{one.name} has {way} {text} than {one.other} ({one.source})",
        events, test, parts, PERCENT if one.metric == "utilisation_short" else SECONDS,
        {f"{words}, less {one.other}": difference(events, metric, one.name, one.other) for metric, words in METRICS.items()},
        f"mean of paired differences {'above' if one.better > 0 else 'below'} 0; {STUDENT}, parts after Bonferroni",
    )  # fmt: skip
