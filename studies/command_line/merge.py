"""`readhesion merge`: results of several folders into one."""

from pathlib import Path

from studies.command_line.options import FilePath
from studies.command_line.terminal import console
from studies.files.study_error import StudyError
from studies.files.writable import check_place


def merge(*folders: FilePath, out: FilePath) -> None:
    """Unite tables and recorded runs of several folders, such as those of `--shard`, in one.

    Then run the same command on the united folder, without --shard: it computes nothing again and
    states the result. Where rows of the same run differ, a warning names the run, and the rows
    added later count.

    Parameters
    ----------
    folders
        Folders that earlier commands wrote to with --out.
    out
        Folder for the united results; it may be one of the given folders.
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
