"""The ladder of readhesion controllers, from none to MPC: all of them meet the same random events with the same noise."""

from studies.core.drawn_events import complete
from studies.core.job import Job
from studies.core.study import EachEvent, Study
from studies.ladder.events import DURATION, EVENTS, scenario
from studies.ladder.measures import measure
from studies.ladder.statements import CLAIMS, LADDER, ladder_statements

RULE = "alone"
"""Units exchange nothing: the result of a run depends on its readhesion controller alone."""


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` under every controller."""
    one = scenario(seed, k, duration)
    return [Job(one, RULE, controller, k, measure) for controller in LADDER]


LADDER_STUDY = Study(
    name="ladder",
    question="readhesion controllers from none to MPC: adhesion used, search time, fluctuation, slip, damage",
    default_events=30,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: ladder_statements(complete(table)),
    claims=CLAIMS,
)
