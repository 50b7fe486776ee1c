"""The speed control on drawn routes, with errors of position and map: the row that an event yields in an arm."""

from collections.abc import Iterable
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

from alloc.estimation.running_resistance import RunLog, learn_from_log
from alloc.onboard.line_memory import WEIGHTS, PositionDetector
from alloc.onboard.speed_controller import USE
from studies.resistance import driven_cases as cases
from studies.resistance.drawn_routes import RANGES, drawn_route
from studies.resistance.events import WRONG_BY, felt
from studies.resistance.learners import SQUARES, learners
from studies.resistance.line_errors import (
    AIR,
    ALL,
    ARMS,
    GRADIENTS,
    NONE,
    ODOMETER,
    PLACES,
    Draw,
    LineErrors,
    detector,
    with_errors,
)
from studies.resistance.routes import Route

LEAD = 0.4
"""Share of the way from the point before by which disturbances are looked at earlier, and later: positions are wrong."""
STREAM = 16
"""Distinguishes the draws of this study from those of `studies.resistance.events`."""
ALONE = {3: f"{SQUARES}, 3", 5: f"{SQUARES}, 5"}
"""Stand-alone learner by its number of weights."""


class DrawnRun(NamedTuple):
    """What an event draws; all arms have the same."""

    route: Route
    control: cases.Control
    wrong: tuple[float, float, float]
    """Factors of the weights that learning begins with."""
    errors: Draw


def draw(seed: int, event: int) -> DrawnRun:
    """The draw of an event; trains and controls take turns, so that each has its share of any number."""
    generator = np.random.default_rng([seed, event, STREAM])
    route = drawn_route(tuple(RANGES)[event % 2], generator)
    first, second, third = (float(1.0 + WRONG_BY * s) for s in generator.choice([-1.0, 1.0], 3))
    control = cases.CONTROLS[event // 2 % 2]
    return DrawnRun(route, control, (first, second, third), Draw.of(route, generator))


def cases_of(arm: str) -> tuple[str, ...]:
    """Cases that are driven in an arm; a rung of the ladder asks of compensation alone."""
    found = [cases.FEEDBACK, cases.RIGHT, cases.CARS]
    if arm in ARMS:
        # what is learnt while it compensates begins elsewhere, and never sees the map's air resistance
        found += [cases.LEARNED] if arm in (NONE, PLACES, ODOMETER, ALL) else []
        found += [cases.TAUGHT] if arm in (NONE, PLACES, GRADIENTS, AIR, ALL) else []
        found += [cases.FRONT] if arm == NONE else []
        found += [cases.USED] if arm in (NONE, ALL) else []
    return tuple(found)


def position_row(seed: int, event: int, arm: str, errors: LineErrors) -> dict[str, Any]:
    """Disturbances of all cases of `arm`, which has these `errors`, and what was learnt."""
    drawn = draw(seed, event)
    of = with_errors(drawn.route, errors, drawn.errors)
    signals = detector(of, errors, drawn.errors, cases.SPEED_NOISE, 1000 * seed + 10 * event)
    alone = _feedback_alone(seed, event, signals)
    row: dict[str, Any] = {
        "route": of.name, "control": drawn.control, "cruise": of.command.speeds[0], "length": of.length,
        "position error": _position_error(of, alone),
    }  # fmt: skip
    learner = None
    if arm in ARMS:
        learnt, learner = _alone(of, alone, ALONE if arm in (NONE, ALL) else (3,))
        row |= learnt
    for case in cases_of(arm):
        done = alone
        if case != cases.FEEDBACK:
            teacher = learner if case == cases.TAUGHT else None
            done = cases.drive_case(of, case, drawn.control, teacher, signals, wrong=drawn.wrong)
        row |= felt(of, done, case, LEAD)
        if case == cases.LEARNED:
            share = done.control.weights / of.true_weights()
            row |= {f"{name}@{case}": float(x) for name, x in zip(WEIGHTS, share, strict=True)}
        elif case == cases.USED:
            row["use share"] = float((done.log["switch"].values == USE).mean())
    return row


@lru_cache(maxsize=1)
def _feedback_alone(seed: int, event: int, signals: PositionDetector) -> cases.CaseRun:
    """It reads no map: arms with the same signals have it in common."""
    drawn = draw(seed, event)
    return cases.drive_case(drawn.route, cases.FEEDBACK, drawn.control, detector=signals)


def _position_error(of: Route, done: cases.CaseRun) -> float:
    """Mean size of the position's error as the front passes the points [m]."""
    position = done.run["position"].values
    at = np.searchsorted(position, [point.position for point in of.points])
    return float(np.abs(done.log["position"].values - position)[at].mean())


def _alone(of: Route, done: cases.CaseRun, sizes: Iterable[int]) -> tuple[dict[str, float], Any]:
    """What the stand-alone learners make of the run as the train measured it, and the one of three weights."""
    names = ("position", "measured_speed", "force")
    log = RunLog(done.log["time"].values, *(done.log[name].values for name in names))
    row: dict[str, float] = {}
    found = {}
    for weights in sizes:
        learner = found[weights] = learners(of, weights)[SQUARES]
        learn_from_log(
            log, of.memory(), learner, of.train.rotating_mass, cases.FILTER_TIME, of.length
        )
        share = learner.weights / of.true_weights(weights)
        row |= {
            f"{name}@{ALONE[weights]}": float(x) for name, x in zip(WEIGHTS, share, strict=False)
        }
    return row, found[3]
