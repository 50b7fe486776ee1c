"""What is wrong with on-board equipment, and the checks of its numbers."""

import math
from collections.abc import Iterable
from typing import Any


class OnboardError(ValueError):
    """A parameter of the on-board equipment is impossible; the message names it and what to do."""


def check_numbers(
    owner: str, record: Any, positive: Iterable[str] = (), nonnegative: Iterable[str] = ()
) -> None:
    """Raise `OnboardError` where a field of `record` is no number, nan or outside its range; inf is allowed."""
    for names, low, text in (
        (positive, False, "greater than 0"),
        (nonnegative, True, "0 or greater"),
    ):
        for name in names:
            value = getattr(record, name)
            if not isinstance(value, (int, float)) or math.isnan(value) or value < 0.0:
                raise OnboardError(f"{owner}: {name} = {value!r} must be {text}")
            if value == 0.0 and not low:
                raise OnboardError(f"{owner}: {name} = {value!r} must be {text}")
