"""Sweeps: one question each, asked over many random events; a table out, and plain statements with their numbers."""

from collections.abc import Callable
from pathlib import Path
from typing import Protocol

import pandas as pd

from studies.brake_force import study as brake_force
from studies.claims import study as claims
from studies.core.statement import Statement
from studies.core.study_error import unknown
from studies.curves import study as curves
from studies.differences import study as differences
from studies.joint import study as joint
from studies.ladder import study as ladder
from studies.learning import study as learning
from studies.readhesion_paper import calibration_study as calibration
from studies.readhesion_paper import study as readhesion
from studies.resistance import study as resistance
from studies.slides import study as slide_protection

OnRow = Callable[[str, int, int], None]


class Sweep(Protocol):
    """What a module of this package offers to be a sweep."""

    DESCRIPTION: str
    """One line: the question."""
    DEFAULT_EVENTS: int
    """Events where none are asked for."""

    def run(
        self, folder: Path, events: int, seed: int, jobs: int, on_row: OnRow | None = None
    ) -> pd.DataFrame:
        """The table of so many events drawn from `seed`; what `folder` holds already is not run again."""

    def statements(self, table: pd.DataFrame) -> list[Statement]:
        """What the table says, computed from it by thresholds that the module states."""


SWEEPS: dict[str, Sweep] = {
    "claims": claims,
    "differences": differences,
    "learning": learning,
    "ladder": ladder,
    "curves": curves,
    "joint": joint,
    "readhesion": readhesion,
    "calibration": calibration,
    "brake-force": brake_force,
    "resistance": resistance,
    "slide-protection": slide_protection,
}
"""Every sweep by name."""


def find_sweep(name: str) -> Sweep:
    """The sweep called `name`; raises `StudyError` with the nearest name for one that does not exist."""
    if name not in SWEEPS:
        raise unknown("sweep", name, SWEEPS)
    return SWEEPS[name]


def sweep_folder(out: str | Path, name: str) -> Path:
    """Where a sweep keeps its table under the results' folder `out`."""
    return Path(out) / "sweeps" / name


__all__ = ["SWEEPS", "Statement", "Sweep", "find_sweep", "sweep_folder"]
