"""Input of the reference speed's estimate about train and sensors, and its memory."""

import math
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from alloc.compilation import equation
from alloc.onboard.quantity import filled
from alloc.plant.model import Floats, Ints

if TYPE_CHECKING:
    from alloc.onboard.parameters import Onboard


OBSERVER_POLE = 12.0
"""Pole [1/s] of the filter behind which rail forces and rim accelerations are compared."""


RATE_POLE = 50.0
"""The same [1/s] of the filter behind which a sounded wheel is seen to settle, fast against a sounding."""

NOISE_MARGIN = 2.5
"""Deviations of a noisy acceleration within which a wheel counts as at rest against the train."""

USUAL_PERIOD = 0.01
"""Period [s] for which the parameters count samples, and for which `BOUND_SHARE` is."""

MEAN_TIME = 0.1
"""Time [s] over which an axle's lead is averaged."""

BOUND_SHARE = 0.2
"""Share of its violation by which the bound of an axle moves the estimate per period."""

SLOWEST_SHARE = 0.25
"""Share of a new value that the mean takes at most: over fewer samples noise would not cancel."""


class SoundingSettings(NamedTuple):
    """As `Sounding`."""

    doubt: float
    doubt_ratio: float
    ease: float
    share: float
    time: float
    longest: float
    return_time: float
    pause: float
    air_doubt: float
    air_known: float
    patience: float


class ReferenceSettings(NamedTuple):
    """As `ReferenceSpeed`."""

    given: bool  # the true speed stands in place of the estimate
    noise: float  # deviation of a speed reading [m/s]
    speed_walk: float
    force_walk: float
    unknown_force: float
    shoe_error: float
    shoe_walk: float
    mass_error: float
    slip: float
    slip_deviation: float
    creep: float
    creep_speed: float
    repeat: float
    light_repeat: float
    sounded_repeat: float
    ease_time: float
    light: float
    away: float
    returning: float
    gate: float
    persist: float
    carried_time: float
    slid_time: float
    radius_deviation: float
    radius_prior: float  # deviation at the start of the run
    sounding: SoundingSettings


class ReferencePace(NamedTuple):
    """What depends on the period."""

    observer_gain: float  # share of a new value that a filter of `OBSERVER_POLE` takes
    rate_gain: float  # as observer_gain, of a filter of `RATE_POLE`
    carried_kept: float  # share of a wheel's greatest force that is remembered
    slid_kept: float
    mean_share: float  # as observer_gain, of the mean over `MEAN_TIME`
    bound_share: float  # as `BOUND_SHARE`
    repeat: float  # number of samples, as those of `ReferenceSpeed`
    light_repeat: float
    sounded_repeat: float


@equation
def reference_pace(o, period):
    """`ReferencePace` of a period [s]; `o`: `ReferenceSettings`, or `ReferenceSpeed`."""
    usual = USUAL_PERIOD / period
    return ReferencePace(
        -math.expm1(-OBSERVER_POLE * period),
        -math.expm1(-RATE_POLE * period),
        math.exp(-period / o.carried_time),
        math.exp(-period / o.slid_time),
        min(period / MEAN_TIME, SLOWEST_SHARE),
        min(BOUND_SHARE / usual, 2.0 * SLOWEST_SHARE),
        o.repeat * usual,
        o.light_repeat * usual,
        o.sounded_repeat * usual,
    )


class SoundingMemory(NamedTuple):
    """Which wheels are relieved for the sake of the estimate."""

    unit: Ints  # (1,) that is sounded, -1: none
    group: Ints  # (1,) brake group that is released, -1: none
    last: Ints  # (1,) unit that was sounded last
    told: Ints  # (1,) whether one of its wheels has told the speed
    clock: Floats  # (1,) time since a sounding of a unit began or ended [s]
    share: Floats  # (units,) of the torque command that is left to each


