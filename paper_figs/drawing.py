"""Figures by name: each registers with a sentence and the data that it needs; drawn from a folder of results into files.

This is what the entry point `gallery` offers to the commands, see `studies.core.gallery.Gallery`.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from inspect import getdoc
from pathlib import Path
from string import ascii_lowercase
from textwrap import wrap
from time import perf_counter
from typing import Any, Generic, Literal, NamedTuple, ParamSpec

import matplotlib as mpl
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine

from alloc.display import displayed
from alloc.recording import load
from alloc.registry import Registry
from paper_figs.drawn_data import rows_of
from paper_figs.saving import MOVING, Legend, Origin, data_of, save_figure, save_image
from paper_figs.style import DARK, NOTE, STYLE_FILE, remarks
from studies.comparison.summary import DEFAULT_SEEDS, KEPT_RUNS, default_grid, default_rules
from studies.core.cell import OnRow, key_of
from studies.core.drawn_events import COMPARED
from studies.core.gallery import Asked, Saved
from studies.core.job import Job, simulate_job
from studies.core.own_parts import called, is_own
from studies.core.run import run_cells
from studies.core.store import Store
from studies.core.study import Study, find_study, study_folder
from studies.files.study_error import StudyError
from studies.report.replay import drawing
from studies.scenario.scenario import SCENARIOS, default_scenarios, load_scenario

Data = ParamSpec("Data")
DRAFT = "#b00000"
"""Colour of the line that marks a draft."""
LINE, LETTER = 0.115, 0.052
"""Height of a line under a figure and width that a letter of it needs [inches]."""
MOST_LETTERS = 9
"""Panels that have letters; of more, rows and columns have names."""
NOTHING = "nothing to draw:\nnone of these events\nbears on it"
"""In a panel without data."""


class Source:
    """Data of a comparison, of its recorded runs and of studies; computed only when a figure asks."""

    def __init__(
        self,
        store: Store,
        table: pd.DataFrame | None = None,
        jobs: int = 1,
        on_row: OnRow | None = None,
        asked: Asked | None = None,
    ) -> None:
        self.store = store
        self.asked = asked
        """How the table of the comparison was asked for, where this is known."""
        self.jobs = jobs
        self.on_row = on_row
        self._table = table
        self.origins: list[Origin] = []
        """Of the data that were given since it was emptied."""

    @cached_property
    def table(self) -> pd.DataFrame:
        """Rows of the comparison that succeeded, of the default one where none is given."""
        table = self._table
        if table is None:
            cells = default_grid().jobs()
            table = run_cells(cells, self.store, self.jobs, KEPT_RUNS, on_row=self.on_row)
        return table[table["status"] == "ok"]

    def run(self, scenario: str, rule: str, controller: str, seed: int = 0) -> xr.Dataset:
        """A recorded run of a shipped scenario, from its file or anew."""
        job = Job(load_scenario(scenario), rule, controller, seed)
        self.origins.append(of_job(job))
        path = self.store.run_path(key_of(job))
        return simulate_job(job) if path is None else load(path)

    def study(
        self, name: str, least: int | None, instead: Callable[[], pd.DataFrame] | None = None
    ) -> pd.DataFrame:
        """Table of a study: of the events that the results hold, `least` or more [default: the study's own number].

        Where they hold none, `instead` gives the table if there is one.
        """
        study, folder = find_study(name), study_folder(self.store.folder, name)
        held = study.held(folder)
        if not held and instead is not None:
            self.origins.append(of_study(study, None))
            return instead()
        events = max(held, study.default_events if least is None else least)
        self.origins.append(of_study(study, events))
        return study.run(folder, events, 0, self.jobs, self.on_row)


Need = Callable[[Source], Any]
"""What a figure needs, stated where it registers: gives its data."""


def comparison(source: Source) -> pd.DataFrame:
    """Need: the rows of the comparison."""
    if not source.table.empty:
        source.origins.append(of_comparison(source.table, source.asked))
    return source.table


def recorded(scenario: str, rule: str, controller: str) -> Need:
    """Need: a recorded run of a shipped scenario."""
    return lambda source: source.run(scenario, rule, controller)


def study(
    name: str, least: int | None = None, instead: Callable[[], pd.DataFrame] | None = None
) -> Need:
    """Need: a study's table, see `Source.study`."""
    return lambda source: source.study(name, least, instead)


def made(make: Callable[..., Any], *arguments: Any) -> Need:
    """Need: data that are made on the spot, without the results."""
    return lambda source: make(*arguments)


def of_study(study: Study, events: int | None) -> Origin:
    """Origin of the first so many events of a study; None where a few stand in for them."""
    whole = study.default_events
    shown = f"{'a few' if events is None else events} of {max(whole, events or 0)} events"
    return Origin(f"readhesion sweep {study.name}", shown, (0,), events is None or events < whole)


def of_job(job: Job, command: str = "") -> Origin:
    """Origin of a recorded run, made by `command`; without one the scenario is told by its name."""
    name = job.scenario.name
    words = f"{name} --rule {job.rule} --controller {job.controller} --seed {job.seed}"
    return Origin(command or f"readhesion simulate {words}", f"one run of {name}", (job.seed,))


def of_comparison(table: pd.DataFrame, asked: Asked | None = None) -> Origin:
    """Origin of the rows of a comparison; a draft where events that draw something have fewer seeds than by default.

    Unless it is known how they were `asked` for, a command is told that names the same parts.
    """
    seeds = tuple(sorted({int(seed) for seed in table["seed"]}))
    scenarios = list(dict.fromkeys(table["scenario"]))
    if asked is None:
        random = any(name not in SCENARIOS or load_scenario(name).draws() for name in scenarios)
        asked = Asked(_command_of(table, scenarios), not random or len(seeds) >= DEFAULT_SEEDS)
    events = f"{len(scenarios)} event{'s' * (len(scenarios) != 1)}"
    shown = f"{events} of up to {len(seeds)} seeds" if len(seeds) > 1 else f"{events} of 1 seed"
    if not asked.whole:
        shown = f"{events}, {len(seeds)} of {DEFAULT_SEEDS} seeds each"
    return Origin(asked.command, shown, seeds, not asked.whole)


def _command_of(table: pd.DataFrame, scenarios: Sequence[str]) -> str:
    """The comparison of these parts over all seeds; parts that are those of the default are left out."""
    words = ["readhesion compare"]
    if set(scenarios) != {one.name for one in default_scenarios()}:
        words += ["--scenario", *scenarios]
    rules, controllers = (list(dict.fromkeys(table[part])) for part in ("rule", "controller"))
    if set(rules) != set(default_rules()):
        words += ["--rules", *rules]
    if set(controllers) != {*COMPARED, "mpc"}:
        words += ["--controllers", *controllers]
    return " ".join(words)


class Drawn(NamedTuple):
    """A figure and its caption."""

    figure: Figure
    legend: Legend


@displayed
@dataclass(frozen=True)
class FigureEntry(Generic[Data]):
    """A figure; called with its data, it is drawn in the project's style."""

    name: str
    function: Callable[Data, Figure]
    description: str
    """What it shows, in one line."""
    needs: tuple[Need, ...]
    """Data, each of which gives one argument of the function."""
    events: str = "events"
    """What its means are over, in the plural."""

    def __call__(self, *data: Data.args, **named: Data.kwargs) -> Figure:
        """The figure of these data."""
        with mpl.rc_context(fname=STYLE_FILE):
            drawn = self.function(*data, **named)
            if not isinstance(drawn, Figure):
                kind = type(drawn).__name__
                raise StudyError(
                    f"figure {self.name!r} returns a {kind}; return the figure that new_panels gives"
                )
            say_where_nothing_is_drawn(drawn)
            letter_panels(drawn)
            if said := remarks(drawn, self.events):
                add_strip(drawn, said)
            return drawn

    @property
    def of_comparison(self) -> bool:
        """Whether it shows the rows of a comparison, and is drawn together with one."""
        return comparison in self.needs

    @property
    def legend(self) -> Legend:
        """Caption without the source of the data: the figure's line and its function's docstring."""
        return Legend(self.name, self.description, " ".join((getdoc(self.function) or "").split()))

    def make(self, source: Source) -> Figure:
        """The figure of the data in `source`, marked as a draft where these are incomplete."""
        return self.drawn(source).figure

    def drawn(self, source: Source) -> Drawn:
        """The same with its caption."""
        source.origins.clear()
        data = [need(source) for need in self.needs]
        return self.of_data(data, source.origins)

    def of_data(self, data: Sequence[Any], origins: Sequence[Origin] = ()) -> Drawn:
        """The figure of these data, with its caption."""
        if is_own(FIGURES, self.name):
            drawn = called(FIGURES, self.name, lambda: self(*data))  # type: ignore[call-arg]
        else:
            drawn = self(*data)  # type: ignore[call-arg]
        caption = f"{self.legend.caption} {remarks(drawn, self.events)}".strip()
        legend = replace(self.legend, caption=caption, origins=tuple(origins))
        if legend.draft:
            with mpl.rc_context(fname=STYLE_FILE):
                add_strip(drawn, legend.draft, DRAFT)
        return Drawn(drawn, legend)


FIGURES: Registry[FigureEntry[Any]] = Registry(
    "figure", "readhesion.figures", StudyError, package="paper_figs"
)
"""Every figure by name."""


def figure(
    name: str, description: str, *needs: Need, events: str = "events"
) -> Callable[[Callable[Data, Figure]], FigureEntry[Data]]:
    """Register a function as the figure `name`; it takes what each of `needs` gives. `events`: what means are over.

    Raises `StudyError` for a need that is no function, such as a name of data.
    """
    for need in needs:
        if not callable(need):
            raise StudyError(
                f"figure {name!r} needs {need!r}, which gives no data; give comparison, study(...) or recorded(...) of "
                "paper_figs.drawing"
            )

    def register(function: Callable[Data, Figure]) -> FigureEntry[Data]:
        entry = FigureEntry(name, function, description, needs, events)
        FIGURES.register(name, entry, origin=function.__module__)
        return entry

    return register


def add_strip(drawn: Figure, words: str, colour: str = DARK) -> None:
    """Add a line of `words` under the figure, below those that it has; panels keep their size."""
    width, height = drawn.get_size_inches()
    lines = wrap(words, int(width / LETTER), break_on_hyphens=False)  # a command stays in one piece
    strip = LINE * (len(lines) + 0.5)
    strips = [text for text in drawn.texts if text.get_gid() == "strip"]
    engine = drawn.get_layout_engine()
    below, over = _room_of_legends(drawn)
    whole = height + strip
    drawn.set_size_inches(width, whole)
    for text in strips:
        text.set_y((text.get_position()[1] * height + strip) / whole)
    drawn.text(
        0.5, 0.5 * strip / whole, "\n".join(lines), ha="center", va="center", fontsize=NOTE, color=colour, gid="strip"
    ).set_in_layout(False)  # fmt: skip
    taken = strip + sum(LINE * (text.get_text().count("\n") + 1.5) for text in strips)
    low = taken / whole
    if isinstance(engine, ConstrainedLayoutEngine):
        # a legend with an anchor is left out of the layout: its room is kept here
        engine.set(rect=(0.0, low + below / whole, 1.0, 1.0 - low - (below + over) / whole))
    for legend in drawn.legends:  # those of subfigures move with them
        legend.set_bbox_to_anchor((0.0, low, 1.0, 1.0 - low), transform=drawn.transFigure)


def _room_of_legends(drawn: Figure) -> tuple[float, float]:
    """Heights that legends outside of the panels take, below and above them [inches]."""
    engine = drawn.get_layout_engine()
    if not isinstance(engine, ConstrainedLayoutEngine):
        return 0.0, 0.0
    drawn.draw_without_rendering()
    room = {"lower": 0.0, "upper": 0.0}
    for legend in drawn.legends:
        side = legend._outside_loc  # type: ignore[attr-defined]  # no public name says it
        if side in room:
            high = legend.get_window_extent().height / drawn.dpi + 2.0 * engine.get()["h_pad"]
            room[side] = max(room[side], high)
    return room["lower"], room["upper"]


def say_where_nothing_is_drawn(drawn: Figure) -> None:
    """Write into every panel without data why it is empty; bounds and shades alone are no data."""

    def empty(axes: Axes) -> bool:
        return not axes.texts and all(row["kind"] == "bound" for row in rows_of(axes))

    for axes in drawn.axes:
        if axes.get_visible() and axes.axison and axes.get_label() != "<colorbar>" and empty(axes):
            axes.text(
                0.5, 0.5, NOTHING, transform=axes.transAxes, ha="center", va="center", color=DARK, fontsize=NOTE,
            ).set_in_layout(False)  # fmt: skip


def letter_panels(drawn: Figure) -> None:
    """Put (a), (b), ... before the titles of two to `MOST_LETTERS` panels; a figure that names its parts itself stays."""
    panels = [
        one
        for one in drawn.axes
        if one.get_visible() and one.axison and one.get_label() != "<colorbar>"
    ]
    sides: tuple[Literal["left", "center", "right"], ...] = ("left", "center", "right")
    own = [
        *(one.get_title(side) for one in panels for side in sides),
        *(one.get_ylabel() for one in panels),
    ]
    if not 2 <= len(panels) <= MOST_LETTERS or any(words.startswith("(a)") for words in own):
        return
    for letter, one in zip(ascii_lowercase, panels, strict=False):
        side = next((side for side in sides if one.get_title(side)), sides[0])
        texts: Any = one  # no public name gives a title as the text that it is
        text = {"left": texts._left_title, "center": one.title, "right": texts._right_title}[side]
        text.set_text(f"({letter}) {one.get_title(side)}".strip())


def descriptions() -> dict[str, str]:
    """Every figure by name, and what it shows."""
    return {name: entry.description for name, entry in FIGURES.items()}


def draw_figures(
    names: Sequence[str],
    out: str | Path,
    results: str | Path,
    jobs: int = 1,
    on_row: OnRow | None = None,
) -> list[Saved]:
    """Draw figures by name, or all without names, into `out`, each with its caption and its data.

    What `results` lacks is run first, in `jobs` processes. `on_row` is told of each run, and of each figure that is done.
    Raises `StudyError` for a name that does not exist.
    """
    chosen = [FIGURES.find(name) for name in names or FIGURES]
    source = Source(Store(results), None, jobs, on_row)
    written = []
    for done, entry in enumerate(chosen, 1):
        began = perf_counter()
        saved = _saved(entry, source, Path(out))
        written.append(saved._replace(seconds=perf_counter() - began))
        if on_row is not None:
            on_row(f"figure {entry.name}", done, len(chosen))
    return written


def draw_comparison(
    table: pd.DataFrame, store: Store, out: str | Path, asked: Asked | None = None
) -> list[str]:
    """Draw the figures of a comparison from its `table` into `out`; returns their names (none if every row failed).

    `asked`: how the table was asked for, where this is known.
    """
    source = Source(store, table, asked=asked)
    if source.table.empty:
        return []
    chosen = {name: entry for name, entry in FIGURES.items() if entry.of_comparison}
    for entry in chosen.values():
        _saved(entry, source, Path(out))
    return list(chosen)


def _saved(entry: FigureEntry[Any], source: Source, out: Path) -> Saved:
    drawn, legend = entry.drawn(source)
    return Saved(entry.name, tuple(save_figure(drawn, out / entry.name, legend)), legend.draft)


def draw_one(
    name: str, path: str | Path, *data: Any, origins: Sequence[Origin] = (), command: str = ""
) -> None:
    """Draw a figure from `data` into one file; its ending (pdf, png, svg) gives the format.

    `origins`: of the data; or the `command` that gives all of them, where no seed is in it.
    The ending gif is for a figure that moves. Nothing is written beside it: a log that is drawn may well be NAME.csv itself.
    """
    given = [Origin(command, "as given", ())] if command else origins
    drawn, legend = FIGURES[name].of_data(data, given)
    try:
        with mpl.rc_context(fname=STYLE_FILE):
            save_image(drawn, Path(path), legend, data_of(drawn))
    except ValueError as error:
        raise StudyError(f"figure {str(path)!r}: {error}") from None


def figure_of_run(run: xr.Dataset) -> str:
    """Name of the figure that shows a run over time; of a train without motors, what its slide protection does."""
    return "slip-event" if run.sizes["unit"] else "slide-control"


def draw_run(run: xr.Dataset, path: str | Path, job: Job | None = None, command: str = "") -> None:
    """Draw a recorded run over time as `draw_one` does, see `figure_of_run`.

    As GIF it moves, for which `job` has to say of what event it is; `command` made it.
    """
    origins = [] if job is None else [of_job(job, command)]
    if Path(path).suffix.lower() != MOVING:
        return draw_one(figure_of_run(run), path, run, origins=origins)
    if job is None or not run.sizes["unit"]:
        lacks = "its train has no motor" if job else "it is not known of what event it is"
        raise StudyError(
            f"figure {str(path)!r}: {lacks}, so this run is not shown as {MOVING}; take .png"
        )
    train = drawing(job.scenario.event(job.seed).model)
    return draw_one("slip-replay", path, train, run, origins=origins)
