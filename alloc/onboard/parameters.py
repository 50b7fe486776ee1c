"""Parameters of what runs on board; what the train believes is kept apart from what is true."""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from typing import Any, Literal

from alloc.errors import OnboardError
from alloc.onboard.controllers.collection import BuiltInControllers
from alloc.onboard.increment_learning import IncrementLearning, LearntIncrements
from alloc.onboard.quantity import NOT_IN_FILES, quantity
from alloc.onboard.reference_speed.parameters import ReferenceSpeed
from alloc.onboard.sanding import Sanding
from alloc.onboard.slide_protection.parameters import SlideProtection
from alloc.plant.adhesion import AdhesionCurve, PiecewiseCurve


@dataclass(frozen=True)
class Detector:
    """Slip detector with hysteresis (JP5484215 Fig. 5): mean computed axle acceleration of the unit.

    `on`, `off` [m/s2]: signal on above `on`, off at or below `off` < `on`, measured in the direction of the demand.
    `pole` [1/s]: of the differentiator that computes the accelerations. `speed_on` [m/s]: signal also on where the
    slip of the unit's worst axle against the reference speed exceeds it, since a small deficit accelerates the wheels too
    little for `on`, and one slipping axle of four moves the mean too little (not in the patent; inf switches it off);
    off again below half of it.
    """

    on: float = quantity(1.8, "km/h/s")
    off: float = quantity(0.9, "km/h/s")
    pole: float = quantity(40.0, "1/s")
    speed_on: float = quantity(0.6, "km/h")

    def __post_init__(self) -> None:
        OnboardError.check("detector", self, positive=("on", "pole", "speed_on"))
        OnboardError.check_order("detector", self, "off", "on")


@dataclass(frozen=True)
class Observer:
    """Minimal-order disturbance observer, JP5484215 (3); `pole` a [1/s]."""

    pole: float = quantity(25.0, "1/s")

    def __post_init__(self) -> None:
        OnboardError.check("observer", self, positive=("pole",))


@dataclass(frozen=True)
class Telegrams:
    """Periodic telegrams of the train monitor system; times in s, `loss` a probability.

    A unit that has heard nothing for `silence` falls back to its planned limit.
    """

    period: float = quantity(0.1, "s")
    latency: float = quantity(0.05, "s")
    jitter: float = quantity(0.0, "s")
    loss: float = quantity(0.0, "1")
    silence: float = quantity(1.0, "s")

    def __post_init__(self) -> None:
        OnboardError.check("telegrams", self, ("period", "silence"), ("latency", "jitter"))
        if not 0.0 <= self.loss <= 1.0:
            raise OnboardError(f"telegrams: loss = {self.loss!r} must lie in [0, 1]")


@dataclass(frozen=True)
class Dropout:
    """Loss of the speed signal of `axle` (0 = foremost) from `begin` to `until` [s]; the computers notice it."""

    axle: int
    begin: float = quantity(MISSING, "s")
    until: float = quantity(math.inf, "s")

    def __post_init__(self) -> None:
        if not isinstance(self.axle, int) or self.axle < 0:
            raise OnboardError(f"dropout: axle = {self.axle!r} must be a whole number from 0 on")
        if not self.begin < self.until:
            raise OnboardError(
                f"dropout: begin = {self.begin!r} must lie before until = {self.until!r}"
            )


