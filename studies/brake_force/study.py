"""The RTRI report's running tests over many days: each finding, and which car did not deliver its allocated force."""

from collections.abc import Sequence

from studies.brake_force.findings import SHORTFALLS, allocated_rows, driven_rows, running_test_row
from studies.brake_force.running_tests import TESTS
from studies.brake_force.statements import brake_force_statements
from studies.core.cell import Task
from studies.core.study import EachEvent, Study


def cells(
    seed: int, k: int, tests: Sequence[str] = tuple(TESTS), shortfalls: Sequence[float] = SHORTFALLS
) -> list[Task]:
    """Day `k`: the running tests, stops under allocation and dry stops; wagons, loads, rails and errors are the day's."""
    draw, columns = 10_000 * seed + k, (("event", k),)
    return [
        *(Task(f"{draw}/{name}", running_test_row, (name, draw), columns) for name in tests),
        Task(f"{draw}/allocated", allocated_rows, (draw,), columns),
        Task(f"{draw}/driven", driven_rows, (draw, tuple(shortfalls)), columns),
    ]


BRAKE_FORCE = Study(
    name="brake-force",
    question="what the RTRI report found of brake force per car, and whether a faulty car is found",
    default_events=20,
    cells=EachEvent(cells),
    judge=brake_force_statements,
    whole=True,
)
