"""Which undisclosed curves and rules make the demonstration of JP4209318 come out as its Tables 3 and 4 say?

Unknown are the adhesion of Fig. 2, the conditioning, the fuzzy sets and the sensitivities (`studies.slides.jp4209318`).
Damped least squares start from a set chosen by hand and from the best of a Latin hypercube over `BOUNDS`; the misfit is the
sum of the squared deviations from the targets of `studies.slides.targets`, each in its tolerance. Other starts that
end as near tell how little the tables determine; fits to one and three cars alone, which must predict two, how far the
structure carries; noise of 1e-4 on every parameter, how far any such number can be trusted.

`python -m studies.slides.calibration --samples 60 --starts 2 --seed 1 --jobs 2 --out slide_calibration.parquet`
"""

import argparse
import math
import sys
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import joblib
import numpy as np
import pandas as pd
from numpy.typing import NDArray
from scipy.stats import qmc

from studies.files.study_error import StudyError
from studies.files.writable import check_file
from studies.slides.damped_least_squares import minimise
from studies.slides.jp4209318 import BOUNDS, Undisclosed
from studies.slides.targets import HOLD_OUT, implausible, outcomes, residuals, unreached

DEFAULT_SAMPLES, DEFAULT_STARTS = 60, 2
ITERATIONS = 12
"""Of the damped least squares, each with two sets of five runs per parameter."""
WIDTH = 0.04
"""Half width of the first differences as a share of each range: far above the jitter of valves that switch."""
ENOUGH = 0.3
"""Misfit at which they end: no target misses by more than half its tolerance."""
CAP = 15.0
"""Most tolerances that one deviation counts, so that none hides the others."""
BY_HAND = Undisclosed(
    front_adhesion=0.098, speed_offset=250.0, rear_gain=0.25, rear_fall=0.3, rear_axles=4.0,
    conditioning=0.08, conditioning_slip=0.04, peak_slip_ratio=0.015, shoe_force_share=0.14,
    slip_medium=0.05, slip_large=0.17, rate_growing=0.8, pole=8.0, sensitivity_low=0.9, sensitivity_high=4.0,
)  # fmt: skip
"""Where every calibration starts besides the sets drawn: a set whose distances are 2 % from the source's."""
JITTER = 1e-4
"""Relative noise on every parameter (standard deviation)."""
JITTER_DRAWS = 16
LOGARITHMIC = ("conditioning_slip", "rate_growing", "sensitivity_high")
"""Parameters that are drawn on a logarithmic scale."""


def from_unit_cube(point: NDArray[np.float64]) -> Undisclosed:
    """The set at a point of the unit cube, (parameters,)."""
    values = {}
    for x, (name, (low, high)) in zip(point, BOUNDS.items(), strict=True):
        share = float(np.clip(x, 0.0, 1.0))
        straight = low + share * (high - low)
        values[name] = low * (high / low) ** share if name in LOGARITHMIC else straight
    return Undisclosed(**values)


def to_unit_cube(undisclosed: Undisclosed) -> NDArray[np.float64]:
    """Where in the unit cube a set lies, (parameters,)."""
    point = []
    for name, value in asdict(undisclosed).items():
        low, high = BOUNDS[name]
        logarithmic = math.log(value / low) / math.log(high / low)
        point.append(logarithmic if name in LOGARITHMIC else (value - low) / (high - low))
    return np.array(point)


def misfit(
    undisclosed: Undisclosed, found: Mapping[str, float], leave_out: str | None = None
) -> float:
    """Sum of the squared deviations from the targets, each in its tolerance and at most `CAP`."""
    return _capped(np.array(residuals(undisclosed, found, leave_out)))


def _capped(deviations: NDArray[np.float64]) -> float:
    return float((np.minimum(np.abs(deviations), CAP) ** 2).sum())


def row_of(undisclosed: Undisclosed, stage: str, start: int) -> dict[str, Any]:
    """A row of the table: stage and start, the set, its outcomes, misfit, and what it does not reach."""
    found = outcomes(undisclosed)
    return {
        "stage": stage,
        "start": start,
        **asdict(undisclosed),
        **found,
        "misfit": misfit(undisclosed, found),
        "misfit without 2": misfit(undisclosed, found, HOLD_OUT),
        "unreached": ", ".join(unreached(found)),
        "plausible": implausible(undisclosed) == 0.0,
    }


def undisclosed_of(row: "pd.Series[Any]") -> Undisclosed:
    """The set of a row."""
    return Undisclosed(**{name: float(row[name]) for name in BOUNDS})


def draw(samples: int, seed: int) -> list[Undisclosed]:
    """Plausible sets by a Latin hypercube over the ranges, at most so many."""
    points = qmc.LatinHypercube(len(BOUNDS), rng=seed).random(4 * samples)
    sets = [from_unit_cube(point) for point in points]
    return [one for one in sets if implausible(one) == 0.0][:samples]


