"""The calibration of what the readhesion paper does not print."""

from functools import partial

from studies.core.study import Study
from studies.readhesion_paper.calibration import (
    DEFAULT_SAMPLES,
    NEARNESS,
    first_cells,
    near_cells,
    refining_cells,
)
from studies.readhesion_paper.calibration_statements import calibration_statements

CALIBRATION = Study(
    name="calibration",
    question="what the readhesion paper does not print, calibrated on what it does, and how narrowly",
    default_events=DEFAULT_SAMPLES,  # sets drawn
    step=DEFAULT_SAMPLES,  # a Latin hypercube of more sets has none of these
    cells=first_cells,
    later=(*(partial(near_cells, k) for k in range(len(NEARNESS))), refining_cells),
    finish=lambda table, seed, samples: table.assign(seed=seed, samples=samples),
    judge=calibration_statements,
    whole=True,
)
