"""What a scenario file says about the equipment on board, and what the train believes."""

from typing import Literal

from pydantic import field_validator

from alloc.onboard import (
    Belief,
    Braking,
    CreepControl,
    CutAndRamp,
    Detector,
    Dropout,
    Fuzzy,
    Observer,
    Onboard,
    PerturbObserve,
    ReferenceSpeed,
    Sensors,
    SlideProtection,
    SteepestGradient,
    Telegrams,
    Threshold,
    TorqueTable,
)
from alloc.onboard.slide_protection import SENSITIVITIES
from alloc.plant.adhesion import AdhesionCurve
from studies.scenario.rail_keys import CurveKeys, IncrementKeys
from studies.scenario.strict import Strict
from studies.scenario.units import si


class DetectorKeys(Strict):
    """Slip detector: `[onboard.detector]`."""

    on_kmhs: float | None = None
    off_kmhs: float | None = None
    pole_per_s: float | None = None
    speed_on_kmh: float | None = None


class ObserverKeys(Strict):
    """Disturbance observer: `[onboard.observer]`."""

    pole_per_s: float | None = None


class CutAndRampKeys(Strict):
    """Cut-and-ramp controller: `[onboard.cut_and_ramp]`."""

    cut: float | None = None
    recover: float | None = None
    hold_s: float | None = None
    ramp_s: float | None = None


class TableKeys(Strict):
    """Torque table of the readhesion paper: `[onboard.table]`."""

    margin_kmhs: float | None = None
    width_kmhs: float | None = None
    rise_s: float | None = None
    fall_s: float | None = None
    time_constant_s: float | None = None


class CreepKeys(Strict):
    """Creep control, and what the searching controllers share with it: `[onboard.creep]`."""

    reference_kmh: float | None = None
    proportional_s_per_m: float | None = None
    integral_per_m: float | None = None


class PerturbObserveKeys(Strict):
    """Perturb and observe: `[onboard.perturb_observe]`."""

    interval_s: float | None = None
    step_kmh: float | None = None
    lowest_kmh: float | None = None
    highest_kmh: float | None = None


class SteepestGradientKeys(Strict):
    """Steepest gradient: `[onboard.steepest_gradient]`."""

    interval_s: float | None = None
    gain_m2_per_s2: float | None = None
    least_kmh: float | None = None
    largest_kmh: float | None = None
    lowest_kmh: float | None = None
    highest_kmh: float | None = None


class TelegramKeys(Strict):
    """Telegrams along the train: `[onboard.telegrams]`."""

    period_s: float | None = None
    latency_s: float | None = None
    jitter_s: float | None = None
    loss: float | None = None
    silence_s: float | None = None


class DropoutKeys(Strict):
    """A speed signal that is lost for a time, to the end where nothing is said: `[[onboard.sensors.dropouts]]`."""

    axle: int
    begin_s: float
    until_s: float | None = None


class SensorKeys(Strict):
    """Sensors: `[onboard.sensors]`; the noise is drawn from the seed."""

    speed_noise_kmh: float | None = None
    speed_quantum_kmh: float | None = None
    load_error: float | None = None
    sensorless_pole_per_s: float | None = None
    dropouts: tuple[DropoutKeys, ...] = ()
    blind_share: float | None = None

    def sensors(self, seed: int) -> Sensors:
        """The sensors; `seed` draws their errors."""
        values = si(self) | {"dropouts": tuple(Dropout(**si(one)) for one in self.dropouts)}
        return Sensors(**values, seed=seed)


class ThresholdKeys(Strict):
    """Switching points of a plain slide protection: `[onboard.braking.slide_protection.threshold]`."""

    release: float | None = None
    hold: float | None = None


