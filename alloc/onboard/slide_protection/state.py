"""Input of the slide protection of a run, and its memory."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.onboard import slide_protection
from alloc.onboard.detector import differentiator_gain
from alloc.onboard.quantity import filled
from alloc.onboard.slide_protection.parameters import SlideProtection
from alloc.plant.model import Floats


class ThresholdSettings(NamedTuple):
    """As `Threshold`."""

    release: float
    hold: float


class FuzzySettings(NamedTuple):
    """As `Fuzzy`, with the gain of its differentiator."""

    sensitivity: float
    slip: Floats  # (3,)
    rate: Floats  # (3,)
    pole: float
    gain: float


class SlideSettings(NamedTuple):
    """Parameters for one run."""

    law: int
    every: int  # control periods between two decisions
    period: float  # between two decisions [s]
    cut_out_speed: float
    time_out: float
    refill: float
    threshold: ThresholdSettings
    fuzzy: FuzzySettings


class SlideMemory(NamedTuple):
    """What the cars' computers remember."""

    filtered: Floats  # (axles,) slip behind the differentiator's filter [m/s]
    locked: NDArray[np.bool_]  # (axles,) stands while its car runs
    severity: Floats  # (groups,) action that the worst axle asks for, before it is rounded
    action: Floats  # (groups,) of the valves until the next decision
    away: Floats  # (groups,) time since the valve last supplied [s]
    refill: Floats  # (groups,) time that it must still supply [s]


def slide_settings(protection: SlideProtection, period: float) -> SlideSettings:
    """Settings for a control period [s], to a whole number of which the protection's is rounded."""
    every = max(1, round(protection.period / period))
    fuzzy = protection.fuzzy
    return filled(
        SlideSettings,
        protection,
        law=slide_protection.LAWS[protection.law],
        every=every,
        period=every * period,
        threshold=filled(ThresholdSettings, protection.threshold),
        fuzzy=filled(
            FuzzySettings,
            fuzzy,
            slip=np.array(fuzzy.slip, dtype=float),
            rate=np.array(fuzzy.rate, dtype=float),
            gain=differentiator_gain(fuzzy.pole, every * period),
        ),
    )


def slide_memory(axles: int, groups: int) -> SlideMemory:
    """Memory at the start of a run."""
    return SlideMemory(
        np.zeros(axles), np.zeros(axles, dtype=np.bool_),
        *(np.zeros(groups) for _ in range(4)),
    )  # fmt: skip
