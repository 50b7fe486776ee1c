"""Readhesion and adhesion used over mu_lim and a_w: readhesion paper Figs. 19, 20 and 21."""

import pandas as pd
from matplotlib.figure import Figure

from paper_figs.source import Source
from paper_figs.sweep_panels import draw_sweep, table_of


def figure(source: Source) -> Figure:
    """The figure, from the sweep `readhesion`."""
    return draw(table_of(source))


def draw(table: pd.DataFrame) -> Figure:
    """Three panels; filled points: readhesion is possible."""
    return draw_sweep(table, "width")
