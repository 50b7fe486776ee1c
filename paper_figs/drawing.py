"""Figures into files: what the entry point `gallery` offers to the commands, see `studies.core.gallery.Gallery`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure

from alloc.whole_file import write_whole
from paper_figs.registry import FIGURES, figure
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE
from studies.core.cell import OnRow
from studies.core.store import Store
from studies.files.study_error import StudyError


def descriptions() -> dict[str, str]:
    """Every figure by name, and what it shows."""
    return {name: entry.description for name, entry in FIGURES.items()}


def draw_figures(
    names: Sequence[str],
    out: str | Path,
    results: str | Path,
    jobs: int = 1,
    on_row: OnRow | None = None,
) -> list[Path]:
    """Draw figures by name, or all without names, into `out` as PDF and PNG; returns the files.

    What `results` lacks is run first, in `jobs` processes. Raises `StudyError` for a name that does not exist.
    """
    chosen = {name: FIGURES.find(name) for name in names or FIGURES}
    source = Source.of_folder(results, jobs, on_row)
    return [
        path
        for name, entry in chosen.items()
        for path in save_figure(entry.make(source), Path(out) / name)
    ]


def draw_comparison(table: pd.DataFrame, store: Store, out: str | Path) -> list[str]:
    """Draw the figures of a comparison from its `table` into `out`; returns their names (none if every row failed)."""
    source = Source(store, table)
    if source.table.empty:
        return []
    chosen = {name: entry for name, entry in FIGURES.items() if entry.of_comparison}
    for name, entry in chosen.items():
        save_figure(entry.make(source), Path(out) / name)
    return list(chosen)


def draw_one(name: str, path: str | Path, *data: Any) -> None:
    """Draw a figure from `data` into a file; its ending (pdf, png, svg) gives the format."""
    drawn = FIGURES[name](*data)
    try:
        with mpl.rc_context(fname=STYLE_FILE):
            write_whole(Path(path), drawn.savefig)
    except ValueError as error:
        raise StudyError(f"figure {str(path)!r}: {error}") from None


def draw_run(run: xr.Dataset, path: str | Path) -> None:
    """Draw a recorded run over time as `draw_one` does; of a train without motors, what its slide protection does."""
    draw_one("slip-event" if run.sizes["unit"] else "slide-control", path, run)


def save_figure(drawn: Figure, path: Path) -> list[Path]:
    """Write a figure as `path`.pdf and `path`.png, without the date so that equal figures are equal files."""
    files = [path.with_name(path.name + ending) for ending in (".pdf", ".png")]
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with mpl.rc_context(fname=STYLE_FILE):
            drawn.draw_without_rendering()
            drawn.set_layout_engine("none")  # laid out once: both files are the same to the point
            write_whole(files[0], lambda path: drawn.savefig(path, metadata={"CreationDate": None}))
            write_whole(files[1], drawn.savefig)
    except OSError as error:
        raise StudyError(
            f"figure folder {str(path.parent)!r} cannot be written: {error.strerror}; choose another with --out"
        ) from None
    return files


__all__ = [
    "descriptions",
    "draw_comparison",
    "draw_figures",
    "draw_one",
    "draw_run",
    "figure",
    "save_figure",
]
