"""What is wrong with a number that someone gave: one test for every layer, which raises its own error of it."""

import math
from typing import Any


def number_fault(value: Any, zero: bool = False, infinite: bool = False) -> str | None:
    """What `value` must be if it is not a number above 0; None if it is one. `zero`, `infinite`: may be that too."""
    number = isinstance(value, (int, float)) and not isinstance(value, bool)
    if number and (value > 0.0 or (zero and value == 0.0)) and (infinite or math.isfinite(value)):
        return None
    kind = "a number" if infinite else "a finite number"
    return f"must be {kind}, {'0 or greater' if zero else 'greater than 0'}"
