"""How a multi-car train should share adhesion when its wheels slip: what a program needs, under one name::

    import readhesion

    run = readhesion.simulate("wet-patch", "cooperative", "perturb-observe")  # an xarray.Dataset
    print(readhesion.evaluate(run)["bound_use"])
    table = readhesion.compare("wet-patch", rules=["alone", "cooperative"])  # a pandas.DataFrame
    readhesion.plot(run, "event.png")

Plant, rules and controllers are in `alloc`, the MPC in `mpc`, studies in `studies`, figures in `paper_figs`.
`python -m readhesion` is the command of the same name.
"""

import tempfile as _tempfile
from collections.abc import Iterable as _Iterable
from collections.abc import Sequence as _Sequence
from importlib.metadata import version as _version
from pathlib import Path as _Path
from typing import Any as _Any

import pandas as _pd
import xarray as _xr

from alloc.conformance import check_belief, check_controller, check_curve
from alloc.evaluation.metrics import METRICS, Metric, metric
from alloc.evaluation.metrics import evaluate as _evaluate
from alloc.onboard.beliefs import BELIEFS, Belief
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.onboard.controllers import register as register_controller
from alloc.onboard.signatures import belief, control, share
from alloc.rules import (
    RULES,
    Allocation,
    AllocationProblem,
    Rule,
    convex_rule,
    optimality,
    reference_rule,
)
from alloc.rules.conformance import check_rule
from alloc.run import simulation as _simulation
from alloc.run.driving import drive
from alloc.run.event import DriverCommand, Event
from alloc.run.recording import check_whole as _check_whole
from alloc.run.recording import load
from alloc.run.recording import save as _save
from alloc.schema.errors import InputError
from alloc.schema.tables import Column, Table
from studies import StudyError as _StudyError
from studies import compare as _compare
from studies import rank as _rank
from studies.files.scenario import Scenario
from studies.files.scenario_files import load_scenario
from studies.run_cell import recorded as _recorded
from studies.runner.catalogue import find_study as _find_study
from studies.runner.plugins import reload_plugins as _reload_plugins
from studies.runner.plugins import try_own_parts as _try_own_parts
from studies.runner.study import Study as _Study
from studies.runner.study import run_study as _run_study

__version__ = _version("readhesion")
__all__ = [
    "BELIEFS",
    "CONTROLLERS",
    "METRICS",
    "RULES",
    "Allocation",
    "AllocationProblem",
    "Belief",
    "Column",
    "Controller",
    "DriverCommand",
    "Event",
    "InputError",
    "Metric",
    "Rule",
    "Scenario",
    "Table",
    "belief",
    "check_belief",
    "check_controller",
    "check_curve",
    "check_rule",
    "compare",
    "control",
    "convex_rule",
    "drive",
    "evaluate",
    "frame",
    "law",
    "load",
    "load_scenario",
    "metric",
    "optimality",
    "plot",
    "rank",
    "reference_rule",
    "register_controller",
    "save",
    "share",
    "simulate",
    "sweep",
]  # fmt: skip

law = share
"""What `share` was called; goes with the next release."""

_Named = str | _Path | Scenario


def __dir__() -> list[str]:
    return [*__all__, "__version__"]


def simulate(
    event: _Named | Event,
    rule: str | Rule = "cooperative",
    controller: str | Controller = "perturb-observe",
    seed: int | None = None,
) -> _xr.Dataset:
    """Run one slip event under a rule and a readhesion controller; returns the recorded run, see `alloc.run.recording`.

    `event`: the name of a scenario or of a drawn event, the path of a file, a `Scenario`, or an `Event`, which has its draws
    already. `seed` determines all that a scenario draws; left out: 0, or a drawn event's number. Raises `InputError` for
    what cannot be simulated.
    """
    _check("seed", 0 if seed is None else seed, 0)
    for registry, part, kind in ((RULES, rule, Rule), (CONTROLLERS, controller, Controller)):
        if isinstance(part, str) and not isinstance(registry.find(part), kind):
            raise InputError(f"{registry.kind} {part!r}: what is registered is no {kind.__name__}")
    if isinstance(event, Event):
        if seed:
            raise _StudyError(f"seed = {seed}: an event has its draws; give its scenario")
        return _simulation.simulate(event, rule, controller)
    scenario = _scenario(event)
    seed = scenario.first_seed if seed is None else seed
    if isinstance(rule, str) and isinstance(controller, str):
        return _recorded(scenario, rule, controller, seed)
    return _simulation.simulate(scenario.event(seed), rule, controller)