@dataclass(frozen=True)
class Sensors:
    """Axle speed sensors and load signals.

    `speed_noise` [m/s at the rim], standard deviation per sample; `speed_quantum` [m/s at the rim], 0: none; `load_error`:
    standard deviation of the relative error of the load signals, drawn once per run. `radius_error`: greatest relative error
    of the wheel radii that the computers believe in, as wear leaves it, drawn evenly. `seed` draws all of them.
    `sensorless_pole` [1/s]: motor speeds are estimated without sensors, known per unit as the mean of its axles through a
    low-pass filter of this pole; None: every axle has a sensor. Axles without motor keep theirs.
    `dropouts`: signals lost for a time. A unit goes on with the axles that it still sees; one that sees none takes the
    reference speed for its own, knows no slip, and pulls with `blind_share` of its target (assumed).
    """

    speed_noise: float = quantity(0.0, "km/h")
    speed_quantum: float = quantity(0.0, "km/h")
    load_error: float = quantity(0.0, "1")
    radius_error: float = quantity(0.0, "1")
    seed: int = field(default=0, metadata=NOT_IN_FILES)
    sensorless_pole: float | None = quantity(None, "1/s")
    dropouts: tuple[Dropout, ...] = ()
    blind_share: float = quantity(0.5, "1")

    def __post_init__(self) -> None:
        OnboardError.check(
            "sensors",
            self,
            nonnegative=("speed_noise", "speed_quantum", "load_error", "radius_error"),
        )
        if self.sensorless_pole is not None:
            OnboardError.check("sensors", self, positive=("sensorless_pole",))
            if self.dropouts:
                raise OnboardError(
                    "sensors: dropouts need sensors; leave out sensorless_pole or the dropouts"
                )
        if not 0.0 <= self.blind_share <= 1.0:
            raise OnboardError(f"sensors: blind_share = {self.blind_share!r} must lie in [0, 1]")


@dataclass(frozen=True)
class Braking:
    """Brakes of the train. `blended`: every car brakes itself, the air brake filling what the electric brake lacks and
    serving the trailers alone, as JP5484215, embodiment 3; else the motors brake the whole train. A train without air brakes
    is never blended; one without motors brakes with air alone.

    `blend_time` [s]: time in which the motors take over a full brake from the air (assumed: a few times the cylinders' lag).
    `inertia_in_estimate`: (18) counts what decelerates the wheelsets, as the observer does; as printed it does not, and
    finds more adhesion than there is in wheels that are just being braked to a slide.
    `air_force`: the air brake's force in (18) and beside a limit is that of the cylinders' "pressure", or the "command" as
    printed, which the cylinders lag.
    `slide_protection`: what the valves of the air brakes do while wheels slide, which the patent does not describe and
    without which a trailer's wheels would lock; a plain threshold if nothing is said. `release_speed` [m/s]: reference speed
    below which the driver releases, so that a run ends rolling; 0: brakes stay on to the standstill and beyond.
    `car_shares`: brake force that each car by weight is asked for, relative to the plan, from the front; None: 1 for all.
    It holds for cars that brake by air alone; limits of the others are the allocation rule's.
    """

    blended: bool = True
    blend_time: float = quantity(4.0, "s")
    inertia_in_estimate: bool = True
    air_force: Literal["pressure", "command"] = "pressure"
    slide_protection: SlideProtection = field(default_factory=SlideProtection)
    release_speed: float = quantity(0.5, "km/h")
    car_shares: tuple[float, ...] | None = quantity(None, "1")

    def __post_init__(self) -> None:
        shares = () if self.car_shares is None else ("car_shares[]",)
        OnboardError.check("braking", self, ("blend_time",), ("release_speed", *shares))
        OnboardError.check_choice("braking", "air_force", self.air_force, ("pressure", "command"))


@dataclass(frozen=True)
class Belief:
    """What the train takes for true: growth of adhesion per axle from the front, and the adhesion curve.

    `increments` None: all zero. JP5484215 (15) gives Shinkansen values. `unit_increments`: increment of each traction unit
    over the foremost one, as learnt; stands in place of `increments`, from which it is otherwise the mean over the
    unit's axles. `unit_deviation`: standard deviation of each unit's cap about the truth, for rules that know risk.
    `learnt`: with what the train begins that has learnt before; stands in place of all of these.
    `loads`: pay load of each car [kg] in place of the load sensors, as learnt from the train's motion (JP H07-322414).
    `mass_factor`, `resistance_factor`, `coupler_factor`: believed over true empty mass, running resistance, and stiffness of
    the draft gear, as the reference speed's estimate takes them.
    """

    increments: tuple[float, ...] | None = None
    unit_increments: tuple[float, ...] | None = None
    unit_deviation: tuple[float, ...] | None = None
    learnt: LearntIncrements | None = None
    curve: AdhesionCurve = field(default_factory=PiecewiseCurve)
    loads: tuple[float, ...] | None = None
    mass_factor: float = 1.0
    resistance_factor: float = 1.0
    coupler_factor: float = 1.0

    def __post_init__(self) -> None:
        OnboardError.check(
            "belief", self, ("mass_factor", "coupler_factor"), nonnegative=("resistance_factor",)
        )
        factors = ("mass_factor", "resistance_factor", "coupler_factor")
        OnboardError.check_finite("belief", self, factors)
        if self.loads is not None and not all(math.isfinite(x) and x >= 0.0 for x in self.loads):
            raise OnboardError(
                f"belief: loads = {self.loads} must be finite, 0 or greater, one per car in kg"
            )


