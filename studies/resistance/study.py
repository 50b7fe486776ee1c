"""Running resistance (JP H07-322414): does compensation steady the train, do the weights converge, does the mass help?"""

from studies.core.cell import Task
from studies.core.study import EachEvent, Study
from studies.resistance.events import event_row
from studies.resistance.statements import CLAIMS, resistance_statements


def cells(seed: int, k: int) -> list[Task]:
    """Event `k`: random runs of the speed control, and a random boarding."""
    return [Task(f"{seed}/{k}", event_row, (seed, k), (("seed", seed),))]


RESISTANCE = Study(
    name="resistance",
    question="compensation and learning of running resistance by line position (JP H07-322414)",
    default_events=12,
    cells=EachEvent(cells),
    judge=resistance_statements,
    claims=CLAIMS,
    whole=True,
)
