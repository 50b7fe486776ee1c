"""The command `readhesion`.

Exit codes: 0; 1 where all runs failed, or many of a ranked part, a law is broken or a worker was lost; 2 for bad input; 130
and 143 where it was stopped by a signal.
"""

import gc
import io
import json
import os
import shutil
import signal
import sys
import warnings
from collections.abc import Sequence
from contextlib import nullcontext
from functools import partial
from importlib.metadata import version
from pathlib import Path
from textwrap import fill
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter, UnusedCliTokensError

from alloc.schema.errors import InputError, UnsoundRun, blamed_on
from studies import RARELY, PartFailed, StudyError, WorkerLost
from studies.command.options import (
    SWEEP,
    WORK,
    Count,
    Flag,
    Json,
    Names,
    Seed,
    Sweep,
    Width,
    Work,
    check_file,
)

if TYPE_CHECKING:  # a command imports what it needs: the help is there at once
    import pandas as pd

    from studies.runner.study import Study

FAILED, BAD_INPUT, UNREAD = 1, 2, 141
LONGEST = 1500
"""Letters of a message; a value in it may be longer."""

app = App(
    name="readhesion",
    help="How a train of many cars should share adhesion when its wheels slip.",
    version=version("readhesion"),
    help_on_error=False,
    suppress_keyboard_interrupt=False,
)
app.meta.suppress_keyboard_interrupt = False
RETURNING: Any = {"exit_on_error": False, "print_error": False, "result_action": "return_value"}
"""The library is to return and to raise, and to print nothing of its own."""

# commands


@app.command
def compare(
    *,
    scenario: Names = None,
    rules: Names = None,
    controllers: Names = None,
    seeds: Seed | None = None,
    work: Sweep = SWEEP,
) -> int:
    """Run rules and controllers over the same slip events, and print how well each does.

    Rows that the output folder has are not run again. The exit code is 1 if every run failed.

    Args:
        scenario: Shipped scenarios or TOML files [default: all that ship but faults of single functions].
        rules: Allocation rules [default: all that differ].
        controllers: Readhesion controllers [default: cut-and-ramp, perturb-observe, mpc].
        seeds: Number of seeds of every event; the first, 0, is the event as its file says [default: 2].
    """
    from studies import compare as comparison
    from studies.benchmark import summarise_stored
    from studies.files.scenario import find_remarks
    from studies.files.scenario_files import load_scenario
    from studies.runner.plugins import try_own_parts

    scenarios = [load_scenario(name) for name in scenario or ()]
    chosen = comparison.choose_grid(scenarios, rules, controllers, seeds)
    folder = work.out / "compare"
    if not work.dry_run:
        for event in chosen.scenarios:
            _print_messages(*find_remarks(event.event()))
        try_own_parts(chosen.rules, chosen.controllers)
    results = _run_study(comparison.make_study(chosen), folder, work)
    if results is None:
        return 0
    rows, _ = results
    if work.as_json:
        _print_json(comparison.export_comparison(rows))
    else:
        standings = comparison.rank_rules(rows)
        table = comparison.format_standings(standings)
        print(comparison.summarise_standings(standings), *table, sep="\n")
        shown = "" if work.out == Path("results") else f" --results {work.out}"
        print(f"{_count_rows(rows)} in {folder}; next: readhesion report{shown}")
        if beyond := summarise_stored(rows):
            print(fill(beyond, 80, break_on_hyphens=False))
    return 0 if (rows["status"] == "ok").any() else FAILED


