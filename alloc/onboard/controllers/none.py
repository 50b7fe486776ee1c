"""No readhesion control: the torque follows its target whatever the wheels do."""

from dataclasses import dataclass

from alloc.compilation import equation
from alloc.onboard.controllers.built_in import BuiltInController, share_of_target


@equation
def follow_target(eq, st, m, p, k, j, commanded):
    """Command of unit `j`."""
    m.unit.torque_command[j] = m.unit.torque_target[j]
    return share_of_target(m, j)


@dataclass(frozen=True)
class NoControl(BuiltInController):
    """No readhesion control; it has no parameters."""

    name = "none"
    meaning = "torque follows the limit whatever the wheels do"
    colour = "#aa8e55"
    marker = "o"
    law = follow_target
