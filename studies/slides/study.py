"""The demonstration of JP4209318: its Tables 3 and 4, what lies between their settings, and how far the numbers carry."""

from studies.core.study import Study
from studies.slides.calibration import JITTER_DRAWS
from studies.slides.runs import run_cells
from studies.slides.statements import slide_statements

SLIDE_PROTECTION = Study(
    name="slide-protection",
    question="slide protection of JP4209318: distance, wheel damage and air by train and sensitivity",
    default_events=JITTER_DRAWS,  # of noise on the calibrated parameters; nothing else is random
    cells=run_cells,
    finish=lambda table, seed, draws: table.assign(draws=draws, seed=seed),
    judge=slide_statements,
    whole=True,
)
