"""Text of a figure as it stands on the page: what is too small, overlaps or is cut off."""

from collections.abc import Iterator
from itertools import combinations
from typing import NamedTuple

from matplotlib.axis import Tick
from matplotlib.figure import Figure
from matplotlib.text import Text
from matplotlib.transforms import Bbox

SLACK = 1.0
"""Overlap [points] of two boxes that is no overlap of letters: boxes have the height of the tallest letter."""


class Words(NamedTuple):
    """A piece of text, its size [points] and its box [points]."""

    text: str
    size: float
    box: Bbox


def words_of(figure: Figure) -> list[Words]:
    """Every piece of text that is seen, after the layout has been made."""
    figure.draw_without_rendering()
    to_points = 72.0 / figure.dpi
    found = []
    for text in _texts(figure):
        box = text.get_window_extent()
        if text.get_text().strip() and box.width > 0:
            points = Bbox(to_points * box.get_points())
            found.append(Words(text.get_text(), text.get_fontsize(), points))
    return found


def overlapping(words: list[Words]) -> list[tuple[str, str]]:
    """Pairs of pieces that overlap by more than `SLACK` both ways."""
    pairs = []
    for one, other in combinations(words, 2):
        both = Bbox.intersection(one.box, other.box)
        if both is not None and min(both.width, both.height) > SLACK:
            pairs.append((one.text, other.text))
    return pairs


def cut_off(figure: Figure, words: list[Words]) -> list[str]:
    """Pieces that reach beyond the page."""
    width, height = 72.0 * figure.get_size_inches()
    page = Bbox([[-SLACK, -SLACK], [width + SLACK, height + SLACK]])
    return [one.text for one in words if not _within(page, one.box)]


def _within(page: Bbox, box: Bbox) -> bool:
    return page.x0 <= box.x0 and page.y0 <= box.y0 and box.x1 <= page.x1 and box.y1 <= page.y1


def _texts(artist) -> Iterator[Text]:
    if not artist.get_visible():
        return
    if isinstance(artist, Text):
        yield artist
        return
    if hasattr(artist, "get_major_ticks"):  # an axis: ticks beyond its limits are not drawn
        ticks: list[Tick] = artist._update_ticks()
        for tick in ticks:
            yield from (t for t in (tick.label1, tick.label2) if t.get_visible())
        yield from (artist.label, artist.offsetText)
        return
    for child in artist.get_children():
        yield from _texts(child)
