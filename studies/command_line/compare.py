"""Many runs in a folder of results: `readhesion compare`, `sweep`, `merge`."""

import json
import shlex
from dataclasses import dataclass
from fnmatch import fnmatchcase
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from studies.command_line.options import (
    ALL_FAILED,
    EVERYTHING,
    GREATEST_SEED,
    MOST_EVENTS,
    MOST_SEEDS,
    FilePath,
    Format,
    Names,
    Settings,
    Whole,
    Work,
    check_whole,
    command_of,
    console,
    counted,
    of_shard,
    process_count,
    progress,
    said,
    settings_of,
    split_names,
)
from studies.files.study_error import StudyError
from studies.files.writable import check_place

if TYPE_CHECKING:
    from studies.scenario.scenario import Scenario


@Parameter(name="*")
@dataclass(frozen=True)
class Show:
    """What is shown of a comparison."""

    figures: bool = True
    """Draw the figures that belong to a comparison."""
    every_event: Annotated[bool, Parameter("--all", negative=())] = False
    """Print the table of each event too, with more columns; it is printed of a single one anyway."""
    text: Format = None
    """Print the table over all events as CSV, Markdown or LaTeX, and nothing else."""
    dry_run: Annotated[bool, Parameter(negative=())] = False
    """Say how many runs there are, how many are to be made and about how long they take; run none."""
    as_json: Annotated[bool, Parameter("--json", negative=())] = False
    """Print JSON with every metric instead of tables."""


PRINTED = Show()


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
    show: Show = PRINTED,
) -> int:
    """Run rules and controllers over the same slip events and print how well each does.

    It ends with one table over all events, a sentence, and table.csv in the output folder. Rows
    that the folder already holds are not run again. A run in which rule or controller failed in
    more than 5 % of their calls is "degraded" and enters no mean. The exit code is 1 if no run is
    ok.

    Parameters
    ----------
    scenario
        Names of shipped scenarios or paths of TOML files [default: all that ship except those of
        faults].
    rules
        Allocation rules [default: all but qp-daqp, qp-cvxpy and qp-robust].
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
    """
    from alloc.recording import provenance
    from alloc.sources import code_hash, write_whole
    from studies.comparison.pooled import ALL, notes, pooled, pooled_table, printed
    from studies.comparison.summary import (
        DEFAULT_SEEDS,
        KEPT_RUNS,
        REFERENCE,
        make_grid,
        summarise,
        to_json,
    )
    from studies.comparison.table import left_out, minus, tables
    from studies.core.own_parts import try_parts
    from studies.core.run import forecast, read_shard, run_cells
    from studies.core.store import Store
    from studies.report.answer import sentences, standings

    shard = read_shard(work.shard)
    if seeds is not None:
        check_whole("--seeds", seeds, 1, MOST_SEEDS)
    check_place(out, of_results=True)
    given = {"scenario": scenario, "rules": rules, "controllers": controllers}
    parts = {name: split_names(words) for name, words in given.items()}
    chosen = _scenarios(parts["scenario"], line, train)
    grid = make_grid(chosen, parts["rules"], parts["controllers"], seeds)
    jobs = grid.jobs()
    for pattern in keep or ():
        if not any(fnmatchcase(job.label, pattern) for job in jobs):
            raise StudyError(f"--keep {pattern}: no run is called so; one is {jobs[0].label}")
    cells = shard.of_cells(jobs)
    if show.dry_run:
        console().print(forecast(cells, Store(out), process_count(work.jobs)))
        return 0
    kept = KEPT_RUNS if keep is None else keep
    check = partial(try_parts, grid.rules, grid.controllers)
    with work.workers() as workers, progress() as on_row:
        store = Store(out)
        table = run_cells(cells, store, workers, kept, retry_failed, on_row, check)
    lines = [] if work.shard else summarise(table)
    if show.as_json:
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
    elif show.text is not None:
        print(printed(pooled(lines), show.text), end="")
    else:
        screen = console()
        over_all = pooled(lines)
        if show.every_event or len(chosen) == 1:
            for item in tables(lines, {s.name: s.title for s in chosen}, screen.width):
                screen.print(item)
        elif bad := [note for line in lines for note in left_out(line)]:
            screen.print(*bad, sep="\n")
        if over_all and len(chosen) > 1:
            screen.print(
                f"[bold]{ALL}[/bold]: means, and what is more than under {REFERENCE}, paired by event:"
            )
            fixed = [one.name for one in chosen if not one.draws()]
            told = map(minus, sentences(lines, standings(lines, fixed)))
            screen.print(pooled_table(over_all), *notes(over_all), *told, sep="\n")
        screen.print(f"{counted(table, 'runs')}{of_shard(work)}; rows in {store.path}")
        if over_all:
            place = store.folder / "table.csv"
            write_whole(place, partial(Path.write_text, data=printed([*over_all, *lines], "csv")))
            screen.print(f"numbers in {place}; next: readhesion report{_results(out)}")
    if show.figures and show.text is None and not work.shard:
        from studies.core.gallery import Asked, draw_comparison

        more = {"line": said(line), "train": said(train), "out": said(out, Path("results"))}
        command = command_of("compare", **parts, **more)
        whole = seeds is None or seeds >= DEFAULT_SEEDS or not any(one.draws() for one in chosen)
        written = draw_comparison(table, store, store.folder / "figures", Asked(command, whole))
        if written and not show.as_json:
            console().print(f"figures in {store.folder / 'figures'}: {', '.join(written)}")
    return 0 if table.empty or (table["status"] == "ok").any() else ALL_FAILED


