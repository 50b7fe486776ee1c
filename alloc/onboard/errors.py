"""The error of on-board equipment, and the check of its numbers."""

from alloc.errors import OnboardError, check_numbers

__all__ = ["OnboardError", "check_numbers"]
