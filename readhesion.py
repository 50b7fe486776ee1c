"""How a multi-car train should share adhesion when its wheels slip: what a program needs, under one name.

    import readhesion

    run = readhesion.simulate("wet-patch", "cooperative", "perturb-observe")  # an xarray.Dataset
    print(readhesion.evaluate(run)["bound_use"])
    table = readhesion.compare("wet-patch", rules=["alone", "cooperative"])  # a pandas.DataFrame
    readhesion.plot(run, "event.png")

The rest is in the packages: plant, rules and controllers in `alloc`, the MPC in `mpc`, studies in `studies`, figures in
`paper_figs`. `python -m readhesion` is the command of the same name.
"""

if __name__ == "__main__":  # listens to signals before it imports what follows
    from studies.command_line.__main__ import main

    main()

import tempfile
from collections.abc import Iterable, Sequence
from functools import partial
from pathlib import Path
from typing import Any

import pandas as pd
import xarray as xr

from alloc import simulation
from alloc.errors import InputError
from alloc.event import DriverCommand, Event
from alloc.metrics import METRICS, Metric, evaluate, metric
from alloc.onboard.host import CONTROLLERS, HostedController, each_unit
from alloc.recording import load, save
from alloc.rules import RULES, Allocation, AllocationProblem, Caps, Rule, Trigger, optimality
from alloc.rules.testing import check_rule
from alloc.testing import check_controller, check_curve
from studies.comparison.summary import make_grid
from studies.core.own_parts import try_parts
from studies.core.run import run_cells
from studies.core.store import Store
from studies.core.study import find_study, study_folder
from studies.files.study_error import StudyError
from studies.scenario.scenario import Scenario, default_scenarios, load_scenario

__all__ = [
    "CONTROLLERS", "METRICS", "RULES", "Allocation", "AllocationProblem", "Caps", "DriverCommand", "Event",
    "HostedController", "InputError", "Metric", "Rule", "Scenario", "Trigger", "check_controller", "check_curve",
    "check_rule", "compare", "each_unit", "evaluate", "load", "load_scenario", "metric", "optimality", "plot", "save",
    "simulate", "sweep",
]  # fmt: skip

INTERNAL = ("cell", "code_hash", "scenario_hash", "messages")
"""Columns by which a store knows its rows."""
FIRST = ("scenario", "rule", "controller", "seed", "status", "reason")
"""Columns that a table of runs begins with."""

Named = str | Path | Scenario


def simulate(
    event: Named | Event,
    rule: str | Rule = "greedy",
    controller: str | HostedController = "cut-and-ramp",
    seed: int = 0,
    **options: Any,
) -> xr.Dataset:
    """Run one slip event under a rule and a readhesion controller; returns the recorded run, see `alloc.recording`.

    `event`: the name of a scenario, the path of its file, a `Scenario`, or an `Event`, which has its draws already. `seed`
    determines all that a scenario draws. `options` are those of `alloc.simulation.simulate`. Raises `InputError` for what
    cannot be simulated.
    """
    if isinstance(event, str | Path):
        event = load_scenario(event)
    if isinstance(event, Scenario):
        event = event.event(seed)
    elif seed:
        raise StudyError(
            f"seed = {seed}: an event has its draws already; give the scenario that it is of"
        )
    return simulation.simulate(event, rule, controller, **options)


def compare(
    scenarios: Named | Sequence[Named] | None = None,
    rules: str | Sequence[str] | None = None,
    controllers: str | Sequence[str] | None = None,
    seeds: int | None = None,
    out: str | Path | None = None,
    jobs: int = 1,
    keep: Sequence[str] = (),
) -> pd.DataFrame:
    """Run rules and controllers over the same slip events: one row per run, with every metric.

    What is left out is as in `readhesion compare`. `out`: a folder that keeps rows as they are computed; the same call goes
    on where it stopped. `jobs`: number of processes. `keep`: runs to record in `out`, as patterns of
    scenario/rule/controller/seed. Raises `InputError` for a part that does not exist or does not work; a run that fails is a
    row with its `status` and `reason`.
    """
    chosen = [
        one if isinstance(one, Scenario) else load_scenario(one)
        for one in _several(scenarios) or default_scenarios()
    ]
    for part, names in (("rule", _several(rules)), ("controller", _several(controllers))):
        for one in names or ():
            if not isinstance(one, str):
                raise StudyError(
                    f"{part} = {one!r:.80} must be a name: register it in {part.upper()}S first"
                )
    grid = make_grid(chosen, _several(rules), _several(controllers), seeds)
    if keep and out is None:
        raise StudyError(f"keep = {keep!r}: say in which folder, by out")
    check = partial(try_parts, grid.rules, (*grid.controllers, *grid.once))
    with tempfile.TemporaryDirectory() as folder:
        table = run_cells(grid.jobs(), Store(out or folder), jobs, keep, check=check)
    return _tidy(table)


def sweep(
    name: str,
    events: int | None = None,
    seed: int = 0,
    out: str | Path | None = None,
    jobs: int = 1,
    **settings: Any,
) -> pd.DataFrame:
    """The table of a study over random events; `readhesion list` names studies and the settings of each.

    What it states is in `table.attrs["statements"]`. `out`: as for `compare`.
    """
    study = find_study(name)
    for one in settings:
        study.kind_of(one)
    with tempfile.TemporaryDirectory() as folder:
        place = study_folder(out or folder, name)
        table = study.run(place, events or study.default_events, seed, jobs, **settings)
    stated = study.statements(table)
    found = _tidy(table)
    found.attrs["statements"] = stated
    return found


def plot(run: xr.Dataset, path: str | Path | None = None) -> Any:
    """The figure of a run over time (`matplotlib.figure.Figure`); with a `path` (pdf, png, svg) it is written there."""
    from paper_figs.drawing import FIGURES, draw_run, figure_of_run

    return FIGURES[figure_of_run(run)](run) if path is None else draw_run(run, path)


@xr.register_dataset_accessor("readhesion")
class OfRun:
    """What `run.readhesion` offers: the metrics of a run and its figure."""

    def __init__(self, run: xr.Dataset) -> None:
        self._run = run

    def metrics(self) -> pd.Series:
        """Every metric by name."""
        return pd.Series(evaluate(self._run), name=str(self._run.attrs["event"]))

    def plot(self, path: str | Path | None = None) -> Any:
        """As `plot`."""
        return plot(self._run, path)


def _several(given: Any) -> list[Any] | None:
    """What one or several names, or other things, are as a list; None for None."""
    if given is None or isinstance(given, list):
        return given
    alone = isinstance(given, str | Path | Scenario) or not isinstance(given, Iterable)
    return [given] if alone else list(given)


def _tidy(table: pd.DataFrame) -> pd.DataFrame:
    first = [name for name in FIRST if name in table]
    return table[
        [*first, *(name for name in table if name not in (*FIRST, *INTERNAL))]
    ].reset_index(drop=True)
