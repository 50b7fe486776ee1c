"""The command `readhesion`.

Exit codes: 0; 1 where all runs failed, a law is broken or a worker was lost; 2 for bad input; 130 and 143 where it was
stopped by a signal.
"""

import io
import json
import os
import signal
import sys
import warnings
from collections.abc import Sequence
from dataclasses import dataclass
from functools import partial
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Literal

from cyclopts import App, CycloptsError, Parameter, Token, UnusedCliTokensError

if TYPE_CHECKING:
    import pandas as pd

    from studies.core import Study

FAILED, BAD_INPUT, INTERRUPTED, UNREAD, TERMINATED = 1, 2, 130, 141, 143
LONGEST = 1500
"""Letters of a message; what was given may be longer."""
MOST_EVENTS, GREATEST_SEED, PROCESSES_PER_CORE = 1_000_000, 2**31 - 1, 16

app = App(
    name="readhesion",
    help="How a train of many cars should share adhesion when its wheels slip.",
    version=version("readhesion"),
    help_on_error=False,
    suppress_keyboard_interrupt=False,
)
app.meta.suppress_keyboard_interrupt = False


def _whole(_: type, tokens: Sequence[Token]) -> int:
    """A whole number; the library would round 1.5."""
    try:
        return int(tokens[0].value)
    except ValueError:
        raise ValueError(f"{tokens[0].value!r} is not a whole number") from None


Whole = Annotated[int, Parameter(converter=_whole, n_tokens=1)]
Names = Annotated[list[str] | None, Parameter(consume_multiple=True, negative_iterable=())]
"""Several names, one by one or with commas."""
Flag = Annotated[bool, Parameter(negative=())]
Json = Annotated[bool, Parameter("--json", negative=())]


@Parameter(name="*")
@dataclass(frozen=True)
class Work:
    """Who works."""

    jobs: Whole | None = None
    """Processes [default: one per core]."""
    scheduler: str | None = None
    """Address of a Dask scheduler, or the file that it wrote; its workers do the work."""
    retry_failed: Flag = False
    """Run again what failed."""

    def options(self) -> dict[str, Any]:
        """As arguments of `run_study`. Raises `StudyError` for an impossible number of processes."""
        from studies.core import cores

        most = PROCESSES_PER_CORE * cores()
        _check_whole("--jobs", self.jobs, 1, most)
        return {
            "jobs": self.jobs or cores(),
            "scheduler": self.scheduler,
            "retry_failed": self.retry_failed,
            "quiet": False,
        }


ALONE = Work()


@app.command
def compare(
    *,
    scenario: Names = None,
    rules: Names = None,
    controllers: Names = None,
    seeds: Whole | None = None,
    out: Path = Path("results"),
    work: Work = ALONE,
    dry_run: Flag = False,
    as_json: Json = False,
) -> int:
    """Run rules and controllers over the same slip events, and print how well each does.

    Rows that the output folder has are not run again. The exit code is 1 if every run failed.

    Parameters
    ----------
    scenario
        Shipped scenarios or TOML files [default: all that ship but those of faults].
    rules
        Allocation rules [default: all that differ].
    controllers
        Readhesion controllers [default: cut-and-ramp, perturb-observe, and mpc on the first seed].
    seeds
        Number of seeds of every event; the first, 0, is the event as its file says [default: 5].
    out
        Folder for rows, table and figure.
    dry_run
        Say how many runs are to be made and about how long they take; make none.
    as_json
        Print JSON with every metric of every event instead.
    """
    from studies import compare as comparison
    from studies.plugins import try_own_parts
    from studies.scenario import load

    chosen = comparison.grid(
        [load(name) for name in _split(scenario)],
        _split(rules),
        _split(controllers),
        seeds,
    )
    study = comparison.study_of(chosen)
    if dry_run:
        return _forecast(study, out / "compare", None, None, work)
    for one in chosen.scenarios:
        _remark(one.remarks(one.event()))
    try_own_parts(chosen.rules, (*chosen.controllers, *chosen.slow))
    rows = _run(study, out / "compare", None, None, work)
    if as_json:
        print(json.dumps(comparison.as_json(rows), indent=1))
    else:
        found = comparison.standings(rows)
        print("\n".join([comparison.answer(found), *comparison.lines(found)]))
        shown = "" if out == Path("results") else f" --results {out}"
        print(f"{_counted(rows)} in {out / 'compare'}; next: readhesion report{shown}")
    return 0 if (rows["status"] == "ok").any() else FAILED


