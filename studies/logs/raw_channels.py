"""Content of a log file before interpretation: channels by name, with the units that it states."""

from collections.abc import Callable
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True)
class RawChannel:
    """One channel of a file."""

    name: str
    unit: str
    """As the file states it, "" where it does not."""
    load: Callable[[], NDArray[Any]]
    """Its values: numbers, time stamps or texts."""
    clock: Floats | None = None
    """Its own instants [s]; None: those of the rows."""


@dataclass
class Recording:
    """A file of a log; a channel that is taken is gone, so that a long log is not held twice."""

    source: str
    channels: dict[str, RawChannel]
    notes: list[str] = field(default_factory=list)
    """What was done to read it."""

    @property
    def units(self) -> dict[str, str]:
        """Unit by name, "" where the file states none."""
        return {name: channel.unit for name, channel in self.channels.items()}

    def take(self, name: str) -> NDArray[Any]:
        """The values of a channel, and forget them."""
        return self.channels.pop(name).load()


def recording_of(
    table: pd.DataFrame, source: str, units: dict[str, str] | None = None
) -> Recording:
    """A table in memory as a recording."""

    def loader(position: int) -> Callable[[], NDArray[Any]]:
        return lambda: table.iloc[:, position].to_numpy()

    names = [str(name) for name in table.columns]
    stated = units or {}
    return Recording(
        source,
        {name: RawChannel(name, stated.get(name, ""), loader(k)) for k, name in enumerate(names)},
    )
