"""The demonstration of JP4209318: its tables, what lies between their settings, other laws, noise, the ensemble."""

from collections.abc import Iterator
from dataclasses import asdict
from typing import Any

import numpy as np

from alloc.onboard.brakes import SlideProtection, Threshold
from studies.core.cell import Task
from studies.core.study import Study
from studies.slides.calibration import jittered
from studies.slides.electric import PART as ELECTRIC
from studies.slides.electric import electric_row, electric_tasks
from studies.slides.ensemble_statements import NOISES
from studies.slides.extrapolation import STOPS, beyond_row
from studies.slides.jp4209318 import (
    CALIBRATED,
    DURATIONS,
    HALVED_STEP,
    STEP,
    Undisclosed,
    brake,
    brake_event,
    measures,
    slide_protection,
)
from studies.slides.members import HELD_OUT, MEMBERS
from studies.slides.statements import CLAIMS, slide_statements
from studies.slides.targets import outcomes

SENSITIVITIES = tuple(float(x) for x in np.geomspace(0.4, 12.0, 33))
"""Of the front of distance against Q; 1 is medium."""
THRESHOLDS = ((0.01, 0.02), (0.02, 0.04), (0.03, 0.06), (0.05, 0.10), (0.08, 0.15), (0.12, 0.25))
"""Slip ratios above which the plain threshold law holds and releases the pressure."""

Stop = tuple[dict[str, Any], SlideProtection, int, float]
"""Identity of a row; protection, cars and step of its run."""


def stops(undisclosed: Undisclosed = CALIBRATED) -> Iterator[Stop]:
    """Every run of a set; with half the step of the one in use alone."""

    def fuzzy(sensitivity: float) -> SlideProtection:
        return slide_protection(law="fuzzy", fuzzy=undisclosed.fuzzy(sensitivity))

    for step in (STEP, HALVED_STEP) if undisclosed == CALIBRATED else (STEP,):
        part = "tables" if step == STEP else "halved"
        for cars in (1, 2, 3):
            yield {"part": part, "cars": cars, "setting": "medium"}, fuzzy(1.0), cars, step
        for setting, value in undisclosed.sensitivities.items():
            if setting != "medium":
                yield {"part": part, "cars": 3, "setting": setting}, fuzzy(value), 3, step
    for value in SENSITIVITIES:
        yield {"part": "pareto", "cars": 3, "sensitivity": value}, fuzzy(value), 3, STEP
    for hold, release in THRESHOLDS:
        plain = slide_protection(law="threshold", threshold=Threshold(release=release, hold=hold))
        yield {"part": "threshold", "cars": 3, "hold": hold, "release": release}, plain, 3, STEP
    yield {"part": "none", "cars": 3}, slide_protection(law="none"), 3, STEP


def stop_row(
    protection: SlideProtection, cars: int, step: float, undisclosed: Undisclosed = CALIBRATED
) -> dict[str, Any]:
    """Measures of one stop of a set, and its computing time per simulated second [ms]."""
    found = brake(brake_event(undisclosed, cars, protection=protection, step=step))
    per_second = 1e3 * float(found.attrs["wall_time_s"]) / DURATIONS[cars]
    return {**measures(found), "computing": per_second}


def member_rows(undisclosed: Undisclosed, seed: int, k: int) -> list[dict[str, Any]]:
    """All runs of a member of the ensemble, and its draw `k` of every size of noise."""
    return [
        {"part": "member", **asdict(undisclosed), **outcomes(undisclosed)},
        *(
            {"part": "noise", "noise": size, **jittered(undisclosed, seed, k, size)}
            for size in NOISES
        ),
        *(
            {**identity, **stop_row(law, cars, step, undisclosed)}
            for identity, law, cars, step in stops(undisclosed)
        ),
        *(electric_row(group, controller, undisclosed) for group, controller in electric_tasks()),
        *(beyond_row(undisclosed, name) for name in STOPS),
    ]


def cells(seed: int, draws: int) -> list[Task]:
    """Every run with the set in use, `draws` draws of noise on it, and the first `draws` members of the ensemble."""
    return [
        *(
            Task(f"{ELECTRIC}/{group}/{controller}", electric_row, (group, controller))
            for group, controller in reversed(electric_tasks())
        ),
        *(
            Task(
                "/".join(map(str, identity.values())), stop_row, tuple(how), tuple(identity.items())
            )
            for identity, *how in stops()
        ),
        *(
            Task(f"jitter/{seed}/{k}", jittered, (CALIBRATED, seed, k), (("part", "jitter"),))
            for k in range(draws)
        ),
        *(
            Task(f"member/{seed}/{k}", member_rows, (one, seed, k), (("member", k),))
            for k, one in enumerate(MEMBERS[:draws])
        ),
        *(
            Task(f"held out/{k}", outcomes, (one,), (("part", "held out"),))
            for k, one in enumerate(HELD_OUT[:draws])
        ),
    ]


SLIDE_PROTECTION = Study(
    name="slide-protection",
    question="slide protection of JP4209318: distance, wheel damage and air by train and sensitivity",
    default_events=len(
        MEMBERS
    ),  # members of the ensemble, and draws of noise; nothing else is random
    cells=cells,
    finish=lambda table, seed, draws: table.assign(draws=draws, seed=seed),
    judge=slide_statements,
    claims=CLAIMS,
    whole=True,
)
