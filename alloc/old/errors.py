"""Errors of this package, and the one check of numbers that a user gives."""

import math
import os
from collections.abc import Iterable, Mapping
from numbers import Real
from typing import Any, ClassVar


def number_fault(
    value: Any, zero: bool = False, infinite: bool = False, negative: bool = False
) -> str | None:
    """What `value` must be if it is not a number above 0, else None. `zero`, `infinite`, `negative`: also allowed."""
    if isinstance(value, Real) and not isinstance(value, bool):
        number = float(value)
        within = number > 0.0 or (zero and number == 0.0) or (negative and not math.isnan(number))
        if within and (infinite or math.isfinite(number)):
            return None
    kind = "a number" if infinite else "a finite number"
    bound = "" if negative else ", 0 or greater" if zero else ", greater than 0"
    return f"must be {kind}{bound}"


class InputError(ValueError):
    """The input is impossible; the message names it and says what to do."""

    infinite: ClassVar[bool] = False
    """Whether every number may be infinite where a check says nothing else."""

    @classmethod
    def check(
        cls,
        owner: str,
        values: Any,
        positive: Iterable[str] = (),
        nonnegative: Iterable[str] = (),
        finite: Iterable[str] = (),
        infinite: Iterable[str] | None = None,
    ) -> None:
        """Raise this error for the first of the named `values`, fields or entries, that is not a number in its range.

        A name that ends with [] is a sequence of numbers. `finite`: of any sign. `infinite`: the only names whose values
        may be infinite.
        """
        unbounded = cls.infinite and infinite is None
        ranges: list[tuple[Iterable[str], dict[str, bool]]] = [
            (positive, {}), (nonnegative, {"zero": True}), (finite, {"negative": True})
        ]  # fmt: skip
        for names, kind in ranges:
            for name in names:
                key = name.removesuffix("[]")
                given = values[key] if isinstance(values, Mapping) else getattr(values, key)
                may_be_infinite = unbounded or name in (infinite or ())
                for k, value in enumerate(given if name.endswith("[]") else [given]):
                    fault = number_fault(value, infinite=may_be_infinite, **kind)
                    if fault is not None:
                        place = f"{key}[{k}]" if name.endswith("[]") else key
                        raise cls(f"{owner}: {place} = {value!r} {fault}")

    @classmethod
    def check_order(cls, owner: str, values: Any, low: str, high: str, equal: bool = False) -> None:
        """Raise this error unless field `low` of `values` is below field `high`, or with `equal` not above it."""
        a, b = getattr(values, low), getattr(values, high)
        if not (a < b or (equal and a == b)):
            bound = "not exceed" if equal else "be below"
            raise cls(f"{owner}: {low} = {a!r} must {bound} {high} = {b!r}")

    @classmethod
    def check_choice(cls, owner: str, name: str, value: str, choices: Iterable[str]) -> None:
        """Raise this error unless `value` is one of `choices`."""
        if value not in choices:
            raise cls(f"{owner}: {name} = {value!r} must be one of {', '.join(choices)}")


class PlantError(InputError):
    """A parameter of the plant is impossible."""


class OnboardError(InputError):
    """A parameter of the on-board equipment is impossible."""

    infinite = True


class SimulationError(InputError):
    """A run cannot be made as asked."""


def check_compiling() -> None:
    """Raise `SimulationError` where Numba may not compile: the plant's vectors exist in compiled code alone."""
    if os.environ.get("NUMBA_DISABLE_JIT", "0") not in ("", "0"):
        raise SimulationError("simulations need compiled code: unset NUMBA_DISABLE_JIT")


class UnsoundRun(ArithmeticError):
    """A run or a metric of it broke a law that all keep: a fault of the program, and its numbers count for nothing."""


class EstimationError(InputError):
    """Data or a parameter of an estimation is impossible."""


class AllocationError(InputError):
    """A rule got an impossible problem; the message names the field, its value and what to do."""
