"""`readhesion figures`: draw figures as PDF and PNG."""

from pathlib import Path

from studies.command_line.options import Whole, process_count
from studies.command_line.terminal import progress


def figures(
    *names: str,
    out: Path = Path("figures"),
    results: Path = Path("results"),
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
    from studies.files.study_error import unknown

    known = gallery().descriptions()
    for name in names:
        if name not in known:
            raise unknown("figure", name, known)
    count = process_count(jobs)
    with progress() as on_row:
        written = gallery().draw_figures(names or tuple(known), out, results, count, on_row)
    for path in written:
        print(path)
