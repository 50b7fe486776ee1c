"""Figures as the commands know them: what draws stands above this package and comes in by an entry point."""

from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from studies.files.study_error import StudyError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from studies.core.cell import OnRow
    from studies.core.store import Store

GROUP = "readhesion.gallery"
"""Entry points of what draws; figures of further packages stand in the group `readhesion.figures`."""


class Gallery(Protocol):
    """What draws figures."""

    def figure(self, name: str, description: str, *needs: Any) -> Callable[[Any], Any]:
        """Decorator that registers a figure; it is called with what each of `needs` gives of a folder of results."""

    def descriptions(self) -> Mapping[str, str]:
        """Every figure by name, and what it shows."""

    def draw_figures(
        self,
        names: Sequence[str],
        out: str | Path,
        results: str | Path,
        jobs: int = 1,
        on_row: "OnRow | None" = None,
    ) -> list[Path]:
        """Draw figures by name [default: all] from `results`, in which what is missing is run first; returns the files."""

    def draw_comparison(self, table: "pd.DataFrame", store: "Store", out: str | Path) -> list[str]:
        """Draw the figures of a comparison; returns their names."""

    def draw_one(self, name: str, path: str | Path, *data: Any) -> None:
        """Draw a figure from data that the caller has."""

    def draw_run(self, run: "xr.Dataset", path: str | Path) -> None:
        """Draw a recorded run over time."""


def gallery() -> Gallery:
    """What is installed to draw figures; raises `StudyError` if nothing is."""
    for found in entry_points(group=GROUP):
        return cast(Gallery, found.load())
    raise StudyError("nothing is installed that draws figures; run `make setup`")
