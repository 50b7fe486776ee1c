"""What wheels and forces of a train say at common instants: what every reading of a log starts from."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from studies.logs.known_train import MeasuredTrain

Floats = NDArray[np.float64]
Numbers = NDArray[np.int64]

STANDING, STILL = 0.05, 0.01
"""Speed of all wheels [m/s] below which a train stands, by wheels with much noise and with little."""
OF_NOISE = 4.0
"""Deviations of a speed that noise may add to it."""


class TrainReadings(NamedTuple):
    """Series at common instants in SI units, and the train that they are of; nan where nothing is known."""

    time: Floats
    """[s], (instants,), growing."""
    part: Numbers
    """Number of the part, from gap to gap, that each instant belongs to, (instants,)."""
    rim: Floats
    """Circumferential speeds of the wheels [m/s], (instants, axles)."""
    force: Floats
    """Forces on the wheels, positive in traction [N], (instants, axles)."""
    train: MeasuredTrain
    grade: Floats | None = None
    """Rise per run at the train, (instants,); None: unknown."""
    rim_noise: float = 0.0
    """Standard deviation of a wheel's speed [m/s]."""
    rim_span: float = 0.0
    """Time over which a wheel's speed is a mean [s], for which its error lasts; 0: as measured."""
    force_period: float = 0.0
    """Time between two samples of the forces [s]; 0: that of the instants."""

    @property
    def still(self) -> float:
        """Speed [m/s] below which a wheel stands, as far as its noise lets one see it."""
        return min(max(STILL, OF_NOISE * self.rim_noise), STANDING)

    def rows(self, some: slice) -> "TrainReadings":
        """Those of some instants."""
        return self._replace(
            time=self.time[some],
            part=self.part[some],
            rim=self.rim[some],
            force=self.force[some],
            grade=None if self.grade is None else self.grade[some],
        )
