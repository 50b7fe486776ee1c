"""How right the figures of logs are that recorders have written with their usual defects."""

from studies.core.cell import Task
from studies.core.study import EachEvent, Study
from studies.log_accuracy.drawn_logs import LOGS, rows_of
from studies.log_accuracy.statements import CLAIMS, log_accuracy_statements


def cells(seed: int, k: int, logs: int = LOGS) -> list[Task]:
    """Run `k` and its logs."""
    return [Task(f"{seed}/{k:04d}/{logs}", rows_of, (seed, k, logs), (("seed", seed),))]


LOG_ACCURACY = Study(
    name="log-accuracy",
    question="how right figures from logs are that recorders wrote with drawn defects, and what is said of wrong ones",
    default_events=68,
    cells=EachEvent(cells),
    judge=log_accuracy_statements,
    claims=CLAIMS,
)
