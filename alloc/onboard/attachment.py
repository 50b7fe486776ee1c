"""Numbers that a controller in Python adds to the train's periodic telegrams, so that its units can exchange them.

Reports and limits are sent in any case (`alloc.onboard.reports`, `alloc.onboard.distribution`). The added numbers are part
of the same telegram. So they are counted once and are late or lost together with it, and a seed loses the same telegrams
whatever controls the train.
"""

from typing import NamedTuple

from alloc.plant.model import Floats


class Attachment(NamedTuple):
    """Numbers added to the telegrams of one direction, a row per unit. The leader reaches itself without a telegram."""

    told: Floats
    """Numbers of the next telegram, (units, numbers); they are sent until they are changed."""
    read: Floats
    """What the newest telegram that has arrived said, (units, numbers); nan before the first."""
    heard: Floats
    """When a telegram arrived last, lost contents or not, (units,) [s]."""


class AddedNumbers(NamedTuple):
    """How many numbers a controller adds to each report, and to each limit that is sent."""

    report: int = 0
    order: int = 0


NOTHING_ADDED = AddedNumbers()
