"""What is wrong with on-board equipment, and the checks of its numbers."""

from collections.abc import Iterable
from typing import Any

from alloc.number_fault import number_fault


class OnboardError(ValueError):
    """A parameter of the on-board equipment is impossible; the message names it and what to do."""


def check_numbers(
    owner: str, record: Any, positive: Iterable[str] = (), nonnegative: Iterable[str] = ()
) -> None:
    """Raise `OnboardError` where a field of `record` is no number, nan or outside its range; inf is allowed."""
    for names, zero in ((positive, False), (nonnegative, True)):
        for name in names:
            value = getattr(record, name)
            fault = number_fault(value, zero, infinite=True)
            if fault is not None:
                raise OnboardError(f"{owner}: {name} = {value!r} {fault}")