def refine(
    start: Undisclosed,
    number: int,
    leave_out: str | None = None,
    iterations: int | None = None,
    free: Collection[str] = tuple(BOUNDS),
) -> dict[str, Any]:
    """Row of the best set that damped least squares find from `start`, in `ITERATIONS` where nothing else is said.

    Parameters that are not `free` stay as they are.
    """
    moved = np.array([name in free for name in BOUNDS])
    whole = to_unit_cube(start)

    def put(point: NDArray[np.float64]) -> Undisclosed:
        placed = whole.copy()
        placed[moved] = point
        found = asdict(from_unit_cube(placed))
        return replace(start, **{name: found[name] for name in BOUNDS if name in free})

    def deviations(point: NDArray[np.float64]) -> NDArray[np.float64]:
        undisclosed = put(point)
        return np.array(residuals(undisclosed, outcomes(undisclosed), leave_out))

    steps = ITERATIONS if iterations is None else iterations
    point, _ = minimise(deviations, _capped, whole[moved], WIDTH, steps, ENOUGH)
    stage = "refined" if leave_out is None else "held out"
    return row_of(put(point), stage, number)


def calibrate(
    samples: int,
    starts: int,
    seed: int,
    jobs: int,
    iterations: int | None = None,
) -> pd.DataFrame:
    """A row per set: drawn ("wide"); refined from `BY_HAND` (start 0) and the best drawn; the same without two cars."""
    parallel = joblib.Parallel(n_jobs=jobs)

    sets = draw(samples, seed) if samples else []
    rows = parallel(joblib.delayed(row_of)(one, "wide", k) for k, one in enumerate(sets))
    order = np.argsort([row["misfit"] for row in rows], kind="stable")
    chosen = [BY_HAND, *(sets[k] for k in order)][:starts]
    refined = parallel(
        joblib.delayed(refine)(start, k, leave_out, iterations)
        for k, start in enumerate(chosen)
        for leave_out in (None, HOLD_OUT)
    )
    return pd.DataFrame(rows + refined)


def jittered(undisclosed: Undisclosed, seed: int, k: int) -> dict[str, Any]:
    """Outcomes of the set with the draw `k` of normal noise of `JITTER` on every parameter."""
    noise = np.random.default_rng(seed).standard_normal((k + 1, len(BOUNDS)))[k]
    values = zip(asdict(undisclosed).values(), noise, strict=True)
    return outcomes(Undisclosed(*(value * (1.0 + JITTER * float(x)) for value, x in values)))


def jitter(undisclosed: Undisclosed, seed: int, draws: int = JITTER_DRAWS) -> pd.DataFrame:
    """A row of `jittered` per draw."""
    return pd.DataFrame([jittered(undisclosed, seed, k) for k in range(draws)])


def equally_good(table: pd.DataFrame) -> pd.DataFrame:
    """Rows of refined, plausible sets that reach every target."""
    return table[(table["stage"] == "refined") & (table["unreached"] == "") & table["plausible"]]


def best(table: pd.DataFrame) -> "pd.Series[Any]":
    """Row of the least misfit among the sets that reach every target; of all refined ones where none does."""
    good = equally_good(table)
    chosen = good if len(good) else table[table["stage"] == "refined"]
    return chosen.sort_values("misfit", kind="stable").iloc[0]


def main(arguments: Sequence[str] | None = None) -> int:
    """Calibrate, write every set, print the best and its jitter."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").partition("\n")[0])
    parser.add_argument("--samples", type=int, default=DEFAULT_SAMPLES)
    parser.add_argument("--starts", type=int, default=DEFAULT_STARTS)
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--jobs", type=int, default=joblib.cpu_count())
    parser.add_argument("--out", type=Path, default=Path("slide_calibration.parquet"))
    chosen = parser.parse_args(arguments)
    try:
        for name, least in (("samples", 0), ("starts", 1), ("seed", 0), ("jobs", 1)):
            if getattr(chosen, name) < least:
                raise StudyError(f"--{name} {getattr(chosen, name)}: must be {least} or greater")
        check_file(chosen.out, (".parquet",))
    except StudyError as error:
        parser.error(str(error))  # exit code 2
    table = calibrate(chosen.samples, chosen.starts, chosen.seed, chosen.jobs)
    table.to_parquet(chosen.out, index=False)
    row = best(table)
    print(", ".join(f"{name} {row[name]:.5g}" for name in BOUNDS))
    print(f"misfit {row['misfit']:.3g}; not reached: {row['unreached'] or 'nothing'}")
    print(
        f"{len(equally_good(table))} of {len(table[table['stage'] == 'refined'])} starts reach every target"
    )
    for _, held in table[table["stage"] == "held out"].iterrows():
        print(f"held out, start {held['start']}: predicts {held[HOLD_OUT]:.1f} m of two cars")
    noise = jitter(undisclosed_of(row), chosen.seed)
    print("jitter: " + ", ".join(f"{name} {noise[name].std():.2g}" for name in noise))
    return 0


if __name__ == "__main__":
    sys.exit(main())
