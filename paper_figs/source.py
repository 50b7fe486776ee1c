"""Where figures get their data: a folder of results, in which what is missing is run first."""

from collections.abc import Callable
from functools import cached_property
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from alloc.recording import load
from paper_figs.origin import Origin, of_comparison, of_job, of_study
from studies.comparison.defaults import KEPT_RUNS, default_grid
from studies.core.cell import OnRow, key_of
from studies.core.collection import find_study, study_folder
from studies.core.gallery import Asked
from studies.core.job import Job, simulate_job
from studies.core.runner import run_cells
from studies.core.store import Store
from studies.scenario.loading import load_scenario


class Source:
    """Data of a comparison, of its recorded runs and of studies; computed only when a figure asks."""

    def __init__(
        self,
        store: Store,
        table: pd.DataFrame | None = None,
        jobs: int = 1,
        on_row: OnRow | None = None,
        asked: Asked | None = None,
    ) -> None:
        self.store = store
        self.asked = asked
        """How the table of the comparison was asked for, where this is known."""
        self.jobs = jobs
        self.on_row = on_row
        self._table = table
        self.origins: list[Origin] = []
        """Of the data that were given since it was emptied."""

    @classmethod
    def of_folder(cls, folder: str | Path, jobs: int = 1, on_row: OnRow | None = None) -> "Source":
        """Data of the default comparison, kept in `folder`."""
        return cls(Store(folder), None, jobs, on_row)

    @cached_property
    def table(self) -> pd.DataFrame:
        """Rows of the comparison that succeeded."""
        table = self._table
        if table is None:
            cells = default_grid().jobs()
            table = run_cells(cells, self.store, self.jobs, KEPT_RUNS, on_row=self.on_row)
        return table[table["status"] == "ok"]

    def run(self, scenario: str, rule: str, controller: str, seed: int = 0) -> xr.Dataset:
        """A recorded run of a shipped scenario, from its file or anew."""
        job = Job(load_scenario(scenario), rule, controller, seed)
        self.origins.append(of_job(job))
        path = self.store.run_path(key_of(job))
        return simulate_job(job) if path is None else load(path)

    def study(
        self, name: str, least: int | None, instead: Callable[[], pd.DataFrame] | None = None
    ) -> pd.DataFrame:
        """Table of a study: of the events that the results hold, `least` or more [default: the study's own number].

        Where they hold none, `instead` gives the table if there is one.
        """
        study, folder = find_study(name), study_folder(self.store.folder, name)
        held = study.held(folder)
        if not held and instead is not None:
            self.origins.append(of_study(study, None))
            return instead()
        events = max(held, study.default_events if least is None else least)
        self.origins.append(of_study(study, events))
        return study.run(folder, events, 0, self.jobs, self.on_row)


Need = Callable[[Source], Any]
"""What a figure needs, stated where it registers: gives its data."""


def comparison(source: Source) -> pd.DataFrame:
    """Need: the rows of the comparison."""
    if not source.table.empty:
        source.origins.append(of_comparison(source.table, source.asked))
    return source.table


def recorded(scenario: str, rule: str, controller: str) -> Need:
    """Need: a recorded run of a shipped scenario."""
    return lambda source: source.run(scenario, rule, controller)


def study(
    name: str, least: int | None = None, instead: Callable[[], pd.DataFrame] | None = None
) -> Need:
    """Need: a study's table, see `Source.study`."""
    return lambda source: source.study(name, least, instead)


def made(make: Callable[..., Any], *arguments: Any) -> Need:
    """Need: data that are made on the spot, without the results."""
    return lambda source: make(*arguments)
