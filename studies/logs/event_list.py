"""The slips of a log as a table."""

from pathlib import Path
from typing import Any

import pandas as pd

from alloc.sources import write_whole
from studies.files.study_error import StudyError
from studies.files.writable import as_csv

COLUMNS = (
    "log", "axle", "car", "kind", "small", "start_s", "end_s", "cut", "largest_slip_ms", "slip_ratio", "onset_s",
    "onset_coefficient", "utilisation", "damage_kj",
)  # fmt: skip


def event_table(reports: list[dict[str, Any]]) -> pd.DataFrame:
    """A row per slip or slide of the logs whose `studies.logs.report.content` is given; small ones are marked."""
    rows = [
        {"log": report["log"], "small": small, **event}
        for report in reports
        for small, key in ((False, "events"), (True, "small_events"))
        for event in report[key]
    ]
    return pd.DataFrame(rows, columns=list(COLUMNS))


def write_events(reports: list[dict[str, Any]], path: Path) -> None:
    """Write the table as CSV; raises `StudyError` if that fails."""
    try:
        write_whole(
            path, lambda aside: aside.write_text(as_csv(event_table(reports)), "utf-8", newline="")
        )
    except OSError as error:
        raise StudyError(f"file {str(path)!r} cannot be written: {error.strerror}") from None
