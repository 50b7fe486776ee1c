"""`readhesion schema`: every key of the project's own files, for editors and for readers."""

import json
from functools import partial
from pathlib import Path
from typing import Annotated, Literal

from cyclopts import Parameter

from studies.command_line.options import FilePath
from studies.files.study_error import StudyError
from studies.files.writable import check_file


def schema(
    kind: Literal["scenario", "train", "line"] | None = None,
    *,
    reference: Annotated[bool, Parameter(negative=())] = False,
    out: FilePath | None = None,
) -> None:
    """Print the JSON schema of a kind of file: every key with its unit, default, meaning and source.

    Parameters
    ----------
    kind
        What the file describes [default: scenario].
    reference
        Print the reference page of the keys of all kinds of files instead, in Markdown.
    out
        File to write instead (.json, with --reference .md); one that exists is replaced.
    """
    from alloc.sources import write_whole
    from studies.scenario.file_kinds import reference_page, schema_of_kind

    if reference and kind is not None:
        raise StudyError("--reference has the keys of all kinds of files; leave out the kind")
    check_file(out, (".md",) if reference else (".json",))
    if reference:
        text = reference_page()
    else:
        text = json.dumps(schema_of_kind(kind or "scenario"), indent=2, ensure_ascii=False) + "\n"
    if out is None:
        print(text, end="")
    else:
        write_whole(out, partial(Path.write_text, data=text, encoding="utf-8"))