class RadiusMemory(NamedTuple):
    """What is known of the wheels' radii, (axles,) unless said otherwise."""

    rolling: Floats  # (1,) time for which nothing has acted on any wheel [s]
    factor: Floats  # by which the believed radius is multiplied
    known: Floats  # inverse of the variance that its readings leave
    ahead: Floats  # what a wheel runs ahead of its body, relative


class ReferenceMemory(NamedTuple):
    """What the filter remembers."""

    ready: Ints  # (1,)
    state: Floats  # (4,) speed, unknown specific force, micro-slip per coefficient, error of the inverse mass
    covariance: Floats  # (4, 4)
    place: Floats  # (bodies,) of the believed bodies [m]
    force: Floats  # (bodies,) on them
    change: Floats  # (bodies,) acceleration of each [m/s2] were the next one to keep its speed
    share: Floats  # (bodies,) of the next one's acceleration that it follows
    smooth_speed: Floats  # (1,) speed behind a filter
    shoe_decel: Floats  # (1,) greatest specific force of the shoes in this application [m/s2]
    rim: Floats  # (axles,) rim speed at the last period
    rim_rate: Floats  # (axles,) its acceleration behind a fast filter [m/s2]
    rail: Floats  # (axles,) rail force; of a sounded unit's axles that before [N]
    smooth_rim: Floats  # (axles,) behind a filter
    applied: Floats  # (axles,) force that motor and shoe apply, in the direction of the demand [N]
    smooth_applied: Floats  # (axles,) behind the same filter
    carried: Floats  # (axles,) greatest force lately [N]
    ease: Floats  # (axles,) time for which nobody has limited its force [s]
    telling: Floats  # (axles,) time for which it has been light and rolled [s]
    ahead: Floats  # (axles,) mean over 0.1 s of what it runs ahead, in the direction of the demand [m/s]
    full: Floats  # (groups,) pressure that is asked for
    pressure: Floats  # (groups,) that is there
    sounding: SoundingMemory
    radii: RadiusMemory


def reference_settings(onboard: "Onboard") -> ReferenceSettings:
    """Settings of a run; a reading is as uncertain as its noise and its quantum make it."""
    given, sensors = onboard.reference, onboard.sensors
    noise = math.sqrt(given.sensor**2 + sensors.speed_noise**2 + sensors.speed_quantum**2 / 12.0)
    return filled(
        ReferenceSettings,
        given,
        given=given.source == "truth",
        noise=noise,
        radius_prior=given.radius_prior,
        # what is taken for a motion of the wheel must exceed what noise makes of its speed
        returning=max(given.returning, NOISE_MARGIN * OBSERVER_POLE * noise),
        sounding=filled(SoundingSettings, given.sounding),
    )


def reference_memory(bodies: int, axles: int, units: int, groups: int) -> ReferenceMemory:
    """Memory of a train whose computers have not sensed yet."""
    nobody = np.full((3, 1), -1, dtype=np.int64)
    untold = np.zeros(1, dtype=np.int64)
    of_axles = (
        "rim", "rim_rate", "rail", "smooth_rim", "applied", "smooth_applied", "carried", "ease", "telling", "ahead",
    )  # fmt: skip
    zeros: Any = {name: np.zeros(axles) for name in of_axles}
    return ReferenceMemory(
        ready=np.zeros(1, dtype=np.int64),
        state=np.zeros(4),
        covariance=np.zeros((4, 4)),
        place=np.zeros(bodies),
        force=np.zeros(bodies),
        change=np.zeros(bodies),
        share=np.zeros(bodies),
        smooth_speed=np.zeros(1),
        shoe_decel=np.zeros(1),
        **zeros,
        full=np.zeros(groups),
        pressure=np.zeros(groups),
        sounding=SoundingMemory(
            unit=nobody[0],
            group=nobody[1],
            last=nobody[2],
            told=untold,
            clock=np.zeros(1),
            share=np.ones(units),
        ),
        radii=RadiusMemory(
            rolling=np.zeros(1),
            factor=np.ones(axles),
            known=np.zeros(axles),
            ahead=np.zeros(axles),
        ),
    )
