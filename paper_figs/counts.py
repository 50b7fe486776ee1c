"""How many events stand behind the means of a figure, and what else it says of itself in one line."""

from collections.abc import Iterable
from weakref import WeakKeyDictionary

from matplotlib.axes import Axes
from matplotlib.figure import Figure

from studies.core.statement import CONFIDENCE, Interval

_COUNTS: "WeakKeyDictionary[Figure, set[int]]" = WeakKeyDictionary()
"""Numbers of events of the means in a figure."""
_REMARKS: "WeakKeyDictionary[Figure, list[str]]" = WeakKeyDictionary()
"""Further sentences of a figure."""


def counted(axes: Axes, found: Iterable[Interval]) -> None:
    """Note that a panel shows these means, so that their figure says how many events are behind them."""
    _COUNTS.setdefault(_whole(axes), set()).update(one.count for one in found if one.count)


def remark(axes: Axes, words: str) -> None:
    """A sentence that the figure says of itself beside its counts."""
    _REMARKS.setdefault(_whole(axes), []).append(words)


def remarks(drawn: Figure, events: str) -> str:
    """What a figure says of itself: how many events, named by `events`, its means have; and its further sentences."""
    counts = sorted(_COUNTS.get(drawn, ()))
    said = [_of_means(counts, events)] if counts else []
    return " ".join(said + _REMARKS.get(drawn, []))


def _of_means(counts: list[int], events: str) -> str:
    least, most = counts[0], counts[-1]
    if most == 1:
        return f"Each mark is one of the {events} alone, without an interval."
    number = f"{most}" if least == most else f"{least} to {most}"
    alone = " A mark without a bar has one alone." if least == 1 else ""
    return f"Means with {100 * CONFIDENCE:g} % intervals over n = {number} {events}.{alone}"


def _whole(axes: Axes) -> Figure:
    """The figure that all panels belong to, also those of subfigures."""
    found = axes.get_figure(root=True)
    assert isinstance(found, Figure)
    return found
