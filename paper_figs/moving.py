"""Figures that move: they show one instant, as any other figure, and all of them in a GIF."""

import io
from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from matplotlib.figure import Figure
from PIL import Image

PIXELS = 200
"""Of a GIF per inch: a column has 700."""


class Motion(NamedTuple):
    """What moves in a figure."""

    show: Callable[[int], None]
    """Makes the figure show the instant of this number."""
    instants: int
    rate: int
    """Instants that are shown in a second."""
    still: int
    """The instant at which the figure stands."""


class MovingFigure(Figure):
    """A figure that knows its other instants."""

    motion: Motion

    def save_motion(self, path: Path, comment: str = "") -> None:
        """Write all instants as a GIF that repeats, with a comment inside; afterwards the figure stands as before."""
        motion = self.motion
        self.draw_without_rendering()
        self.set_layout_engine("none")  # nothing jumps while numbers change
        first, *rest = [self._picture(instant) for instant in range(motion.instants)]
        motion.show(motion.still)
        first.save(
            path, format="GIF", save_all=True, append_images=rest, duration=1000 // motion.rate, loop=0,
            comment=comment.encode(),
        )  # fmt: skip

    def _picture(self, instant: int) -> Image.Image:
        """One instant as pixels."""
        self.motion.show(instant)
        drawn = io.BytesIO()
        self.savefig(drawn, format="png", dpi=PIXELS)
        return Image.open(drawn).convert("RGB")
