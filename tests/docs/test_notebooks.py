"""Notebooks: each runs, prints what is stored in it, and is small. As a program this stores what they print."""

from pathlib import Path
from tempfile import TemporaryDirectory

import nbformat
from nbclient import NotebookClient

PATHS = sorted(Path(__file__).parents[2].glob("docs/notebooks/*.ipynb"))


def run_notebook(path, folder):
    """The notebook with what its cells print now; it runs in `folder`."""
    notebook = nbformat.read(path, 4)
    where = {"metadata": {"path": folder}}
    client = NotebookClient(notebook, resources=where, startup_timeout=600, record_timing=False)
    return client.execute()


def printed(notebook):
    """Lines of each cell that stand as text; of a figure only that it is drawn. Progress on stderr is none of them."""
    lines = []
    for cell in notebook.cells:
        for output in cell.get("outputs", []):
            data = output.get("data", {})
            if output.get("name") != "stderr":
                lines += (
                    ["figure"]
                    if "image/png" in data
                    else output.get("text", data.get("text/plain", "")).splitlines()
                )
    return lines


def test_notebooks_print_what_is_stored(tmp_path):
    for path in PATHS:
        stored = nbformat.read(path, 4)
        assert printed(run_notebook(path, tmp_path)) == printed(stored), path.name


def test_notebooks_are_short_and_name_no_machine():
    for path in PATHS:
        code = [cell.source for cell in nbformat.read(path, 4).cells if cell.cell_type == "code"]
        assert len("\n".join(code).splitlines()) <= 60, path.name
        text = path.read_text("utf-8")
        assert len(text) < 150_000, path.name
        assert not [word for word in ("/tmp", "/home", "/root", "stderr") if word in text], (
            path.name
        )


if __name__ == "__main__":
    for path in PATHS:
        with TemporaryDirectory() as folder:
            notebook = run_notebook(path, folder)
        nbformat.write(notebook, path)
