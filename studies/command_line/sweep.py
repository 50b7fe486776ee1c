"""`readhesion sweep`: one question over many random events."""

import json
from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from studies.command_line.options import (
    ALL_FAILED,
    EVERYTHING,
    GREATEST_SEED,
    MOST_EVENTS,
    FilePath,
    Settings,
    Whole,
    Work,
    check_whole,
    settings_of,
)  # fmt: skip
from studies.command_line.terminal import console, counted, of_shard, progress
from studies.files.writable import check_place


def sweep(
    name: str,
    *,
    events: Whole | None = None,
    out: FilePath = Path("results"),
    seed: Whole = 0,
    work: Work = EVERYTHING,
    as_json: Annotated[bool, Parameter("--json", negative=())] = False,
    **own: Settings,
) -> int:
    """Ask one question over many random events, and state what the answer is.

    Rows that the output folder already holds are not run again. The exit code is 1 if no run is ok.

    Parameters
    ----------
    name
        Sweep; `readhesion list` names them.
    events
        Number of random events [default: the sweep's own]; more of them extend fewer.
    out
        Folder of results; the sweep's table (parquet) goes to sweeps/NAME in it.
    seed
        Seed of the events, 0 or greater.
    as_json
        Print JSON instead of text.
    own
        Options of the sweep itself, by the arguments of its cells: `readhesion list` names them.
    """
    from studies.core.collection import find_study, study_folder
    from studies.core.shard import read_shard
    from studies.core.statement_report import about, frozen_words, printed, rows_of, shown_rows

    chosen = find_study(name)
    count = chosen.default_events if events is None else events
    check_whole("--events", count, 1, MOST_EVENTS)
    check_whole("--seed", seed, 0, GREATEST_SEED)
    settings = settings_of(chosen, own)
    shard = read_shard(work.shard)
    check_place(out, of_results=True)
    folder = study_folder(out, name)
    with work.workers() as workers, progress() as on_row:
        table = chosen.run(folder, count, seed, workers, on_row, shard=shard, **settings)
    failed = int((table["status"] != "ok").sum()) if "status" in table else 0
    all_failed = failed == len(table) > 0
    found = [] if all_failed or work.shard else chosen.statements(table)
    if as_json:
        content = about(chosen, count, seed, folder, len(table), failed, **settings) | {
            "shard": work.shard
        }
        content["statements"] = [statement.content() for statement in found]
        if chosen.shown:
            content["rows"] = rows_of(table)
        print(json.dumps(content, indent=2, allow_nan=False))
    else:
        screen = console()
        if chosen.shown:
            screen.print(shown_rows(table, chosen.shown))
        for item in printed(found):
            screen.print(item)
        if words := frozen_words(chosen, folder, seed, **settings):
            screen.print(words)
        screen.print(f"{counted(table, 'rows')}{of_shard(work)}; tables in {folder}")
    return ALL_FAILED if all_failed else 0
