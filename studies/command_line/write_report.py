"""What goes into papers and other programs: `readhesion report`, `figures`, `cite`, `export-controller` and the like."""

import json
import sys
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from cyclopts import Parameter

from studies.command_line.options import (
    ALL_FAILED,
    GREATEST_SEED,
    MOST_SEEDS,
    FilePath,
    Names,
    Whole,
    check_whole,
    command_of,
    console,
    counted,
    process_count,
    progress,
    split_names,
)
from studies.files.study_error import StudyError
from studies.files.writable import PAGE, check_file, check_place, make_folder

if TYPE_CHECKING:
    from studies.scenario.scenario import Scenario


def write_report(
    *,
    scenario: Names = None,
    rules: Names = None,
    controllers: Names = None,
    seeds: Whole | None = None,
    out: FilePath = Path("report.html"),
    results: FilePath = Path("results"),
    jobs: Whole | None = None,
) -> int:
    """Write a comparison into one HTML file: answer, table, gain against headroom, replays, provenance, sources.

    The file opens in a browser without network, and stays below 15 MB. Rows that the results
    folder already holds are not run again. The exit code is 1 if no run is ok.

    Parameters
    ----------
    scenario
        Names of shipped scenarios or paths of TOML files [default: those of `readhesion compare`].
    rules
        Allocation rules [default: those of `readhesion compare`].
    controllers
        Readhesion controllers [default: cut-and-ramp, perturb-observe, and mpc on the first seed].
    seeds
        Number of seeds [default: 5, but 1 where nothing is drawn]; replays show the first.
    out
        HTML file; one that is there is replaced.
    results
        Folder of a comparison; what it lacks is run and kept there.
    jobs
        Number of processes [default: one per core].
    """
    from alloc.sources import write_whole
    from studies.comparison.summary import make_grid
    from studies.core.run import workers
    from studies.report.page import check_packages, gather, rendered
    from studies.scenario.scenario import default_scenarios, load_scenario

    count = process_count(jobs)
    if seeds is not None:
        check_whole("--seeds", seeds, 1, MOST_SEEDS)
    check_file(out, PAGE)
    check_place(results, "results", "--results", of_results=True)
    names = split_names(scenario)
    chosen = default_scenarios() if names is None else [load_scenario(name) for name in dict.fromkeys(names)]  # fmt: skip
    grid = make_grid(chosen, split_names(rules), split_names(controllers), seeds)
    check_packages()
    parts = {
        "scenario": scenario,
        "rules": rules,
        "controllers": controllers,
        "seeds": None if seeds is None else [str(seeds)],
    }
    command = command_of("report", **parts)
    with workers(count) as others, progress() as on_row:
        material = gather(grid, results, command, others, on_row)
    page = rendered(material)
    write_whole(out, lambda path: path.write_text(page, encoding="utf-8"))
    size = len(page.encode()) / 1e6
    console().print(
        f"{counted(material.table, 'runs')}, {len(material.replays)} replays, {size:.1f} MB: {out}"
    )
    return 0 if (material.table["status"] == "ok").any() else ALL_FAILED


# `readhesion figures`: draw figures, each with its caption and its data.


