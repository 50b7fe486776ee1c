"""What differs from day to day in a scenario that is the same by its file."""

from dataclasses import dataclass

import numpy as np
from pydantic import Field, model_validator

from studies.files.strict import Strict


@dataclass(frozen=True)
class Day:
    """What is drawn for one day; the defaults are those of the event as the file states it."""

    level: float = 1.0
    """Factor on the level of the rail."""
    start: float = 0.0
    """Shift of the place where the train starts [m]."""
    delay: float = 0.0
    """Time by which the driver's commands come later [s]."""


class VariationKeys(Strict):
    """Draws of a seed of 1 or more, uniform within bounds: `[variation]`. Seed 0 is the event as the file states it.

    The bounds are assumed. JP5484215 (on (12) to (15)) has a scatter of 0.012 of the coefficient, over rail of all kinds.
    Here the rail is of one kind, so `level` bounds a factor of a few per cent.

    Source: assumed.
    """

    level: tuple[float, float] = (0.97, 1.03)
    """Least and greatest factor on the rail's level."""
    start_m: float = Field(default=2.0, ge=0.0)
    """How far from the stopping mark the train stands, either way."""
    delay_s: float = Field(default=0.1, ge=0.0, le=10.0)
    """Greatest time by which the commands come later. Source: a telegram period: the driver does not wait for telegrams."""

    @model_validator(mode="after")
    def _fits(self) -> "VariationKeys":
        if not 0.0 < self.level[0] <= self.level[1]:
            raise ValueError("level must be the least and the greatest factor, both greater than 0")
        return self

    def day(self, seed: int) -> Day:
        """The day of a seed."""
        if seed == 0:
            return Day()
        generator = np.random.default_rng([seed, 5])  # a stream of its own
        level, start, delay = generator.random(3)
        return Day(
            float(self.level[0] + (self.level[1] - self.level[0]) * level),
            float(self.start_m * (2.0 * start - 1.0)),
            float(self.delay_s * delay),
        )
