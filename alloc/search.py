"""How long a readhesion controller searches for adhesion that was lost.

A unit is short while its target asks for more than its weakest axle finds: only then is there something to search for. An
episode is a shortage in which adhesion does not drop again. A search starts when the coefficient used falls below `FOUND` of
what the rail offers, and ends when it has come back to stay.
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import spans

Flags = NDArray[np.bool_]
Floats = NDArray[np.float64]

FOUND = 0.9
"""Share of the available adhesion from which on its peak counts as found."""
DROP = 0.1
"""Fall of the adhesion within `stay` instants, as a share of it, that starts a new search."""


def searches(
    short: Flags, used: Floats, available: Floats, stay: int, least: int
) -> Iterator[tuple[int, bool]]:
    """Of every search of a unit its length in instants, and whether adhesion was found. One search per episode.

    `short`: whether the unit is short; `used`, `available`: coefficients, (instants,) each. `stay`: instants for which the
    share used must stay above `FOUND`; an episode has `least` instants or more. The length is 0 where nothing was lost, and
    that of the rest of the episode where nothing was found.
    """
    for start, stop in _episodes(short, available, stay, least):
        lost = (used < FOUND * available)[start:stop]
        if not lost[:-stay].any():  # what is lost at the very end cannot be found in time
            yield 0, True
            continue
        losses = np.concatenate([[0], np.cumsum(lost[np.argmax(lost) :])])
        held = np.flatnonzero(losses[stay:] == losses[:-stay])
        yield int(held[0]) if held.size else losses.size - 1, held.size > 0


def _episodes(short: Flags, available: Floats, stay: int, least: int) -> Iterator[tuple[int, int]]:
    """First instant and first one after it; gaps shorter than `stay` are bridged."""
    fallen, bridged = np.zeros(short.size, dtype=bool), short.copy()
    fallen[stay:] = available[stay:] < (1.0 - DROP) * available[:-stay]
    drops = spans(fallen)[:, 0]
    for begin, end in spans(~short):
        bridged[begin:end] = begin > 0 and end < short.size and end - begin < stay
    for start, stop in spans(bridged):
        for first, end in pairwise([start, *drops[(drops > start) & (drops < stop)], stop]):
            if end - first >= least:
                yield first, end
