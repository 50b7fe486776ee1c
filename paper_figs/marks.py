"""What a figure says of itself: how many events it shows, that it is a draft, and why a panel has nothing in it."""

from textwrap import wrap
from weakref import WeakKeyDictionary

from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.text import Text

from paper_figs.drawn_data import rows_of
from paper_figs.palette import DARK, DRAFT
from paper_figs.style import NOTE

LINE = 0.115
"""Height of a line under a figure [inches]; they are added to the figure's height."""
LETTER = 0.052
"""Width that a letter of these lines needs [inches]."""
NOTHING = "nothing to draw:\nnone of these events\nbears on it"
"""In a panel without data."""
_STRIPS: "WeakKeyDictionary[Figure, list[tuple[Text, float]]]" = WeakKeyDictionary()
"""Lines under a figure, with the height [inches] that they take, from the top."""


def mark_as_draft(drawn: Figure, words: str) -> None:
    """Add a strip under the figure that says what the draft lacks; panels keep their size."""
    add_strip(drawn, words, DRAFT)


def add_strip(drawn: Figure, words: str, colour: str = DARK) -> None:
    """Add a line of `words` under the figure, below those that it has; panels keep their size."""
    width, height = drawn.get_size_inches()
    lines = wrap(words, int(width / LETTER), break_on_hyphens=False)  # a command stays in one piece
    strip = LINE * (len(lines) + 0.5)
    engine = drawn.get_layout_engine()
    below, over = _room_of_legends(drawn)
    drawn.set_size_inches(width, height + strip)
    whole = height + strip
    line = drawn.text(
        0.5, 0.0, "\n".join(lines), ha="center", va="center", fontsize=NOTE, color=colour
    )
    line.set_in_layout(False)
    strips = _STRIPS.setdefault(drawn, [])
    strips.append((line, strip))
    taken = 0.0
    for text, own in reversed(strips):
        text.set_position((0.5, (taken + 0.5 * own) / whole))
        taken += own
    low = taken / whole
    above = (0.0, low, 1.0, 1.0 - low)
    if isinstance(engine, ConstrainedLayoutEngine):
        # a legend with an anchor is left out of the layout: its room is kept here
        engine.set(rect=(0.0, low + below / whole, 1.0, 1.0 - low - (below + over) / whole))
    for legend in drawn.legends:  # those of subfigures move with them
        legend.set_bbox_to_anchor(above, transform=drawn.transFigure)


def _room_of_legends(drawn: Figure) -> tuple[float, float]:
    """Heights that legends outside of the panels take, below and above them [inches]."""
    engine = drawn.get_layout_engine()
    if not isinstance(engine, ConstrainedLayoutEngine):
        return 0.0, 0.0
    drawn.draw_without_rendering()
    room = {"lower": 0.0, "upper": 0.0}
    for legend in drawn.legends:
        side = legend._outside_loc  # type: ignore[attr-defined]  # no public name says it
        if side in room:
            high = legend.get_window_extent().height / drawn.dpi + 2.0 * engine.get()["h_pad"]
            room[side] = max(room[side], high)
    return room["lower"], room["upper"]


def say_where_nothing_is_drawn(drawn: Figure) -> None:
    """Write into every panel without data why it is empty; bounds and shades alone are no data."""
    for axes in drawn.axes:
        if axes.get_visible() and axes.axison and axes.get_label() != "<colorbar>" and _empty(axes):
            note = axes.text(
                0.5, 0.5, NOTHING, transform=axes.transAxes, ha="center", va="center", color=DARK, fontsize=NOTE,
            )  # fmt: skip
            note.set_in_layout(False)


def _empty(axes: Axes) -> bool:
    """Whether a panel shows no number but that of a bound, and no words either."""
    return not axes.texts and all(row["kind"] == "bound" for row in rows_of(axes))
