"""`readhesion compare`: rules and controllers over the same slip events."""

from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from studies.command_line.options import (
    ALL_FAILED,
    EVERYTHING,
    MOST_SEEDS,
    FilePath,
    Names,
    Whole,
    Work,
    check_whole,
    command_of,
    process_count,
    said,
    split_names,
)  # fmt: skip
from studies.command_line.terminal import console, counted, of_shard, progress
from studies.files.writable import check_place

if TYPE_CHECKING:
    from studies.scenario.scenario import Scenario


def compare(
    *,
    scenario: Names = None,
    rules: Names = None,
    controllers: Names = None,
    seeds: Whole | None = None,
    work: Work = EVERYTHING,
    out: FilePath = Path("results"),
    line: str | None = None,
    train: str | None = None,
    keep: Names = None,
    retry_failed: Annotated[bool, Parameter(negative=())] = False,
    figures: bool = True,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> int:
    """Run rules and controllers over the same slip events and print how well each does.

    Rows that the output folder already holds are not run again. A run in which rule or
    controller failed in more than 5 % of their calls is "degraded" and enters no mean. The exit
    code is 1 if no run is ok.

    Parameters
    ----------
    scenario
        Names of shipped scenarios or paths of TOML files [default: all that ship except those of
        faults].
    rules
        Allocation rules [default: all but qp-cvxpy].
    controllers
        Readhesion controllers [default: cut-and-ramp, perturb-observe, and mpc on the first seed].
    seeds
        Number of seeds: 3 runs the seeds 0, 1 and 2; 0 is the event as its file states it [default:
        5, but 1 where nothing is drawn].
    out
        Folder for the table (parquet), recorded runs (netCDF) and figures.
    line
        Line that ships, or file (TOML, railtoolkit): the events happen on its steepest climb.
    train
        Train set or file (TOML, railtoolkit): the train that meets the events.
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
    from alloc.sources import code_hash
    from studies.comparison.defaults import DEFAULT_SEEDS, KEPT_RUNS, make_grid
    from studies.comparison.summary import summarise, to_json
    from studies.comparison.table import tables
    from studies.core.own_parts import try_parts
    from studies.core.runner import run_cells
    from studies.core.shard import read_shard
    from studies.core.store import Store

    shard = read_shard(work.shard)
    if seeds is not None:
        check_whole("--seeds", seeds, 1, MOST_SEEDS)
    check_place(out, of_results=True)
    given = {"scenario": scenario, "rules": rules, "controllers": controllers}
    parts = {name: split_names(words) for name, words in given.items()}
    chosen = _scenarios(parts["scenario"], line, train)
    grid = make_grid(chosen, parts["rules"], parts["controllers"], seeds)
    cells = shard.of_cells(grid.jobs())
    kept = KEPT_RUNS if keep is None else keep
    check = partial(try_parts, grid.rules, grid.controllers)
    with work.workers() as workers, progress() as on_row:
        store = Store(out)
        table = run_cells(cells, store, workers, kept, retry_failed, on_row, check)
    lines = [] if work.shard else summarise(table)
    if as_json:
        about = {
            "table": str(store.path),
            "seeds": list(grid.seeds),
            "scenarios": {
                s.name: {"title": s.title, "hash": s.hash(), "case": s.case} for s in chosen
            },
            "code": code_hash("studies.core.job"),
            "cores": process_count(None),
            "shard": work.shard,
            **provenance(),
        }
        print(to_json(lines, about))
    else:
        screen = console()
        for item in tables(lines, {s.name: s.title for s in chosen}, screen.width):
            screen.print(item)
        screen.print(f"{counted(table, 'runs')}{of_shard(work)}; table in {store.path}")
    if figures and not work.shard:
        from studies.core.gallery import Asked, draw_comparison

        more = {"line": said(line), "train": said(train), "out": said(out, Path("results"))}
        command = command_of("compare", **parts, **more)
        whole = seeds is None or seeds >= DEFAULT_SEEDS or not any(one.draws() for one in chosen)
        written = draw_comparison(table, store, store.folder / "figures", Asked(command, whole))
        if written and not as_json:
            console().print(f"figures in {store.folder / 'figures'}: {', '.join(written)}")
    return 0 if table.empty or (table["status"] == "ok").any() else ALL_FAILED


def _scenarios(names: list[str] | None, line: str | None, train: str | None) -> "list[Scenario]":
    from studies.lines.real_input import with_real_input
    from studies.scenario.loading import default_scenarios, load_scenario

    real = line is not None or train is not None
    if names is None and not real:
        return default_scenarios()
    if names is None:
        names = ["gradient-start"]
    chosen = [load_scenario(name) for name in dict.fromkeys(names)]
    return [with_real_input(item, line, train) for item in chosen] if real else chosen
