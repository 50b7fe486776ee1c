"""What is raised when a train, a line or a rail cannot exist."""

from collections.abc import Iterable
from typing import Any

from alloc.number_fault import number_fault


class PlantError(ValueError):
    """A parameter of the plant is impossible; the message names it and what to do."""


def require_finite(
    owner: str, record: Any, positive: Iterable[str] = (), nonnegative: Iterable[str] = ()
) -> None:
    """Check named attributes of `record`: finite, and > 0 or >= 0; raise `PlantError` naming the first fault."""
    for names, zero in ((positive, False), (nonnegative, True)):
        for name in names:
            value = getattr(record, name)
            fault = number_fault(value, zero)
            if fault is not None:
                raise PlantError(f"{owner}: {name} = {value!r} {fault}")
