"""What is raised when a train, a line or a rail cannot exist."""

import math
from collections.abc import Iterable
from typing import Any


class PlantError(ValueError):
    """A parameter of the plant is impossible; the message names it and what to do."""


def require_finite(
    owner: str, record: Any, positive: Iterable[str] = (), nonnegative: Iterable[str] = ()
) -> None:
    """Check named attributes of `record`: finite, and > 0 or >= 0; raise `PlantError` naming the first fault."""
    for names, bound in ((positive, "greater than 0"), (nonnegative, "0 or greater")):
        for name in names:
            value = getattr(record, name)
            good = isinstance(value, (int, float)) and math.isfinite(value)
            if not good or value < 0.0 or (bound == "greater than 0" and value == 0.0):
                raise PlantError(f"{owner}: {name} = {value!r} must be a finite number {bound}")
