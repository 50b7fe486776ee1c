"""The default grid of `readhesion compare`."""

from collections.abc import Sequence

from alloc.rules import RULES
from studies.comparison.grid import Grid
from studies.core.controllers import check_controller
from studies.core.drawn_events import COMPARED
from studies.files.study_error import StudyError, unknown
from studies.scenario.loading import default_scenarios
from studies.scenario.scenario import Scenario

DEFAULT_SEEDS = 5
"""Seeds of every event in which something is drawn; the first, 0, is the event as its file states it."""
SLOW_RULES = ("qp-cvxpy", "qp-robust")
"""Rules left out unless asked for, because they repeat `qp`. One takes milliseconds a call. The other takes tens of
microseconds, and its answer differs only where the train believes in deviations of its caps, which no shipped scenario
does."""
SLOW_CONTROLLER = "mpc"
"""What joins in where nothing is said about controllers, on the first seed alone: it takes tens of times as long as what is
compiled into the loop."""
KEPT_RUNS = ("wet-patch/alone/*/0", "wet-patch/exact/*/0", "wet-patch/cooperative/*/0")
"""Runs that a comparison records as netCDF."""


def default_rules() -> tuple[str, ...]:
    """Every rule but the slow ones."""
    return tuple(name for name in RULES if name not in SLOW_RULES)


def check_names(rules: Sequence[str], controllers: Sequence[str]) -> None:
    """Raise `StudyError` for an unknown rule or controller, or a controller that needs what is not installed."""
    for rule in rules:
        if rule not in RULES:
            raise unknown("rule", rule, RULES)
    for controller in controllers:
        check_controller(controller)


def make_grid(
    scenarios: Sequence[Scenario],
    rules: Sequence[str] | None,
    controllers: Sequence[str] | None,
    seeds: int | None,
) -> Grid:
    """The grid for these parts; None represents the default.

    Where no controllers are named, the MPC is added under every rule, on the first seed of every event. Raises `StudyError`
    where several seeds are asked for and a scenario leaves nothing to them.
    """
    if seeds is not None and seeds < 1:
        raise StudyError(f"--seeds {seeds}: give the number of seeds, 1 or more")
    count = DEFAULT_SEEDS if seeds is None else seeds
    fixed = [one.name for one in scenarios if count > 1 and not one.draws()]
    if seeds is not None and fixed:
        raise StudyError(
            f"--seeds {seeds}: nothing in scenario {fixed[0]!r} depends on the seed, all its rows would be equal; "
            "give it a table [variation], or leave --seeds out"
        )
    chosen = tuple(dict.fromkeys(default_rules() if rules is None else rules))
    built_in = tuple(dict.fromkeys(COMPARED if controllers is None else controllers))
    check_names(chosen, built_in)
    once = (SLOW_CONTROLLER,) if controllers is None else ()
    check_names(chosen, once)
    return Grid(
        tuple(scenarios), chosen, built_in, tuple(range(count)), once, frozenset(fixed),
    )  # fmt: skip


def default_grid() -> Grid:
    """The grid of `readhesion compare` without options."""
    return make_grid(default_scenarios(), None, None, None)
