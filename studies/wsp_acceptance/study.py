"""One setting of the slide protection from adhesion 0.02 up, on every curve, for 1 to 8 cars, beside the true speed."""

from collections.abc import Sequence
from typing import Any

from alloc.onboard.parameters import ReferenceSpeed
from studies.core.cell import Task
from studies.core.study import Study
from studies.files.study_error import StudyError
from studies.wsp_acceptance.measures import measured, stopped_run
from studies.wsp_acceptance.statements import CLAIMS, acceptance_statements
from studies.wsp_acceptance.stop_cases import (
    LAWS,
    StopCase,
    chosen_cases,
    drawn_case,
    table_cases,
)

TRUE = "true_speed_"
"""Beginning of the columns of the stop with the true speed."""


def stop_row(case: StopCase) -> dict[str, Any]:
    """Measures of a stop and, where it is compared, those of the same one with the true speed."""
    stop = case.stop()
    row = case.columns | {"event": stop.event.name, "reference": "estimated"}
    row |= measured(stopped_run(stop.event), stop)
    if case.compared:
        told = stop.under(ReferenceSpeed(source="truth"))
        found = measured(stopped_run(told.event), told)
        row |= {TRUE + name: value for name, value in found.items()}
    return row


def cells(
    seed: int,
    events: int,
    adhesion: Sequence[float] | None = None,
    curve: Sequence[str] | None = None,
    speed_kmh: float | None = None,
    train: str | None = None,
    law: str = "fuzzy",
) -> list[Task]:
    """The table and `events` drawn stops; or, where something is chosen, stops on uniform rail as asked for."""
    if law not in LAWS:
        raise StudyError(f"--law {law}: give one of {', '.join(LAWS)}")
    if (adhesion, curve, speed_kmh, train) == (None,) * 4:
        chosen = [*table_cases(law), *(drawn_case(seed, k, law) for k in range(events))]
    else:
        chosen = chosen_cases(adhesion, curve, speed_kmh, train, law)
    return [Task(label_of(case), stop_row, (case,), tuple(case.columns.items())) for case in chosen]


def label_of(case: StopCase) -> str:
    """Name of a case: its part, train, curve, levels and what else is not as usual."""
    levels = case.levels if isinstance(case.levels, (int, float)) else tuple(case.levels)
    parts = (case.part, case.train.name, case.curve, levels, case.speed, case.grade)
    return "/".join(map(str, (*parts, case.friction_factor, case.law)))


WSP_ACCEPTANCE = Study(
    name="wsp-acceptance",
    question="whether one setting of the slide protection serves every rail from adhesion 0.02 up",
    default_events=12,
    cells=cells,
    judge=lambda table: acceptance_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
    shown={
        "part": "part", "train": "train", "event": "event",
        "adhesion_used": "used", "true_speed_adhesion_used": "with true speed",
        "locked_axle_s": "locked [axle s]", "damage_kj": "Q [kJ]", "air_nl": "air [Nl]", "distance_m": "distance [m]",
    },
)  # fmt: skip
