"""The page itself: everything that it shows, put into one file."""

import hashlib
import inspect
import json
import os
import platform
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from functools import lru_cache, partial
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pandas as pd

from alloc.citations import Citation, uses
from alloc.metrics import METRICS
from alloc.onboard.host import CONTROLLERS
from alloc.plant.adhesion import CURVES
from alloc.recording import provenance
from alloc.rules import RULES
from studies.comparison.summary import EFFORT, REFERENCE, Grid, SummaryLine, summarise
from studies.core.cell import OnRow
from studies.core.own_parts import try_parts
from studies.core.plugins import plugin_modules
from studies.core.run import Workers, run_cells
from studies.core.statement import LEAST_SHOWN
from studies.core.store import Store
from studies.files.study_error import StudyError
from studies.report.answer import (
    Gain,
    Heading,
    Standing,
    as_values,
    drawn_gains,
    forest,
    gains_of,
    headings,
    sentences,
    shown_columns,
    signed,
    standings,
    table_rows,
    told_interval,
)
from studies.report.replay import PERIOD, Replay, ReplayCell, deflated, drawing, replays_of
from studies.report.run_parts import module_of_controller, module_text, train_text
from studies.scenario.scenario import SCENARIOS, Scenario

# Where a page comes from: command, versions, hashes, seeds and machine, and the publications behind what was run.

PLANT = ("alloc.plant.laws", "alloc.plant.rail", "alloc.onboard.laws")
"""Modules whose laws every run obeys."""
TIMED = ("rule_time", "controller_time", "controller_median", "controller_p99")
"""Metrics that measure how long something took to compute, which no other run repeats."""


@dataclass(frozen=True)
class EventOrigin:
    """A scenario of the page."""

    name: str
    title: str
    hash: str
    seeds: tuple[int, ...]
    runs: int
    curve: str


def facts(table: pd.DataFrame, command: str) -> dict[str, str]:
    """Data that a reader needs to make the same page: name -> value."""
    found = provenance()
    versions = [
        f"{name.removeprefix('version_')} {value}"
        for name, value in found.items()
        if name.startswith("version_")
    ]
    good = int((table["status"] == "ok").sum())
    cores = len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count()
    return {
        "command": command,
        "made": f"{datetime.now(UTC):%Y-%m-%d %H:%M} UTC",
        "versions": ", ".join([*versions, f"plotly {version('plotly')}"]),
        "git revision": found["git_revision"],
        **({"plug-ins": ", ".join(plug_ins)} if (plug_ins := plugin_modules()) else {}),
        "machine": f"{platform.platform()}, {_processor()}, {cores} cores in use",
        "runs": f"{len(table)} runs, {'all' if good == len(table) else f'of which {good}'} count",
        "hash of the code": ", ".join(sorted(set(table["code_hash"]))),
        "hash of the rows": hash_of_rows(table),
    }


def hash_of_rows(table: pd.DataFrame) -> str:
    """Hash of the cells, their status and their metrics, except for those that measure computing time."""
    names = sorted(name for name in METRICS if name in table and name not in TIMED)
    digest = hashlib.sha256()
    for row in table[["cell", "status", *names]].itertuples(index=False):
        digest.update(repr(tuple(row)).encode())
    return digest.hexdigest()[:16]


def events(table: pd.DataFrame, scenarios: Sequence[Scenario]) -> list[EventOrigin]:
    """The scenarios with their hashes and seeds."""
    found = []
    for one in scenarios:
        rows = table[table["scenario"] == one.name]
        seeds = tuple(sorted({int(seed) for seed in rows["seed"]}))
        found.append(EventOrigin(one.name, one.title, one.hash(), seeds, len(rows), one.rail.curve.kind))  # fmt: skip
    return found


