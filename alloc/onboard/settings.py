"""What differs between runs, as compiled code reads it: parameters of the on-board functions."""

from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.onboard.controllers.collection import BUILT_IN, LawSettings, law_settings
from alloc.onboard.detector import differentiator_gain
from alloc.onboard.observer import observer_gains
from alloc.onboard.parameters import Onboard
from alloc.onboard.slide_protection.state import SlideSettings, slide_settings

Floats = NDArray[np.float64]

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


class ReferenceSettings(NamedTuple):
    """As `ReferenceSpeed`."""

    by_forces: bool
    margin: float


class BrakeSettings(NamedTuple):
    """As `Braking`; `inertia` 1: the estimate (18) counts the wheelsets' deceleration, 0: as printed."""

    inertia: float
    blend_time: float
    release_speed: float


class Settings(NamedTuple):
    """Parameters of the on-board functions for one run."""

    period: float
    hold_time: float
    rise_time: float
    rule: RuleSettings
    hosted: (
        bool  # whether the controller runs in Python, and the one of index `controller` in reserve
    )
    controller: int
    law: LawSettings
    detector: DetectorSettings
    observer: ObserverSettings
    telegrams: TelegramSettings
    sensors: SensorSettings
    reference: ReferenceSettings
    brakes: BrakeSettings
    slide: SlideSettings


def settings(onboard: Onboard, rule: RuleSettings, controller: str) -> Settings:
    """Settings of a run; `controller` names a built-in one, any other name stands for one that is hosted."""
    d, t, sensors, braking = onboard.detector, onboard.telegrams, onboard.sensors, onboard.braking
    hosted = controller not in BUILT_IN
    return _typed(
        Settings(
            period=onboard.period,
            hold_time=onboard.hold_time,
            rise_time=onboard.rise_time,
            rule=rule,
            hosted=hosted,
            controller=list(BUILT_IN).index(RESERVE if hosted else controller),
            law=law_settings(onboard),
            detector=DetectorSettings(
                d.on, d.off, d.pole, differentiator_gain(d.pole, onboard.period), d.speed_on
            ),
            observer=ObserverSettings(
                onboard.observer.pole, *observer_gains(onboard.observer.pole, onboard.period)
            ),
            telegrams=TelegramSettings(
                t.latency, t.jitter, t.silence, t.loss, max(1, round(t.period / onboard.period))
            ),
            sensors=SensorSettings(
                noisy=sensors.speed_noise > 0.0,
                quantum=sensors.speed_quantum,
                pole=sensors.sensorless_pole or 0.0,
                blind_share=sensors.blind_share,
                dropout=DropoutSettings(
                    np.array([one.axle for one in sensors.dropouts], dtype=np.int64),
                    np.array([one.begin for one in sensors.dropouts], dtype=float),
                    np.array([one.until for one in sensors.dropouts], dtype=float),
                ),
            ),
            reference=ReferenceSettings(
                onboard.reference.bound == "forces", onboard.reference.margin or 0.0
            ),
            brakes=BrakeSettings(
                float(braking.inertia_in_estimate), braking.blend_time, braking.release_speed
            ),
            slide=slide_settings(braking.slide_protection, onboard.period),
        )
    )


def _typed(record: Any) -> Any:
    """The same record with every number of the type that its field states: for another type all is compiled anew."""
    kinds = type(record).__annotations__
    values = (
        _typed(value)
        if isinstance(value, tuple)
        else kinds[name](value)
        if kinds.get(name) in (float, int, bool)
        else value
        for name, value in zip(record._fields, record, strict=True)
    )
    return type(record)(*values)