@app.command
def simulate(
    scenario: str,
    *,
    rule: str = "cooperative",
    controller: str = "perturb-observe",
    seed: Seed | None = None,
    out: Path | None = None,
    figure: Path | None = None,
    every: Annotated[Flag, Parameter("--all")] = False,
    as_json: Json = False,
) -> None:
    """Run one slip event and print its main metrics.

    Args:
        scenario: Name of a shipped scenario or of a drawn event, as population-65-0002, or a TOML file.
        rule: Allocation rule.
        controller: Readhesion controller.
        seed: Seed of what the event draws; 0 is the event as its file says [default: 0, or a drawn event's number].
        out: File for the recorded run (netCDF, .nc; MATLAB, .mat).
        figure: File for a figure of the run (pdf, png or svg).
        every: Print every metric.
        as_json: Print JSON with every metric instead.
    """
    from alloc.evaluation.metrics import METRICS, evaluate
    from alloc.onboard.controllers import CONTROLLERS
    from alloc.rules import RULES
    from alloc.run.recording import save
    from studies.files.scenario import DRAWN, find_remarks
    from studies.files.scenario_files import load_scenario
    from studies.run_cell import event_of, recorded
    from studies.runner.plugins import try_own_parts

    event = load_scenario(scenario)
    seed = event.first_seed if seed is None else seed
    RULES.find(rule)
    CONTROLLERS.find(controller)
    check_file(out, ".nc", ".mat")
    check_file(figure, ".pdf", ".png", ".svg")
    if DRAWN.fullmatch(event.name) is None:
        _print_messages(*find_remarks(event_of(event, seed)))
    elif seed != event.first_seed:
        _print_messages(
            f"seed {seed} draws other errors than the rows of {event.name}, which have seed {event.first_seed}"
        )
    try_own_parts([rule], [controller])
    run = recorded(event, rule, controller, seed)
    of_user = {*METRICS} > {*METRICS.shipped()}
    with blamed_on("metrics") if of_user else nullcontext():
        values = evaluate(run)
    if out is not None:
        save(run, out)
    if figure is not None:
        import paper_figs
        from paper_figs.event import draw_course

        paper_figs.save(lambda: draw_course(run), figure)
    if as_json:
        names = {"scenario": event.name, "rule": rule, "controller": controller, "seed": seed}
        _print_json({**names, "metrics": values})
        return
    shown = HEADLINES if not every else tuple(values)
    print(f"{event.name}: {rule}, {controller}, seed {seed}")
    for name in shown:
        number = "–" if values[name] != values[name] else f"{values[name]:.4g}"
        unit, meaning = METRICS[name].unit.removeprefix("1"), METRICS[name].description
        _print_line(f"  {name:19}{number:>9} {unit:6}", meaning)
    if not every:
        print(f"  {len(values) - len(shown)} more: --all")


HEADLINES = (
    "bound_use",
    "headroom",
    "over_delivery",
    "acceleration_ratio",
    "slip_time",
    "damage",
    "jerk_rms",
)
"""Metrics that are printed of a run where not all are asked for."""


@app.command
def optimum(
    scenario: str,
    *,
    rules: Names = None,
    controllers: Names = None,
    seed: Seed | None = None,
    figure: Path | None = None,
    as_json: Json = False,
) -> int:
    """Find the least wheel damage of a slip event at the end speed of each strategy, and what it dissipates above that.

    Args:
        scenario: Name of a shipped scenario or of a drawn event, as population-65-0002, or a TOML file.
        rules: Allocation rules [default: alone, cooperative].
        controllers: Readhesion controllers [default: perturb-observe, mpc].
        seed: Seed of what the event draws; 0 is the event as its file says [default: 0, or a drawn event's number].
        figure: File for a figure of the first strategy beside the optimum (pdf, png or svg).
        as_json: Print JSON instead.
    """
    import paper_figs
    from studies import optimum as study
    from studies.files.scenario_files import load_scenario
    from studies.run_cell import event_of
    from studies.runner.plugins import try_own_parts
    from studies.runner.progress import show_progress
    from studies.runner.rows import markdown_table

    event, pairs = load_scenario(scenario), study.choose_pairs(rules, controllers)
    check_file(figure, ".pdf", ".png", ".svg")
    try_own_parts(rules or (), controllers or ())
    start = event_of(event, event.first_seed if seed is None else seed)
    with show_progress("optimum", len(pairs), False) as advance:
        comparison = study.compare_with_optimum(start, pairs, advance)
    if as_json:
        _print_json(comparison.rows)
    else:
        print(markdown_table(study.lay_out(comparison.rows)), end="")
        print("oracle: the rule that knows the rail; parts of Q above the least: docs/optimum.md")
    _print_messages(*(row["reason"] for row in comparison.rows if "least" not in row))
    solved = any(comparison.optima)
    if figure is not None and solved:
        paper_figs.save(lambda: study.draw_beside(comparison), figure)
    return 0 if solved else FAILED


@app.command
def sweep(
    study: str, *, events: Count | None = None, seed: Seed | None = None, work: Sweep = SWEEP
) -> int:
    """Ask one question over many events, and print the answer; more events extend fewer.

    Args:
        study: Name of a study, see `readhesion list studies`, or a Python file that has a STUDY.
        events: Number of events [default: the study's].
        seed: Seed of what is drawn [default: the study's].
    """
    from studies.runner.catalogue import find_study

    chosen = find_study(study)
    return _print_answer(chosen, work.out / chosen.name, events, seed, work)