def figures(
    *names: str,
    out: FilePath = Path("figures"),
    results: FilePath = Path("results"),
    jobs: Whole | None = None,
) -> None:
    """Draw figures as PDF and PNG, with the caption (txt) and the numbers drawn (CSV) beside each.

    A figure from fewer events than its study has by default is marked as a draft. The
    draft, its caption and the terminal name the command that gives the full data. At the end
    it says how long each figure took, with the runs that it needed.

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
    from studies.core.gallery import gallery

    count = process_count(jobs)
    check_place(out, "figure")
    check_place(results, "results", "--results", of_results=True)
    with progress() as on_row:
        written = gallery().draw_figures(names, out, results, count, on_row)
    for one in written:
        for path in one.files:
            print(path)
    if written:
        slowest = sorted(written, key=lambda one: -one.seconds)
        told = ", ".join(f"{one.name} {one.seconds:.1f} s" for one in slowest)
        print(f"drawn in {sum(one.seconds for one in written):.1f} s: {told}", file=sys.stderr)
    drafts = [one for one in written if one.draft]
    for one in drafts:
        print(f"{one.name} is a {one.draft}", file=sys.stderr)
    if drafts and results != Path("results"):
        print(f"in full: add --out {results} to these commands", file=sys.stderr)


# `readhesion cite`: the documents that a run rests on, and which of its values have a source.


def cite(
    scenario: str,
    *,
    rule: str = "greedy",
    controller: str = "cut-and-ramp",
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
) -> None:
    """Print the documents that a run uses as BibTeX, and list which values are sourced or assumed.

    A document counts as used where the source of a part of the run names it: of the rule, the
    controller, the curve, the train, the scenario, and of what runs on board.

    Parameters
    ----------
    scenario
        Name of a shipped scenario or path of a TOML file.
    rule
        Allocation rule.
    controller
        Readhesion controller.
    as_json
        Print JSON instead of text.
    """
    from rich.markup import escape
    from rich.table import Table

    from studies.comparison.summary import check_names
    from studies.report.run_parts import documents_of, values_of
    from studies.scenario.scenario import load_scenario

    chosen = load_scenario(scenario)
    check_names([rule], [controller])
    path = Path(scenario)
    own = path.read_text(encoding="utf-8").splitlines() if path.is_file() else None
    used, values = documents_of(chosen, rule, controller), values_of(chosen, own)
    if as_json:
        content = {
            "documents": [
                {"key": one.document.key, "used_by": one.parts, "bibtex": one.document.bibtex}
                for one in used
            ],
            "values": [one._asdict() for one in values],
        }
        print(json.dumps(content, indent=2))
        return
    for one in used:
        print(f"% {', '.join(one.parts)}\n{one.document.bibtex}\n")
    table = Table(title="[bold]values[/bold]", title_justify="left")
    for column in ("of", "value", "", "what is said of it"):
        table.add_column(column, overflow="fold")
    for value in values:
        table.add_row(*(escape(word) for word in value))
    console().print(table)


# `readhesion export-controller`: the readhesion MPC of one unit as an object file for C; `export-fmu`: units of FMI.


def export_controller(scenario: str, *, unit: Whole, out: FilePath, target: str = "x86-64") -> None:
    """Write the readhesion MPC of one unit for C: controller.o, controller.h, README, and what they were made from.

    It is what the simulation runs, compiled for another processor: no allocation, no library but that of mathematics.

    Parameters
    ----------
    scenario
        Name of a shipped scenario or path of a TOML file, with the train and the settings `[onboard.mpc]`.
    unit
        Number of the traction unit, 1 = foremost.
    out
        Folder for the files.
    target
        Processor: x86-64, x86-64-v2, x86-64-v3, x86-64-v4 or aarch64. Higher levels are faster; only newer ones run them.
    """
    from alloc.onboard.host import unit_contexts
    from alloc.sources import write_whole
    from studies.scenario.scenario import load_scenario

    chosen = load_scenario(scenario)
    event = chosen.event()
    _check_unit(chosen, unit)
    check_place(out)
    from mpc.export import export_unit

    eq = event.equipment
    context = unit_contexts(event.model, eq, event.onboard, "mpc")[unit - 1]
    made = export_unit(context, context.settings, target, f"unit {unit} of {chosen.name}")
    make_folder(out)
    for name, content in made.contents.items():
        write_whole(out / name, partial(Path.write_bytes, data=content))
    console().print(f"{out} holds the controller, of {made.memory} bytes of static memory")


def export_fmu(scenario: str, *, out: FilePath, unit: Whole | None = None, seed: Whole = 0) -> None:
    """Write a unit of FMI 3.0 for co-simulation with Simulink and others: train and rail, or one unit's readhesion MPC.

    To make one takes Linux, a C compiler and the package fmpy (`pip install -e '.[fmi]'`); it runs without Python.

    Parameters
    ----------
    scenario
        Name of a shipped scenario or path of a TOML file.
    out
        File (.fmu).
    unit
        Number of the traction unit, 1 = foremost, whose controller it is [default: train and rail].
    seed
        Seed of the event's random draws, 0 or greater.
    """
    from alloc.sources import write_whole
    from studies.peers.fmi import controller_of, plant_of, write_fmu
    from studies.scenario.scenario import load_scenario

    chosen = load_scenario(scenario)
    check_whole("--seed", seed, 0, GREATEST_SEED)
    check_file(out, (".fmu",))
    if unit is not None:
        _check_unit(chosen, unit)
    made = plant_of(chosen, seed) if unit is None else controller_of(chosen, unit)
    write_whole(out, partial(write_fmu, made))
    console().print(
        f"{out}: {made.description}, {len(made.inputs)} inputs, {len(made.outputs)} outputs, steps of {made.step:g} s"
    )


# `readhesion export-qps`: quadratic programs of the MPC for a benchmark of solvers.


def export_qps(*, scenario: Names = None, out: FilePath) -> None:
    """Write quadratic programs of the readhesion MPC as a test set of qpbenchmark: readhesion_mpc.py and its data.

    For each scenario, some of one unit's and some of all units as one problem, from a run of each.

    Parameters
    ----------
    scenario
        Names of shipped scenarios or paths of TOML files [default: those of `readhesion compare`].
    out
        Folder for the files.
    """
    from studies.peers.qpbenchmark_set import write_test_set
    from studies.scenario.scenario import default_scenarios, load_scenario

    names = split_names(scenario)
    chosen = default_scenarios() if names is None else [load_scenario(name) for name in dict.fromkeys(names)]  # fmt: skip
    for one in chosen:
        _check_unit(one, 1)
    check_place(out)
    make_folder(out)
    number = write_test_set(chosen, out)
    console().print(f"{number} programs: {out}")


def _check_unit(chosen: "Scenario", unit: int) -> None:
    """Raise `StudyError` where the scenario's train has no traction unit of this number."""
    units = chosen.event().model.layout.units
    if units == 0:
        raise StudyError(
            f"scenario {chosen.name!r}: its train has no motors, so there is no controller to export"
        )
    check_whole("--unit", unit, 1, units)
