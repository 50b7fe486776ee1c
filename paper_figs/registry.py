"""Figures by name: each registers where it is written, with a sentence and the data that it needs."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any, Generic, ParamSpec

import matplotlib as mpl
from matplotlib.figure import Figure

from alloc.display import displayed
from alloc.registry import Registry
from paper_figs.source import Need, Source, comparison
from paper_figs.style import STYLE_FILE
from studies.files.study_error import StudyError

Data = ParamSpec("Data")


@displayed
@dataclass(frozen=True)
class FigureEntry(Generic[Data]):
    """A figure; called with its data, it is drawn in the project's style."""

    function: Callable[Data, Figure]
    description: str
    """What it shows, in one line."""
    needs: tuple[Need, ...]
    """Each gives one argument of the function."""

    def __call__(self, *data: Data.args, **named: Data.kwargs) -> Figure:
        """The figure of these data."""
        with mpl.rc_context(fname=STYLE_FILE):
            return self.function(*data, **named)

    @property
    def of_comparison(self) -> bool:
        """Whether it shows the rows of a comparison, and is drawn with one."""
        return comparison in self.needs

    def make(self, source: Source) -> Figure:
        """The figure of what `source` has."""
        return self(*(need(source) for need in self.needs))  # type: ignore[call-arg]


FIGURES: Registry[FigureEntry[Any]] = Registry(
    "figure", "readhesion.figures", StudyError, package="paper_figs"
)
"""Every figure by name."""


def figure(
    name: str, description: str, *needs: Need
) -> Callable[[Callable[Data, Figure]], FigureEntry[Data]]:
    """Register a function as the figure `name`; it takes what each of `needs` gives."""

    def register(function: Callable[Data, Figure]) -> FigureEntry[Data]:
        entry = FigureEntry(function, description, needs)
        FIGURES.register(name, entry, origin=function.__module__)
        return entry

    return register
