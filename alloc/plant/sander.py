"""Sanders: devices that lay sand ahead of an axle."""

from dataclasses import dataclass

from alloc.errors import PlantError


@dataclass(frozen=True)
class Sander:
    """Lays sand on both rails just ahead of an axle of its car, in either running direction.

    Source: the vehicle's.
    """

    axle: int
    """Number of the axle in its car, 0 = foremost."""
    rate: float
    """Sand per rail: the rate of a sander of fixed rate, else the largest rate [kg/s]."""
    amount: float | None = None
    """Sand per rail and metre that a sander of variable rate keeps to as long as `rate` allows [kg/m]. Left out: the rate is
    fixed."""

    def __post_init__(self) -> None:
        if isinstance(self.axle, bool) or not isinstance(self.axle, int) or self.axle < 0:
            raise PlantError(f"sander: axle = {self.axle!r} must be a whole number, 0 = foremost")
        amount = () if self.amount is None else ("amount",)
        PlantError.check("sander", self, positive=("rate", *amount))
