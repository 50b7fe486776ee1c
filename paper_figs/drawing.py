"""Figures into files: what the entry point `gallery` offers to the commands, see `studies.core.gallery.Gallery`."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import matplotlib as mpl
import pandas as pd
import xarray as xr

from paper_figs.origin import Origin, of_job
from paper_figs.registry import FIGURES, FigureEntry, figure
from paper_figs.saving import MOVING, data_of, save_figure, save_image
from paper_figs.source import Source
from paper_figs.style import STYLE_FILE
from studies.core.cell import OnRow
from studies.core.gallery import Asked, Saved
from studies.core.job import Job
from studies.core.store import Store
from studies.files.study_error import StudyError
from studies.report.replay import drawing


def descriptions() -> dict[str, str]:
    """Every figure by name, and what it shows."""
    return {name: entry.description for name, entry in FIGURES.items()}


def draw_figures(
    names: Sequence[str],
    out: str | Path,
    results: str | Path,
    jobs: int = 1,
    on_row: OnRow | None = None,
) -> list[Saved]:
    """Draw figures by name, or all without names, into `out`, each with its caption and its data.

    What `results` lacks is run first, in `jobs` processes. Raises `StudyError` for a name that does not exist.
    """
    chosen = [FIGURES.find(name) for name in names or FIGURES]
    source = Source.of_folder(results, jobs, on_row)
    return [_saved(entry, source, Path(out)) for entry in chosen]


def draw_comparison(
    table: pd.DataFrame, store: Store, out: str | Path, asked: Asked | None = None
) -> list[str]:
    """Draw the figures of a comparison from its `table` into `out`; returns their names (none if every row failed).

    `asked`: how the table was asked for, where this is known.
    """
    source = Source(store, table, asked=asked)
    if source.table.empty:
        return []
    chosen = {name: entry for name, entry in FIGURES.items() if entry.of_comparison}
    for entry in chosen.values():
        _saved(entry, source, Path(out))
    return list(chosen)


def _saved(entry: FigureEntry[Any], source: Source, out: Path) -> Saved:
    drawn, legend = entry.drawn(source)
    return Saved(entry.name, tuple(save_figure(drawn, out / entry.name, legend)), legend.draft)


def draw_one(
    name: str, path: str | Path, *data: Any, origins: Sequence[Origin] = (), command: str = ""
) -> None:
    """Draw a figure from `data` into one file; its ending (pdf, png, svg) gives the format.

    `origins`: of the data; or the `command` that gives all of them, where no seed is in it.
    The ending gif is for a figure that moves. Nothing is written beside it: a log that is drawn may well be NAME.csv itself.
    """
    given = [Origin(command, "as given", ())] if command else origins
    drawn, legend = FIGURES[name].of_data(data, given)
    try:
        with mpl.rc_context(fname=STYLE_FILE):
            save_image(drawn, Path(path), legend, data_of(drawn))
    except ValueError as error:
        raise StudyError(f"figure {str(path)!r}: {error}") from None


def draw_run(run: xr.Dataset, path: str | Path, job: Job | None = None, command: str = "") -> None:
    """Draw a recorded run over time as `draw_one` does; of a train without motors, what its slide protection does.

    As GIF it moves, for which `job` has to say of what event it is; `command` made it.
    """
    origins = [] if job is None else [of_job(job, command)]
    if Path(path).suffix.lower() != MOVING:
        name = "slip-event" if run.sizes["unit"] else "slide-control"
        return draw_one(name, path, run, origins=origins)
    if job is None or not run.sizes["unit"]:
        lacks = "its train has no motor" if job else "it is not known of what event it is"
        raise StudyError(
            f"figure {str(path)!r}: {lacks}, so this run is not shown as {MOVING}; take .png"
        )
    train = drawing(job.scenario.event(job.seed).model)
    return draw_one("slip-replay", path, train, run, origins=origins)


__all__ = [
    "descriptions",
    "draw_comparison",
    "draw_figures",
    "draw_one",
    "draw_run",
    "figure",
    "save_figure",
]
