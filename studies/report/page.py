"""The page itself: everything that it shows, put into one file."""

import json
import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Any

import pandas as pd

from alloc.onboard.host import CONTROLLERS
from alloc.rules import RULES
from studies.comparison.grid import Grid
from studies.comparison.summary import REFERENCE, SummaryLine, summarise
from studies.files.study_error import StudyError
from studies.report import origin
from studies.report.answer import sentences, standings
from studies.report.gains import Gain, as_values
from studies.report.packing import deflated
from studies.report.replay import PERIOD, Replay, drawing
from studies.report.result_table import Heading, headings, shown_columns, table_rows

HERE = Path(__file__).parent
SCRIPTS = (
    "unpack.js", "table.js", "plot_look.js", "headroom.js", "part.js", "train_plot.js", "force_plots.js", "replay.js",
    "start.js",
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
            f"a report needs the package {error.name!r}: pip install 'readhesion[report]'"
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
    controllers = tuple(dict.fromkeys((*grid.controllers, *grid.once)))
    place = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined,
        trim_blocks=True, lstrip_blocks=True,
    )  # fmt: skip
    place.globals.update(count=_count, signed=_signed, hint=_hint, repr=repr, zip=zip)
    seed = grid.seeds[0]
    return place.get_template("page.html").render(
        style=(HERE / "page.css").read_text(), program=_program(), plotly=_plotly(), content=_content(material, replays),
        lines=lines, headings=headings(columns), rows=rows, bad=[row for row in rows if row.status],
        standings=found, sentences=sentences(lines, found), reference=REFERENCE,
        events=origin.events(table, grid.scenarios), rules=_rules(grid),
        controllers={name: CONTROLLERS[name].meaning for name in controllers},
        facts=origin.facts(table, material.command), cited=origin.cited(grid), gains=material.gains,
        gain_controllers=list(dict.fromkeys(one.controller for one in material.gains)),
        any_drawn=any(one.drawn for one in material.gains),
        replayed={one.label for one in replays if one.run}, label=lambda line: _label(line, seed), seed=seed, period=PERIOD,
        left_out=len(material.replays) - len(replays), most=MOST_BYTES,
    )  # fmt: skip


def _content(material: Material, replays: Sequence[Replay]) -> str:
    """What the page's programs read, as JSON that ends no script."""
    content = {
        "seed": material.grid.seeds[0],
        "first": _first(material, replays),
        "rules": _rules(material.grid),
        "events": {
            one.name: {"title": one.title} | drawing(one.event(material.grid.seeds[0]).model)
            for one in dict.fromkeys(material.grid.scenarios)
        },
        "gains": as_values(material.gains),
        "replays": {one.label: one.content() for one in replays},
    }
    return json.dumps(content, allow_nan=False, separators=(",", ":")).replace("<", "\\u003c")


def _first(material: Material, replays: Sequence[Replay]) -> str:
    """The run that is shown first: where a rule that a train can carry out gains most."""
    shown = {one.label for one in replays if one.run}
    seed = material.grid.seeds[0]
    ranked = sorted(material.gains, key=lambda one: -one.gain)
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


def _signed(value: float, digits: int) -> str:
    return "–" if math.isnan(value) else f"{round(value, digits) + 0.0:+.{digits}f}"


def _hint(one: Heading) -> str:
    """What a heading says of itself."""
    unit = f" [{one.unit}]" if one.unit else ""
    return f"{one.metric}{unit}: {one.meaning}" + (f"; {one.better}" if one.better else "")
