"""How many events of a sweep a folder holds already: figures are drawn from those, and run no others."""

from collections.abc import Callable
from itertools import count
from pathlib import Path

from studies.code_version import code_hash
from studies.job import Key
from studies.store import Store


def stored_events(
    folder: Path, part: Callable[[Key], object], wanted: Callable[[int], set[object]]
) -> int:
    """Number of events, counted from the first, that a folder holds in full under the present code.

    `part` of a row's key is compared with what is `wanted` of event k.
    """
    code = code_hash()
    done = {part(key) for key in Store(folder).keys() if key.code_hash == code}  # noqa: SIM118
    return next(k for k in count() if not wanted(k) <= done)
