"""Base class of the readhesion controllers that are compiled with the loop."""

from collections import namedtuple
from collections.abc import Mapping
from typing import Any, ClassVar

import numpy as np

from alloc.old.compilation import equation, jit
from alloc.old.display import displayed
from alloc.old.records import numbers_of

Remembered = Mapping[str, Any]
"""What a law stores of every unit, and its value at the start of a run: a number, or nested tuples of numbers."""


@displayed
class BuiltInController:
    """A readhesion controller; a subclass is a frozen dataclass of its parameters.

    `law(eq, st, m, p, k, j, commanded)` is compiled. It fills the torque command of unit `j` and returns the share of its
    target that it leaves the unit. `p` comes from `settings`, `k` from `memory`; `eq`, `st`, `m` are equipment, settings and
    memory of the whole train. All quantities count positive in the direction of the demand.
    """

    name: ClassVar[str]
    meaning: ClassVar[str]
    """One line."""
    colour: ClassVar[str]
    """Hexadecimal; the same in every figure."""
    marker: ClassVar[str]
    """In figures, as Matplotlib names it."""
    law: ClassVar[Any]
    _remembered: ClassVar[Remembered]
    Memory: ClassVar[Any]
    """Named tuple of the stored values of the law, as compiled code takes them."""

    def __init_subclass__(cls, remembered: Remembered | None = None) -> None:
        """`remembered`: what the law keeps of every unit."""
        cls._remembered = remembered or {}
        cls.Memory = namedtuple(cls.__name__ + "Memory", cls._remembered, module=cls.__module__)  # type: ignore[misc]
        cls.Memory.__qualname__ = f"{cls.__qualname__}.Memory"  # where Numba's cache looks for it
        missing = [part for part in BuiltInController.__annotations__ if not hasattr(cls, part)]
        if missing:
            raise TypeError(f"controller {cls.__name__}: needs {', '.join(missing)}")

    def settings(self, period: float) -> Any:
        """Numbers that the law takes as `p` at a control `period` [s]: its fields and constants; None if it needs none."""
        return numbers_of(self) or None

    @classmethod
    def memory(cls, units: int) -> Any:
        """Named tuple of arrays that the law keeps in `k`, as at the start of a run; None if it keeps none.

        Each is (units,), or (units, n) where n values are stored per unit.
        """
        arrays = [np.full((units, *np.shape(value)), value) for value in cls._remembered.values()]
        return cls.Memory(*arrays) if arrays else None


def of_units(kind: type[BuiltInController], place: int) -> Any:
    """Compiled law of all units of a train under a controller of `kind`; its settings and memory are those at `place`."""
    law = kind.law

    def control(eq, st, m, commanded):
        """Torque commands of all units, and the share of its target that each is.

        Under a hosted controller these are its reserve; the share is then that of the host, which is not known yet.
        """
        for j in range(eq.axles.size):
            share = law(eq, st, m, st.law[place], m.law[place], j, commanded)
            if not st.hosted:
                m.unit.torque_factor[j] = share

    # Numba tells closures of one name apart by a count per process: of two that were compiled in different processes, and
    # found in the cache by a third, one would be taken for the other
    control.__qualname__ = f"{kind.__name__}.control"
    return jit(control, kind.__module__)


@equation
def share_of_target(m, j):
    """Command of unit `j` as a share of its target."""
    target = m.unit.torque_target[j]
    return m.unit.torque_command[j] / target if target != 0.0 else 1.0


@equation
def direction(commanded):
    """1 driving, -1 braking."""
    return 1.0 if commanded >= 0.0 else -1.0


@equation
def torque_per_coefficient(eq, j):
    """Torque [N m] of each motor of unit `j` for a coefficient of 1 at its axles."""
    return eq.axle_load[j] * eq.radius[j] / eq.gear[j]
