"""The error of the estimations."""


class EstimationError(ValueError):
    """Data or a parameter of an estimation is impossible; the message names it and what to do."""