class FuzzyKeys(Strict):
    """Sets and sensitivity of the fuzzy slide protection: `[onboard.braking.slide_protection.fuzzy]`."""

    sensitivity: float | None = None
    slip: tuple[float, float, float] | None = None
    rate_kmhs: tuple[float, float, float] | None = None
    pole_per_s: float | None = None

    @field_validator("sensitivity", mode="before")
    @classmethod
    def _named(cls, value: object) -> object:
        if isinstance(value, str):
            if value not in SENSITIVITIES:
                raise ValueError(f"must be {', '.join(map(repr, SENSITIVITIES))} or a number")
            return SENSITIVITIES[value]
        return value


class SlideProtectionKeys(Strict):
    """Wheel slide protection of the air brakes: `[onboard.braking.slide_protection]`."""

    law: Literal["none", "threshold", "fuzzy"] | None = None
    period_s: float | None = None
    reference: Literal["train", "car"] | None = None
    deceleration_kmhs: float | None = None
    sounding_s: float | None = None
    cut_out_speed_kmh: float | None = None
    time_out_s: float | None = None
    refill_s: float | None = None
    threshold: ThresholdKeys = ThresholdKeys()
    fuzzy: FuzzyKeys = FuzzyKeys()

    def slide_protection(self) -> SlideProtection:
        """The train's slide protection."""
        return SlideProtection(
            **si(self), threshold=Threshold(**si(self.threshold)), fuzzy=Fuzzy(**si(self.fuzzy))
        )


class BrakingKeys(Strict):
    """Brakes: `[onboard.braking]`."""

    blended: bool | None = None
    blend_time_s: float | None = None
    inertia_in_estimate: bool | None = None
    release_speed_kmh: float | None = None
    slide_protection: SlideProtectionKeys = SlideProtectionKeys()


class ReferenceKeys(Strict):
    """Reference speed: `[onboard.reference]`."""

    bound: Literal["command", "forces"] | None = None
    margin_kmhs: float | None = None


class BeliefKeys(Strict):
    """What the train believes where that differs from the truth: `[belief]`."""

    increments: IncrementKeys | None = None
    unit_increments: tuple[float, ...] | None = None
    unit_deviation: tuple[float, ...] | None = None
    curve: CurveKeys | None = None
    loads_t: tuple[float, ...] | None = None


class OnboardKeys(Strict):
    """Equipment of the train: `[onboard]`."""

    hold_time_s: float | None = None
    rise_time_s: float | None = None
    period_s: float | None = None
    limit_rate: float | None = None
    inertia_in_limit: bool | None = None
    detector: DetectorKeys = DetectorKeys()
    observer: ObserverKeys = ObserverKeys()
    cut_and_ramp: CutAndRampKeys = CutAndRampKeys()
    table: TableKeys = TableKeys()
    creep: CreepKeys = CreepKeys()
    perturb_observe: PerturbObserveKeys = PerturbObserveKeys()
    steepest_gradient: SteepestGradientKeys = SteepestGradientKeys()
    telegrams: TelegramKeys = TelegramKeys()
    sensors: SensorKeys = SensorKeys()
    braking: BrakingKeys = BrakingKeys()
    reference: ReferenceKeys = ReferenceKeys()

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
            cut_and_ramp=CutAndRamp(**si(self.cut_and_ramp)),
            table=TorqueTable(**si(self.table)),
            creep=CreepControl(**si(self.creep)),
            perturb_observe=PerturbObserve(**si(self.perturb_observe)),
            steepest_gradient=SteepestGradient(**si(self.steepest_gradient)),
            telegrams=Telegrams(**si(self.telegrams)),
            sensors=self.sensors.sensors(seed),
            reference=ReferenceSpeed(**si(self.reference)),
            braking=Braking(
                **si(self.braking),
                slide_protection=self.braking.slide_protection.slide_protection(),
            ),
            belief=Belief(
                increments=increments,
                unit_increments=belief.unit_increments,
                unit_deviation=belief.unit_deviation,
                curve=curve,
                loads=None if belief.loads_t is None else tuple(1e3 * t for t in belief.loads_t),
            ),
        )
