"""What all figures share: a style file, two widths, and what a figure is made of."""

from collections.abc import Callable
from typing import Any, NamedTuple

from matplotlib.figure import Figure

from studies.runner.study import NARROW, WIDE

__all__ = ["LARGE", "NARROW", "WIDE", "Drawing"]

LARGE: dict[Any, float] = {
    f"{part}size": 8.5
    for part in ("font.", "xtick.label", "ytick.label", "axes.label", "axes.title", "legend.font")
}
"""Type of a figure of full width that is read on a telephone too."""


class Drawing(NamedTuple):
    """A figure that can be asked for by its name."""

    draw: Callable[..., Figure]
    """Called with the rows of `study` if one is named, else with nothing."""
    caption: str
    """What is seen, in a sentence."""
    study: str = ""
    """Study whose rows it shows."""
    source: str = ""
    """Document whose figure it is: jp5484215, jp4209318, rtri, readhesion_paper, jph07322414."""
