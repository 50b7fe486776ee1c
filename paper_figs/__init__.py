"""Figures of the papers, by topic and by source, over one style."""

import warnings
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from functools import partial
from importlib import import_module
from pathlib import Path

import matplotlib as mpl
import pandas as pd
from matplotlib import style as styles
from matplotlib.figure import Figure

from alloc.files import write_whole
from alloc.schema.errors import InputError
from paper_figs.figure_data import tabulate_figure
from paper_figs.style import Drawing
from studies import StudyError
from studies.files.toml_keys import suggest_name

MODULES = (
    "methods", "model", "event", "sharing", "limits_sizes", "solvers",
    "jp5484215", "jp4209318", "rtri", "readhesion_paper", "jph07322414",
)  # fmt: skip

SMALL = 0.7
"""Share of its usual width below which a figure's texts overlap, as their size stays."""


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


def find_missing(figures: dict[str, Drawing], results: Path) -> list[str]:
    """Studies whose rows these figures show and `results` does not have."""
    studies = sorted({drawing.study for drawing in figures.values() if drawing.study})
    return [study for study in studies if not (results / study / "rows.parquet").is_file()]


@contextmanager
def apply_style(style: str = "") -> Iterator[None]:
    """A context in which figures have the style of the papers, and over it that of a Matplotlib style file.

    `style`: a file, or a name, of this folder such as "latex" or of Matplotlib. Raises `StudyError` where there is none, and
    for what is wrong in a file.
    """
    with mpl.rc_context(fname=str(Path(__file__).with_name("readhesion.mplstyle"))):
        if style:
            shipped = Path(__file__).parent / f"{style}.mplstyle"
            path = shipped if shipped.is_file() else Path(style)
            if path.is_file():
                mpl.rcParams.update(_read_style(path))
            elif style in styles.available:
                styles.use(style)
            else:
                raise StudyError(
                    f"style {style!r}: no file, and no name; give a file, latex, or a name of Matplotlib's"
                )
        yield


def _read_style(path: Path) -> mpl.RcParams:
    """The settings of a style file; Matplotlib itself passes over lines that it does not know."""
    try:
        for number, line in enumerate(path.read_text("utf-8").splitlines(), 1):
            key = line.partition("#")[0].partition(":")[0].strip()
            if key and key not in mpl.rcParams:
                raise ValueError(f"line {number}: Matplotlib has no setting {key!r}")
        return mpl.rc_params_from_file(path, fail_on_error=True, use_default_template=False)
    except ValueError as error:
        raise StudyError(f"style {str(path)!r}: {error}") from error


def save(draw: Callable[[], Figure], path: Path) -> None:
    """Write a figure to a file of any ending that Matplotlib knows."""
    with apply_style():
        write_whole(path, draw().savefig)


def draw(
    figures: dict[str, Drawing],
    results: Path,
    out: Path,
    kind: str,
    style: str = "",
    width: float | None = None,
) -> Iterator[Path]:
    """Draw figures into a folder, each with its caption and its data beside it; their files as they are written.

    `results` has the rows of the studies that figures show, as a sweep writes them; `style`: see `apply_style`; `width`: of
    all [in], with heights in proportion. Raises `StudyError` at the end for those that cannot be drawn.
    """
    failed = []
    out.mkdir(parents=True, exist_ok=True)
    for name, drawing in figures.items():
        path = out / f"{name}.{kind}"
        rows = [pd.read_parquet(results / drawing.study / "rows.parquet")] if drawing.study else []
        with apply_style(style):
            try:
                figure = drawing.draw(*rows)
            except InputError as error:
                of = f" by the rows of {results / drawing.study}" if drawing.study else ""
                failed.append(f"figure {name!r}{of}: {error}")
                continue
            usual = figure.get_figwidth()
            if width is not None:
                figure.set_size_inches(width, figure.get_figheight() * width / usual)
                if width < SMALL * usual:
                    text = f"figure {name!r} is made for {usual:g} in; at {width:g} in its texts overlap"
                    warnings.warn(text, stacklevel=2)
            write_whole(path, figure.savefig)
            data = tabulate_figure(figure)
        caption = partial(Path.write_text, data=f"{drawing.caption}\n", encoding="utf-8")
        write_whole(path.with_suffix(".txt"), caption)
        if len(data):
            write_data = partial(data.to_csv, index=False, float_format="%.6g")
            write_whole(path.with_suffix(".csv"), write_data)
        yield path
    if failed:
        raise StudyError("; ".join(failed))
