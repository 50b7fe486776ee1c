"""Readhesion controllers: what a traction unit does with its torque when its wheels slip.

`CONTROLLERS` has all by name. A controller is a function of one unit's row, called once a control period: it reads what is
sensed (`unit.worst_slip`, `unit.slipping`, `unit.coefficient_estimate`, ...) and `unit.torque_target`, and writes
`unit.torque_command`; both torques are positive in the direction of the demand. One of your own::

    def cautious(unit, axles, memory, run):
        unit.torque_command = 0.9 * unit.torque_target

    register("cautious", cautious, "a tenth less than asked for")

Under `alloc.onboard.signatures.control` the same function is compiled. Its parameters and memory are columns of a
`Table` of its own, of which `m = memory.view(ROW)[0]` is the unit's row; ROW is the table's `dtype`.
"""

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from difflib import get_close_matches
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.schema.errors import OnboardError
from alloc.schema.registry import Registry
from alloc.schema.tables import Table

NOTHING = Table("nothing")
"""Memory of a controller without one."""
ORDERED = (("lowest", "highest"), ("least", "largest"), ("cut", "recover"))
"""Pairs of parameters of which the first must not exceed the second."""


@dataclass(frozen=True, eq=False)
class Controller:
    """A readhesion controller."""

    name: str
    control: Callable[..., None]
    """Function `control(unit, axles, memory, run)`, see `alloc.onboard.signatures`."""
    meaning: str
    """One line."""
    memory: Table = NOTHING
    """Its parameters, which are the columns with a source, and what it remembers of a unit."""
    colour: str = "#555555"
    """Hexadecimal, the same in every figure."""
    marker: str = "o"
    """In figures, as Matplotlib names it."""
    bounds: Mapping[str, tuple[float, float]] = field(default_factory=dict)
    """Least and greatest value of parameters; one that is not named must be above 0."""

    @property
    def settings(self) -> tuple[str, ...]:
        """Names of its parameters."""
        return tuple(key for key, column in self.memory.columns.items() if column.source)

    def tuned(self, **values: float) -> "Controller":
        """The same controller with other values of parameters; nothing is compiled anew.

        Raises `OnboardError` for a parameter that does not exist and for an impossible value.
        """
        columns = dict(self.memory.columns)
        for key, value in values.items():
            if key not in self.settings:
                near = get_close_matches(key, self.settings, 1)
                names = ", ".join(self.settings) or "it has none"
                hint = f"did you mean {near[0]!r}?" if near else f"parameters: {names}"
                raise OnboardError(f"{self.name}: unknown parameter {key!r}; {hint}")
            whole = isinstance(columns[key].default, int)
            low, high = self.bounds.get(key, (1e-12, math.inf))
            if not low <= value <= high or not math.isfinite(value) or (whole and value % 1 != 0):
                kind = "a whole number" if whole else "a number"
                raise OnboardError(
                    f"{self.name}: {key} = {value!r} must be {kind} from {low:g} to {high:g}"
                )
            columns[key] = replace(columns[key], default=int(value) if whole else float(value))
        for lower, upper in ORDERED:
            limits: Any = [
                columns[name].default for name in (lower, upper) if name in self.settings
            ]
            if limits != sorted(limits):
                raise OnboardError(f"{self.name}: {lower} must not exceed {upper}")
        return replace(self, memory=Table(self.memory.name, **columns))

    def rows(self, n: int) -> NDArray[np.float64]:
        """Memory of `n` units at the start of a run, (n, numbers)."""
        memory: NDArray[np.float64] = np.asarray(self.memory.rows(n)).view(np.uint8)
        return memory.view(np.float64).reshape(n, self.memory.dtype.itemsize // 8)


CONTROLLERS: Registry[Controller] = Registry(
    "controller",
    "alloc.onboard.controllers.plain",
    "alloc.onboard.controllers.creep",
    "alloc.onboard.controllers.search",
    "mpc.unit",
)
"""Readhesion controllers by name, from these modules on."""


def register(
    name: str, control: Callable[..., None], meaning: str, memory: Table = NOTHING, **fields: Any
) -> Controller:
    """Make a `Controller` (`fields`: colour, marker, bounds) and enter it in `CONTROLLERS`."""
    controller = Controller(name, control, meaning, memory, **fields)
    return CONTROLLERS.register(name, controller, control.__module__)
