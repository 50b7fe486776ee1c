"""What the computers on board are and believe, as rows: a train with its believed columns, and `ONBOARD`, `SLIDE`, `RUN`."""

import math
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.columns import INF, ONBOARD, RUN, SLIDE
from alloc.onboard.settings import Onboard, SlideLaw
from alloc.plant.rows import TrainRows, train_rows
from alloc.plant.train import Train
from alloc.schema.errors import OnboardError
from alloc.schema.tables import Rows, put

COMPARED = 1e-4
"""Relative deviation of radii that were compared: 3 s at 10 m/s and with 10 mm/s of noise in a reading leave as much."""
FASTEST, QUIET = 40.0, 0.14
"""Pole of the detector's differentiator with quiet sensors [1/s]. Where they are noisy, share of the threshold that the
deviation of computed accelerations is held to [1]: at pole 40 noise of 0.1 km/h is taken for slip, and cut-and-ramp cuts."""


def believed_rows(onboard: Onboard, train: Train) -> TrainRows:
    """Rows of `train` as these computers believe it; raises `OnboardError` where belief and train do not fit."""
    sensors, belief, shares = onboard.sensors, onboard.belief, onboard.braking.car_shares
    errors = np.random.default_rng(sensors.seed).standard_normal(len(train.cars))
    loads = np.array([car.load for car in train.cars]) * (1.0 + sensors.load_error * errors)
    radii = _radius_errors(onboard, train.axle_count)
    rows = train_rows(
        train, loads.tolist(), radii, onboard.inertia_in_limit, onboard.braking.blended
    )
    if not rows.units.size and not rows.brakes.size:
        told = "the train has no traction unit and no air brake"
        raise OnboardError(f"on board: {told}; give at least one driven axle, or an air brake")
    for name, given, count, places in (
        ("belief: increments", belief.increments, rows.axles.size, "axles"),
        ("belief: unit_increments", belief.unit_increments, rows.units.size, "traction units"),
        ("belief: unit_deviation", belief.unit_deviation, rows.units.size, "traction units"),
        ("braking: car_shares", shares, rows.cars.size, "cars"),
    ):
        if given is not None and len(given) != count:
            told = f"{len(given)} values for {count} {places}; give one for each from the front"
            raise OnboardError(f"{name}: {told}")
    grown = np.asarray(belief.increments or np.zeros(rows.axles.size))
    for j, unit in enumerate(rows.units):
        unit.increment = grown[rows.axles.unit == j].mean()
    if belief.unit_increments is not None:
        rows.units.increment = belief.unit_increments
    rows.units.deviation = belief.unit_deviation or 0.0
    for g, brake in enumerate(rows.brakes):
        brake.share = 1.0 if shares is None else shares[rows.axles.car[rows.axles.brake == g][0]]
    for one in sensors.dropouts:
        if one.axle >= rows.axles.size:
            told = f"axle = {one.axle} of a dropout, but the last axle is {rows.axles.size - 1}"
            raise OnboardError(f"sensors: {told}")
        rows.axles[one.axle].lost, rows.axles[one.axle].back = one.begin, one.until
    return rows


def _radius_errors(onboard: Onboard, axles: int) -> NDArray[np.float64]:
    """Relative errors of the wheel radii that the computers believe in, (axles,).

    Where the wheels were compared before the run, each error is that of all, and the posterior deviation of its own.
    """
    most, generator = onboard.sensors.radius_error, np.random.default_rng([onboard.sensors.seed, 3])
    errors = np.asarray(most * generator.uniform(-1.0, 1.0, axles))
    if most == 0.0 or not onboard.reference.radii_compared:
        return errors
    return np.asarray(errors.mean() + COMPARED * generator.standard_normal(axles))


def detector_pole(onboard: Onboard, noise: float, axles: int) -> float:
    """Pole [1/s] of the detector of a unit of so many axles, each read with this `noise` [m/s].

    Left open, it is `FASTEST`, or so much slower that noise computes accelerations of a deviation of `QUIET` times the
    threshold. With a = exp(-pole h), noise s of the mean speed makes it s / h (1 - a) sqrt(2 / (1 + a)).
    """
    if onboard.detector.pole is not None:
        return onboard.detector.pole
    h, mean_noise = onboard.period, max(noise, 1e-9) / math.sqrt(axles)
    ratio = (QUIET * onboard.detector.on * h / mean_noise) ** 2
    keep = 0.25 * (4.0 + ratio - math.sqrt(ratio * (ratio + 16.0)))
    return FASTEST if keep <= 0.0 else min(FASTEST, -math.log(keep) / h)


def onboard_rows(onboard: Onboard, rows: TrainRows, speed: float) -> tuple[Rows, Rows, Rows]:
    """The rows of `ONBOARD`, `SLIDE` and `RUN` of a train that begins at `speed` [m/s]."""
    detector, sensors, braking = onboard.detector, onboard.sensors, onboard.braking
    slide, belief, telegrams = braking.slide_protection, onboard.belief, onboard.telegrams
    resistance = {
        one: belief.resistance_factor * rows.onboard[one]
        for one in rows.onboard
        if "resistance" in one
    }
    known = (
        rows.onboard | resistance | {"train_mass": belief.mass_factor * rows.onboard["train_mass"]}
    )
    # rounding is as uncertain as its quantum makes it
    noise = math.hypot(sensors.speed_noise, sensors.speed_quantum / math.sqrt(12.0))
    board = ONBOARD.rows(
        1, **known, air_commanded=int(braking.air_force == "command"), true_speed=int(onboard.reference.source == "truth")
    )  # fmt: skip
    valves = SLIDE.rows(
        1, protection=get_args(SlideLaw).index(slide.law), every=max(1, round(slide.period / onboard.period))
    )  # fmt: skip
    for row, record, prefix in (
        (board, onboard, ""), (board, braking, ""), (board, sensors, ""), (board, telegrams, ""),
        (board, detector, "detector_"), (board, onboard.observer, "observer_"), (valves, slide, ""),
        (valves, slide.threshold, "threshold_"), (valves, slide.fuzzy, "fuzzy_"),
    ):  # fmt: skip
        put(row, record, prefix)
    board.detector_pole = detector_pole(onboard, noise, int(rows.units.axles.min(initial=4)))
    run = RUN.rows(
        1, period=onboard.period, telegram=telegrams.period, rise=onboard.rise_time, hold=onboard.hold_time,
        limit_rate=INF if onboard.limit_rate is None else onboard.limit_rate,
        reference_speed=speed, before=speed, speed=speed, noise=noise,
    )  # fmt: skip
    return board, valves, run