def cited(grid: Grid) -> dict[Citation, list[str]]:
    """The publications that the parts of a comparison name in their files: publication -> the parts."""
    texts = {"the plant": " ".join(map(module_text, PLANT))}
    for name in grid.rules:
        texts[f"rule {name}"] = f"{RULES[name].description} {module_text(RULES.origin(name))}"
    for name in dict.fromkeys((*grid.controllers, *grid.once)):
        texts[f"controller {name}"] = module_text(module_of_controller(name))
    for one in grid.scenarios:
        texts[f"event {one.name}"] = _scenario_text(one)
        texts[f"train {one.train}"] = train_text(one.event().model.train)
        kind = one.rail.curve.kind
        texts[f"curve {kind}"] = inspect.getdoc(CURVES[kind]) or ""
    for module in sorted({METRICS.origin(name) for name in METRICS}):
        texts[f"metrics of {module.rpartition('.')[2]}"] = module_text(module)
    return uses(texts)


def _scenario_text(one: Scenario) -> str:
    """What a scenario's file says beside its keys."""
    known = SCENARIOS.get(one.name)
    return known.read_text() if isinstance(known, Path) else f"{one.title} {one.description}"


def _processor() -> str:
    """What the system calls its processor."""
    info = Path("/proc/cpuinfo")
    if info.exists():
        for line in info.read_text().splitlines():
            if line.startswith("model name"):
                return line.partition(":")[2].strip()
    return platform.processor() or platform.machine()


HERE = Path(__file__).parent
SCRIPTS = (
    "unpack.js", "download.js", "table.js", "plot_look.js", "headroom.js", "part.js", "train_plot.js", "force_plots.js",
    "replay.js", "start.js",
)  # fmt: skip
MOST_BYTES = 15_000_000
"""Size of a page [bytes], which mail and most readers take; replays beyond it are left out."""
SYMBOLS = {
    "o": "circle", "s": "square", "^": "triangle-up", "v": "triangle-down", "<": "triangle-left", ">": "triangle-right",
    "D": "diamond", "d": "diamond-tall", "P": "cross", "X": "x", "*": "star", "h": "hexagon", "H": "hexagon2",
    "p": "pentagon", "8": "octagon",
}  # fmt: skip
"""Matplotlib's markers -> those of plotly."""


@dataclass(frozen=True)
class Material:
    """What a page is made of."""

    grid: Grid
    table: pd.DataFrame
    """Rows of the comparison."""
    replays: Sequence[Replay]
    """The most wanted first."""
    gains: Sequence[Gain]
    command: str


def check_packages() -> None:
    """Raise `StudyError` where a package that a page needs is not installed."""
    try:
        import jinja2  # noqa: F401
        import plotly  # noqa: F401
    except ImportError as error:
        raise StudyError(
            f"a report needs the package {error.name!r}: pip install -e '.[report]'"
        ) from None


def rendered(material: Material, most: int = MOST_BYTES) -> str:
    """The page as HTML of at most `most` bytes; raises `StudyError` where it is larger even without replays."""
    bare = _render(material, [])
    room = most - len(bare.encode())
    if room < 0:
        raise StudyError(
            f"the report would have {len(bare.encode()) / 1e6:.1f} MB without any replay, {most / 1e6:.0f} MB are allowed; "
            "name fewer events, rules or controllers"
        )
    kept = []
    for one in material.replays:
        room -= len(json.dumps({one.label: one.content()})) + 200  # the button beside its row
        if room < 0:
            break
        kept.append(one)
    return _render(material, kept)


def _render(material: Material, replays: Sequence[Replay]) -> str:
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    grid, table = material.grid, material.table
    lines = summarise(table)
    columns = shown_columns(lines)
    rows = table_rows(lines, columns)
    found = standings(lines, {one.name for one in grid.scenarios if not one.draws()})
    best = max((one for one in found if one.ranked), key=lambda one: one.gain, default=None)
    controllers = tuple(dict.fromkeys((*grid.controllers, *grid.once)))
    place = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    place.globals.update(
        count=_count, signed=signed, told=told_interval, hint=_hint, repr=repr, zip=zip
    )
    seed = grid.seeds[0]
    return place.get_template("page.html").render(
        style=(HERE / "page.css").read_text(), program=_program(), plotly=_plotly(),
        content=_content(material, replays, best),
        lines=lines, headings=headings(columns), rows=rows, bad=[row for row in rows if row.status],
        standings=found, forest=forest(found), effort=EFFORT, least=LEAST_SHOWN,
        sentences=sentences(lines, found), reference=REFERENCE,
        events=events(table, grid.scenarios), rules=_rules(grid),
        controllers={name: CONTROLLERS[name].meaning for name in controllers},
        facts=facts(table, material.command), cited=cited(grid), gains=material.gains,
        gain_controllers=list(dict.fromkeys(one.controller for one in material.gains)),
        any_drawn=any(one.drawn for one in material.gains),
        replayed={one.label for one in replays if one.run}, label=lambda line: _label(line, seed), seed=seed, period=PERIOD,
        left_out=len(material.replays) - len(replays), most=MOST_BYTES,
    )  # fmt: skip


