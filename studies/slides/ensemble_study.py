"""Which sets of undisclosed parameters reach the tables of JP4209318, and what do they say of two cars if not told?"""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import partial

import numpy as np
import pandas as pd

from studies.core.cell import Task
from studies.core.study import Study
from studies.core.walkers import needed
from studies.slides.calibration import draw, from_unit_cube, to_unit_cube
from studies.slides.ensemble import PASSED, Row, around, sample, search, tried_row
from studies.slides.ensemble_statements import CLAIMS, distinct, ensemble_statements
from studies.slides.jp4209318 import BOUNDS, CALIBRATED, Undisclosed
from studies.slides.targets import HOLD_OUT

ARMS: Mapping[str, str | None] = {"all": None, "held out": HOLD_OUT}
"""What is asked of a set, and the target that is left out."""
STARTS = 1
"""Points of the prior from which sets are sought in each arm; `--events` asks for more."""
NEAR, NEARBY = 23, 0.02
"""Walkers that begin near the set in use, and the standard deviation of their distance as a share of every range."""


@dataclass(frozen=True)
class Effort:
    """How much is run; a small one is for tests."""

    evaluations: int = 2500
    """Sets that a search may run; one in ten or fewer needs more."""
    generations: int = 4
    """Pieces of work of the sampler."""
    steps: int = 10
    """Its steps in each."""
    clouds: int = 10
    """Pieces of work that draw sets around those found."""
    draws: int = 60
    """Draws in each."""


WHOLE = Effort()


def first_cells(seed: int, starts: int, effort: Effort = WHOLE) -> list[Task]:
    """The shipped set, and a search from each start of the prior in each arm."""
    for package in ("cma", "emcee"):
        needed(package)
    return [
        Task("shipped", tried_row, (CALIBRATED,), (("arm", "all"), ("stage", "shipped"))),
        *(
            Task(f"near/{k}", noisy_row, (CALIBRATED, seed, k), (("arm", "all"), ("stage", "near")))
            for k in range(NEAR)
        ),
        *(
            Task(
                f"{arm}/start/{k}", search, (one, _number(seed, arm, k), leave_out, effort.evaluations),
                (("arm", arm), ("stage", "start"), ("start", k)),
            )
            for k, one in enumerate(draw(starts, seed))
            for arm, leave_out in ARMS.items()
        ),
    ]  # fmt: skip


def noisy_row(undisclosed: Undisclosed, seed: int, k: int) -> Row:
    """Row of the draw `k` of noise on a set, kept within the ranges: a walker near it."""
    noise = np.random.default_rng([seed, k]).standard_normal(len(BOUNDS))
    return tried_row(from_unit_cube(np.clip(to_unit_cube(undisclosed) + NEARBY * noise, 0.0, 1.0)))


def later_cells(
    generation: int, seed: int, starts: int, table: pd.DataFrame, effort: Effort = WHOLE
) -> list[Task]:
    """The sampler's next steps from where the walkers are; the first from the set in use, near it, and what searches found.

    Only with all targets: walkers that start from fits of two cars would be long in forgetting them.
    """
    if generation >= effort.generations:
        return []
    own = table[table["arm"] == "all"]
    if generation:
        latest = own[(own["generation"] == generation - 1) & (own["walker"] >= 0)]
        rows = latest.sort_values("walker")
    else:
        rows = own.drop_duplicates(subset=list(BOUNDS))
    walkers = rows[list(PASSED)].to_dict("records")
    return [
        Task(
            f"all/generation/{generation}", sample,
            (walkers, _number(seed, "all", starts + generation), None, effort.steps),
            (("arm", "all"), ("stage", "sampled"), ("generation", generation)),
        )
    ]  # fmt: skip


def cloud_cells(
    cloud: int, seed: int, starts: int, table: pd.DataFrame, effort: Effort = WHOLE
) -> list[Task]:
    """More sets around all that reach everything so far."""
    if cloud >= effort.clouds:
        return []
    found = distinct(table[table["arm"] == "all"])
    if found.empty:
        return []
    number = _number(seed, "all", 1000 + cloud)
    arguments = (found[list(PASSED)].to_dict("records"), number, effort.draws)
    columns = (("arm", "all"), ("stage", "around"), ("generation", WHOLE.generations + cloud))
    return [Task(f"all/around/{cloud}", around, arguments, columns)]


def _number(seed: int, arm: str, k: int) -> int:
    """Seed of a piece of work, below 2^31."""
    drawn = np.random.SeedSequence([seed, list(ARMS).index(arm), k]).generate_state(1)[0]
    return int(drawn) % (2**31 - 2)


SLIDE_CALIBRATION = Study(
    name="slide-calibration",
    question="which sets of what JP4209318 does not disclose reach its Tables 3 and 4, and how far apart they lie",
    default_events=STARTS,  # points of the prior from which sets are sought
    step=STARTS,
    cells=first_cells,
    later=(
        *(partial(later_cells, generation) for generation in range(WHOLE.generations)),
        *(partial(cloud_cells, cloud) for cloud in range(WHOLE.clouds)),
    ),
    judge=ensemble_statements,
    claims=CLAIMS,
    whole=True,
)
