"""Keys of a scenario file on the growth of adhesion along the train."""

from typing import Annotated, Literal

from pydantic import Field, model_validator

from alloc.plant.rail import GROWTH_OFFSET, GROWTH_SLOPE, logarithmic_increments
from studies.files.strict import Strict

MOST_COEFFICIENT = 1.0
"""No dry or sanded rail carries a force as large as the wheel's load: measured coefficients stay below 0.7."""
Increment = Annotated[float, Field(ge=-MOST_COEFFICIENT, le=MOST_COEFFICIENT)]
"""Of the coefficient, at one axle or unit."""


class IncrementKeys(Strict):
    """Growth of adhesion along the train: none, the law (15) of JP5484215, or a value per axle.

    Source: JP5484215 (15), Shinkansen.
    """

    law: Literal["none", "logarithmic", "given"]
    """Law of the growth: none, slope ln j + offset for axle j (1 = foremost), or given by values."""
    slope: float = Field(default=GROWTH_SLOPE, ge=-MOST_COEFFICIENT, le=MOST_COEFFICIENT)
    """Slope of the law logarithmic."""
    offset: float = Field(default=GROWTH_OFFSET, ge=-MOST_COEFFICIENT, le=MOST_COEFFICIENT)
    """Offset of the law logarithmic; with the default the mean over the first four axles is zero."""
    values: tuple[Increment, ...] | None = None
    """Increment of the coefficient per axle from the front, with the law given. Left out: another law is meant. Source: the
    file's."""

    @model_validator(mode="after")
    def _fits(self) -> "IncrementKeys":
        if (self.values is not None) != (self.law == "given"):
            raise ValueError('values go with law = "given", and only with it')
        if self.law != "logarithmic" and (self.slope, self.offset) != (
            GROWTH_SLOPE,
            GROWTH_OFFSET,
        ):
            raise ValueError('slope and offset go with law = "logarithmic", and only with it')
        return self

    def increments(self, axles: int) -> tuple[float, ...] | None:
        """One increment per axle from the front, None for none."""
        if self.law == "none":
            return None
        if self.law == "given":
            return self.values
        return tuple(logarithmic_increments(axles, self.slope, self.offset).tolist())
