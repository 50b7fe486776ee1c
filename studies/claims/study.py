"""The claims of JP5484215 put to the test by Monte Carlo: random events, every rule meets each of them."""

from studies.claims.events import DURATION, EVENTS, scenario
from studies.claims.measures import measure
from studies.claims.statements import CLAIMS, LAYERS, claim_statements
from studies.core.drawn_events import COMPARED, complete
from studies.core.job import Job
from studies.core.study import EachEvent, Study

RULES = ("alone", "preset", "sharing", *LAYERS, "exact", "oracle")


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` under every rule and controller, with the seed `k` for all of them, so that they meet the same event."""
    one = scenario(seed, k, duration)
    return [Job(one, rule, controller, k, measure) for controller in COMPARED for rule in RULES]


CLAIM_STUDY = Study(
    name="claims",
    question="claims (a) to (e) of JP5484215 over random events, all rules paired",
    default_events=240,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: claim_statements(complete(table)),
    claims=CLAIMS,
)
