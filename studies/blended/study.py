"""Rules and controllers in drawn blended stops, with the estimated reference speed and with the true one."""

import pandas as pd

from studies.blended.events import DURATION, EVENTS, SOURCES, event_name, peak_of, scenario
from studies.blended.measures import measure
from studies.blended.statements import ARMS, CLAIMS, blended_statements
from studies.core.job import Job
from studies.core.study import EachEvent, Study


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
    meaning = table["scenario"].map(names)
    table = table.assign(event=meaning.str[0].astype(int), source=meaning.str[1])
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
