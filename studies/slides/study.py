"""The demonstration of JP4209318: its Tables 3 and 4, what lies between their settings, and how far the numbers carry."""

from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd

from alloc.onboard import SlideProtection, Threshold
from studies.core.code_version import hash_with
from studies.core.statement import Statement
from studies.core.store import Store
from studies.core.stored_events import stored_table
from studies.slides import calibration as slide_calibration
from studies.slides import electric as slide_electric
from studies.slides import electric_event as electric_slide
from studies.slides import jp4209318
from studies.slides import targets as slide_targets
from studies.slides.calibration import JITTER_DRAWS, jitter
from studies.slides.electric import electric_row, electric_tasks
from studies.slides.jp4209318 import (
    CALIBRATED,
    CAR_DECELERATION,
    CYCLE,
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

DESCRIPTION = (
    "slide protection of JP4209318: distance, wheel damage and air by train and sensitivity"
)
DEFAULT_EVENTS = JITTER_DRAWS
"""Draws of noise on the calibrated parameters; nothing else is random."""
TABLE = "slide_protection.parquet"
SENSITIVITIES = tuple(float(x) for x in np.geomspace(0.4, 12.0, 33))
"""Of the front of distance against Q; 1 is medium."""
THRESHOLDS = ((0.01, 0.02), (0.02, 0.04), (0.03, 0.06), (0.05, 0.10), (0.08, 0.15), (0.12, 0.25))
"""Slip ratios above which the plain threshold holds, and releases."""

OnRow = Callable[[str, int, int], None]
Task = tuple[dict[str, Any], SlideProtection, int, float]
"""Identity of a row; protection, cars and step of its run."""


def tasks() -> Iterator[Task]:
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
        plain = _plain("threshold", Threshold(release=release, hold=hold))
        yield {"part": "threshold", "cars": 3, "hold": hold, "release": release}, plain, 3, STEP
    yield {"part": "none", "cars": 3}, _plain("none"), 3, STEP


def run(
    folder: Path, events: int, seed: int, jobs: int, on_row: OnRow | None = None
) -> pd.DataFrame:
    """The table, kept in `folder`: a row per run of the calibrated set (`part`), per draw of noise, and per other set.

    Rows of runs hold `studies.slides.jp4209318.measures` and the computing time per simulated second, those of the part
    "electric" what `studies.slides.electric` says; "jitter", "rival" and "held out" hold
    `studies.slides.targets.outcomes`.
    """
    path = Store(folder).folder / TABLE
    known = stored(folder)
    if known is not None and (known["draws"] == events).all() and (known["seed"] == seed).all():
        return known
    # the runs of the MPC take longest, so they go first
    chosen = [joblib.delayed(electric_row)(*task) for task in reversed(list(electric_tasks()))]
    chosen += [joblib.delayed(_row)(*task) for task in tasks()]
    rows: list[dict[str, Any]] = []
    for row in joblib.Parallel(n_jobs=jobs, return_as="generator")(chosen):
        rows.append(row)
        if on_row is not None:
            on_row(str(row["part"]), len(rows), len(chosen))
    draws = jitter(CALIBRATED, seed, events).assign(part="jitter")
    rows += [{str(key): value for key, value in row.items()} for row in draws.to_dict("records")]
    rows += [{"part": "rival", **outcomes(rival)} for rival in RIVALS]
    rows.append({"part": "held out", **outcomes(HELD_OUT)})
    table = pd.DataFrame(rows).assign(draws=events, seed=seed, code_hash=_hash())
    table.to_parquet(path, index=False)
    return pd.read_parquet(path)  # as a later call gives it


def stored(folder: Path) -> pd.DataFrame | None:
    """The table that a folder holds, None if there is none or it comes from other code."""
    return stored_table(folder, TABLE, _hash())


def statements(table: pd.DataFrame) -> list[Statement]:
    """Every target and finding: whether it holds here, and the numbers."""
    return slide_statements(table)


def _fuzzy(sensitivity: float) -> SlideProtection:
    return slide_protection(CALIBRATED, sensitivity)


def _plain(law: Any, threshold: Threshold | None = None) -> SlideProtection:
    return SlideProtection(
        law=law,
        threshold=threshold or Threshold(),
        period=CYCLE,
        reference="car",
        deceleration=CAR_DECELERATION,
    )


def _row(
    identity: dict[str, Any], protection: SlideProtection, cars: int, step: float
) -> dict[str, Any]:
    found = brake(brake_event(CALIBRATED, cars, protection=protection, step=step))
    per_second = 1e3 * float(found.attrs["wall_time_s"]) / DURATIONS[cars]
    return {**identity, **measures(found), "computing": per_second}


def _hash() -> str:
    modules = (electric_slide, jp4209318, slide_calibration, slide_electric, slide_targets)
    return hash_with(__file__, *(str(module.__file__) for module in modules))


__all__ = ["DEFAULT_EVENTS", "DESCRIPTION", "run", "statements", "stored"]
