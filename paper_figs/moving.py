"""Figures that move: they show one instant, as any other figure, and all of them in a GIF."""

from collections.abc import Callable
from pathlib import Path
from typing import NamedTuple

from matplotlib.animation import FuncAnimation, PillowWriter
from matplotlib.artist import Artist
from matplotlib.figure import Figure

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

    def save_motion(self, path: Path) -> None:
        """Write all instants as a GIF that repeats; afterwards the figure stands as before."""
        motion = self.motion
        self.draw_without_rendering()
        self.set_layout_engine("none")  # nothing jumps while numbers change

        def show(instant: int) -> list[Artist]:
            motion.show(instant)
            return []

        moving = FuncAnimation(self, show, range(motion.instants), init_func=list)
        moving.save(path, PillowWriter(fps=motion.rate), dpi=PIXELS)
        motion.show(motion.still)