@app.command
def benchmark(
    *,
    events: Count | None = None,
    seed: Seed | None = None,
    store: Path | None = None,
    work: Sweep = SWEEP,
) -> int:
    """Run all rules and controllers on the population of the benchmark, and print the tables.

    Args:
        events: Number of events [default: 500].
        seed: Seed of the population [default: the stored rows'].
        store: File for the rows that `readhesion rank` compares with (parquet).
    """
    import pandas as pd

    from studies import benchmark as bench

    check_file(store, ".parquet")
    folder = work.out / "benchmark"
    code = _print_answer(bench.STUDY, folder, events, seed, work)
    if store is not None and not work.dry_run and code == 0:
        bench.store_rows(pd.read_parquet(folder / "rows.parquet"), store)
    return code


@app.command
def rank(
    part: str,
    *,
    under: str = "perturb-observe",
    events: Count | None = None,
    work: Sweep = SWEEP,
) -> int:
    """Run a rule or a controller of your own on the benchmark, and print its place.

    Only this part is run; the others' rows are stored.

    Args:
        part: Python file that registers rules or controllers, or the name of one.
        under: Controller under which a rule is run: cut-and-ramp, perturb-observe or mpc.
        events: Number of events, the first [default: all 500].
    """
    from studies import rank as ranking
    from studies.benchmark import is_stale
    from studies.runner.provenance import describe_origin

    tables_of_parts = {}
    for pair in ranking.find_pairs(part, under):
        study = ranking.rank_study(*pair)
        folder = work.out / study.name
        if not work.dry_run:
            ranking.announce_time(pair, folder, events, work.jobs)
        results = _run_study(study, folder, work, events)
        if results is None:
            continue
        rows, tables = results
        if not tables:
            return _report_failure(study, rows)
        if work.as_json:
            name = ranking.compared_parts(*pair)[0]
            tables_of_parts[name] = {**tables, "about": describe_origin()}
        else:
            print("\n".join(ranking.format_rank(pair, tables)))
            print(f"{_count_rows(rows)}, tables and figure in {folder}")
    if work.as_json:
        _print_json(tables_of_parts)
    if is_stale():
        _print_messages(
            "the stored rows are of other sources of alloc or mpc; readhesion benchmark computes them anew"
        )
    return 0


def _print_answer(
    study: "Study", folder: Path, events: int | None, seed: int | None, work: Sweep
) -> int:
    """Run a study and print its tables; the exit code."""
    from studies.runner.provenance import describe_origin
    from studies.runner.study import format_tables

    results = _run_study(study, folder, work, events, seed)
    if results is None:
        return 0
    rows, tables = results
    if not tables:
        return _report_failure(study, rows)
    if work.as_json:
        _print_json({**tables, "about": describe_origin()})
    else:
        print("\n".join([study.question, "", *format_tables(tables, work.kind)]))
        written = "tables and figure" if study.figure else "tables"
        print(f"{_count_rows(rows)}, {written} in {folder}")
    return 0


def _report_failure(study: "Study", rows: "pd.DataFrame") -> int:
    _print_messages(f"all of {study.name} failed: {rows['reason'].iloc[0]}")
    return FAILED


@app.command
def figures(
    *names: str,
    source: str | None = None,
    results: Path = Path("results"),
    out: Path = Path("figures"),
    kind: Annotated[Literal["pdf", "png", "svg"], Parameter("--format")] = "pdf",
    style: str = "",
    width: Width | None = None,
    work: Work = WORK,
) -> None:
    """Draw the figures of the papers, each with its caption and its data (NAME.csv) beside it.

    A figure of a study shows the rows of its last sweep. Where there are none, the sweep is run for a
    figure that is asked for by name or source; among all figures it is left out.

    Args:
        names: Figures [default: all]; `readhesion list figures` names them.
        source: Those of one document: jp5484215, jp4209318, rtri, readhesion_paper or jph07322414.
        results: Folder of the studies' rows.
        out: Folder for the figures.
        kind: Format of the files.
        style: Matplotlib style over the project's: a file, or latex for the fonts of a paper in Times.
        width: Width in inches [default: 3.5 or 7.16]; heights in proportion.
    """
    import paper_figs
    from studies.runner.catalogue import find_study

    chosen = paper_figs.chosen_figures(names, source)
    with paper_figs.apply_style(style):
        pass  # a style that is none is refused before a sweep is run
    for study in paper_figs.find_missing(chosen, results):
        if not names and source is None:
            command = study if study == "compare" else f"sweep {study}"
            print(f"left out, for there are no rows of readhesion {command}")
            chosen = {name: figure for name, figure in chosen.items() if figure.study != study}
        elif study == "compare":
            raise StudyError(
                f"there are no rows in {results / study}; run readhesion compare first"
            )
        else:
            print(end=f"{study}: " if work.dry_run else "")
            _run_study(find_study(study), results / study, work)
    if work.dry_run:
        print(f"{len(chosen)} figures to draw")
        return
    for path in paper_figs.draw(chosen, results, out, kind, style, width):
        _print_line(f"{path}: ", chosen[path.stem].caption)