def evaluate(run: _xr.Dataset) -> dict[str, float]:
    """Every metric of a recorded run, by name; nan where it does not apply. Raises `InputError` for no whole run."""
    if not isinstance(run, _xr.Dataset):
        raise InputError(f"evaluate takes a run, not {run!r:.60}; readhesion.load reads one")
    try:
        _check_whole(run)
        return _evaluate(run)
    except (KeyError, AttributeError) as error:
        raise InputError(f"run: {error} is missing; evaluate takes whole runs") from None


def compare(
    scenarios: _Named | _Sequence[_Named] | None = None,
    rules: str | _Sequence[str] | None = None,
    controllers: str | _Sequence[str] | None = None,
    seeds: int | None = None,
    out: str | _Path | None = None,
    jobs: int = 1,
) -> _pd.DataFrame:
    """Run rules and controllers over the same slip events: one row per run, with every metric.

    What is left out is as in `readhesion compare`. `out`: a folder that keeps rows as they are computed; the same call goes
    on where it stopped. `jobs`: processes; a script that asks for several does so under ``if __name__ == "__main__"``.
    `attrs["table"]` has the standings. Raises `InputError` for a part that does not exist or does not work; a run that fails
    is a row with its reason.
    """
    _check("seeds", 1 if seeds is None else seeds, 1)
    _check("jobs", jobs, 1)
    _reload_plugins()
    chosen = [_scenario(scenario) for scenario in _as_list("scenarios", scenarios, _Path, Scenario)]
    parts = _as_list("rules", rules), _as_list("controllers", controllers)
    grid = _compare.choose_grid(chosen, *parts, seeds)
    _try_own_parts(grid.rules, grid.controllers)
    study = _compare.make_study(grid)
    with _tempfile.TemporaryDirectory() as folder:
        rows = _run_study(study, folder if out is None else out, jobs=jobs)
    return _with_tables(rows, study)


def sweep(
    name: str,
    events: int | None = None,
    seed: int | None = None,
    out: str | _Path | None = None,
    jobs: int = 1,
) -> _pd.DataFrame:
    """The rows of a study over random events; `readhesion list studies` names them, and a file may have one.

    `attrs` have what the study makes of them, as lists of rows: "table", and "statements" where it has some. `out`, `jobs`:
    as for `compare`.
    """
    _check("events", 1 if events is None else events, 1, 1_000_000)
    _check("seed", 0 if seed is None else seed, 0)
    _check("jobs", jobs, 1)
    _reload_plugins()
    study = _find_study(str(name))
    with _tempfile.TemporaryDirectory() as folder:
        rows = _run_study(study, folder if out is None else out, events, seed, jobs)
    return _with_tables(rows, study)


def rank(
    part: str,
    under: str = "perturb-observe",
    events: int | None = None,
    out: str | _Path | None = None,
    jobs: int = 1,
) -> _rank.Ranking:
    """The place of a registered rule or controller of your own among all of the benchmark, over the same events.

    A `DataFrame` that prints as the command does, and has `.plot()`. One row per part, the best first: "used" [%], "less"
    [points], by how much yours is ahead, with its interval, "tied". `attrs["gains"]` has the gain over `alone`, of a
    controller over perturb-observe, by parts of the events, `attrs["worst"]` the events in which it is least. `under`: the
    controller under which a rule runs; `events`: how many, the first [default: all 500]. `out`, `jobs`: as for `compare`.
    """
    _check("events", 1 if events is None else events, 1)
    _check("jobs", jobs, 1)
    _reload_plugins()
    pairs = _rank.find_pairs(str(part), under)
    if len(pairs) > 1:
        raise _StudyError(f"{part}: it registers several parts; give the name of one")
    study = _rank.rank_study(*pairs[0])
    with _tempfile.TemporaryDirectory() as room:
        folder = room if out is None else out
        _rank.announce_time(pairs[0], folder, events, jobs)
        rows = _run_study(study, folder, events, jobs=jobs)
    return _rank.make_ranking(pairs[0], study.make_tables(rows))


