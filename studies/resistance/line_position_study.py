"""Line position (JP H07-322414): do compensation and learning survive errors of odometer, signals and map?"""

from collections.abc import Sequence

from studies.core.cell import Task
from studies.core.study import EachEvent, Study
from studies.files.study_error import unknown
from studies.resistance.line_errors import TYPICAL, arms_of, read_line_errors
from studies.resistance.position_events import position_row
from studies.resistance.position_statements import CLAIMS, position_statements


def cells(seed: int, k: int, errors: str | None = None, arms: Sequence[str] = ()) -> list[Task]:
    """Route `k` with each error; `errors`: path of a file that says how large they are; `arms`: some of them [all]."""
    sizes = arms_of(TYPICAL if errors is None else read_line_errors(errors))
    for arm in arms:
        if arm not in sizes:
            raise unknown("arm", arm, sizes)
    return [
        Task(f"{seed}/{k}/{arm}", position_row, (seed, k, arm, sizes[arm]), (("event", k), ("arm", arm)))
        for arm in arms or sizes
    ]  # fmt: skip


LINE_POSITION = Study(
    name="line-position",
    question="what errors of odometer, signals and map leave of compensation and learning by position (JP H07-322414)",
    default_events=40,
    cells=EachEvent(cells),
    judge=position_statements,
    whole=True,
    claims=tuple(claim for claims in CLAIMS.values() for claim in claims),
)
