"""Figures by name: each registers in the file that defines it, with a sentence and the data that it needs."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from inspect import getdoc
from typing import Any, Generic, NamedTuple, ParamSpec

import matplotlib as mpl
from matplotlib.figure import Figure

from alloc.display import displayed
from alloc.registry import Registry
from paper_figs.counts import remarks
from paper_figs.marks import add_strip, mark_as_draft, say_where_nothing_is_drawn
from paper_figs.origin import Origin
from paper_figs.saving import Legend
from paper_figs.source import Need, Source, comparison
from paper_figs.style import STYLE_FILE
from studies.core.own_parts import called, is_own
from studies.files.study_error import StudyError

Data = ParamSpec("Data")


class Drawn(NamedTuple):
    """A figure and its caption."""

    figure: Figure
    legend: Legend


@displayed
@dataclass(frozen=True)
class FigureEntry(Generic[Data]):
    """A figure; called with its data, it is drawn in the project's style."""

    name: str
    function: Callable[Data, Figure]
    description: str
    """What it shows, in one line."""
    needs: tuple[Need, ...]
    """Data, each of which gives one argument of the function."""
    events: str = "events"
    """What its means are over, in the plural."""

    def __call__(self, *data: Data.args, **named: Data.kwargs) -> Figure:
        """The figure of these data."""
        with mpl.rc_context(fname=STYLE_FILE):
            drawn = self.function(*data, **named)
            if not isinstance(drawn, Figure):
                kind = type(drawn).__name__
                raise StudyError(
                    f"figure {self.name!r} returns a {kind}; return the figure that new_panels gives"
                )
            say_where_nothing_is_drawn(drawn)
            if said := remarks(drawn, self.events):
                add_strip(drawn, said)
            return drawn

    @property
    def of_comparison(self) -> bool:
        """Whether it shows the rows of a comparison, and is drawn together with one."""
        return comparison in self.needs

    @property
    def legend(self) -> Legend:
        """Caption without the source of the data: the figure's line and its function's docstring."""
        return Legend(self.name, self.description, " ".join((getdoc(self.function) or "").split()))

    def make(self, source: Source) -> Figure:
        """The figure of the data in `source`, marked as a draft where these are incomplete."""
        return self.drawn(source).figure

    def drawn(self, source: Source) -> Drawn:
        """The same with its caption."""
        source.origins.clear()
        data = [need(source) for need in self.needs]
        return self.of_data(data, source.origins)

    def of_data(self, data: Sequence[Any], origins: Sequence[Origin] = ()) -> Drawn:
        """The figure of these data, with its caption."""
        if is_own(FIGURES, self.name):
            drawn = called(FIGURES, self.name, lambda: self(*data))  # type: ignore[call-arg]
        else:
            drawn = self(*data)  # type: ignore[call-arg]
        caption = f"{self.legend.caption} {remarks(drawn, self.events)}".strip()
        legend = replace(self.legend, caption=caption, origins=tuple(origins))
        if legend.draft:
            with mpl.rc_context(fname=STYLE_FILE):
                mark_as_draft(drawn, legend.draft)
        return Drawn(drawn, legend)


FIGURES: Registry[FigureEntry[Any]] = Registry(
    "figure", "readhesion.figures", StudyError, package="paper_figs"
)
"""Every figure by name."""


def figure(
    name: str, description: str, *needs: Need, events: str = "events"
) -> Callable[[Callable[Data, Figure]], FigureEntry[Data]]:
    """Register a function as the figure `name`; it takes what each of `needs` gives. `events`: what means are over.

    Raises `StudyError` for a need that is no function, such as a name of data.
    """
    for need in needs:
        if not callable(need):
            raise StudyError(
                f"figure {name!r} needs {need!r}, which gives no data; give comparison, study(...) or recorded(...) of "
                "paper_figs.source"
            )

    def register(function: Callable[Data, Figure]) -> FigureEntry[Data]:
        entry = FigureEntry(name, function, description, needs, events)
        FIGURES.register(name, entry, origin=function.__module__)
        return entry

    return register
