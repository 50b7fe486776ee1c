"""Errors, each of one line that names the thing and says what to do."""


class InputError(ValueError):
    """The input is impossible; the message names it and says what to do."""

    fault: str = ""
    """The message of a record without the name of the record."""


class PlantError(InputError):
    """A parameter of train, rail or line is impossible."""


class OnboardError(InputError):
    """A parameter of the computers on board is impossible."""


class SimulationError(InputError):
    """A run cannot be made as asked."""


class AllocationError(InputError):
    """A rule got an impossible problem; the message names the field, its value and what to do."""


class EstimationError(InputError):
    """Data or a parameter of an estimation is impossible."""


class UnsoundRun(ArithmeticError):
    """A run or a metric of it broke a law that all keep: a fault of the program, and its numbers count for nothing."""
