"""Others' readhesion controllers on the events of the ladder, beside the rungs that their sources put them above."""

from studies.core.drawn_events import complete
from studies.core.job import Job
from studies.core.study import EachEvent, Study
from studies.ladder.events import DURATION, EVENTS, scenario
from studies.ladder.measures import measure
from studies.ladder.published import ARMS, CLAIMS, published_statements
from studies.ladder.study import RULE


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