@app.command(name="list")
def list_names(kind: str | None = None, *, as_json: Json = False) -> None:
    """Name what there is: scenarios, rules, controllers, curves, trains, studies, figures, metrics.

    Args:
        kind: One of these kinds alone.
        as_json: Print JSON instead.
    """
    from studies.files.toml_keys import suggest_name
    from studies.runner.catalogue import KINDS

    def list_figures() -> dict[str, str]:
        import paper_figs

        return {name: figure.caption for name, figure in paper_figs.all_figures().items()}

    kinds = KINDS | {"figures": list_figures}
    if kind not in (None, *kinds):
        raise StudyError(f"unknown kind {kind!r}{suggest_name(str(kind), kinds)}")
    lists = {name: names() for name, names in kinds.items() if kind in (None, name)}
    if as_json:
        _print_json(lists)
        return
    for title, names in lists.items():
        print(f"{title}:")
        for name, meaning in names.items():
            _print_line(f"  {name:21} ", meaning)


@app.command
def check(name: str, *, tolerance: float = 1e-6, as_json: Json = False) -> int:
    """Try the laws of rules, controllers or curves on one of them; the exit code is 1 if it breaks one.

    Args:
        name: Name of the part, one of a plug-in too.
        tolerance: Amount by which a law may be broken, as a share of the plan.
        as_json: Print JSON instead.
    """
    from alloc.conformance import check_part
    from alloc.rules.conformance import BrokenLaw
    from studies.runner.plugins import try_own_parts

    if not 0.0 <= tolerance < float("inf"):
        raise StudyError(f"--tolerance {tolerance:g}: give a finite number of 0 or more")
    try_own_parts([name], [name])
    broken: list[str] = []
    try:
        verdicts = check_part(name, tolerance)
    except BrokenLaw as error:
        verdicts, broken = error.verdicts, error.broken
    if as_json:
        _print_json(verdicts)
    else:
        print(*verdicts.values(), sep="\n")
    _print_messages(*broken)
    return FAILED if broken else 0


@app.command
def report(
    *, results: Path = Path("results"), out: Path = Path("report.html"), events: Names = None
) -> None:
    """Write the last comparison as one page that opens offline: answer, tables, and replays of events.

    Args:
        results: Folder of the comparison.
        out: HTML file.
        events: Scenarios that are replayed [default: the three in which rules differ most].
    """
    from studies.command.report import write_report

    check_file(out, ".html")
    write_report(results / "compare", out, events or ())
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB")


@app.command
def schema(kind: Literal["scenario", "train"] = "scenario", *, out: Path | None = None) -> None:
    """Print the JSON schema of a kind of file: every key with its unit, meaning and default.

    Args:
        kind: What the file describes.
        out: File to write instead.
    """
    from alloc.files import write_whole
    from studies.files.scenario_files import json_schema

    text = json.dumps(json_schema(kind), indent=1, allow_nan=False) + "\n"
    check_file(out, ".json")
    if out is None:
        print(text, end="")
    else:
        write_whole(out, partial(Path.write_text, data=text, encoding="utf-8"))


@app.command
def new_scenario(name: str, *, like: str = "wet-start", out: Path = Path()) -> None:
    """Write a scenario file that runs as it stands, with the schema by which editors complete keys.

    Args:
        name: Name of the scenario; the file is NAME.toml.
        like: Scenario that it begins as: one that ships, or a TOML file.
        out: Folder for both files.
    """
    from studies.files import scenario_files

    path = scenario_files.new_scenario(name, like, out)
    print(f"{path} runs as it stands: readhesion simulate {path}")


@app.command
def cite(*, as_bibtex: Annotated[Flag, Parameter("--bibtex")] = False) -> None:
    """Print how to cite this software, and the publications that it is based on.

    Args:
        as_bibtex: As BibTeX.
    """
    from studies.command.citations import CITATIONS

    for citation in CITATIONS:
        print(citation.bibtex if as_bibtex else citation.text)


