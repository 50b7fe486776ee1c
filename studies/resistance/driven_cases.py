"""The speed control on its routes: disturbance at tunnel mouths and gradient changes, case by case (JP H07-322414)."""

from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from alloc.driving import drive
from alloc.estimation.running_resistance import (
    Learner,
    LeastSquaresLearner,
    NormalisedGradientLearner,
)
from alloc.metrics.use import jerk
from alloc.onboard.line_memory import PositionDetector
from alloc.onboard.speed_controller import Feedback, Learning, LearnThenUse, SpeedControl, Traction
from studies.files.study_error import StudyError, unknown
from studies.resistance.routes import Route

PERIOD = 0.05
"""Control period [s]; it is integrated in the largest steps that the plant allows."""
CURRENT_PER_FORCE = 1e-3
"""K_i [A/N], assumed; no result depends on it, since gains are given by times."""
TIME_CONSTANT, RESET_TIME = 4.0, 16.0
"""Of the speed loop [s], assumed: critically damped under PI control.

What compensation does for the acceleration depends on it: on the commuter train's gradient the root mean square over that
of the feedback alone is 1.25 at half of it, 0.71 as it is, and 0.42 at twice of it; for the speed it is a gain throughout.
"""
RATE = PERIOD / 10.0
"""Rate of the normalised gradient: learning acts like an integrator of 10 s on the feedback, slower than the loop."""
FILTER_TIME = 1.0
"""Of what is learnt from [s]."""
SPEED_NOISE = 0.01
"""Standard deviation of the measured speed [m/s] where there is noise, assumed."""
WRONG = (1.3, 0.7, 0.7)
"""Wrong coefficients relative to the true ones: W1, W2 and the mass, as of a full train that is taken to be empty."""
SETTLE = 10.0
"""Time [s] after the train's rear has passed a point in which its disturbance is looked at."""

Control = Literal["P", "PI"]
CONTROLS: tuple[Control, ...] = ("P", "PI")
FEEDBACK, RIGHT, WRONGLY, LEARNED = (
    "feedback only",
    "compensation",
    "compensation, wrong",
    "learned",
)
FRONT, CARS = "compensation at the front", "compensation, car by car"
EXACT, USED = "feedforward, car by car", "learn, then use"
TAUGHT = "compensation, learned"
CASES = (FEEDBACK, RIGHT, WRONGLY, LEARNED)
"""The four that are compared, with the line's memory read at the middle of the train: the source does not say which
position of a train is its position. `FRONT` and `CARS` read it at the front and in the middle of every car (not in the
source); `EXACT` does so with the plant's five weights in the feedforward from commanded values; `USED` is claim 5."""
ALL_CASES = (*CASES, FRONT, CARS, EXACT, USED)
"""`TAUGHT`, compensation car by car with weights that a learner has learnt before, needs that learner."""
TRUE_SIGNALS = PositionDetector()
"""Position and speed as they are."""


class CaseRun(NamedTuple):
    """A run, what its speed control noted, and the speed control."""

    run: xr.Dataset
    log: xr.Dataset
    control: SpeedControl


def feedback(route: Route, control: Control) -> Feedback:
    """The speed feedback of a route, its gains made for the empty train with its rotating mass."""
    empty = route.train.loaded((0.0,) * len(route.train.cars))
    mass = empty.mass + empty.rotating_mass
    return Feedback.for_train(
        mass, CURRENT_PER_FORCE, TIME_CONSTANT, RESET_TIME if control == "PI" else 0.0
    )


def beginning(
    route: Route, weights: int, wrong: tuple[float, float, float] = WRONG
) -> tuple[np.ndarray, np.ndarray]:
    """Weights `wrong` by these factors, A and B, if any, zero; and the size of what each multiplies; two (weights,)."""
    start = np.array([*(np.array(wrong) * route.true_weights()), 0.0, 0.0])[:weights]
    speed, rate = route.command.speeds[0], route.command.acceleration
    return start, np.array([speed**2, speed**2, rate, 1.0, speed])[:weights]