@app.command
def simulate(
    scenario: str,
    *,
    rule: str = "cooperative",
    controller: str = "perturb-observe",
    seed: Whole = 0,
    out: Path | None = None,
    figure: Path | None = None,
    every: Annotated[bool, Parameter("--all", negative=())] = False,
    as_json: Json = False,
) -> None:
    """Run one slip event and print its main metrics.

    Parameters
    ----------
    scenario
        Name of a shipped scenario, or a TOML file.
    rule
        Allocation rule.
    controller
        Readhesion controller.
    seed
        Seed of what the event draws; 0 is the event as its file says.
    out
        File for the recorded run (netCDF, .nc; MATLAB, .mat).
    figure
        File for a figure of it (pdf, png or svg).
    every
        Print every metric.
    as_json
        Print JSON with every metric instead.
    """
    from alloc.metrics import METRICS, evaluate
    from alloc.recording import save
    from alloc.rules import RULES
    from studies.compare import find_controller
    from studies.plugins import try_own_parts
    from studies.runs import recorded
    from studies.scenario import load

    event = load(scenario)
    RULES.find(rule)
    find_controller(controller)
    _check_whole("--seed", seed, 0, GREATEST_SEED)
    _check_file(out, ".nc", ".mat")
    _check_file(figure, ".pdf", ".png", ".svg")
    _remark(event.remarks(event.event(seed)))
    try_own_parts([rule], [controller])
    run = recorded(event, rule, controller, seed)
    values = evaluate(run)
    if out is not None:
        save(run, out)
    if figure is not None:
        import paper_figs
        from paper_figs.event import course

        paper_figs.save(lambda: course(run), figure)
    if as_json:
        about = {"scenario": event.name, "rule": rule, "controller": controller, "seed": seed}
        known = {name: None if one != one else one for name, one in values.items()}
        print(json.dumps({**about, "metrics": known}, indent=1))
        return
    shown = HEADLINES if not every else tuple(values)
    print(f"{event.name}: {rule}, {controller}, seed {seed}")
    for name in shown:
        told = "–" if values[name] != values[name] else f"{values[name]:.4g}"
        unit, meaning = METRICS[name].unit.removeprefix("1"), METRICS[name].description
        print(f"  {name:19}{told:>9} {unit:6}{meaning}"[: _width()])
    if not every:
        print(f"  {len(values) - len(shown)} more: --all")


HEADLINES = (
    "bound_use", "headroom", "over_delivery", "acceleration_ratio", "slip_time", "damage", "jerk_rms", "search_time",
)  # fmt: skip
"""Metrics that are printed of a run where not all are asked for."""


@app.command
def sweep(
    study: str,
    *,
    events: Whole | None = None,
    seed: Whole | None = None,
    out: Path = Path("results"),
    work: Work = ALONE,
    dry_run: Flag = False,
    as_json: Json = False,
) -> int:
    """Ask one question over many events, and print the answer; more events extend fewer.

    Parameters
    ----------
    study
        Name of a study, see `readhesion list studies`, or a Python file that has a STUDY.
    events
        Number of events [default: that of the study].
    seed
        Seed of what is drawn [default: that of the study].
    out
        Folder for rows, tables and figure.
    dry_run
        Say how many cells are to be run and about how long they take; run none.
    as_json
        Print JSON instead.
    """
    from studies.catalogue import find_study
    from studies.core import markdown
    from studies.statistics import statement_table

    found = find_study(study)
    _check_whole("--events", events, 1, MOST_EVENTS)
    _check_whole("--seed", seed, 0, GREATEST_SEED)
    folder = out / found.name
    if dry_run:
        return _forecast(found, folder, events, seed, work)
    rows = _run(found, folder, events, seed, work)
    good = rows[rows["status"] == "ok"]
    if good.empty:
        print(f"readhesion: all of {found.name} failed: {rows['reason'].iloc[0]}", file=sys.stderr)
        return FAILED
    tables = {"table": found.table(rows)}
    if found.statements is not None:
        tables["statements"] = statement_table(found.statements(rows))
    if as_json:
        print(json.dumps({name: json.loads(one.to_json(orient="records"))
                          for name, one in tables.items()}, indent=1))  # fmt: skip
    else:
        print("\n".join([found.question, "", *map(markdown, tables.values())]))
        print(f"{_counted(rows)}, tables and figure in {folder}")
    return 0


