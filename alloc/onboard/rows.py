"""What the computers on board are, as rows of `ONBOARD`, `SLIDE` and `RUN`, and by how much their wheel radii are wrong."""

import math
from collections.abc import Mapping
from typing import get_args

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.columns import INF, ONBOARD, RUN, SLIDE
from alloc.onboard.settings import Onboard, SlideLaw
from alloc.schema.tables import Rows, put_fields

COMPARED = 1e-4
"""Relative deviation of radii that were compared: 3 s at 10 m/s and with 10 mm/s of noise in a reading leave as much."""
FASTEST, QUIET = 40.0, 0.14
"""Pole of the detector's differentiator with quiet sensors [1/s]. Where they are noisy, share of the threshold that the
deviation of computed accelerations is held to [1]: at pole 40 noise of 0.1 km/h is taken for slip, and cut-and-ramp cuts."""


def radius_errors(onboard: Onboard, axles: int) -> NDArray[np.float64]:
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


def onboard_rows(
    onboard: Onboard, train: Mapping[str, float], watched: int, speed: float
) -> tuple[Rows, Rows, Rows]:
    """The rows of `ONBOARD`, `SLIDE` and `RUN` of a train that begins at `speed` [m/s].

    `train`: what the computers believe of the train, by columns of `ONBOARD`; `watched`: axles of the shortest unit.
    """
    detector, sensors, braking = onboard.detector, onboard.sensors, onboard.braking
    slide, telegrams = braking.slide_protection, onboard.telegrams
    # rounding is as uncertain as its quantum makes it
    noise = math.hypot(sensors.speed_noise, sensors.speed_quantum / math.sqrt(12.0))
    board = ONBOARD.rows(
        1, **train, air_commanded=int(braking.air_force == "command"), true_speed=int(onboard.reference.source == "truth")
    )  # fmt: skip
    valves = SLIDE.rows(
        1, protection=get_args(SlideLaw).index(slide.law), every=max(1, round(slide.period / onboard.period))
    )  # fmt: skip
    for row, record, prefix in (
        (board, onboard, ""), (board, braking, ""), (board, sensors, ""), (board, telegrams, ""),
        (board, detector, "detector_"), (board, onboard.observer, "observer_"), (valves, slide, ""),
        (valves, slide.threshold, "threshold_"), (valves, slide.fuzzy, "fuzzy_"),
    ):  # fmt: skip
        put_fields(row, record, prefix)
    board.detector_pole = detector_pole(onboard, noise, watched)
    run = RUN.rows(
        1, period=onboard.period, telegram=telegrams.period, rise=onboard.rise_time, hold=onboard.hold_time,
        limit_rate=INF if onboard.limit_rate is None else onboard.limit_rate,
        reference_speed=speed, before=speed, noise=noise,
    )  # fmt: skip
    return board, valves, run
