"""What sharing gains where there is something to gain: every rule meets the same random events with headroom."""

from collections.abc import Sequence

from studies.core.controllers import check_controller, is_hosted
from studies.core.drawn_events import COMPARED, complete
from studies.core.job import Job
from studies.core.study import EachEvent, Study
from studies.headroom.events import DURATION, EVENTS, scenario
from studies.headroom.measures import measure
from studies.headroom.statements import NEEDED, RULES, headroom_claims, headroom_statements


def cells(
    seed: int, k: int, duration: float = DURATION, controllers: Sequence[str] = COMPARED
) -> list[Job]:
    """Event `k` under every controller and rule; under a controller that lives in Python, under the rules of the goals."""
    for controller in controllers:
        check_controller(controller)
    one = scenario(seed, k, duration)
    return [
        Job(one, rule, controller, k, measure)
        for controller in controllers
        for rule in (NEEDED if is_hosted(controller) else RULES)
    ]


HEADROOM = Study(
    name="headroom",
    question="what each rule gains over alone by how much there is to gain, and what it costs",
    default_events=60,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: headroom_statements(complete(table)),
    claims=headroom_claims,
)
