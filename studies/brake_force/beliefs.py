"""Possible errors of the estimator: its friction law, resistance, gradient and pressure sensors, apart from the plant.

Plant and estimator share their formulas, and the locomotive's 60 kN is an input of the plant. So an agreement of the two
shows that the estimator is consistent, not that a real train would agree with it. These arms separate them: the plant is
unchanged (except for the gradient, which it has), and the estimator reads a stop with one thing wrong.
"""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import NamedTuple

import numpy as np

from alloc.estimation.brake_force import level_acceleration
from studies.brake_force.measurement import Measured


class FrictionBelief(NamedTuple):
    """Friction law that the estimator believes in, relative to the plant's."""

    level: float = 1.0
    """Factor of the coefficient."""
    fall: float = 1.0
    """Factor of what the coefficient loses from standstill to the speed."""


RIGHT_FRICTION = FrictionBelief()


@dataclass(frozen=True)
class Misbelief:
    """One thing, or several, that the estimator has wrong."""

    friction: FrictionBelief = RIGHT_FRICTION
    resistance: float = 1.0
    """Factor of the running resistance."""
    grade: float = 0.0
    """Rise per run of the line, which the estimator takes for level."""
    from_speeds: bool = True
    """Whether accelerations are derived from speeds; an accelerometer on the car body reads those of level track."""
    pressure_gain: float = 0.0
    """Relative standard deviation of a pressure sensor's gain, drawn for each car."""
    pressure_offset: float = 0.0
    """Standard deviation of its zero [Pa], drawn for each car."""

    def applied(self, measured: Measured, seed: int) -> Measured:
        """Inputs of an estimator with this belief; `seed` draws the pressure sensors."""
        draw = np.random.default_rng([seed, 46]).standard_normal((2, measured.pressure.shape[1]))
        pressure = measured.pressure * (1.0 + self.pressure_gain * draw[0])
        a = measured.acceleration
        return measured._replace(
            pressure=pressure + self.pressure_offset * draw[1],
            resistance=self.resistance * measured.resistance,
            acceleration=a if self.from_speeds else level_acceleration(a, self.grade),
        )


AS_PLANT = "as the plant"
BELIEFS: Mapping[str, Misbelief] = MappingProxyType(
    {
        **{f"friction {x:+.0%}": Misbelief(FrictionBelief(1.0 + x)) for x in (-0.2, -0.1, 0.1, 0.2)},
        **{f"friction's fall with speed {x:+.0%}": Misbelief(FrictionBelief(fall=1.0 + x)) for x in (-0.2, 0.2)},
        **{f"resistance {x:+.0%}": Misbelief(resistance=1.0 + x) for x in (-0.2, -0.1, 0.1, 0.2)},
        **{f"gradient {x:+g} per mille, by speeds": Misbelief(grade=1e-3 * x) for x in (-2, 2, 10)},
        "gradient +10 per mille, by accelerometers": Misbelief(grade=0.01, from_speeds=False),
        "pressure sensors 5 %, 10 kPa": Misbelief(pressure_gain=0.05, pressure_offset=10e3),
        "pressure sensors 10 %, 20 kPa": Misbelief(pressure_gain=0.1, pressure_offset=20e3),
    }
)  # fmt: skip
"""Arms of the error budget. Steeper falling gradients are not among them: the locomotive alone would not stop the train."""
