"""A share of a study's events for one job of many: independent jobs that do each event once."""

import re
from collections.abc import Sequence
from typing import NamedTuple, TypeVar

from studies.core.cell import Cell
from studies.core.job import Job
from studies.files.study_error import StudyError

Item = TypeVar("Item")
MOST_SHARDS = 100_000


class Shard(NamedTuple):
    """Share number `number`, counted from 1, of `shares` shares."""

    number: int
    shares: int

    def __str__(self) -> str:
        """As it is given."""
        return f"{self.number}/{self.shares}"

    def of(self, items: Sequence[Item]) -> Sequence[Item]:
        """Every n-th item of n shares: slow and quick ones spread over all shares."""
        return items[self.number - 1 :: self.shares]

    def of_cells(self, cells: Sequence[Cell]) -> list[Cell]:
        """The cells of this share's events; those of one event stay together."""
        events = [
            (cell.scenario.name, cell.seed) if isinstance(cell, Job) else cell.label
            for cell in cells
        ]
        mine = set(self.of(list(dict.fromkeys(events))))
        return [cell for cell, event in zip(cells, events, strict=True) if event in mine]


ALL = Shard(1, 1)


def read_shard(text: str | None) -> Shard:
    """The share that ``k/n`` names, all if nothing is said; raises `StudyError` unless k is one of 1 ... n."""
    if text is None:
        return ALL
    numbers = re.fullmatch(r"([0-9]{1,6})/([0-9]{1,6})", text.strip())
    shard = Shard(*map(int, numbers.groups())) if numbers else Shard(0, 0)
    if not 1 <= shard.number <= shard.shares <= MOST_SHARDS:
        raise StudyError(
            f"--shard {text[:50]!r}: give k/n, part k of n, such as 3/8; k from 1 to n, n at most {MOST_SHARDS}"
        )
    return shard
