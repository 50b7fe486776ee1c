"""The ensemble of the slide protection's calibration: sets that reach the tables of JP4209318, and fits without two cars.

`members.csv` holds what `readhesion sweep slide-calibration --seed 1` found; `python -m studies.slides.members` writes it
again.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import joblib
import numpy as np
import pandas as pd

from studies.core.collection import study_folder
from studies.slides.calibration import reaches, undisclosed_of
from studies.slides.jp4209318 import BOUNDS, Undisclosed

FILE = Path(__file__).with_name("members.csv")
SEED = 1
"""Seed of the sweep that found the members."""
MOST_MEMBERS = 60
"""Sets of each arm that are kept."""


def chosen(table: pd.DataFrame, arm: str, leave_out: str | None) -> pd.DataFrame:
    """Distinct sets of an arm that reach all but `leave_out`: the shipped one, those of search and walkers, the rest."""
    rows = table[table["arm"] == arm]
    good = np.array([reaches(row, leave_out) for row in rows.to_dict("records")], dtype=bool)
    rows = rows[good]
    first = rows["stage"].map({"shipped": 0, "sampled": 1, "start": 1, "near": 1, "around": 2})
    ordered = rows.assign(first=first).sort_values("first", kind="stable")
    return ordered.drop_duplicates(subset=list(BOUNDS)).drop(columns="first")


def _sets(arm: str) -> tuple[Undisclosed, ...]:
    # every digit counts: valves that switch turn the last ones into metres
    table = pd.read_csv(FILE, dtype=str)
    return tuple(undisclosed_of(row) for _, row in table[table["arm"] == arm].iterrows())


MEMBERS = _sets("all")
"""Sets that reach every target; the first is the one in use."""
HELD_OUT = _sets("held out")
"""Sets that reach every target but the distance of two cars, of which the search did not know."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the members from the sweep's table, whose missing rows are run first."""
    from studies.slides.ensemble_study import ARMS, SLIDE_CALIBRATION  # needed here alone

    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count())
    parser.add_argument("--out", type=Path, default=FILE)
    given = parser.parse_args(arguments)
    folder = study_folder(given.results, SLIDE_CALIBRATION.name)
    table = SLIDE_CALIBRATION.run(folder, SLIDE_CALIBRATION.default_events, given.seed, given.jobs)
    parts = [chosen(table, arm, leave_out).head(MOST_MEMBERS) for arm, leave_out in ARMS.items()]
    pd.concat(parts)[["arm", *BOUNDS]].to_csv(given.out, index=False)
    print(", ".join(f"{arm}: {len(part)} sets" for arm, part in zip(ARMS, parts, strict=True)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
