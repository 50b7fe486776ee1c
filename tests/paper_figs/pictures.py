"""Figures that need no run, of made-up tables, against stored pictures: marks, lines and colours, without letters.

Letters are left out because they differ between versions of FreeType; other tests read the text. Tables are made up, so a
picture changes where the drawing changes and not where a run does. `python -m pytest tests/paper_figs/test_every_figure.py
--mpl-generate-path tests/paper_figs/pictures` stores them anew: look at each before you keep it.
"""

import io

import matplotlib as mpl
import numpy as np
import pandas as pd
from matplotlib.figure import Figure
from matplotlib.text import Text

from paper_figs.drawing import FIGURES
from paper_figs.style import STYLE_FILE
from tests.studies.blended_tables import blended_table
from tests.studies.brake_tables import brake_table
from tests.studies.comparison_tables import comparison_table
from tests.studies.headroom_tables import headroom_table
from tests.studies.ladder_tables import curve_table, ladder_table
from tests.studies.learning_tables import falling, synthetic
from tests.studies.mismatch_tables import mismatch_table
from tests.studies.readhesion_tables import sweep_table
from tests.studies.sander_tables import sander_table
from tests.studies.slide_tables import slide_table
from tests.studies.sweep_tables import claim_table, difference_table

DPI = 50


def learning_table() -> pd.DataFrame:
    """Errors that fall from station to station, of two trains."""
    return synthetic(falling, trains=2)


TABLES = {
    "allocation-bars": (), "rule-comparison": (comparison_table,),
    "ladder": (ladder_table,), "curves": (curve_table,), "headroom": (headroom_table,), "mismatch": (mismatch_table,),
    "differences": (difference_table,), "brake-cut-out": (brake_table,), "learning": (learning_table,),
    **dict.fromkeys(("claim-verdicts", "claim-verdicts-search"), (lambda: claim_table(60),)),
    "adhesion-curve": (), "open-rails": (),
    **dict.fromkeys(("slide-pareto", "slide-electric"), (slide_table,)),
    **dict.fromkeys(("margin-sweep", "width-sweep"), (sweep_table,)),
    "blended": (blended_table,), "sanders": (sander_table,),
}  # fmt: skip
"""Figures that have a picture, and what makes their tables."""


def from_tables(name: str) -> Figure:
    """A figure of its made-up tables."""
    return FIGURES[name](*(make() for make in TABLES[name]))


def without_letters(drawn: Figure) -> Figure:
    """The same figure, whose text is no longer seen."""
    for text in drawn.findobj(Text):
        text.set_visible(False)
    return drawn


def pixels(drawn: Figure) -> np.ndarray:
    """The figure as it would be stored, (height, width, 3)."""
    file = io.BytesIO()
    with mpl.rc_context(fname=STYLE_FILE):
        without_letters(drawn).savefig(file, dpi=DPI)
    file.seek(0)
    return (255 * mpl.image.imread(file)[..., :3]).astype(np.uint8)
