"""The table as it was kept before: one file `runs.parquet` with its checksum in a list. It becomes a part of the new one."""

import hashlib
import io
from pathlib import Path

import pandas as pd
import pyarrow as pa

from studies.core.checked_file import Gone, read_present, set_aside
from studies.core.parts import KEPT, Parts, other_version

TABLE, SUMS, LOCK = "runs.parquet", "SHA256SUMS", ".lock"
SCHEMA = 1


def take_over(folder: Path, parts: Parts) -> None:
    """Make the single table of `folder` a part; of another program it is refused, and left alone."""
    path = folder / TABLE
    try:
        added, content = path.stat().st_mtime_ns, read_present(path)
    except (FileNotFoundError, Gone):
        return
    sums = (folder / SUMS).read_text(errors="replace") if (folder / SUMS).exists() else ""
    listed = [line.partition("  ")[0] for line in sums.splitlines() if line.endswith(f"  {TABLE}")]
    if listed and hashlib.sha256(content).hexdigest() not in listed:
        set_aside(path, "it is not as it was written")
        return
    try:
        table = pd.read_parquet(io.BytesIO(content))
    except Exception as error:  # whatever a damaged file makes the library raise
        set_aside(path, " ".join(str(error).split()) or type(error).__name__)
        return
    if not set(KEPT) <= set(table) or table.attrs.get("schema", SCHEMA) != SCHEMA:
        raise other_version(path)
    if len(table):
        parts.add(pa.Table.from_pandas(table, preserve_index=False), added)
    for name in (TABLE, SUMS, LOCK):
        (folder / name).unlink(missing_ok=True)
