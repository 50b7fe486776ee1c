"""What a scenario file says about the equipment on board, and what the train believes."""

from alloc.onboard import (
    Belief,
    Braking,
    CutAndRamp,
    Detector,
    Observer,
    Onboard,
    Sensors,
    Telegrams,
)
from alloc.plant.adhesion import AdhesionCurve
from studies.rail_keys import CurveKeys, IncrementKeys
from studies.strict import Strict
from studies.units import si


class DetectorKeys(Strict):
    """Slip detector: `[onboard.detector]`."""

    on_kmhs: float | None = None
    off_kmhs: float | None = None
    pole_per_s: float | None = None
    speed_on_kmh: float | None = None


class ObserverKeys(Strict):
    """Disturbance observer: `[onboard.observer]`."""

    pole_per_s: float | None = None


class ReadhesionKeys(Strict):
    """Cut-and-ramp controller: `[onboard.readhesion]`."""

    cut: float | None = None
    recover: float | None = None
    hold_s: float | None = None
    ramp_s: float | None = None


class TelegramKeys(Strict):
    """Telegrams along the train: `[onboard.telegrams]`."""

    period_s: float | None = None
    latency_s: float | None = None
    jitter_s: float | None = None
    loss: float | None = None
    silence_s: float | None = None


class SensorKeys(Strict):
    """Sensors: `[onboard.sensors]`; the noise is drawn from the seed."""

    speed_noise_kmh: float | None = None
    speed_quantum_kmh: float | None = None
    load_error: float | None = None
    sensorless_pole_per_s: float | None = None


class BrakingKeys(Strict):
    """Blended brakes: `[onboard.braking]`."""

    blended: bool | None = None
    blend_time_s: float | None = None
    inertia_in_estimate: bool | None = None
    release: float | None = None
    hold: float | None = None


class BeliefKeys(Strict):
    """What the train believes where that differs from the truth: `[belief]`."""

    increments: IncrementKeys | None = None
    unit_increments: tuple[float, ...] | None = None
    unit_deviation: tuple[float, ...] | None = None
    curve: CurveKeys | None = None


class OnboardKeys(Strict):
    """Equipment of the train: `[onboard]`."""

    hold_time_s: float | None = None
    rise_time_s: float | None = None
    period_s: float | None = None
    limit_rate: float | None = None
    inertia_in_limit: bool | None = None
    detector: DetectorKeys = DetectorKeys()
    observer: ObserverKeys = ObserverKeys()
    readhesion: ReadhesionKeys = ReadhesionKeys()
    telegrams: TelegramKeys = TelegramKeys()
    sensors: SensorKeys = SensorKeys()
    braking: BrakingKeys = BrakingKeys()

    def onboard(
        self,
        belief: BeliefKeys,
        true_increments: IncrementKeys,
        true_curve: AdhesionCurve,
        axles: int,
        seed: int,
    ) -> Onboard:
        """The train's equipment; it believes the truth except for what `belief` says. `seed` draws the sensors' errors."""
        increments = (belief.increments or true_increments).increments(axles)
        curve = true_curve if belief.curve is None else belief.curve.curve()
        return Onboard(
            **si(self),
            detector=Detector(**si(self.detector)),
            observer=Observer(**si(self.observer)),
            readhesion=CutAndRamp(**si(self.readhesion)),
            telegrams=Telegrams(**si(self.telegrams)),
            sensors=Sensors(**si(self.sensors), seed=seed),
            braking=Braking(**si(self.braking)),
            belief=Belief(
                increments=increments,
                unit_increments=belief.unit_increments,
                unit_deviation=belief.unit_deviation,
                curve=curve,
            ),
        )
