"""Notebooks: every cell runs; `make docs` runs them in a kernel of their own and puts their output into the site."""

import ast
import io

import matplotlib as mpl
import pytest
from matplotlib.figure import Figure

from alloc.rules import RULES
from paper_figs.drawing import FIGURES
from studies.core.plugins import VARIABLE
from tests.docs.pages import PAGES, ROOT, blocks

CELL = "{code-cell} python"
NOTEBOOKS = sorted({one.page for one in blocks(CELL)})


def test_notebooks_are_five_and_say_what_runs_them():
    assert len(NOTEBOOKS) == 5
    for page in NOTEBOOKS:
        text = (ROOT / page).read_text(encoding="utf-8")
        kernel = "kernelspec:\n  display_name: Python 3\n  name: python3\n"  # Jupytext asks for both names
        assert text.startswith(f"---\nfile_format: mystnb\n{kernel}---\n")
        assert {one.language for one in blocks() if one.page == page} == {CELL}
        assert page.removeprefix("docs/notebooks/") in PAGES["docs/notebooks/index.md"]


def run_cells(cells):
    """Run cells one after the other, as a kernel does; returns what the last lines of the cells are."""
    names, shown = {"__name__": "notebook"}, []
    for cell in cells:
        tree = ast.parse(cell)
        last = tree.body.pop() if isinstance(tree.body[-1], ast.Expr) else None
        exec(compile(tree, "cell", "exec"), names)
        if last is not None:
            shown.append(eval(compile(ast.Expression(last.value), "cell", "eval"), names))
    return [one for one in shown if one is not None]


@pytest.mark.slow
@pytest.mark.parametrize("page", NOTEBOOKS)
def test_every_cell_runs_and_shows_something(page, monkeypatch):
    monkeypatch.chdir(ROOT / "docs/notebooks")
    monkeypatch.setenv(VARIABLE, "")
    for registry in (RULES, FIGURES):
        list(registry)  # those that ship are registered
        monkeypatch.setattr(registry, "_parts", dict(registry._parts))
        monkeypatch.setattr(registry, "_origins", dict(registry._origins))
    shown = run_cells(one.code for one in blocks(CELL) if one.page == page)
    assert shown
    for one in shown:
        assert isinstance(one, Figure | list) or hasattr(one, "_repr_html_"), type(one)
        if isinstance(one, Figure):
            one.savefig(io.BytesIO(), format="png")


def test_a_cell_that_fails_is_noticed():
    with pytest.raises(ZeroDivisionError):
        run_cells(["a = 1", "a / 0"])


def test_a_figure_shows_in_a_notebook_without_pyplot():
    interactive = pytest.importorskip(
        "IPython.core.interactiveshell", reason="IPython: pip install -e '.[docs]'"
    )
    from paper_figs.style import show_figures

    shell = interactive.InteractiveShell.instance()
    try:
        show_figures()
        shown, _ = shell.display_formatter.format(FIGURES["allocation-bars"](("greedy", "exact")))
        assert shown["image/png"]
    finally:
        interactive.InteractiveShell.clear_instance()


def test_figures_are_drawn_outside_of_pyplot():
    drawn = FIGURES["allocation-bars"](("greedy",))
    assert isinstance(drawn, Figure)
    assert mpl.rcParams["font.size"] == mpl.rcParamsDefault["font.size"], "the style ends with it"
