"""Notebooks: each runs, prints what is stored in it, and is small. As a program this stores what they print."""

import re
from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient

PATHS = sorted(Path(__file__).parents[2].glob("docs/notebooks/*.ipynb"))


def run_notebooks(folder):
    """The notebooks by path with what their cells print now, but for progress on stderr; they run in `folder`.

    One kernel runs all, without the names of those before: to start one and import takes longer than they do.
    """
    notebooks = {path: nbformat.read(path, 4) for path in PATHS}
    whole = nbformat.v4.new_notebook()
    for notebook in notebooks.values():
        whole.cells += [nbformat.v4.new_code_cell("%reset -f"), *notebook.cells]
    options = {"startup_timeout": 600, "record_timing": False, "coalesce_streams": True}
    NotebookClient(whole, resources={"metadata": {"path": folder}}, **options).execute()
    for cell in code_cells(whole):
        cell.outputs = [shown for shown in cell.outputs if shown.get("name") != "stderr"]
    return notebooks


def code_cells(notebook):
    """Those that run."""
    return [cell for cell in notebook.cells if cell.cell_type == "code"]


def printed(notebook):
    """Of each cell what stands as text; of a figure only that it is drawn."""
    shown = [output for cell in code_cells(notebook) for output in cell.outputs]
    data = [output.get("data", {"text/plain": output.get("text")}) for output in shown]
    return ["figure" if "image/png" in kinds else kinds["text/plain"] for kinds in data]


def test_notebooks_print_what_is_stored(tmp_path):
    for path, notebook in run_notebooks(tmp_path).items():
        assert printed(notebook) == printed(nbformat.read(path, 4)), path.name


def test_notebooks_are_short_and_name_no_machine():
    for path in PATHS:
        code = "\n".join(cell.source for cell in code_cells(nbformat.read(path, 4)))
        assert sum(line.strip() != "" for line in code.splitlines()) < 60, path.name
        text = path.read_text("utf-8")
        assert len(text) < 150_000, path.name
        assert not re.search("/(tmp|home|root|work)/", text), path.name


if __name__ == "__main__":
    with TemporaryDirectory() as room:
        for path, notebook in run_notebooks(room).items():
            nbformat.write(notebook, path)
