"""The speed control on its routes: disturbance at tunnel mouths and gradient changes, case by case (JP H07-322414)."""

from collections.abc import Mapping
from dataclasses import replace
from typing import Literal, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from alloc.driving import drive
from alloc.estimation.running_resistance import (
    GradientLearner,
    Learner,
    Learnt,
    LeastSquaresLearner,
    NormalisedGradientLearner,
    RunLog,
    learn_from_log,
)
from alloc.event import DriverCommand, Event
from alloc.metrics import evaluate
from alloc.metrics.use import jerk
from alloc.onboard.line_memory import WEIGHTS, PositionDetector
from alloc.onboard.parameters import Belief, Onboard
from alloc.onboard.speed_controller import (
    Feedback,
    Learning,
    LearnThenUse,
    SpeedCommand,
    SpeedControl,
    Traction,
)
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail
from alloc.simulation import simulate
from studies.files.study_error import StudyError, unknown
from studies.resistance.routes import FULL_LOAD, LINE_SPACING, Route, route

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


# Learning of running resistance: convergence by learner, and the mass after boarding as load signal of the allocation.

PRINTED, GRADIENT, NORMALISED, SQUARES = (
    "gradient (5) with Z3 = a", "gradient (5)", "normalised gradient", "least squares",
)  # fmt: skip
LEARNER_NAMES = (PRINTED, GRADIENT, NORMALISED, SQUARES)
BOUND_SHARE = 0.5
"""Gain of the gradient (5), as a share of its stability bound 2/|Z|^2 at cruising speed."""
NORMALISED_RATE = 0.02
SENSOR_ERROR = -0.3
"""Relative error of the load sensors whose place the learnt mass takes."""
BOARDING_SPEED, BOARDING_RATE, BOARDING_TIME = 15.0, 0.5, 60.0
"""Departure after boarding [m/s], [m/s2], [s], assumed."""


def learners(of: Route, weights: int = 3) -> dict[str, Learner]:
    """Every learner by name, with wrong weights at first."""
    start, typical = beginning(of, weights)
    gain = BOUND_SHARE * 2.0 / of.command.speeds[0] ** 4
    prior = np.array([*(0.5 * of.true_weights()), 5e3, 300.0])[:weights]
    return {
        PRINTED: GradientLearner(start, gain, as_printed=True),
        GRADIENT: GradientLearner(start, gain),
        NORMALISED: NormalisedGradientLearner(start, NORMALISED_RATE, typical),
        SQUARES: LeastSquaresLearner(start, prior),
    }


def learn_passes(
    of: Route, run: xr.Dataset, learner: Learner, passes: int = 1, seed: int = 0
) -> tuple[pd.DataFrame, Learnt]:
    """Errors of W1, W2, W3 relative to the plant's over `passes` of a recorded run, each with its own noise.

    The mass of the turning wheelsets is known, and W3 is the train's mass.
    """
    true = of.true_weights(learner.weights.size)
    parts = []
    for k in range(passes):
        found = learn_from_log(
            RunLog.of_run(run, SPEED_NOISE, seed + k),
            of.memory(),
            learner,
            of.train.rotating_mass,
            FILTER_TIME,
            of.length,
        )
        errors = found.weights[:, :3] / true[:3] - 1.0
        part = pd.DataFrame(errors, columns=list(WEIGHTS))
        parts.append(part.assign(time=found.time + k * (found.time[-1] - found.time[0]), run=k))
    return pd.concat(parts, ignore_index=True), found


def convergence(of: Route, passes: int = 3) -> pd.DataFrame:
    """Errors of all learners over the same recorded run of the feedback alone, every 20th sample; column `learner`."""
    run = drive_case(of, FEEDBACK).run
    parts = [
        learn_passes(of, run, learner, passes)[0].iloc[::20].assign(learner=name)
        for name, learner in learners(of).items()
    ]
    return pd.concat(parts, ignore_index=True)


class Boarding(NamedTuple):
    """What a departure after boarding has taught of the mass."""

    load: float
    """True pay load of the train [kg]."""
    learned: Mapping[str, float]
    """Mass [kg] learnt by way: W3 of three weights, the same with M_r unknown, W3 of five weights."""
    mass: float
    empty_mass: float


def boarding(loads: tuple[float, ...], seed: int = 0) -> Boarding:
    """The mass of the commuter train with `loads` [kg per car], learnt on its first departure after boarding.

    Before boarding it knew the resistance of its empty self: W1, W2 (and A, B) are the empty train's, with little doubt; W3
    begins with the empty mass.
    """
    empty = route("commuter")
    command = SpeedCommand((2.0,), (BOARDING_SPEED,), BOARDING_RATE)
    train = empty.train.loaded(loads)
    of = Route("boarding", train, Line(spacing=LINE_SPACING), command, BOARDING_TIME)
    run = drive_case(of, FEEDBACK).run
    log = RunLog.of_run(run, SPEED_NOISE, seed)
    learned = {}
    for name, weights, own in (
        ("three weights", 3, True),
        ("three weights, rotating mass not known", 3, False),
        ("five weights", 5, True),
    ):
        known = empty.true_weights(weights)
        doubt = 0.05 * known
        doubt[2] = known[2]
        learner = LeastSquaresLearner(known, doubt)
        learn_from_log(log, of.memory(), learner, train.rotating_mass if own else 0.0, FILTER_TIME)
        learned[name] = float(learner.weights[2])
    return Boarding(sum(loads), learned, train.mass, empty.train.mass)


def even_loads(total: float, cars: int) -> tuple[float, ...]:
    """A load of the train [kg] spread evenly over its cars: of one mass, no more is known."""
    return (max(total, 0.0) / cars,) * cars


def load_compensation(loads: tuple[float, ...], learned_mass: float, level: float) -> pd.DataFrame:
    """Acceleration of the loaded commuter train in `simulate` by what it believes of its load: a row per belief.

    Beliefs: true loads, load sensors with `SENSOR_ERROR`, the learnt mass, and the sensors' distribution with the learnt
    sum. `level`: adhesion coefficient of the rail. Columns are the metrics, `acceleration_ratio` among them.
    """
    empty = route("commuter").train
    train = empty.loaded(loads)
    cars = len(train.cars)
    learned = learned_mass - empty.mass
    read = tuple((1.0 + SENSOR_ERROR) * load for load in loads)
    scale = learned / sum(read) if sum(read) > 0.0 else 0.0
    beliefs = {
        "true loads": loads,
        "sensors wrong": read,
        "mass learned": even_loads(learned, cars),
        "sensors scaled to the mass learned": tuple(max(scale, 0.0) * load for load in read),
    }
    model = build(train, Rail(level), Line(), span=(0.0, 600.0))
    rows = []
    for name, believed in beliefs.items():
        event = Event(
            "departure",
            model,
            DriverCommand((0.5,), (train.planned_acceleration,)),
            Onboard(belief=Belief(loads=believed)),
            duration=10.0,
        )
        found = evaluate(simulate(event, "exact", "cut-and-ramp"))
        rows.append({"belief": name, "level": level, "believed": sum(believed), **found})
    return pd.DataFrame(rows)


def random_loads(generator: np.random.Generator) -> tuple[float, ...]:
    """Pay load of each car [kg]: a fill drawn for the train, and an uneven share for every car."""
    fill = generator.uniform(0.3, 1.0)
    share = np.clip(fill + 0.15 * generator.standard_normal(8), 0.0, 1.2)
    return tuple(float(x) for x in FULL_LOAD["commuter"] * share)