def _run(
    study: "Study", folder: Path, events: int | None, seed: int | None, work: Work
) -> "pd.DataFrame":
    """The rows of a study; they are written as they are, and as tables and figure."""
    from paper_figs import styled
    from studies.core import run_study, write_results

    rows = run_study(study, folder, events, seed, **work.options())
    with styled():
        write_results(study, rows, folder)
    return rows


def _forecast(
    study: "Study", folder: Path, events: int | None, seed: int | None, work: Work
) -> int:
    """Say what there is to do."""
    from studies.core import missing

    jobs = work.options()["jobs"]
    cells, lacking, seconds = missing(study, folder, events, seed)
    told = ""
    if lacking:
        told = ": no stored run says how long one takes"
        if seconds == seconds:
            minutes, rest = divmod(round(lacking * seconds / jobs), 60)
            told = f": about {minutes} min {rest} s in {jobs} processes"
    print(f"{cells} runs, of which {lacking} are to be made{told}")
    return 0


@app.command
def figures(
    *names: str,
    source: str | None = None,
    results: Path = Path("results"),
    out: Path = Path("figures"),
    kind: Annotated[Literal["pdf", "png", "svg"], Parameter("--format")] = "pdf",
    work: Work = ALONE,
    dry_run: Flag = False,
) -> None:
    """Draw the figures of the papers, each with its caption beside it.

    A figure of a study shows the rows of its last sweep. Where there are none, the sweep is run for a
    figure that is asked for by name or source; among all figures it is left out.

    Parameters
    ----------
    names
        Figures [default: all]; `readhesion list figures` names them.
    source
        Those of one document: jp5484215, jp4209318, rtri, readhesion_paper or jph07322414.
    results
        Folder of the studies' rows.
    out
        Folder for the figures.
    kind
        Format of the files.
    dry_run
        Say which sweeps are to be run, and about how long they take; draw nothing.
    """
    import paper_figs
    from studies import StudyError
    from studies.catalogue import find_study

    chosen = paper_figs.chosen_figures(names, source)
    lacking = {one.study for one in chosen.values()
               if one.study and not (results / one.study / "rows.parquet").is_file()}  # fmt: skip
    if not names and source is None:
        for study in sorted(lacking):
            command = study if study == "compare" else f"sweep {study}"
            print(f"left out for want of rows: those of readhesion {command}")
        chosen = {name: one for name, one in chosen.items() if one.study not in lacking}
        lacking = set()
    for study in sorted(lacking):
        if study == "compare":
            raise StudyError(
                f"there are no rows in {results / study}; run readhesion compare first"
            )
        found = find_study(study)
        if dry_run:
            print(f"{study}: ", end="")
            _forecast(found, results / study, None, None, work)
        else:
            _run(found, results / study, None, None, work)
    if dry_run:
        print(f"{len(chosen)} figures to draw")
        return
    for path in paper_figs.draw(chosen, results, out, kind):
        print(f"{path}: {chosen[path.stem].caption}"[: _width()])


@app.command(name="list")
def list_names(kind: str | None = None, *, as_json: Json = False) -> None:
    """Name what there is: scenarios, rules, controllers, curves, trains, studies, figures, metrics.

    Parameters
    ----------
    kind
        One of these kinds alone.
    as_json
        Print JSON instead.
    """
    from studies.catalogue import KINDS, find_kind

    found = {name: find_kind(name) for name in ([kind] if kind else KINDS) if name != "figures"}
    if kind in (None, "figures"):
        from paper_figs import all_figures

        found["figures"] = {name: one.caption for name, one in all_figures().items()}
    if as_json:
        print(json.dumps(found, indent=1))
        return
    for title, names in found.items():
        print(f"{title}:")
        for name, words in names.items():
            print(f"  {name:21} {words}"[: _width()])


