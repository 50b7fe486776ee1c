"""The ladder of readhesion controllers, from none to MPC: all of them meet the same random events with the same noise."""

from studies.core.drawn_events import complete
from studies.core.job import Job
from studies.core.study import EachEvent, Study
from studies.ladder.events import DURATION, EVENTS, scenario
from studies.ladder.measures import measure
from studies.ladder.statements import HOSTED_RUNG, LADDER, ladder_statements

BLOCK = 6
"""Events in which every train meets every curve once. The MPC, whose runs take as long as ten of the others, meets every
second block."""
RULE = "alone"
"""No unit hears of another: what a run yields is its readhesion controller's doing."""


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` under the controllers that meet it."""
    one = scenario(seed, k, duration)
    return [Job(one, RULE, controller, k, measure) for controller in controllers_of(k)]


def controllers_of(k: int) -> list[str]:
    """Controllers that meet event `k`."""
    return [name for name in LADDER if name != HOSTED_RUNG or k // BLOCK % 2 == 0]


LADDER_STUDY = Study(
    name="ladder",
    question="readhesion controllers from none to MPC: adhesion used, search time, fluctuation, slip, damage",
    default_events=30,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: ladder_statements(complete(table)),
)
