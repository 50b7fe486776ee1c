"""The ensemble of the readhesion paper's calibration: sets that meet as many findings as any, in both units of a_0 and a_w.

`members.csv` holds what `readhesion sweep calibration` found; `python -m studies.readhesion_paper.members` writes it again.
"""

import argparse
import sys
from collections.abc import Sequence
from pathlib import Path

import joblib
import pandas as pd

from studies.core.collection import study_folder
from studies.readhesion_paper.paper import UNITS, Unit, Unprinted

FILE = Path(__file__).with_name("members.csv")
COLUMNS = ("residual_ratio", "rise", "fall", "time_constant", "unit")


def _sets(unit: Unit) -> tuple[Unprinted, ...]:
    table = pd.read_csv(FILE, dtype=str)
    found = []
    for row in table.loc[table["unit"] == unit, list(COLUMNS[:-1])].to_numpy():
        residual_ratio, rise, fall, time_constant = (float(value) for value in row)
        found.append(Unprinted(residual_ratio, rise, fall, time_constant, unit))
    return tuple(found)


MEMBERS: dict[Unit, tuple[Unprinted, ...]] = {unit: _sets(unit) for unit in UNITS}
"""Sets by unit; the first of each is the one that figures draw."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Write the members from the table of the calibration, whose missing rows are run first."""
    from studies.readhesion_paper.calibration import members
    from studies.readhesion_paper.calibration_study import CALIBRATION

    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--results", type=Path, default=Path("results"))
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count())
    parser.add_argument("--out", type=Path, default=FILE)
    given = parser.parse_args(arguments)
    folder = study_folder(given.results, CALIBRATION.name)
    table = CALIBRATION.run(folder, CALIBRATION.default_events, given.seed, given.jobs)
    # those tried because they are in use come first
    order = table["stage"].map({"shipped": 0, "assumed": 1}).fillna(2)
    ordered = table.loc[order.sort_values(kind="stable").index]
    parts = [members(ordered, unit) for unit in UNITS]
    pd.concat(parts)[list(COLUMNS)].to_csv(given.out, index=False)
    print(", ".join(f"{unit}: {len(part)} sets" for unit, part in zip(UNITS, parts, strict=True)))
    return 0


if __name__ == "__main__":
    sys.exit(main())
