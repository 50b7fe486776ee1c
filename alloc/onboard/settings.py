"""What differs between runs, as compiled code reads it: parameters of the on-board functions."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.controllers.collection import BUILT_IN, LawSettings, law_settings
from alloc.onboard.detector import differentiator_gain
from alloc.onboard.increment_learning import KINDS, LearningSettings
from alloc.onboard.observer import observer_gains
from alloc.onboard.parameters import Onboard
from alloc.onboard.quantity import filled
from alloc.onboard.reference_speed.state import (
    ReferencePace,
    ReferenceSettings,
    reference_pace,
    reference_settings,
)
from alloc.onboard.sanding import SandingSettings
from alloc.onboard.slide_protection.state import SlideSettings, slide_settings
from alloc.plant.model import Floats

RESERVE = "cut-and-ramp"
"""Built-in controller that takes over where a hosted one gives up."""


class RuleSettings(NamedTuple):
    """The allocation rule of the run."""

    compiled: int
    """Its identifier; -1: it is called in Python."""
    periodic: bool
    """Whether it acts with every telegram, else at each detection by the foremost unit."""
    needs_truth: bool
    """Whether it reads the truth; who knows the rail need not wait for slip."""
    always: bool
    """Whether it is called whether or not a unit is limited."""
    on_slip: bool
    """Whether it is called at the foremost unit's slip, whatever units report."""
    own_caps: bool
    """Whether its caps are what the units themselves find; otherwise they follow from that of the foremost unit."""
    own_slips: bool = False
    """Whether, called on slip, it receives every unit's detections."""


class DetectorSettings(NamedTuple):
    """As `Detector`, with the gain of its differentiator."""

    on: float
    off: float
    pole: float
    gain: float
    speed_on: float


class ObserverSettings(NamedTuple):
    """Pole and weights of `observer_gains`."""

    pole: float
    keep: float
    old: float
    new: float


class TelegramSettings(NamedTuple):
    """As `Telegrams`; `ticks`: control periods between two of them."""

    latency: float
    jitter: float
    silence: float
    loss: float
    ticks: int


class DropoutSettings(NamedTuple):
    """As `Dropout`, (dropouts,) each."""

    axle: NDArray[np.int64]
    begin: Floats
    until: Floats


class SensorSettings(NamedTuple):
    """As `Sensors`; `pole`: of the speed estimate without sensors, 0: sensors."""

    noisy: bool
    quantum: float
    pole: float
    blind_share: float
    dropout: DropoutSettings


class BrakeSettings(NamedTuple):
    """As `Braking`; `by_pressure`: whether the air brake's force is that of the cylinders' pressure."""

    inertia_in_estimate: bool
    by_pressure: bool
    blend_time: float
    release_speed: float


class Settings(NamedTuple):
    """Parameters of the on-board functions for one run."""

    period: float
    hold_time: float
    rise_time: float
    rule: RuleSettings
    hosted: bool  # whether the controller runs in Python; that of index `controller` is its reserve
    controller: int
    law: LawSettings
    detector: DetectorSettings
    observer: ObserverSettings
    telegrams: TelegramSettings
    sensors: SensorSettings
    reference: ReferenceSettings
    pace: ReferencePace
    brakes: BrakeSettings
    slide: SlideSettings
    sanding: SandingSettings
    learning: LearningSettings


def settings(onboard: Onboard, rule: RuleSettings, controller: str) -> Settings:
    """Settings of a run; `controller` names a built-in one, any other name stands for one that is hosted."""
    period, sensors, braking = onboard.period, onboard.sensors, onboard.braking
    hosted = controller not in BUILT_IN
    lost = np.array([(one.axle, one.begin, one.until) for one in sensors.dropouts], dtype=float)
    lost = lost.reshape(-1, 3)
    return filled(
        Settings,
        onboard,
        rule=rule._replace(on_slip=rule.on_slip or onboard.trigger == "slip"),
        hosted=hosted,
        controller=list(BUILT_IN).index(RESERVE if hosted else controller),
        law=law_settings(onboard),
        detector=filled(
            DetectorSettings,
            onboard.detector,
            gain=differentiator_gain(onboard.detector.pole, period),
        ),
        observer=ObserverSettings(
            float(onboard.observer.pole), *observer_gains(onboard.observer.pole, period)
        ),
        telegrams=filled(
            TelegramSettings,
            onboard.telegrams,
            ticks=max(1, round(onboard.telegrams.period / period)),
        ),
        sensors=filled(
            SensorSettings,
            sensors,
            noisy=sensors.speed_noise > 0.0,
            quantum=sensors.speed_quantum,
            pole=sensors.sensorless_pole or 0.0,
            dropout=DropoutSettings(lost[:, 0].astype(np.int64), *lost[:, 1:].T.copy()),
        ),
        reference=reference_settings(onboard),
        pace=reference_pace(onboard.reference, period),
        brakes=filled(BrakeSettings, braking, by_pressure=braking.air_force == "pressure"),
        slide=slide_settings(braking.slide_protection, period),
        sanding=filled(SandingSettings, onboard.sanding),
        learning=filled(
            LearningSettings,
            onboard.learning,
            learner=KINDS[onboard.learning.kind],
            held=onboard.learning.reference == "held",
        ),
    )
