"""One small comparison that the figures are drawn from."""

import pytest

from paper_figs.source import Source
from studies.comparison.grid import Grid
from studies.core.runner import run_cells
from studies.core.store import Store
from studies.scenario.loading import load_scenario

RULES = ("alone", "greedy", "exact")


@pytest.fixture(scope="session")
def source(tmp_path_factory) -> Source:
    """Two short events under three rules and two controllers, two seeds."""
    scenarios = tuple(
        load_scenario(name).changed(duration_s=3.0) for name in ("wet-start", "very-low-adhesion")
    )
    grid = Grid(scenarios, RULES, ("none", "cut-and-ramp"), (0, 1))
    store = Store(tmp_path_factory.mktemp("results"))
    return Source(store, run_cells(grid.jobs(), store))
