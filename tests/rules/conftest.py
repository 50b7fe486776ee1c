"""Shared by the tests of the rules."""

from hypothesis import HealthCheck, settings

# A first call may compile, and OSQP's first call for a size sets it up: no deadline. The examples are the same in every
# run, so that a failure is met by whoever caused it.
settings.register_profile(
    "rules", deadline=None, derandomize=True, suppress_health_check=[HealthCheck.too_slow]
)
settings.load_profile("rules")
