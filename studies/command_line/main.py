"""The command `readhesion`."""

import json
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import App, CycloptsError, Parameter

from studies.command_line.options import Names, Whole, check_writable, process_count, split_names
from studies.command_line.terminal import console, progress
from studies.core.study_error import StudyError
from studies.lines.command import run_line
from studies.logs.command import analyse

if TYPE_CHECKING:
    from studies.scenario.scenario import Scenario

ALL_FAILED = 1
BAD_INPUT = 2
INTERRUPTED = 130

app = App(
    name="readhesion",
    help="How a train of many cars should share adhesion when its wheels slip.",
    help_on_error=False,
    suppress_keyboard_interrupt=False,  # `run` says what an interrupt leaves behind
)


@app.command
def compare(
    *,
    scenario: Names = None,
    rules: Names = None,
    controllers: Names = None,
    seeds: Whole | None = None,
    jobs: Whole | None = None,
    out: Path = Path("results"),
    line: str | None = None,
    train: str | None = None,
    keep: Names = None,
    retry_failed: Annotated[bool, Parameter(negative=())] = False,
    figures: bool = True,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> int:
    """Run rules and controllers over the same slip events and print what each is worth.

    Rows that the output folder already holds are not run again. The exit code is 1 if every run failed.

    Parameters
    ----------
    scenario
        Names of shipped scenarios or paths of TOML files [default: the shipped ones but those of
        faults].
    rules
        Allocation rules [default: all but qp-cvxpy].
    controllers
        Readhesion controllers [default: cut-and-ramp, and mpc on some of the events].
    seeds
        Number of seeds: 3 runs the seeds 0, 1 and 2 [default: 1].
    jobs
        Number of processes [default: one per core].
    out
        Folder for the table (parquet), recorded runs (netCDF) and figures.
    line
        Railtoolkit running path: the events happen on its steepest climb.
    train
        Railtoolkit rolling stock: the train that meets the events.
    keep
        Runs to record, as patterns of scenario/rule/controller/seed such as `wet-*/exact/*/0`.
    retry_failed
        Run failed rows again.
    figures
        Draw the figures that belong to a comparison.
    as_json
        Print JSON with every metric instead of tables.
    """
    from alloc.recording import provenance
    from studies.comparison.defaults import DEFAULT_SEEDS, KEPT_RUNS, make_grid
    from studies.comparison.summary import summarise, to_json
    from studies.comparison.table import tables
    from studies.core.code_version import code_hash
    from studies.core.runner import run_grid
    from studies.core.store import Store

    count = process_count(jobs)
    chosen = _scenarios(split_names(scenario), line, train)
    grid = make_grid(
        chosen,
        split_names(rules),
        split_names(controllers),
        DEFAULT_SEEDS if seeds is None else seeds,
    )
    store = Store(out)
    with progress() as on_row:
        table = run_grid(
            grid, store, count, KEPT_RUNS if keep is None else keep, retry_failed, on_row
        )
    lines = summarise(table)
    failed = int((table["status"] != "ok").sum())
    if as_json:
        about = {
            "table": str(store.path),
            "seeds": list(grid.seeds),
            "scenarios": {
                s.name: {"title": s.title, "hash": s.hash(), "case": s.case} for s in chosen
            },
            "code": code_hash(),
            "cores": process_count(None),
            **provenance(),
        }
        print(to_json(lines, about))
    else:
        screen = console()
        for item in tables(lines, {s.name: s.title for s in chosen}, screen.width):
            screen.print(item)
        screen.print(
            f"{len(table)} runs"
            + (f", [red]{failed} failed[/red]" if failed else "")
            + f"; table in {store.path}"
        )
    if figures:
        from studies.core.figures import gallery

        written = gallery().draw_comparison(table, store, store.folder / "figures")
        if written and not as_json:
            console().print(f"figures in {store.folder / 'figures'}: {', '.join(written)}")
    return ALL_FAILED if failed == len(table) else 0


@app.command
def simulate(
    scenario: str,
    *,
    rule: str = "greedy",
    controller: str = "cut-and-ramp",
    seed: Whole = 0,
    out: Path | None = None,
    log: Path | None = None,
    figure: Path | None = None,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> None:
    """Run one slip event and print its metrics.

    Parameters
    ----------
    scenario
        Name of a shipped scenario or path of a TOML file.
    rule
        Allocation rule.
    controller
        Readhesion controller.
    seed
        Seed of the event's random draws, 0 or greater.
    out
        File for the recorded run (netCDF).
    log
        File for a log (csv or parquet) as `readhesion analyse` reads it; the train's data go beside
        it, with the ending .train.toml.
    figure
        File for a figure of the run (pdf or png).
    as_json
        Print JSON instead of a table.
    """
    from rich.table import Table

    from alloc.metrics import METRICS, evaluate
    from alloc.recording import save
    from studies.comparison.defaults import check_names
    from studies.core.controllers import host_factories
    from studies.core.job import Job, simulate_job
    from studies.logs.export import check_log_path, write_log
    from studies.scenario.scenario import load_scenario

    chosen = load_scenario(scenario)
    check_names([rule], [controller])
    if seed < 0:
        raise StudyError(f"--seed {seed}: must be 0 or greater")
    for path in (out, log, figure):
        if path is not None:
            check_writable(path)
    if log is not None:
        check_log_path(log)
    run = simulate_job(Job(chosen, rule, controller, seed), host_factories(controller))
    values = evaluate(run)
    if out is not None:
        save(run, out)
    if log is not None:
        write_log(run, chosen.event(seed).model.train, log)
    if figure is not None:
        from studies.core.figures import gallery

        gallery().draw_run(run, figure)
    if as_json:
        about = {"scenario": chosen.name, "rule": rule, "controller": controller, "seed": seed}
        numbers = {name: None if value != value else value for name, value in values.items()}
        print(json.dumps({**about, "metrics": numbers}, indent=2, allow_nan=False))
        return
    table = Table(title=f"{chosen.name}: {rule}, {controller}, seed {seed}", title_justify="left")
    for heading in ("metric", "value", "unit", "meaning"):
        table.add_column(heading, justify="right" if heading == "value" else "left")
    for name, value in values.items():
        metric = METRICS[name]
        shown = "–" if value != value else f"{value:.4g}"
        table.add_row(name, shown, "" if metric.unit == "1" else metric.unit, metric.description)
    console().print(table)


app.command(run_line)


@app.command
def sweep(
    name: str,
    *,
    events: Whole | None = None,
    jobs: Whole | None = None,
    out: Path = Path("results"),
    seed: Whole = 0,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> int:
    """Ask one question over many random events, and state what the answer is.

    Rows that the output folder already holds are not run again. The exit code is 1 if every run failed.

    Parameters
    ----------
    name
        Sweep; `readhesion list` names them.
    events
        Number of random events [default: the sweep's own]; more of them extend fewer.
    jobs
        Number of processes [default: one per core].
    out
        Folder of results; the sweep's table (parquet) goes to sweeps/NAME in it.
    seed
        Seed of the events, 0 or greater.
    as_json
        Print JSON instead of text.
    """
    from studies.core.collection import find_sweep, sweep_folder
    from studies.core.statement_report import about, printed

    chosen = find_sweep(name)
    if events is not None and events < 1:
        raise StudyError(f"--events {events}: give the number of events, 1 or more")
    if seed < 0:
        raise StudyError(f"--seed {seed}: must be 0 or greater")
    count = chosen.DEFAULT_EVENTS if events is None else events
    folder = sweep_folder(out, name)
    with progress() as on_row:
        table = chosen.run(folder, count, seed, process_count(jobs), on_row)
    failed = int((table["status"] != "ok").sum()) if "status" in table else 0
    found = [] if failed == len(table) else chosen.statements(table)
    if as_json:
        content = about(name, count, seed, folder, len(table), failed)
        content["statements"] = [statement.content() for statement in found]
        print(json.dumps(content, indent=2, allow_nan=False))
    else:
        screen = console()
        for item in printed(found):
            screen.print(item)
        screen.print(
            f"{len(table)} rows"
            + (f", [red]{failed} failed[/red]" if failed else "")
            + f"; tables in {folder}"
        )
    return ALL_FAILED if failed == len(table) else 0


@app.command
def figures(
    *names: str,
    out: Path = Path("figures"),
    results: Path = Path("results"),
    jobs: Whole | None = None,
) -> None:
    """Draw figures as PDF and PNG.

    Parameters
    ----------
    names
        Figures to draw [default: all]; `readhesion list` names them.
    out
        Folder for the figures.
    results
        Folder of a comparison; what the figures need and it lacks is run first.
    jobs
        Number of processes for that [default: one per core].
    """
    from studies.core.figures import gallery
    from studies.core.study_error import unknown

    known = gallery().descriptions()
    for name in names:
        if name not in known:
            raise unknown("figure", name, known)
    count = process_count(jobs)
    with progress() as on_row:
        written = gallery().draw_figures(names or tuple(known), out, results, count, on_row)
    for path in written:
        print(path)


@app.command(name="list")
def list_names(*, as_json: Annotated[bool, Parameter("--json", negative=())] = False) -> None:
    """List scenarios, rules, controllers, train sets, sweeps, figures, metrics and columns of logs.

    Parameters
    ----------
    as_json
        Print JSON instead of tables.
    """
    from rich.markup import escape
    from rich.table import Table

    from studies.command_line.catalogue import catalogue

    content = catalogue()
    if as_json:
        print(json.dumps(content, indent=2))
        return
    screen = console()
    for kind, entries in content.items():
        table = Table(title=f"[bold]{kind}[/bold]", title_justify="left", show_header=False)
        table.add_column(no_wrap=True)
        table.add_column()
        for name, meaning in entries.items():
            table.add_row(escape(name), escape(meaning))
        screen.print(table)


app.command(analyse)


def _scenarios(names: list[str] | None, line: str | None, train: str | None) -> "list[Scenario]":
    from studies.lines.real_input import with_real_input
    from studies.scenario.scenario import default_scenarios, load_scenario

    real = line is not None or train is not None
    if names is None and not real:
        return default_scenarios()
    if names is None:
        names = ["gradient-start"]
    chosen = [load_scenario(name) for name in dict.fromkeys(names)]
    return [with_real_input(item, line, train) for item in chosen] if real else chosen


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code: 0, 1 if all failed, 2 for bad input (one line on stderr), 130."""
    from alloc.estimation.errors import EstimationError
    from alloc.onboard import OnboardError
    from alloc.plant.errors import PlantError
    from alloc.rules import AllocationError
    from alloc.simulation import SimulationError

    refused = (
        StudyError, PlantError, OnboardError, SimulationError, AllocationError, EstimationError, OSError
    )  # fmt: skip
    try:
        code = app(arguments, exit_on_error=False, print_error=False, result_action="return_value")
    except CycloptsError as error:
        return _refuse(str(error))
    except refused as error:
        return _refuse(str(error))
    except KeyboardInterrupt:
        print(
            "readhesion: stopped; finished rows are kept, the same command goes on", file=sys.stderr
        )
        return INTERRUPTED
    return code if isinstance(code, int) else 0


def _refuse(message: str) -> int:
    print(f"readhesion: {' '.join(message.split())}", file=sys.stderr)
    return BAD_INPUT


def main() -> None:
    """Entry point of the installed command."""
    sys.exit(run())
