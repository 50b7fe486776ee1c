"""The demonstration of JP4209318: its tables, what lies between their settings, other laws, noise on the calibrated set."""

from collections.abc import Iterator
from typing import Any

import numpy as np

from alloc.onboard.slide_protection.parameters import SlideProtection, Threshold
from studies.core.cell import Task
from studies.core.study import Study
from studies.slides.calibration import JITTER_DRAWS, jittered
from studies.slides.electric import PART as ELECTRIC
from studies.slides.electric import electric_row, electric_tasks
from studies.slides.jp4209318 import (
    CALIBRATED,
    DURATIONS,
    HALVED_STEP,
    HELD_OUT,
    RIVALS,
    STEP,
    brake,
    brake_event,
    measures,
    slide_protection,
)
from studies.slides.statements import slide_statements
from studies.slides.targets import outcomes

SENSITIVITIES = tuple(float(x) for x in np.geomspace(0.4, 12.0, 33))
"""Of the front of distance against Q; 1 is medium."""
THRESHOLDS = ((0.01, 0.02), (0.02, 0.04), (0.03, 0.06), (0.05, 0.10), (0.08, 0.15), (0.12, 0.25))
"""Slip ratios above which the plain threshold holds, and releases."""

Stop = tuple[dict[str, Any], SlideProtection, int, float]
"""Identity of a row; protection, cars and step of its run."""


def stops() -> Iterator[Stop]:
    """Every run of the calibrated set."""
    for step in (STEP, HALVED_STEP):
        part = "tables" if step == STEP else "halved"
        for cars in (1, 2, 3):
            yield {"part": part, "cars": cars, "setting": "medium"}, _fuzzy(1.0), cars, step
        for setting, value in CALIBRATED.sensitivities.items():
            if setting != "medium":
                yield {"part": part, "cars": 3, "setting": setting}, _fuzzy(value), 3, step
    for value in SENSITIVITIES:
        yield {"part": "pareto", "cars": 3, "sensitivity": value}, _fuzzy(value), 3, STEP
    for hold, release in THRESHOLDS:
        plain = slide_protection(law="threshold", threshold=Threshold(release=release, hold=hold))
        yield {"part": "threshold", "cars": 3, "hold": hold, "release": release}, plain, 3, STEP
    yield {"part": "none", "cars": 3}, slide_protection(law="none"), 3, STEP


def _fuzzy(sensitivity: float) -> SlideProtection:
    return slide_protection(law="fuzzy", fuzzy=CALIBRATED.fuzzy(sensitivity))


def stop_row(protection: SlideProtection, cars: int, step: float) -> dict[str, Any]:
    """Measures of one stop of the calibrated set, and its computing time per simulated second [ms]."""
    found = brake(brake_event(CALIBRATED, cars, protection=protection, step=step))
    per_second = 1e3 * float(found.attrs["wall_time_s"]) / DURATIONS[cars]
    return {**measures(found), "computing": per_second}


def cells(seed: int, draws: int) -> list[Task]:
    """Every run with the calibrated set and its rivals, and `draws` draws of noise on it; the slow runs of the MPC first."""
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
            Task(f"rival/{k}", outcomes, (one,), (("part", "rival"),))
            for k, one in enumerate(RIVALS)
        ),
        Task("held out", outcomes, (HELD_OUT,), (("part", "held out"),)),
    ]


SLIDE_PROTECTION = Study(
    name="slide-protection",
    question="slide protection of JP4209318: distance, wheel damage and air by train and sensitivity",
    default_events=JITTER_DRAWS,  # of noise on the calibrated parameters; nothing else is random
    cells=cells,
    finish=lambda table, seed, draws: table.assign(draws=draws, seed=seed),
    judge=slide_statements,
    whole=True,
)