def plot(run: _xr.Dataset, path: str | _Path | None = None) -> _Any:
    """The figure of a run over time (`matplotlib.figure.Figure`); with a `path` (pdf, png, svg) it is written there."""
    from paper_figs.event import draw_course

    figure = draw_course(run)
    if path is not None:
        figure.savefig(path)
    return figure


def save(run: _xr.Dataset, path: str | _Path) -> None:
    """Write a recorded run, as netCDF (.nc) or for MATLAB (.mat); raises `InputError` for a file that cannot be."""
    from studies.command.options import check_file  # which imports what reads options

    check_file(_Path(path), ".nc", ".mat")
    _save(run, path)


def frame(run: _xr.Dataset, dimension: str = "axle") -> _pd.DataFrame:
    """What a run has over time, and over time and a dimension, a row for each of both; `attrs["units"]` has the units."""
    if dimension not in list(run.dims):
        raise InputError(f"dimension = {dimension!r:.60}: give one of {[*run.dims]}")
    over = ("time",) if dimension == "time" else ("time", dimension)
    variables = run[
        [name for name, variable in run.data_vars.items() if variable.dims in (over, over[:1])]
    ]
    table = variables.to_dataframe(over).reset_index()
    table.attrs["units"] = {
        name: variable.attrs.get("units") for name, variable in variables.variables.items()
    }
    return table


class _OfRun:
    """What `run.readhesion` offers: the metrics of a run and its figure."""

    def __init__(self, run: _xr.Dataset) -> None:
        self._run = run

    def metrics(self) -> _pd.Series:
        """Every metric by name."""
        return _pd.Series(evaluate(self._run), name=str(self._run.attrs["event"]))

    def plot(self, path: str | _Path | None = None) -> _Any:
        """As `readhesion.plot`."""
        return plot(self._run, path)


if __name__ not in ("__main__", "__mp_main__"):  # as a command it is imported again by what it runs
    _xr.register_dataset_accessor("readhesion")(_OfRun)


def _scenario(event: _Any) -> Scenario:
    if isinstance(event, Scenario):
        return event
    if isinstance(event, str | _Path):
        return load_scenario(event)
    raise _StudyError(f"event = {event!r:.60}: give a scenario's name, its file, or a Scenario")


def _as_list(option: str, values: _Any, *kinds: type) -> list[_Any]:
    """One or several names, or things of these kinds, as a list; none for None."""
    if values is None:
        return []
    is_list = isinstance(values, _Iterable) and not isinstance(values, (str, *kinds))
    chosen = list(values) if is_list else [values]
    if not chosen:
        raise _StudyError(f"{option} = {values!r:.60}: give one or more, or None for the default")
    for value in chosen:
        if not isinstance(value, (str, *kinds)):
            hint = "" if kinds else "; register a part of your own, and give its name"
            raise _StudyError(f"{option} = {value!r:.60}: give a name{hint}")
    return chosen


def _check(option: str, value: _Any, least: int, most: int = 2**31 - 1) -> None:
    if not isinstance(value, int) or isinstance(value, bool) or not least <= value <= most:
        raise _StudyError(f"{option} = {value!r:.60}: give a whole number from {least} to {most}")


def _tidy(rows: _pd.DataFrame) -> _pd.DataFrame:
    return rows.drop(columns=["cell", "name", "batch"]).reset_index(drop=True)


def _with_tables(rows: _pd.DataFrame, study: _Study) -> _pd.DataFrame:
    """Rows, and in `attrs` what the study makes of them, as lists of rows."""
    tidied, tables = _tidy(rows), study.make_tables(rows)
    tidied.attrs |= {name: table.to_dict(orient="records") for name, table in tables.items()}
    return tidied


if __name__ == "__main__":
    from studies.command.command_line import main

    main()
