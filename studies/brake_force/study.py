"""The RTRI report's running tests over many days: each finding, and which car did not deliver its allocated force."""

from collections.abc import Sequence

from studies.brake_force.accusations import (
    SHORTFALLS,
    allocated_rows,
    budget_dry_rows,
    driven_rows,
    sliding_rows,
)
from studies.brake_force.beliefs import BELIEFS
from studies.brake_force.findings import budget_rows, running_test_row
from studies.brake_force.running_tests import TESTS
from studies.brake_force.statements import CLAIMS, brake_force_statements
from studies.core.cell import Task
from studies.core.study import EachEvent, Study


def cells(
    seed: int,
    k: int,
    tests: Sequence[str] = tuple(TESTS),
    shortfalls: Sequence[float] = SHORTFALLS,
    beliefs: Sequence[str] = tuple(BELIEFS),
) -> list[Task]:
    """Day `k`: the running tests, stops under allocation, with a sliding trailer and dry, and the error budget of `beliefs`.

    Wagons, loads, rails and errors are the day's. Without beliefs there is no budget.
    """
    draw, columns, wrong = 10_000 * seed + k, (("event", k),), tuple(beliefs)
    return [
        *(Task(f"{draw}/{name}", running_test_row, (name, draw), columns) for name in tests),
        Task(f"{draw}/allocated", allocated_rows, (draw,), columns),
        Task(f"{draw}/driven", driven_rows, (draw, tuple(shortfalls)), columns),
        Task(f"{draw}/sliding", sliding_rows, (draw,), columns),
        *(
            Task(f"{draw}/budget/{name}", budget_rows, (name, draw, wrong), columns)
            for name in tests
            if wrong
        ),
        *([Task(f"{draw}/budget/dry", budget_dry_rows, (draw, wrong), columns)] if wrong else []),
    ]


BRAKE_FORCE = Study(
    name="brake-force",
    question="what the RTRI report found of brake force per car, and whether a faulty car is found",
    default_events=20,
    cells=EachEvent(cells),
    judge=brake_force_statements,
    claims=CLAIMS,
    whole=True,
)
