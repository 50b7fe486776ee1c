"""Line position (JP H07-322414): do compensation and learning survive errors of odometer, signals and map?"""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np
import pandas as pd

from alloc.estimation.running_resistance import RunLog, learn_from_log
from alloc.onboard.line_memory import WEIGHTS, PositionDetector
from alloc.onboard.speed_controller import USE
from studies.core.cell import Task
from studies.core.claims import AT_LEAST, AT_MOST, Claim, Side, family, known_in, survives
from studies.core.statement import INTERVALS_OF_MEANS, Statement
from studies.core.study import EachEvent, Study
from studies.files.study_error import unknown
from studies.resistance import driven_cases as cases
from studies.resistance.driven_cases import (
    CARS,
    FEEDBACK,
    FRONT,
    LEARNED,
    RIGHT,
    SQUARES,
    TAUGHT,
    learners,
)
from studies.resistance.events import WRONG_BY, column, felt
from studies.resistance.routes import (
    AIR,
    ALL,
    ARMS,
    GRADIENTS,
    LADDER,
    NONE,
    ODOMETER,
    PLACES,
    RANGES,
    TYPICAL,
    Draw,
    LineErrors,
    Route,
    arms_of,
    detector,
    drawn_route,
    read_line_errors,
    rung,
    with_errors,
)
from studies.resistance.study import MOUTH, PATENT, SLOPE, mean_claim

# The speed control on drawn routes, with errors of position and map: the row that an event yields in an arm.

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


# Claims of the sweep `line-position`: each with each error of odometer, signals and map, against the same threshold.

KINDS = (MOUTH, SLOPE)
CONCERNED = {AIR: (MOUTH,), GRADIENTS: (SLOPE,)}
"""Places where an error of the map shows; learning must mend it there. Others show at all of them."""
EVERY_ARM = (*ARMS, *map(rung, LADDER))
OWN = "set by this project"
METHOD = (
    "one run of each case per drawn route (studies/resistance/line_position_study.py), with the same noise for each error; "
    "disturbances are means over tunnel mouths and over gradient changes, and then over both; "
    f"{INTERVALS_OF_MEANS}, 95 %; after Holm over all claims"
)


def ratio(quantity: str, case: str, other: str, kinds: Sequence[str] = KINDS) -> str:
    """Disturbance in one case over that in another, the mean over kinds of places."""
    ratios = [f"{column(quantity, k, case)} / {column(quantity, k, other)}" for k in kinds]
    return f"|{' + '.join(ratios)}| / {len(ratios)}"


def _compensation(quantity: str, case: str) -> dict[str, str]:
    """Disturbance with compensation, over that with feedback alone: the whole, then what goes along."""
    found = {"over feedback alone": ratio(quantity, case, FEEDBACK)}
    found |= {f"at a {kind}": ratio(quantity, case, FEEDBACK, (kind,)) for kind in KINDS}
    if case == RIGHT:
        found["memory read at the front"] = ratio(quantity, FRONT, FEEDBACK)
    return found | {"error of the position in m": "position error"}