@app.command
def check(name: str, *, as_json: Json = False) -> int:
    """Try the laws of rules, controllers or curves on one of them; the exit code is 1 if it breaks one.

    Parameters
    ----------
    name
        Name of the part, one of a plug-in too.
    as_json
        Print JSON instead.
    """
    from alloc.onboard.host import CONTROLLERS
    from alloc.plant.adhesion import CURVES
    from alloc.rules import RULES
    from alloc.rules.testing import verdict
    from alloc.testing import laws_of_part
    from studies import StudyError
    from studies.scenario import near

    known = [*RULES, *CONTROLLERS, *CURVES]
    if name not in known:
        raise StudyError(f"no rule, controller or curve is called {name!r}{near(name, known)}")
    part: Any = CURVES[name]() if name in CURVES else {**RULES, **CONTROLLERS}[name]
    found = [verdict(law, part) for law in laws_of_part(part)]
    if as_json:
        print(json.dumps([{"law": one.law.name, "kept": not one.fault, "fault": one.fault,
                           "counterexample": one.counterexample} for one in found], indent=1))  # fmt: skip
    else:
        for one in found:
            kept = "broken" if one.fault else "kept"
            print(f"{kept:7} {one.law.name:24} {one.law.meaning}"[: _width()])
            if one.fault:
                print(f"        {one.fault}; counterexample: {one.counterexample}")
    return FAILED if any(one.fault for one in found) else 0


@app.command
def report(
    *, results: Path = Path("results"), out: Path = Path("report.html"), events: Names = None
) -> None:
    """Write the last comparison as one page that opens offline: answer, tables, and replays of events.

    Parameters
    ----------
    results
        Folder of the comparison.
    out
        HTML file.
    events
        Scenarios that are replayed [default: the three in which rules differ most].
    """
    from studies.report import write

    _check_file(out, ".html")
    write(results / "compare", out, _split(events))
    print(f"{out}: {out.stat().st_size / 1e6:.1f} MB")


@app.command
def schema(kind: Literal["scenario", "train"] = "scenario", *, out: Path | None = None) -> None:
    """Print the JSON schema of a kind of file: every key with its unit, meaning and default.

    Parameters
    ----------
    kind
        What the file describes.
    out
        File to write instead.
    """
    from alloc.sources import write_whole
    from studies import scenario

    text = json.dumps(scenario.schema(kind), indent=1) + "\n"
    _check_file(out, ".json")
    if out is None:
        print(text, end="")
    else:
        write_whole(out, partial(Path.write_text, data=text, encoding="utf-8"))


@app.command
def new_scenario(name: str, *, like: str = "wet-start", out: Path = Path()) -> None:
    """Write a scenario file that runs as it stands, with the schema by which editors complete keys.

    Parameters
    ----------
    name
        Name of the scenario; the file is NAME.toml.
    like
        Scenario that it begins as: one that ships, or a TOML file.
    out
        Folder for both files.
    """
    from studies import scenario

    path = scenario.new_scenario(name, like, out)
    print(f"{path} runs as it stands: readhesion simulate {path}")


@app.command
def cite(*, as_bibtex: Annotated[bool, Parameter("--bibtex", negative=())] = False) -> None:
    """Print the publications that the project is based on.

    Parameters
    ----------
    as_bibtex
        As BibTeX.
    """
    from alloc.citations import CITATIONS

    for one in CITATIONS:
        print(one.bibtex if as_bibtex else f"{one.words} {one.address}".strip())


# what commands share


def _split(words: Sequence[str] | None) -> list[str]:
    from studies import StudyError

    found = [part.strip() for word in words or () for part in word.split(",")]
    if words is not None and not any(found):
        raise StudyError("an option for names has none; `readhesion list` has them")
    return list(dict.fromkeys(filter(None, found)))


def _check_whole(option: str, value: int | None, least: int, most: int) -> None:
    from studies import StudyError

    if value is not None and not least <= value <= most:
        raise StudyError(f"{option} {value}: give a whole number from {least} to {most}")