def _content(material: Material, replays: Sequence[Replay], best: Standing | None) -> str:
    """What the page's programs read, as JSON that ends no script."""
    content = {
        "seed": material.grid.seeds[0],
        "first": _first(material, replays, best),
        "rules": _rules(material.grid),
        "events": {
            one.name: {"title": one.title} | drawing(one.event(material.grid.seeds[0]).model)
            for one in dict.fromkeys(material.grid.scenarios)
        },
        "gains": as_values(material.gains),
        "replays": {one.label: one.content() for one in replays},
    }
    return json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _first(material: Material, replays: Sequence[Replay], best: Standing | None) -> str:
    """The run that is shown first: of the best rule, the event in which it gains most; else of any that is carried out."""
    shown = {one.label for one in replays if one.run}
    seed = material.grid.seeds[0]
    mine = (best.rule, best.controller) if best is not None else None
    ranked = sorted(material.gains, key=lambda one: ((one.rule, one.controller) != mine, -one.gain))
    for one in ranked:
        name = f"{one.scenario}/{one.rule}/{one.controller}"
        if f"{name}/{seed}" in shown and not RULES[one.rule].needs_truth:
            return name
    jobs = [job.label for job in material.grid.jobs() if job.seed == seed]
    return next((name for name in jobs if name in shown), jobs[0]).rpartition("/")[0]


def _rules(grid: Grid) -> Mapping[str, Mapping[str, Any]]:
    return {
        name: {
            "colour": RULES[name].colour, "symbol": SYMBOLS.get(RULES[name].marker, "circle"),
            "description": RULES[name].description,
        }
        for name in grid.rules
    }  # fmt: skip


def _label(line: SummaryLine, seed: int) -> str:
    return f"{line.scenario}/{line.rule}/{line.controller}/{seed}"


def _program() -> str:
    return "\n".join((HERE / name).read_text() for name in SCRIPTS)


@lru_cache(maxsize=1)
def _plotly() -> str:
    """The plotting library, deflated: a third of its size."""
    from plotly.offline import get_plotlyjs

    return deflated(get_plotlyjs())


def _count(number: int, thing: str) -> str:
    return f"{number} {thing}{'' if number == 1 else 's'}"


def _hint(one: Heading) -> str:
    """What a heading says of itself."""
    unit = f" [{one.unit}]" if one.unit else ""
    return f"{one.metric}{unit}: {one.meaning}" + (f"; {one.better}" if one.better else "")


# All data of a page, from the results folder, or run where it lacks them.

REPLAYS = "replays"
"""Folder of the results in which what is replayed is kept."""


def gather(
    grid: Grid, results: Path, command: str, workers: Workers | None = None, on_row: OnRow | None = None
) -> Material:  # fmt: skip
    """The comparison and a replay of each of its lines on the first seed; runs that `results` lacks are made and stored."""
    table = run_cells(
        grid.jobs(),
        Store(results),
        workers,
        on_row=on_row,
        check=partial(try_parts, grid.rules, grid.controllers),
    )
    cells = wanted(grid)
    rows = run_cells(cells, Store(results / REPLAYS), workers, on_row=on_row)
    replays = replays_of(cells, rows)
    controllers = (*grid.controllers, *grid.once)
    gains = [*gains_of(table, replays), *drawn_gains(results, grid.rules, controllers)]
    return Material(grid, table, replays, gains, command)


def wanted(grid: Grid) -> list[ReplayCell]:
    """Runs to replay: on the first seed, rule by rule, so that what a full page leaves out are whole rules."""
    first = [job for job in grid.jobs() if job.seed == grid.seeds[0]]
    return [ReplayCell(job) for job in sorted(first, key=lambda job: grid.rules.index(job.rule))]
