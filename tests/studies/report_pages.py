"""A small page for tests: two events, three rules, two controllers, made without the command."""

from dataclasses import dataclass
from pathlib import Path

import pytest

from studies.comparison.summary import Grid, make_grid
from studies.core.store import Store
from studies.report.page import Material, gather
from studies.report.replay import Packed, unpack
from studies.scenario.scenario import Scenario

RULES = ("alone", "exact", "oracle")
CONTROLLERS = ("none", "cut-and-ramp")
SEEDS = 3


@dataclass(frozen=True)
class Made:
    """What a page was made of, and where."""

    grid: Grid
    results: Path
    material: Material

    @property
    def rows(self):
        """The stored rows of the comparison."""
        return Store(self.results).read()


def make(scenario: Scenario, results: Path) -> Made:
    """Gather what a page of `scenario`, of which 3 s are run, and of a shorter one needs; in 1.5 s nothing has settled."""
    milder = scenario.changed(
        name="milder", title="a <!-- <script> or </script> of <b>two</b> & more", duration_s=1.5
    )
    grid = make_grid([scenario.changed(duration_s=3.0), milder], RULES, CONTROLLERS, SEEDS)
    return Made(grid, results, gather(grid, results, "readhesion report --scenario short.toml"))


def unpacked(replay):
    """The series of a replay, and the step of each."""
    columns = {name: count for name, count, _ in replay.run["series"]}
    steps = {name: step for name, _, step in replay.run["series"]}
    return unpack(Packed(replay.run["text"], columns, steps, replay.run["instants"])), steps


def need_packages() -> None:
    """Skip a module where what a page is made with is not installed."""
    for package in ("jinja2", "plotly"):
        pytest.importorskip(package, reason=f"{package}: pip install -e '.[report]'")
