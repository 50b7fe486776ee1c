"""A figure registers where it is written, and the commands find what draws by its entry point."""

import tomllib
from importlib.metadata import EntryPoint
from pathlib import Path

import pytest

import studies.core.gallery as loader
from paper_figs.drawing import FIGURES, Source, comparison, figure, made
from paper_figs.style import COLUMN, new_panels
from studies.core.gallery import GROUP, Gallery, gallery
from studies.core.plugins import VARIABLE, use_plugins
from studies.core.store import Store
from studies.files.study_error import StudyError

PYPROJECT = tomllib.loads((Path(__file__).parents[2] / "pyproject.toml").read_text())
PLUGIN = """
from paper_figs.drawing import figure
from paper_figs.drawing import made
from paper_figs.style import COLUMN, new_panels


@figure("plugged", "squares of the first numbers", made(range, 4))
def plugged(numbers):
    drawn, axes = new_panels(COLUMN, 2.0)
    axes.plot(numbers, [k**2 for k in numbers])
    return drawn
"""


@pytest.fixture(autouse=True)
def own_register(monkeypatch):
    """Figures that a test registers are gone after it."""
    parts = {name: FIGURES[name] for name in FIGURES}  # loads all of them first
    monkeypatch.setattr(FIGURES, "_parts", parts)
    monkeypatch.setattr(FIGURES, "_origins", dict(FIGURES._origins))


@pytest.fixture
def installed(monkeypatch):
    """The entry point that pyproject.toml states."""
    ((name, value),) = PYPROJECT["project"]["entry-points"][GROUP].items()
    points = {GROUP: [EntryPoint(name, value, GROUP)]}
    monkeypatch.setattr(loader, "entry_points", lambda group: points.get(group, []))
    return points


def test_what_is_installed_draws(installed):
    own = gallery()
    assert all(callable(getattr(own, name)) for name in vars(Gallery) if not name.startswith("_"))
    assert own.descriptions() == {name: one.description for name, one in FIGURES.items()}


def test_where_nothing_draws_it_is_said(installed):
    installed.clear()
    with pytest.raises(StudyError, match="nothing is installed that draws figures"):
        gallery()


def test_a_plugin_file_registers_a_figure(installed, tmp_path, monkeypatch):
    monkeypatch.setenv(VARIABLE, "")
    file = tmp_path / "squares.py"
    file.write_text(PLUGIN)
    use_plugins([file])
    assert gallery().descriptions()["plugged"] == "squares of the first numbers"
    (saved,) = gallery().draw_figures(["plugged"], tmp_path / "out", tmp_path / "results")
    assert [path.suffix for path in saved.files] == [".pdf", ".png", ".txt", ".csv"]
    assert saved.files[3].read_text().splitlines()[-1] == "1,line,,,,,3,9"
    assert saved.draft == ""
    gallery().draw_one("plugged", tmp_path / "own.png", [1, 2])
    assert (tmp_path / "own.png").read_bytes().startswith(b"\x89PNG")


def test_a_figure_is_drawn_from_what_it_needs(tmp_path):
    @figure("pair", "two needs and their order", made(pow, 2, 3), lambda source: source.jobs)
    def pair(power, jobs):
        drawn, axes = new_panels(COLUMN, 2.0)
        axes.set_title(f"{power} {jobs}")
        return drawn

    drawn = FIGURES["pair"].make(Source(Store(tmp_path), jobs=5))
    assert drawn.axes[0]._left_title.get_text() == "8 5"
    assert not pair.of_comparison
    assert figure("rows", "rows of a comparison", comparison)(pair.function).of_comparison


def test_a_need_is_a_function():
    with pytest.raises(StudyError, match="figure 'mine' needs 'comparison', which gives no data"):
        figure("mine", "a name in place of its data", "comparison")


def test_a_name_belongs_to_one_module():
    with pytest.raises(StudyError, match=r"'ladder' exists already, from paper_figs\.controllers"):
        figure("ladder", "another ladder")(lambda: None)


def test_an_unknown_name_brings_the_nearest_one(installed, tmp_path):
    with pytest.raises(StudyError, match="did you mean 'slip-event'"):
        gallery().draw_figures(["slipevent"], tmp_path, tmp_path)
