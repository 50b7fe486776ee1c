"""What a controller in Python lets the units tell each other: numbers added to the train's periodic telegrams.

Reports and limits are sent in any case (`alloc.onboard.reports`, `alloc.onboard.distribution`). What a controller adds is
part of the same telegram. So it is counted once, it is late or lost with the telegram, and a seed loses the same telegrams
whatever controls the train.
"""

from typing import NamedTuple

from alloc.plant.model import Floats


class Attachment(NamedTuple):
    """Numbers added to the telegrams of one direction, a row per unit. The leader tells itself without a telegram."""

    told: Floats
    """What the next telegram will say, (units, numbers); it is sent until it is changed."""
    read: Floats
    """What the newest telegram that has arrived said, (units, numbers); nan before the first."""
    heard: Floats
    """When a telegram arrived last, lost contents or not, (units,) [s]."""


class AddedNumbers(NamedTuple):
    """How many numbers a controller adds to each report, and to each limit that is sent."""

    report: int = 0
    order: int = 0


NOTHING_ADDED = AddedNumbers()
