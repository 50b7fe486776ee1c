"""Learning of running resistance: convergence by learner, and the mass after boarding as load signal of the allocation."""

from collections.abc import Mapping
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

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
from alloc.onboard.line_memory import WEIGHTS
from alloc.onboard.parameters import Belief, Onboard
from alloc.onboard.speed_controller import SpeedCommand
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail
from alloc.simulation import simulate
from studies.resistance.driven_cases import (
    FEEDBACK,
    FILTER_TIME,
    SPEED_NOISE,
    beginning,
    drive_case,
)
from studies.resistance.routes import FULL_LOAD, LINE_SPACING, Route, route

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
