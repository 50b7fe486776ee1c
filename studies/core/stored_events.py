"""What a folder holds of a sweep already: figures are drawn from that, and nothing is run twice."""

from collections.abc import Callable
from itertools import count
from pathlib import Path

import pandas as pd

from studies.core.code_version import code_hash
from studies.core.job import Key
from studies.core.store import Store


def stored_events(
    folder: Path, part: Callable[[Key], object], wanted: Callable[[int], set[object]]
) -> int:
    """Number of events, counted from the first, that a folder holds in full under the present code.

    `part` of a row's key is compared with what is `wanted` of event k.
    """
    code = code_hash()
    done = {part(key) for key in Store(folder).keys() if key.code_hash == code}  # noqa: SIM118
    return next(k for k in count() if not wanted(k) <= done)


def stored_table(folder: Path, name: str, code: str) -> pd.DataFrame | None:
    """The whole table `name` of a folder; None if there is none, or if any row's `code_hash` is not `code`."""
    path = Path(folder) / name
    if not path.exists():
        return None
    table = pd.read_parquet(path)
    return table if set(table["code_hash"].dropna()) == {code} else None
