"""`readhesion figures`: draw figures, each with its caption and its data."""

import sys
from pathlib import Path

from studies.command_line.options import FilePath, Whole, process_count
from studies.command_line.terminal import progress
from studies.files.writable import check_place


def figures(
    *names: str,
    out: FilePath = Path("figures"),
    results: FilePath = Path("results"),
    jobs: Whole | None = None,
) -> None:
    """Draw figures as PDF and PNG, with the caption (txt) and the numbers drawn (CSV) beside each.

    A figure from fewer events than its study has by default is marked as a draft. The
    draft, its caption and the terminal name the command that gives the full data.

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
    drafts = [one for one in written if one.draft]
    for one in drafts:
        print(f"{one.name} is a {one.draft}", file=sys.stderr)
    if drafts and results != Path("results"):
        print(f"in full: add --out {results} to these commands", file=sys.stderr)
