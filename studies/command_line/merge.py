"""`readhesion merge`: results of several folders into one."""

from pathlib import Path

from studies.command_line.options import FilePath
from studies.command_line.terminal import console
from studies.files.study_error import StudyError
from studies.files.writable import check_place


def merge(*folders: FilePath, out: FilePath) -> None:
    """Unite tables and recorded runs of several folders, such as those of `--shard`, in one.

    The command that was shared out, on the united folder without --shard, computes nothing again
    and states the result. Where rows of the same run differ, a warning names it, and those added
    later count.

    Parameters
    ----------
    folders
        Folders that were an --out.
    out
        Folder that holds all of it in the end; it may be one of them.
    """
    if not folders:
        raise StudyError("merge: give the folders to unite")
    check_place(out)
    for folder in folders:
        if not Path(folder).is_dir():
            raise StudyError(f"folder {str(folder)!r} does not exist")
    from studies.core.union import unite

    counts = unite(folders, out)
    console().print(f"{out} holds {counts.cells} cells and {counts.runs} recorded runs")
