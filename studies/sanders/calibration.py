"""Which law of sand makes the trials of RSSB T1107 come out: three rows are fitted, the others predicted.

`python -m studies.sanders.calibration --units 2 --source estimate` prints law and distances.
"""

import argparse
import math
import sys
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray
from scipy.optimize import least_squares

from alloc.plant.rail import Rail
from studies.sanders.trial import DISTANCES, SOURCE, SOURCES, SandLaw, Source, stop

FITTED = ("one fixed", "two fixed", "two variable")
TOLERANCE = 0.05
"""Share of its distance by which a row may be missed."""
LOW, HIGH = SandLaw(0.05, 1e-3, 1e-3), SandLaw(0.4, 0.1, 0.5)
"""Bounds of the law: sanded rail carries no more than dry rail."""
CALIBRATED = SandLaw(*(getattr(Rail(0.1), name) for name in SandLaw._fields))
"""The set in use."""
EVALUATIONS = 12


def distances(
    law: SandLaw, units: int = 2, curve: str = "slip-ratio", source: Source = SOURCE,
    kinds: Sequence[str] = tuple(DISTANCES),
) -> dict[str, float]:  # fmt: skip
    """Stopping distances [m] of the trial's rows."""
    return {kind: stop(kind, law, units, curve, source)["distance"] for kind in kinds}


def calibrate(
    units: int = 2, curve: str = "slip-ratio", source: Source = SOURCE,
    fitted: Sequence[str] = FITTED, start: SandLaw = CALIBRATED,
) -> SandLaw:  # fmt: skip
    """The law whose distances of the `fitted` rows are nearest to the trial's, by least squares of their logarithms."""

    def law(point: NDArray[np.float64]) -> SandLaw:
        return SandLaw(*np.exp(point).tolist())

    def misses(point: NDArray[np.float64]) -> list[float]:
        found = distances(law(point), units, curve, source, fitted)
        return [math.log(found[kind] / DISTANCES[kind]) for kind in fitted]

    bounds = (np.log(LOW), np.log(HIGH))
    # differences far above what valves that switch make of a small change
    found = least_squares(
        misses, np.log(start), bounds=bounds, diff_step=0.02, xtol=1e-3, ftol=1e-3, max_nfev=EVALUATIONS,
    )  # fmt: skip
    return law(found.x)


def main(arguments: Sequence[str] | None = None) -> int:
    """Calibrate, and print the law and all distances under it."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--units", type=int, default=2)
    parser.add_argument("--curve", default="slip-ratio")
    parser.add_argument("--source", default=SOURCE, choices=SOURCES)
    given = parser.parse_args(arguments)
    law = calibrate(given.units, given.curve, given.source)
    print(law)
    for kind, metres in distances(law, given.units, given.curve, given.source).items():
        role = "fitted" if kind in FITTED else "predicted"
        print(f"{kind:14s} {metres:7.1f} m, trial {DISTANCES[kind]:6.0f}, {role}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