@dataclass(frozen=True)
class Onboard(BuiltInControllers):
    """Equipment of a train, the readhesion controllers' parameters included.

    `trigger`: a rule is asked while any unit is "limited", by its own report, or at the foremost unit's "slip" alone, as
    JP5484215 says; then `hold_time` [s] is the time without slip after which limits return to the plan. `rise_time` [s]:
    time in which a unit's torque rises from zero to the expected torque (jerk limit). `period` [s]: control period.
    `limit_rate`: largest change of a limit per allocation, for the rules that know rates. `inertia_in_limit`: a unit's
    torque is its limit (6) plus what turns its own wheelsets, so that limits, caps and plan are all coefficients at the
    rail; without it (6) as printed, whose torque delivers less at the rail than the cap by that part.
    `hosted`: settings of controllers in Python by the controller's name; those not named take their defaults.
    """

    detector: Detector = field(default_factory=Detector)
    observer: Observer = field(default_factory=Observer)
    telegrams: Telegrams = field(default_factory=Telegrams)
    sensors: Sensors = field(default_factory=Sensors)
    belief: Belief = field(default_factory=Belief, metadata=NOT_IN_FILES)
    braking: Braking = field(default_factory=Braking)
    sanding: Sanding = field(default_factory=Sanding)
    learning: IncrementLearning = field(default_factory=IncrementLearning)
    reference: ReferenceSpeed = field(default_factory=ReferenceSpeed)
    trigger: Literal["limited", "slip"] = "limited"
    hold_time: float = quantity(5.0, "s")
    rise_time: float = quantity(1.0, "s")
    period: float = quantity(0.01, "s")
    limit_rate: float | None = quantity(None, "1")
    inertia_in_limit: bool = True
    hosted: Mapping[str, Any] = field(default_factory=dict, hash=False, metadata=NOT_IN_FILES)

    def __post_init__(self) -> None:
        OnboardError.check_choice("on board", "trigger", self.trigger, ("limited", "slip"))
        OnboardError.check("on board", self, positive=("hold_time", "rise_time", "period"))
        if self.limit_rate is not None and not self.limit_rate > 0.0:
            raise OnboardError(f"on board: limit_rate = {self.limit_rate!r} must exceed 0")
        if self.telegrams.period < self.period:
            raise OnboardError(
                f"telegrams: period = {self.telegrams.period!r} must not be below the control period "
                f"{self.period!r}"
            )

    def with_settings(self, settings: Mapping[str, Any]) -> "Onboard":
        """The same equipment but for `settings`: values by the path of their fields, as "detector.pole".

        Raises `OnboardError` for a path that is no field, and for a value out of range.
        """
        changed = self
        for path, value in settings.items():
            part, _, name = path.rpartition(".")
            inner: Any = getattr(changed, part, None) if part else changed
            if name not in ({one.name for one in fields(inner)} if is_dataclass(inner) else ()):
                raise OnboardError(
                    f"a rule's setting {path!r} is no field of the equipment; see alloc.onboard.parameters.Onboard"
                )
            inner = replace(inner, **{name: value})
            changed = replace(changed, **{part: inner}) if part else inner
        return changed
