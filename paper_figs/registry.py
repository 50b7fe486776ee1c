"""Figures by name: each registers where it is written, with a sentence and the data that it needs."""

from collections.abc import Callable
from functools import wraps
from importlib import import_module
from importlib.metadata import entry_points
from pathlib import Path
from pkgutil import iter_modules
from typing import NamedTuple, ParamSpec

import matplotlib as mpl
from matplotlib.figure import Figure

from paper_figs.source import Need, Source, comparison
from paper_figs.style import STYLE_FILE
from studies.core.gallery import GROUP

Data = ParamSpec("Data")


class FigureEntry(NamedTuple):
    """A figure: what draws it in the project's style, what it shows, and the data that it is drawn from."""

    draw: Callable[..., Figure]
    description: str
    needs: tuple[Need, ...]

    @property
    def of_comparison(self) -> bool:
        """Whether it shows the rows of a comparison, and is drawn with one."""
        return comparison in self.needs

    def make(self, source: Source) -> Figure:
        """The figure, from the data of `source`."""
        return self.draw(*(need(source) for need in self.needs))


FIGURES: dict[str, FigureEntry] = {}
"""Figures registered so far; `all_figures` has all."""


def figure(
    name: str, description: str, *needs: Need
) -> Callable[[Callable[Data, Figure]], Callable[Data, Figure]]:
    """Register a function as the figure `name`; it is called with what each of `needs` gives, in the project's style.

    Raises `ValueError` if another module has a figure of that name.
    """

    def register(function: Callable[Data, Figure]) -> Callable[Data, Figure]:
        @wraps(function)
        def draw(*data: Data.args, **named: Data.kwargs) -> Figure:
            with mpl.rc_context(fname=STYLE_FILE):
                return function(*data, **named)

        known = FIGURES.get(name)
        if known is not None and known.draw.__module__ != draw.__module__:
            raise ValueError(f"figure {name!r} stands in {known.draw.__module__} already")
        FIGURES[name] = FigureEntry(draw, description, needs)
        return draw

    return register


def all_figures() -> dict[str, FigureEntry]:
    """Every figure by name: of this package's modules, of those named as entry points, and of plug-ins."""
    for module in iter_modules([str(Path(__file__).parent)]):
        import_module(f"paper_figs.{module.name}")
    for point in entry_points(group=GROUP):
        point.load()
    return FIGURES