def _check_file(path: Path | None, *endings: str) -> None:
    """Raise `StudyError` where a file cannot be written; minutes would be spent in vain."""
    from studies import StudyError

    if path is None:
        return
    if path.suffix.lower() not in endings:
        raise StudyError(f"file {str(path)!r}: its ending must be {' or '.join(endings)}")
    if path.is_dir() or not os.access(path.absolute().parent, os.W_OK):
        raise StudyError(f"file {str(path)!r} cannot be written")


def _remark(remarks: Sequence[str]) -> None:
    for one in remarks:
        print(f"readhesion: {one}", file=sys.stderr)


def _counted(rows: "pd.DataFrame") -> str:
    bad = rows.loc[rows["status"] != "ok", "status"].value_counts()
    return f"{len(rows)} rows" + "".join(f", {n} {status}" for status, n in bad.items())


def _width() -> int:
    return os.get_terminal_size().columns if sys.stdout.isatty() else LONGEST


# the whole


@app.meta.default
def launch(
    *tokens: Annotated[str, Parameter(show=False, allow_leading_hyphen=True)],
    plugin: Annotated[list[Path] | None, Parameter(negative_iterable=())] = None,
) -> Any:
    """Run a command, after loading plug-ins.

    Parameters
    ----------
    plugin
        Python file that registers rules, controllers, curves or metrics, or a train as TOML; may be
        given again.
    """
    if plugin:
        from studies.plugins import load_plugins

        load_plugins(plugin)
    return app(tokens, exit_on_error=False, print_error=False, result_action="return_value")


def run(arguments: Sequence[str] | None = None) -> int:
    """Run the command; returns the exit code. What goes wrong is one line on stderr."""
    from alloc.errors import InputError, UnsoundRun, check_compiling
    from studies import WorkerLost

    said: set[str] = set()

    def warn(message: Warning | str, *_: object, **__: object) -> None:
        if str(message) not in said:  # each once
            said.add(str(message))
            _refuse(str(message))

    try:
        check_compiling()
        with warnings.catch_warnings():
            warnings.showwarning = warn
            code = app.meta(
                arguments, exit_on_error=False, print_error=False, result_action="return_value"
            )
        sys.stdout.flush()
        return code if isinstance(code, int) else 0
    except BrokenPipeError:
        # nobody reads on, as after `| head`: what is still to be printed goes nowhere
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return UNREAD
    except UnusedCliTokensError as error:
        words = ", ".join(map(repr, error.unused_tokens or ()))
        return _refuse(f"{words}: no option takes this; --help has the options")
    except (CycloptsError, InputError) as error:
        return _refuse(str(error))
    except OSError as error:
        named = error.filename is not None and error.strerror
        return _refuse(f"file {str(error.filename)!r}: {error.strerror}" if named else str(error))
    except (UnsoundRun, WorkerLost) as error:
        _refuse(str(error))
        return FAILED


def _refuse(message: str) -> int:
    line = " ".join(message.split())
    if len(line) > LONGEST:
        line = f"{line[: LONGEST // 2]} ... {line[-LONGEST // 2 :]}"
    print(f"readhesion: {line}", file=sys.stderr)
    return BAD_INPUT


_stopped: list[int] = []


def _stop(number: int, frame: object) -> None:
    _stopped.append(number)
    raise KeyboardInterrupt


def main() -> None:
    """Run the command and exit."""
    for stream in (sys.stdout, sys.stderr):
        if isinstance(stream, io.TextIOWrapper):
            stream.reconfigure(errors="replace")  # a terminal may know plain letters only
    for number in (signal.SIGINT, signal.SIGTERM):
        signal.signal(number, _stop)
    try:
        code = run()
    except BaseException:
        if not _stopped:
            raise
        code = TERMINATED if _stopped[0] == signal.SIGTERM else INTERRUPTED
        print("readhesion: stopped; finished rows are kept, the same command goes on", file=sys.stderr)  # fmt: skip
    for number in (signal.SIGINT, signal.SIGTERM):  # nothing is left to stop
        signal.signal(number, signal.SIG_IGN)
    sys.exit(code)


if __name__ == "__main__":
    main()
