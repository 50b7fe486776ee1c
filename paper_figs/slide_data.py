"""The table of the sweep `slide-protection`, as two figures draw it."""

import pandas as pd

from paper_figs.source import Source
from studies.core.collection import sweep_folder
from studies.slides import study as slide_protection

HERE, PRINTED = "#0072b2", "#7f7f7f"
"""Colours of this project's numbers and of the source's."""


def slide_table(source: Source) -> pd.DataFrame:
    """What the results hold of the sweep, or the sweep itself."""
    folder = sweep_folder(source.store.folder, "slide-protection")
    table = slide_protection.stored(folder)
    if table is None:
        events = slide_protection.DEFAULT_EVENTS
        table = slide_protection.run(folder, events, 0, source.jobs, source.on_row)
    return table
