"""Figures as the commands know them: what draws stands above this package and comes in by an entry point."""

import hashlib
import os
import warnings
from collections.abc import Callable, Mapping, Sequence
from importlib.metadata import EntryPoint, version
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple, Protocol, cast

from alloc.registry import offered
from alloc.sources import code_hash, write_whole
from studies.core.plugins import plugin_modules
from studies.files.study_error import FileWarning, StudyError

if TYPE_CHECKING:
    import pandas as pd
    import xarray as xr

    from studies.core.cell import OnRow
    from studies.core.job import Job
    from studies.core.store import Store

GROUP, FURTHER = "readhesion.gallery", "readhesion.figures"
"""Entry points of what draws, and of further packages' figures."""
MARK = ".drawn"
"""File beside the figures of a comparison: which rows they show, by which code, and their names."""


class Saved(NamedTuple):
    """A figure as it was written."""

    name: str
    files: tuple[Path, ...]
    """PDF, PNG, caption and data."""
    draft: str
    """What it lacks and which command gives it; empty where it shows all."""
    seconds: float = 0.0
    """How long it took, with what was run for it."""


class Asked(NamedTuple):
    """How rows of a comparison were asked for."""

    command: str
    """What gives them, without the number of seeds."""
    whole: bool
    """Whether it gives no more seeds than there are."""


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
    ) -> list[Saved]:
        """Draw figures by name [default: all] from `results`, in which what is missing is run first."""

    def draw_comparison(
        self,
        table: "pd.DataFrame",
        store: "Store",
        out: str | Path,
        asked: Asked | None = None,
    ) -> list[str]:
        """Draw the figures of a comparison; returns their names."""

    def draw_one(self, name: str, path: str | Path, *data: Any, command: str = "") -> None:
        """Draw a figure from data that the caller has, made by `command`."""

    def draw_run(
        self, run: "xr.Dataset", path: str | Path, job: "Job | None" = None, command: str = ""
    ) -> None:
        """Draw a recorded run over time, that of `job` and made by `command` where these are known."""


def gallery() -> Gallery:
    """What is installed to draw figures; raises `StudyError` if nothing is."""
    return cast(Gallery, _entry().load())


def draw_comparison(
    table: "pd.DataFrame", store: "Store", out: Path, asked: Asked | None = None
) -> list[str]:
    """Draw the figures of a comparison into `out`; returns their names.

    Those of the same rows, by the same code and asked for in the same words, are left as they are.
    """
    mark = out / MARK
    parts = [
        _entry().module,
        *(entry.module for entry in offered(FURTHER)),
        *plugin_modules(),
    ]
    rows = " ".join(table["cell"] + table["status"])
    digest = hashlib.sha256(
        f"{code_hash(*parts)} {version('matplotlib')} {asked} {rows}".encode()
    ).hexdigest()
    of, *names = mark.read_text().split() if mark.exists() else [""]
    if of != digest or not all((out / f"{name}.pdf").exists() for name in names):
        if not os.access(out if out.exists() else out.parent, os.W_OK):
            warnings.warn(
                f"no figures: folder {str(out)!r} cannot be written", FileWarning, stacklevel=2
            )
            return []
        names = gallery().draw_comparison(table, store, out, asked)
        if names:
            write_whole(mark, lambda path: path.write_text(" ".join([digest, *names])))
    return names


def _entry() -> EntryPoint:
    for found in offered(GROUP):
        return found
    raise StudyError("nothing is installed that draws figures; run `make setup`")
