"""Figures of the papers, by topic and by source, over one style."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import AbstractContextManager
from functools import partial
from importlib import import_module
from pathlib import Path

import matplotlib as mpl
import pandas as pd
from matplotlib.figure import Figure

from alloc.files import write_whole
from paper_figs.style import Drawing
from studies import StudyError
from studies.files.toml_keys import suggest_name

MODULES = (
    "methods", "model", "event", "sharing", "limits_sizes", "solvers",
    "jp5484215", "jp4209318", "rtri", "readhesion_paper", "jph07322414",
)  # fmt: skip


def all_figures() -> dict[str, Drawing]:
    """Every figure by its name."""
    figures: dict[str, Drawing] = {}
    for name in MODULES:
        figures |= import_module(f"paper_figs.{name}").FIGURES
    return figures


def chosen_figures(names: Sequence[str], source: str | None) -> dict[str, Drawing]:
    """The figures of these names, or of a source; all if nothing is said. Raises `StudyError` where there is none."""
    figures = all_figures()
    for name in names:
        if name not in figures:
            raise StudyError(f"unknown figure {name!r}{suggest_name(name, figures)}")
    sources = sorted({drawing.source for drawing in figures.values() if drawing.source})
    if source is not None and source not in sources:
        raise StudyError(f"unknown source {source!r}{suggest_name(source, sources)}")
    return {
        name: drawing
        for name, drawing in figures.items()
        if name in (names or figures) and source in (None, drawing.source)
    }


def apply_style() -> AbstractContextManager[None]:
    """A context in which figures have the style of the papers."""
    return mpl.rc_context(fname=str(Path(__file__).with_name("readhesion.mplstyle")))


def save(draw: Callable[[], Figure], path: Path) -> None:
    """Write a figure to a file of any ending that Matplotlib knows."""
    with apply_style():
        write_whole(path, draw().savefig)


def draw(figures: dict[str, Drawing], results: Path, out: Path, kind: str) -> Iterator[Path]:
    """Draw figures into a folder, each with its caption as text beside it; their files as they are written.

    `results` has the rows of the studies that figures show, as a sweep writes them.
    """
    out.mkdir(parents=True, exist_ok=True)
    for name, drawing in figures.items():
        path = out / f"{name}.{kind}"
        rows = [pd.read_parquet(results / drawing.study / "rows.parquet")] if drawing.study else []
        save(partial(drawing.draw, *rows), path)
        caption = partial(Path.write_text, data=f"{drawing.caption}\n", encoding="utf-8")
        write_whole(path.with_suffix(".txt"), caption)
        yield path
