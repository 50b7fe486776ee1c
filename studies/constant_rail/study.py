"""Stability, by trial: constant rails of drawn curves, levels, speeds and loads, without noise."""

from studies.constant_rail.events import DURATION, EVENTS, scenario
from studies.constant_rail.measures import measure
from studies.constant_rail.statements import CLAIMS, CONTROLLERS, constant_rail_statements
from studies.core.job import Job
from studies.core.study import EachEvent, Study
from studies.ladder.study import RULE


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Rail `k` under every controller."""
    one = scenario(seed, k, duration)
    return [Job(one, RULE, controller, k, measure) for controller in CONTROLLERS]


CONSTANT_RAIL = Study(
    name="constant-rail",
    question="whether slip stays bounded and torque comes to rest on rails that do not change",
    default_events=100,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: constant_rail_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
