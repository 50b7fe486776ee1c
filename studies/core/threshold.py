"""Thresholds of claims as data, and the record of which of them were set before the events of a seed were drawn."""

import hashlib
import json
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Literal, NamedTuple

from alloc.display import displayed
from alloc.sources import write_whole

FOLDER = "thresholds"
"""Folder of these records in a study's folder of results."""


@displayed
class Threshold(NamedTuple):
    """A threshold on a metric: of the rule under test, of another rule, or of the difference of two."""

    name: str
    """Claim and, after a space, the purpose; unique in its table."""
    metric: str
    """Column of the study's table."""
    direction: Literal["at least", "at most"]
    """Side of the threshold that is claimed, or on which an event bears on the claim."""
    value: float
    reason: str
    source: str
    rule: str = ""
    """Rule whose metric it is, if that is not the rule under test."""
    less: str = ""
    """Rule whose metric is subtracted, event by event."""


def fingerprint(table: Sequence[Threshold]) -> str:
    """Short SHA-256 of the content of a table of thresholds."""
    return hashlib.sha256(_text(table).encode()).hexdigest()[:16]


def freeze(folder: Path, seed: int, table: Sequence[Threshold]) -> None:
    """Store in `folder` the thresholds under which events of `seed` are drawn or judged; what is stored is never changed."""
    path = folder / FOLDER / f"seed-{seed}-{fingerprint(table)}.json"
    if path.exists():
        return
    path.parent.mkdir(parents=True, exist_ok=True)
    since = datetime.now(UTC).isoformat(timespec="seconds")
    content = {"seed": seed, "since": since, "thresholds": json.loads(_text(table))}
    write_whole(path, lambda aside: aside.write_text(json.dumps(content, indent=1), "utf-8"))


def frozen(folder: Path, seed: int) -> dict[str, str]:
    """Fingerprints of the thresholds that judged events of `seed` in `folder`, and since when, the first one first."""
    found = {
        path.stem.rpartition("-")[2]: str(json.loads(path.read_text(encoding="utf-8"))["since"])
        for path in (folder / FOLDER).glob(f"seed-{seed}-*.json")
    }
    return dict(sorted(found.items(), key=lambda item: item[1]))


def _text(table: Sequence[Threshold]) -> str:
    return json.dumps([row._asdict() for row in table], sort_keys=True, ensure_ascii=False)
