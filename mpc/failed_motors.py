"""Units whose motors have failed: what is then wanted of the others, and of themselves."""

from collections.abc import Sequence

import numpy as np

from alloc.onboard.host import UnitContext, UnitSense
from alloc.plant.structure import Floats
from mpc.unit_model import torque_per_coefficient


def leading(senses: Sequence[UnitSense]) -> int:
    """Number of the foremost unit that works, which leads; of the last one where none does."""
    working = (j for j, sense in enumerate(senses) if sense.in_service)
    return next(working, len(senses) - 1)


class LostShare:
    """Part of the driver's plan that a group does not deliver because motors have failed."""

    def __init__(self, units: Sequence[UnitContext]) -> None:
        self._mass = np.array([unit.mass for unit in units])
        self._torque = np.array([torque_per_coefficient(unit) for unit in units])
        self._blended = units[0].blended

    def even(self, demand: float, leader: int) -> Floats:
        """Demand on each unit [N m], (units,), that is as even as the plan; `demand` on the `leader`."""
        return demand / self._torque[leader] * self._torque

    def wanted(
        self, demand: Floats, in_service: Sequence[bool], leader: int, planned: float
    ) -> Floats:
        """Demand on each unit [N m], signed, (units,); on one that has failed what is to be found elsewhere.

        That is its part of the plan, less what a rule has already laid on the others; nothing where air brakes give it.
        `demand` on those that work, signed; `planned` as `UnitSense` has it of the `leader`. While demand rises, or motors
        bound it, the leader's is below its plan, and so is what is lost.
        """
        works = np.array(in_service)
        if works.all():
            return demand
        at_rail = demand / self._torque
        sign = np.sign(demand[leader])
        coefficient = sign * min(abs(float(demand[leader])), planned) / self._torque[leader]
        lost = coefficient * self._mass[~works].sum()
        if not works[leader] or lost == 0.0 or (self._blended and sign < 0.0):
            return np.where(works, demand, 0.0)
        missing = coefficient * self._mass.sum() - self._mass[works] @ at_rail[works]
        share = min(max(float(missing / lost), 0.0), 1.0)
        return np.where(works, demand, share * coefficient * self._torque)