def _results(out: Path) -> str:
    return "" if out == Path("results") else f" --results {shlex.quote(str(out))}"


def _scenarios(names: list[str] | None, line: str | None, train: str | None) -> "list[Scenario]":
    from studies.lines.named_files import with_real_input
    from studies.scenario.scenario import default_scenarios, load_scenario

    real = line is not None or train is not None
    if names is None and not real:
        return default_scenarios()
    if names is None:
        names = ["gradient-start"]
    chosen = [load_scenario(name) for name in dict.fromkeys(names)]
    return [with_real_input(item, line, train) for item in chosen] if real else chosen


# `readhesion sweep`: one question over many random events.


def sweep(
    name: str,
    *,
    events: Whole | None = None,
    out: FilePath = Path("results"),
    seed: Whole = 0,
    work: Work = EVERYTHING,
    text: Format = None,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
    **own: Settings,
) -> int:
    """Ask one question over many random events, and state what the answer is.

    Rows that the output folder already holds are not run again. The exit code is 1 if no run is ok.

    Parameters
    ----------
    name
        Sweep; `readhesion list` names them.
    events
        Number of random events [default: the sweep's own]; more of them extend fewer.
    out
        Folder of results; the sweep's table (parquet) goes to sweeps/NAME in it.
    seed
        Seed of the events, 0 or greater.
    text
        Print the numbers of all statements as CSV, Markdown or LaTeX, and nothing else.
    as_json
        Print JSON instead of text.
    own
        Options of the sweep itself, by the arguments of its cells: `readhesion list` names them.
    """
    from studies.comparison.table import as_text
    from studies.core.run import read_shard
    from studies.core.statement_report import (
        about,
        frozen_words,
        numbers_of,
        printed,
        rows_of,
        shown_rows,
    )
    from studies.core.study import find_study, study_folder

    chosen = find_study(name)
    count = chosen.default_events if events is None else events
    check_whole("--events", count, 1, MOST_EVENTS)
    check_whole("--seed", seed, 0, GREATEST_SEED)
    settings = settings_of(chosen, own)
    shard = read_shard(work.shard)
    check_place(out, of_results=True)
    folder = study_folder(out, name)
    with work.workers() as workers, progress() as on_row:
        table = chosen.run(folder, count, seed, workers, on_row, shard=shard, **settings)
    failed = int((table["status"] != "ok").sum()) if "status" in table else 0
    all_failed = failed == len(table) > 0
    found = [] if all_failed or work.shard else chosen.statements(table)
    if as_json:
        content = about(chosen, count, seed, folder, len(table), failed, **settings) | {
            "shard": work.shard
        }
        content["statements"] = [statement.content() for statement in found]
        if chosen.shown:
            content["rows"] = rows_of(table)
        print(json.dumps(content, indent=2, allow_nan=False))
    elif text is not None:
        print(as_text(text, *numbers_of(found)), end="")
    else:
        screen = console()
        if chosen.shown:
            screen.print(shown_rows(table, chosen.shown))
        for item in printed(found):
            screen.print(item)
        if words := frozen_words(chosen, folder, seed, **settings):
            screen.print(words)
        screen.print(f"{counted(table, 'rows')}{of_shard(work)}; tables in {folder}")
    return ALL_FAILED if all_failed else 0


# `readhesion merge`: results of several folders into one.


def merge(*folders: FilePath, out: FilePath) -> None:
    """Unite tables and recorded runs of several folders, such as those of `--shard`, in one.

    Then run the same command on the united folder, without --shard: it computes nothing again and
    states the result. Where rows of the same run differ, a warning names the run, and the rows
    added later count.

    Parameters
    ----------
    folders
        Folders that earlier commands wrote to with --out.
    out
        Folder for the united results; it may be one of the given folders.
    """
    if not folders:
        raise StudyError("merge: give the folders to unite")
    check_place(out)
    for folder in folders:
        if not Path(folder).is_dir():
            raise StudyError(f"folder {str(folder)!r} does not exist")
    from studies.core.store import unite

    counts = unite(folders, out)
    console().print(f"{out} holds {counts.cells} cells and {counts.runs} recorded runs")
