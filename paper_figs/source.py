"""Where figures get their data: a comparison's folder, in which what is missing is run first."""

from collections.abc import Callable
from functools import cached_property
from pathlib import Path

import pandas as pd
import xarray as xr

from alloc.recording import load
from studies.comparison.defaults import KEPT_RUNS, default_grid
from studies.core.cell import key_of
from studies.core.job import Job, simulate_job
from studies.core.runner import run_cells
from studies.core.store import Store
from studies.scenario.loading import load_scenario

OnRow = Callable[[str, int, int], None]


class Source:
    """Data of a comparison: `table` of its rows, recorded `run`s. Both are computed only when a figure asks."""

    def __init__(
        self,
        store: Store,
        table: pd.DataFrame | None = None,
        jobs: int = 1,
        on_row: OnRow | None = None,
    ) -> None:
        self.store = store
        self.jobs = jobs
        self.on_row = on_row
        self._table = table

    @classmethod
    def of_folder(cls, folder: str | Path, jobs: int = 1, on_row: OnRow | None = None) -> "Source":
        """Data of the default comparison, kept in `folder`."""
        return cls(Store(folder), None, jobs, on_row)

    @cached_property
    def table(self) -> pd.DataFrame:
        """Rows of the comparison that succeeded."""
        table = self._table
        if table is None:
            table = run_cells(
                default_grid().jobs(), self.store, self.jobs, KEPT_RUNS, on_row=self.on_row
            )
        return table[table["status"] == "ok"]

    def run(self, scenario: str, rule: str, controller: str, seed: int = 0) -> xr.Dataset:
        """A recorded run of a shipped scenario, from its file or anew."""
        job = Job(load_scenario(scenario), rule, controller, seed)
        path = self.store.run_path(key_of(job))
        if path.exists():
            return load(path)
        return simulate_job(job)