def drive_case(
    route: Route,
    case: str,
    control: Control = "PI",
    learner: Learner | None = None,
    detector: PositionDetector = TRUE_SIGNALS,
    open_loop: bool = False,
    wrong: tuple[float, float, float] = WRONG,
) -> CaseRun:
    """One run of `route` in a `case`; `LEARNED` and `USED` go on with `learner`, a new one if None; `TAUGHT` needs one.

    `detector`: where position and speed come from. `LEARNED` has its weights from one run of the same route before this
    one, which began with weights `wrong` by these factors and compensated while it learnt. `open_loop`: `USED` as printed,
    without feedback while what was learnt is used.
    """
    if case not in (*ALL_CASES, TAUGHT):
        raise unknown("case", case, (*ALL_CASES, TAUGHT))
    if case == TAUGHT and learner is None:
        raise StudyError(f"case {TAUGHT!r}: give the learner whose weights it has")
    start, typical = beginning(route, 3, wrong)
    if case == LEARNED and learner is None:
        learner = NormalisedGradientLearner(start, RATE, typical)
        before = replace(detector, seed=detector.seed + 1)
        drive_case(route, case, control, learner, before, False, wrong)
    if case == USED and learner is None:  # prior: wrong by as much as the weights begin
        learner = LeastSquaresLearner(start, 0.5 * route.true_weights())
    weights = route.believed_weights(5 if case == EXACT else 3)
    if case == WRONGLY:
        weights = weights * np.array(wrong)
    if case == TAUGHT and learner is not None:
        weights = learner.weights
    mass = route.train.mass + route.train.rotating_mass
    switch = LearnThenUse(0.01 * mass, 0.05 * mass, feedback=not open_loop)
    driver = SpeedControl(
        route.command,
        feedback(route, control),
        Traction.of(route.train, CURRENT_PER_FORCE),
        PERIOD,
        "feedback" if case == FEEDBACK
        else "feedforward" if case in (LEARNED, EXACT)
        else "learn-then-use" if case == USED
        else "compensation",
        route.memory({CARS: "cars", EXACT: "cars", TAUGHT: "cars", FRONT: "front"}.get(case, "middle")),
        None if case == FEEDBACK else weights,
        Learning(
            learner if case in (LEARNED, USED) else None,
            switch=switch if case == USED else None,
            filter_time=FILTER_TIME,
            train_length=route.length,
        ),
        rotating_mass=route.train.rotating_mass,
        detector=detector,
    )  # fmt: skip
    run = drive(
        route.model(), driver, route.duration, f"{route.name}, {case}",
        initial_speed=route.command.initial, period=PERIOD, step=PERIOD,
    )  # fmt: skip
    return CaseRun(run, driver.log(), driver)


def disturbances(route: Route, done: CaseRun, lead: float = 0.0) -> pd.DataFrame:
    """What the train feels at every point of the line: a row per point.

    From the front's reaching it until `SETTLE` after the rear has passed. `lead`: the look begins earlier and ends later, by
    this share of the way from the point before; compensation may come early and late where the position is wrong. Speed
    [m/s] and acceleration [m/s2] are deviations from the command, the speed's from its deviation on arrival, which under P
    control is never zero; jerk [m/s3] below 5 Hz.
    """
    time, position = done.run["time"].values, done.run["position"].values
    speed = done.run["speed"].values - done.log["commanded_speed"].values
    acceleration = done.run["acceleration"].values - done.log["commanded_acceleration"].values
    jolt = jerk(done.run)[:, 0]
    force = done.log["feedback_current"].values / CURRENT_PER_FORCE
    rows = []
    points = route.points
    gaps = np.diff([point.position for point in points])
    for point, gap in zip(points, [*gaps[:1], *gaps], strict=True):
        begin = int(np.searchsorted(position, point.position - lead * gap))
        rear = int(np.searchsorted(position, point.position + route.length + lead * gap))
        inside = slice(begin, int(np.searchsorted(time, time[min(rear, time.size - 1)] + SETTLE)))
        moved, pulled = speed[inside] - speed[begin], acceleration[inside]
        rows.append(
            {
                "kind": point.kind,
                "position": point.position,
                "speed_peak": np.abs(moved).max(),
                "speed_rms": np.sqrt((moved**2).mean()),
                "acceleration_peak": np.abs(pulled).max(),
                "acceleration_rms": np.sqrt((pulled**2).mean()),
                "jerk_peak": np.abs(jolt[inside]).max(),
                "jerk_rms": np.sqrt((jolt[inside] ** 2).mean()),
                "feedback_change": np.abs(force[inside] - force[begin]).max(),
            }
        )
    return pd.DataFrame(rows)
