"""Figures as the commands know them: what draws stands above this package and comes in by an entry point."""

from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import entry_points
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol, cast

from studies.files.study_error import StudyError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from studies.core.store import Store

GROUP = "readhesion.figures"
"""Entry points: `gallery` is a `Gallery`; any other is a module that registers figures of its own."""


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
        on_row: Callable[[str, int, int], None] | None = None,
    ) -> list[Path]:
        """Draw figures by name from `results`, in which what is missing is run first; returns the files."""

    def draw_comparison(self, table: "pd.DataFrame", store: "Store", out: str | Path) -> list[str]:
        """Draw the figures of a comparison; returns their names."""

    def draw_one(self, name: str, path: str | Path, *data: Any) -> None:
        """Draw a figure from data that the caller has."""

    def draw_run(self, run: "xr.Dataset", path: str | Path) -> None:
        """Draw a recorded run over time."""


def gallery() -> Gallery:
    """What is installed to draw figures; raises `StudyError` if nothing is."""
    found = entry_points(group=GROUP, name="gallery")
    if not found:
        raise StudyError("nothing is installed that draws figures; run `make setup`")
    return cast(Gallery, next(iter(found)).load())
