"""`readhesion figures`: draw figures as PDF and PNG."""

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
    """Draw figures as PDF and PNG.

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
    check_place(results, "results", "--results")
    with progress() as on_row:
        written = gallery().draw_figures(names, out, results, count, on_row)
    for path in written:
        print(path)