# what commands share


def _run_study(
    study: "Study", folder: Path, work: Work, events: int | None = None, seed: int | None = None
) -> "tuple[pd.DataFrame, dict[str, pd.DataFrame]] | None":
    """The rows of a study and its tables, written with its figure; of a dry run None, and a forecast."""
    from studies.runner.study import forecast_runs, run_study, write_results
    from studies.runner.workers import count_cores

    jobs = work.jobs or count_cores()
    if work.dry_run:
        print(forecast_runs(study, folder, events, seed, jobs))
        return None
    workers = jobs, work.scheduler, work.retry_failed
    rows = run_study(study, folder, events, seed, *workers, quiet=False)
    kind = work.kind if isinstance(work, Sweep) else "md"
    from paper_figs import apply_style

    with apply_style():
        return rows, write_results(study, rows, folder, kind)


def _count_rows(rows: "pd.DataFrame") -> str:
    bad = rows.loc[rows["status"] != "ok", "status"].value_counts()
    return f"{len(rows)} rows" + "".join(f", {n} {status}" for status, n in bad.items())


def _print_json(value: object) -> None:
    """A table as its rows; what is not finite, which JSON does not know, as null."""
    text = json.dumps(value, default=lambda table: json.loads(table.to_json(orient="records")))
    print(json.dumps(json.loads(text, parse_constant=lambda _: None), indent=1, allow_nan=False))


def _print_line(head: str, text: str) -> None:
    """At a terminal in as many lines as `text` needs beside `head`."""
    width = shutil.get_terminal_size().columns if sys.stdout.isatty() else sys.maxsize
    print(fill(text, width, initial_indent=head, subsequent_indent=" " * min(len(head), 38)))


def _print_messages(*messages: str) -> None:
    """Each in one line on stderr."""
    for message in messages:
        line = " ".join(message.split())
        if len(line) > LONGEST:
            line = f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"
        print(f"readhesion: {line}", file=sys.stderr)


# the whole


@app.meta.default
def launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    plugin: Annotated[list[Path] | None, Parameter(negative_iterable=())] = None,
    verbose: Flag = False,
) -> Any:
    """Run a command, after loading plug-ins.

    Args:
        verbose: Say what is compiled, which rows are there already and which are computed, and where a solver fails.
        plugin: Python file that registers rules, controllers, curves or metrics, or a train as TOML; may be given again.
    """
    from studies.runner.progress import print_progress

    with print_progress(tokens[0] if tokens else app.name[0], verbose):
        if plugin:
            from studies.runner.plugins import load_plugins

            load_plugins(plugin)
        return app(tokens, **RETURNING)


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code. What goes wrong is one line on stderr."""
    try:
        with warnings.catch_warnings():
            warnings.showwarning = lambda message, *_, **__: _print_messages(str(message))
            code = app.meta(arguments, **RETURNING)
        sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except BrokenPipeError:
        # nobody reads on, as after `| head`: what is still to be printed goes nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except UnusedCliTokensError as error:
        tokens = ", ".join(map(repr, error.unused_tokens or ()))
        _print_messages(f"{tokens}: no option takes this; --help has the options")
    except (CycloptsError, InputError) as error:
        _print_messages(str(error))
    except OSError as error:
        named = error.filename is not None and error.strerror
        _print_messages(f"file {str(error.filename)!r}: {error.strerror}" if named else str(error))
    except (UnsoundRun, WorkerLost, PartFailed) as error:
        _print_messages(str(error))
        return FAILED
    return BAD_INPUT


def _interrupt(number: int, frame: object) -> None:
    raise KeyboardInterrupt(number)


def main() -> None:
    """Run the command and exit."""
    gc.set_threshold(*RARELY)
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal may know plain letters only
    signals = (signal.SIGINT, signal.SIGTERM)
    for number in signals:
        signal.signal(number, _interrupt)
    try:
        code = run()
    except KeyboardInterrupt as stopped:
        code = 128 + (stopped.args[0] if stopped.args else signal.SIGINT)
        _print_messages("; ".join(["stopped", *getattr(stopped, "__notes__", ())]))
    for number in signals:  # nothing is left to stop
        signal.signal(number, signal.SIG_IGN)
    gc.freeze()  # nor is garbage worth a search
    sys.exit(code)


if __name__ == "__main__":
    main()
