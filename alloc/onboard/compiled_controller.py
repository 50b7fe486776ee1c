"""Readhesion controllers of single units that the loop calls as compiled code, without going through Python.

The loop does not depend on them. It has the address of a function of one signature, and that of a record with the
controller's data, which it passes to the function. So a package that this one must not import can add such a controller.
"""

from collections.abc import Callable, Sequence
from typing import Any, NamedTuple

import numpy as np
from numba import float64, int64, types, void
from numba.np.numpy_support import from_dtype
from numpy.typing import NDArray

from alloc.by_address import function_at
from alloc.compilation import equation
from alloc.named_record import named_record
from alloc.onboard.controllers.built_in import share_of_target
from alloc.onboard.equipment import Equipment
from alloc.onboard.host import UnitContext
from alloc.plant.structure import Floats, Ints

READING = named_record(
    "time", "speed", "torque", "target", "drive_limit", "brake_limit", "coefficient", slipping=np.int64
)  # fmt: skip
"""Readings of a unit's computer at a control instant, as `UnitSense`, except for the angular speeds of its axles."""
ANSWER = named_record("torque", "solve_time", "residual", usable=np.int64, status=np.int64)
"""What a controller answers, as `TorqueDecision`: `usable` 0 or 1, and `status` by its number; 0 is "ok"."""

STEP = types.FunctionType(void(int64, from_dtype(READING), float64[::1], from_dtype(ANSWER)))
"""A control period: (address of the controller's record, reading, angular speeds [rad/s] (axles,), answer to be filled)."""
_step_at = function_at(STEP)

NOT_A_TORQUE = "torque not finite"


class CompiledController(NamedTuple):
    """The compiled controller of one unit."""

    step: int
    """Address of a compiled function of the kind `STEP`, see `alloc.by_address`."""
    state: int
    """Address of the record that it is called with."""
    statuses: tuple[str, ...]
    """By number; the first is "ok"."""
    kept: Any
    """What must live as long as the addresses are in use."""


CompiledControllers = tuple[CompiledController, ...]
"""Those of a train's units, foremost first."""


def each_compiled(
    factory: Callable[[UnitContext], CompiledController],
) -> Callable[[Sequence[UnitContext]], CompiledControllers]:
    """Factory of a train whose units each have a compiled controller of their own."""
    return lambda contexts: tuple(factory(context) for context in contexts)


class Answers(NamedTuple):
    """What the loop calls the units' compiled controllers with, and counts of their answers; of no units without them."""

    step: Ints
    """(units,), as `state`."""
    state: Ints
    reading: NDArray[np.void]
    """`READING` (units,)"""
    answer: NDArray[np.void]
    """`ANSWER` (units,)"""
    first: Ints
    """Place of each unit's first axle in the next two, and the end, (units + 1,)."""
    axle: Ints
    """Number of each driven axle in the train, unit by unit."""
    omega: Floats
    status: Ints
    """How often each status was answered, (units, statuses); in the last column torques that were no number."""
    solve_time: Floats
    """[s], (ticks, units)"""


def answers(controllers: CompiledControllers, eq: Equipment, ticks: int) -> Answers:
    """Room for the answers of `controllers` in a run of `ticks` control periods."""
    units = len(controllers)
    axles = [np.flatnonzero(eq.axle_unit == j) for j in range(units)]
    most = max((len(one.statuses) for one in controllers), default=0)
    none = np.zeros(0, dtype=np.int64)
    return Answers(
        np.array([one.step for one in controllers], dtype=np.int64),
        np.array([one.state for one in controllers], dtype=np.int64),
        np.zeros(units, READING),
        np.zeros(units, ANSWER),
        np.cumsum([0, *map(len, axles)]).astype(np.int64),
        np.concatenate([none, *axles]),
        np.zeros(sum(map(len, axles))),
        np.zeros((units, most + 1), dtype=np.int64),
        np.zeros((ticks if units else 0, units)),
    )


def failures(controllers: CompiledControllers, counted: Answers) -> dict[str, int]:
    """How often the controllers failed, by status."""
    found: dict[str, int] = {}
    for one, row in zip(controllers, counted.status.tolist(), strict=True):
        for status, number in zip(
            (*one.statuses[1:], NOT_A_TORQUE), (*row[1 : len(one.statuses)], row[-1]), strict=True
        ):
            if number:
                found[status] = found.get(status, 0) + number
    return found


@equation
def command_compiled(eq, m, c, torque, time, tick):
    """Torque commands by the compiled controllers `c`; the reserve's stand where one gives none.

    `torque` [N m]: of each motor as the inverters know it, (units,).
    """
    for j in range(c.step.size):
        reading, answer = c.reading[j], c.answer[j]
        reading.time = time
        reading.speed = m.reference[eq.unit_body[j]]
        reading.torque = torque[j]
        reading.target = m.unit.torque_target[j]
        reading.drive_limit = m.drive_limit[j]
        reading.brake_limit = m.brake_limit[j]
        reading.coefficient = m.unit.coefficient_estimate[j]
        reading.slipping = int(m.unit.slipping[j] != 0.0)
        for i in range(c.first[j], c.first[j + 1]):
            k = c.axle[i]
            c.omega[i] = m.axle_omega[k] * (eq.axle_radius[k] / eq.radius[j])
        _step_at(c.step[j])(c.state[j], reading, c.omega[c.first[j] : c.first[j + 1]], answer)
        c.solve_time[tick, j] = answer.solve_time
        status = answer.status
        if answer.usable != 0 and not abs(answer.torque) < np.inf:
            status = c.status.shape[1] - 1
        elif answer.usable != 0:
            m.unit.torque_command[j] = answer.torque
        c.status[j, status] += 1
        m.unit.torque_factor[j] = share_of_target(m, j)