def claims_of(arm: str) -> Iterator[Claim]:
    """What is claimed with the errors of `arm`."""

    def one(
        name: str, side: Side, value: float, reason: str, source: str, numbers: dict[str, str]
    ) -> Claim:
        label, tested = next(iter(numbers.items()))
        return mean_claim(
            f"{name} ({arm})", f"{reason} (errors: {arm})", tested, side, value, label, numbers, reason, source, METHOD
        )  # fmt: skip

    for name, quantity, reason, source in (
        ("speed", "speed_peak", "compensation lessens the disturbance of the speed", PATENT),
        ("ride", "acceleration_peak", "compensation improves the ride: less acceleration off the command", PATENT),
        ("jerk", "jerk_peak", "a better ride is less jerk too", OWN),
    ):  # fmt: skip
        yield one(f"1, 2: {name}", AT_MOST, 1.0, reason, source, _compensation(quantity, RIGHT))
        yield one(
            f"1, 2: {name}, car by car", AT_MOST, 1.0, "the same, the memory read car by car", OWN,
            _compensation(quantity, CARS),
        )  # fmt: skip
    yield one(
        "3, 4: as steady as true ones", AT_MOST, 1.25, "learning has arrived where a quarter is left to be gained",
        f"{PATENT}: almost true; a quarter {OWN}",
        {
            "over true coefficients": ratio("speed_peak", LEARNED, RIGHT),
            "over feedback alone": ratio("speed_peak", LEARNED, FEEDBACK),
        },
    )  # fmt: skip
    yield one(
        "3, 4: mass", AT_MOST, 0.05, "W3 becomes the train's mass while it compensates",
        f"{PATENT}: the mass; a twentieth {OWN}", {"relative error of W3": f"|W3@{LEARNED} - 1|"},
    )  # fmt: skip
    yield one(
        "5: in use", AT_LEAST, 0.5, "the switch comes to use what was learnt, for most of the run",
        f"{PATENT}: alternately; most {OWN}", {"share of the run": "'use share'"},
    )  # fmt: skip
    yield one(
        "7: mass", AT_MOST, 0.05, "the stand-alone learner finds the train's mass",
        f"{PATENT}: the mass; a twentieth {OWN}",
        {
            "relative error of W3": f"|W3@{ALONE[3]} - 1|", "with five weights": f"|W3@{ALONE[5]} - 1|",
            "W1 over air resistance": f"W1@{ALONE[3]}",
        },
    )  # fmt: skip
    if arm != NONE:
        kinds = CONCERNED.get(arm, KINDS)
        yield one(
            "learning mends", AT_MOST, 0.9,
            "coefficients that were learnt take away a tenth of what the error of the map leaves", OWN,
            {
                "with learnt coefficients over with those of the map": ratio("speed_peak", TAUGHT, CARS, kinds),
                "over feedback alone, learnt": ratio("speed_peak", TAUGHT, FEEDBACK, kinds),
                "over feedback alone, as the map has them": ratio("speed_peak", CARS, FEEDBACK, kinds),
            },
        )  # fmt: skip


CLAIMS = {arm: tuple(claims_of(arm)) for arm in EVERY_ARM}
"""What is claimed, by arm; the claims of all arms are one family."""


def position_statements(table: pd.DataFrame) -> list[Statement]:
    """All statements on a table with a row per event and arm: those of each arm that has the case which a claim is about."""
    groups = {}
    for arm in [arm for arm in EVERY_ARM if (table["arm"] == arm).any()]:
        rows = table[table["arm"] == arm].set_index("event").dropna(axis="columns", how="all")
        groups[arm] = (
            rows,
            [_known(claim, rows) for claim in CLAIMS[arm] if known_in(rows, claim.mean)],
        )
    found = family(*groups.values())
    return [*_survivals(found, [arm for arm in groups if arm != NONE]), *found]


def _known(claim: Claim, rows: pd.DataFrame) -> Claim:
    """The claim with those numbers beside it whose cases are driven in this arm."""
    numbers = {words: text for words, text in claim.numbers.items() if known_in(rows, text)}
    return replace(claim, numbers=numbers)


def _survivals(found: Sequence[Statement], arms: Sequence[str]) -> list[Statement]:
    """A statement per claim over all errors, ordered by claim."""
    by_name = {one.name: one for one in found}
    over_all = []
    for claim in CLAIMS[NONE]:
        name = claim.name.removesuffix(f" ({NONE})")
        clean = by_name.get(claim.name)
        others = {arm: by_name[own] for arm in arms if (own := f"{name} ({arm})") in by_name}
        if clean is None or not clean.holds or not others:
            continue  # what is not shown to hold without errors has nothing to survive
        over_all.append(
            survives(
                f"survives: {name}", f"with every error too: {claim.reason}", clean, others, NONE,
                f"no worse than without errors ({clean.verdict}); conditions are the errors with which it is worse",
            )
        )  # fmt: skip
    return over_all


def cells(seed: int, k: int, errors: str | None = None, arms: Sequence[str] = ()) -> list[Task]:
    """Route `k` with each error; `errors`: path of a file that says how large they are; `arms`: some of them [all]."""
    sizes = arms_of(TYPICAL if errors is None else read_line_errors(errors))
    for arm in arms:
        if arm not in sizes:
            raise unknown("arm", arm, sizes)
    return [
        Task(f"{seed}/{k}/{arm}", position_row, (seed, k, arm, sizes[arm]), (("event", k), ("arm", arm)))
        for arm in arms or sizes
    ]  # fmt: skip


LINE_POSITION = Study(
    name="line-position",
    question="what errors of odometer, signals and map leave of compensation and learning by position (JP H07-322414)",
    default_events=40,
    cells=EachEvent(cells),
    judge=position_statements,
    whole=True,
    claims=tuple(claim for claims in CLAIMS.values() for claim in claims),
)
