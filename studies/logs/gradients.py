"""The gradient under a train from a railtoolkit line, by the position that its log has."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

Floats = NDArray[np.float64]


@dataclass(frozen=True, eq=False)
class GradientLine:
    """Rise per run along a line."""

    station: Floats
    """Where each section begins [m], growing, (sections,)."""
    rise: Floats
    """Rise per run of each, (sections,)."""
    start: float | None = None
    """Station of the train's front at the first instant [m], where the log has no position."""
    backwards: bool = False
    """Whether the train runs against the line's stations."""

    def along(self, position: Floats | None, time: Floats, speed: Floats) -> Floats:
        """Rise per run where the train is, (instants,), in its own direction.

        `position` [m] of the log; None: the start, and `speed` [m/s] integrated.
        """
        if position is None:
            way = np.zeros(speed.size)
            v = np.nan_to_num(speed)
            way[1:] = np.cumsum(0.5 * (v[1:] + v[:-1]) * np.diff(time))
            first = self.start if self.start is not None else float(self.station[0])
            position = first + (-way if self.backwards else way)
        known = np.isfinite(position)
        place = np.interp(time, time[known], position[known])
        section = np.clip(
            np.searchsorted(self.station, place, "right") - 1, 0, self.station.size - 1
        )
        sign = -1.0 if self.backwards else 1.0
        moved = place[-1] - place[0]
        if self.start is None and abs(moved) > 1.0:
            sign = float(np.sign(moved))
        return np.asarray(sign * self.rise[section])


def read_gradients(path: Path, start: float | None = None) -> GradientLine:
    """The gradients of a railtoolkit running path; raises `StudyError` where it cannot be read."""
    from studies.railtoolkit.reading import read_path

    found = read_path(path)
    station = np.array([section.start for section in found.sections], dtype=float)
    rise = np.array([section.grade for section in found.sections], dtype=float)
    return GradientLine(station, rise, start)
