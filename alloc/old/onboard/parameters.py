"""Parameters of the equipment on board; what the train believes is kept apart from the truth.

In: keys of scenario files, by the units that each field states. Out: an `Onboard`, validated. All in SI units.
"""

import math
from collections.abc import Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from typing import Any, ClassVar, Literal

from alloc.old.display import displayed
from alloc.old.errors import OnboardError
from alloc.old.onboard.brakes import Sanding, SlideProtection
from alloc.old.onboard.controllers.collection import BuiltInControllers
from alloc.old.onboard.increment_learning import IncrementLearning, LearntIncrements
from alloc.old.plant.adhesion import AdhesionCurve, PiecewiseCurve
from alloc.old.records import NOT_IN_FILES, quantity

# Parameters of the reference speed's estimate. SI units; all assumed, tuned on drawn events of traction and braking.


COMPARED = 1e-4
"""Relative deviation of radii that were compared: 3 s at 10 m/s and with 10 mm/s of noise in a reading leave as much."""


@dataclass(frozen=True)
class TorqueRelief:
    """When and how force is taken from a few wheels, so that they roll and show the speed.

    Source: assumed; tuned on drawn events of traction and braking.
    """

    doubt: float = quantity(0.05, "km/h")
    """Deviation of the estimate above which a unit's torque is cut [m/s]."""
    doubt_ratio: float = quantity(0.004, "1")
    """The same deviation over the speed; the larger of the two bounds applies."""
    ease: ClassVar[float] = 2.4
    """Factor of both deviations while a unit is within adhesion."""
    share: float = quantity(0.4, "1")
    """Share of its torque that a relieved unit keeps, 0 to 1."""
    time: float = quantity(0.06, "s")
    """Time for which its torque is cut at least [s]."""
    longest: float = quantity(0.2, "s")
    """The same at most, where no wheel has settled and shown the speed, at least `time` [s]."""
    return_time: float = quantity(0.06, "s")
    """Time in which its torque returns [s]."""
    pause: float = quantity(0.3, "s")
    """Shortest time from one torque relief to the next [s]."""
    air_doubt: float = quantity(0.06, "1")
    """Deviation over the speed above which a bogie is released."""
    air_known: ClassVar[float] = 0.03
    """Deviation over the speed at which it brakes again, less than `air_doubt`."""
    patience: ClassVar[float] = 5.0
    """Factor of `air_doubt` while an axle runs near the estimate."""

    def __post_init__(self) -> None:
        numbers = sorted({one.name for one in fields(self)} - {"share"})
        OnboardError.check("relief", self, numbers, ("share",), infinite=("share",))
        if self.share > 1.0:
            raise OnboardError(f"relief: share = {self.share!r} must lie in [0, 1]")
        OnboardError.check_order("relief", self, "air_known", "air_doubt")
        OnboardError.check_order("relief", self, "time", "longest", equal=True)


@dataclass(frozen=True)
class ReferenceSpeed:
    """Kalman filter of the train's speed, see `alloc.old.onboard.reference_speed`.

    Source: assumed; tuned on drawn events of traction and braking.
    """

    source: Literal["estimate", "truth"] = "estimate"
    """The computers estimate the train's speed, or they get the true one, for comparisons; no train has the true one.
    Source: this project."""
    sensor: float = quantity(0.005, "km/h")
    """Deviation of a speed reading, beside the sensors' own noise, at the rim [m/s]."""
    speed_walk: ClassVar[float] = 1e-3
    """Deviation by which the speed changes unforeseen, per root s [m/s]."""
    force_walk: ClassVar[float] = 5e-3
    """Deviation by which the unknown specific force changes, per root s [m/s2]."""
    unknown_force: ClassVar[float] = 0.2
    """Deviation of the unknown specific force at the start, mainly a gradient [m/s2]."""
    shoe_error: ClassVar[float] = 0.1
    """Deviation of the shoes' friction, relative."""
    shoe_walk: ClassVar[float] = 0.02
    """Deviation by which the shoes' friction changes, relative, per root s."""
    mass_error: ClassVar[float] = 0.05
    """Deviation of the mass, relative."""
    slip: ClassVar[float] = 0.25
    """Micro-slip per coefficient of force [m/s]."""
    slip_deviation: ClassVar[float] = 0.2
    """Deviation of the micro-slip per coefficient at the start [m/s]."""
    creep: float = quantity(0.01, "1")
    """Deviation of the slip ratio of a wheel that rolls at the full adhesion."""
    creep_speed: float = quantity(5.0, "km/h")
    """Below this speed `creep` has its value at this speed [m/s]."""
    repeat: float = quantity(100.0, "1")
    """Number of samples over which the creep of a wheel is the same."""
    light_repeat: ClassVar[float] = 16.0
    """The same of a wheel with little force."""
    relieved_repeat: ClassVar[float] = 0.3
    """The same while a unit is relieved."""
    ease_time: ClassVar[float] = 0.3
    """An axle whose force nobody limits is at ease after this time [s]."""
    light: ClassVar[float] = 0.85
    """Share of the force that it carried lately below which a wheel is light and rolls."""
    carried_time: ClassVar[float] = 5.0
    """Time in which a wheel's largest force is forgotten [s]."""
    slid_time: ClassVar[float] = 1.0
    """The same while it certainly slides [s]."""
    away: ClassVar[float] = 0.2
    """Acceleration against the train of a wheel that does not roll [m/s2]."""
    returning: ClassVar[float] = 0.45
    """Acceleration against the train of a wheel that returns from a slide [m/s2]."""
    gate: ClassVar[float] = 3.0
    """Number of deviations beyond which an axle at ease counts as slipping."""
    persist: ClassVar[float] = 0.6
    """Time for which a braked axle must show a deviating speed to be believed [s]."""
    radius_deviation: float = quantity(0.01, "1")
    """Deviation of the wheels' believed radii before any comparison, relative. The computers compare them while the train
    rolls; 0: they never do."""
    radii_compared: bool = True
    """Whether the train has rolled before the run, so that only the error that all radii have in common is left."""
    relief: TorqueRelief = field(default_factory=TorqueRelief)
    """When force is taken from a few wheels to learn the speed."""

    def __post_init__(self) -> None:
        OnboardError.check_choice("reference speed", "source", self.source, ("estimate", "truth"))
        positive, others = ("sensor", "creep"), ("creep_speed", "repeat", "radius_deviation")
        OnboardError.check("reference speed", self, positive, others, infinite=())

    @property
    def radius_prior(self) -> float:
        """Deviation of the believed radii from their mean at the start of a run, relative; 0: they are never compared."""
        return min(COMPARED if self.radii_compared else 1.0, self.radius_deviation)


LARGEST_ERRORS = {"load_error": 1.0, "radius_error": 0.5}
"""As shares; wear takes less than a tenth of a wheel's radius."""


@dataclass(frozen=True)
class Detector:
    """Slip detector with hysteresis: mean computed axle acceleration of the unit, in the direction of the demand.

    Source: JP5484215, Fig. 5; the values are assumed.
    """

    on: float = quantity(1.8, "km/h/s")
    """The slip signal is on above this acceleration [m/s2]."""
    off: float = quantity(0.9, "km/h/s")
    """The slip signal is off at or below this acceleration, which is less than `on` [m/s2]."""
    pole: float = quantity(40.0, "1/s")
    """Pole of the differentiator that computes the accelerations [1/s]."""
    speed_on: float = quantity(0.6, "km/h")
    """The signal is also on where the slip of the unit's worst axle against the reference speed exceeds this; off again
    below half of it [m/s]. A small deficit accelerates the wheels too little for `on`, and one slipping axle of four moves
    the mean too little. A large value switches it off. Source: assumed; not in JP5484215."""

    def __post_init__(self) -> None:
        OnboardError.check("detector", self, positive=("on", "pole", "speed_on"))
        OnboardError.check_order("detector", self, "off", "on")


@dataclass(frozen=True)
class Observer:
    """Minimal-order disturbance observer.

    Source: JP5484215 (3); the value is assumed.
    """

    pole: float = quantity(25.0, "1/s")
    """Pole a of the observer [1/s]."""

    def __post_init__(self) -> None:
        OnboardError.check("observer", self, positive=("pole",))


@dataclass(frozen=True)
class Telegrams:
    """Periodic telegrams of the train monitor system.

    Source: JP5484215 has telegrams, without numbers; the values are assumed.
    """

    period: float = quantity(0.1, "s")
    """Time from one telegram of a unit to its next [s]."""
    latency: float = quantity(0.05, "s")
    """Time from sending to receiving [s]."""
    jitter: float = quantity(0.0, "s")
    """Largest time that is added to `latency`, drawn uniformly for each telegram [s]."""
    loss: float = quantity(0.0, "1")
    """Probability that a telegram is lost, 0 to 1."""
    silence: float = quantity(1.0, "s")
    """A unit that has received nothing for this time falls back to its planned limit [s]."""

    def __post_init__(self) -> None:
        OnboardError.check("telegrams", self, ("period", "silence"), ("latency", "jitter"))
        if not 0.0 <= self.loss <= 1.0:
            raise OnboardError(f"telegrams: loss = {self.loss!r} must lie in [0, 1]")


@dataclass(frozen=True)
class Dropout:
    """Loss of the speed signal of an axle for a time; the computers notice it.

    Source: this project.
    """

    axle: int
    """Number of the axle in the train, 0 = foremost."""
    begin: float = quantity(MISSING, "s")
    """Instant from which the signal is lost [s]."""
    until: float = quantity(math.inf, "s")
    """Instant at which the signal returns [s]. Left out: it never returns."""

    def __post_init__(self) -> None:
        if not isinstance(self.axle, int) or self.axle < 0:
            raise OnboardError(f"dropout: axle = {self.axle!r} must be a whole number from 0 on")
        if not self.begin < self.until:
            raise OnboardError(
                f"dropout: begin = {self.begin!r} must lie before until = {self.until!r}"
            )


@dataclass(frozen=True)
class Sensors:
    """Axle speed sensors and load signals; `seed` draws their errors.

    Source: assumed; without a key the sensors are perfect.
    """

    speed_noise: float = quantity(0.0, "km/h")
    """Standard deviation of a sample of an axle's speed, at the rim [m/s]."""
    speed_quantum: float = quantity(0.0, "km/h")
    """Step to which an axle's speed is rounded, at the rim; 0: none [m/s]."""
    load_error: float = quantity(0.0, "1")
    """Standard deviation of the relative error of the load signals, drawn once per run, 0 to 1."""
    radius_error: float = quantity(0.0, "1")
    """Largest relative error of the wheel radii that the computers believe in, as wear leaves it; drawn uniformly, 0 to
    0.5."""
    seed: int = field(default=0, metadata=NOT_IN_FILES)
    sensorless_pole: float | None = quantity(None, "1/s")
    """Motor speeds are estimated without sensors: one speed per unit, the mean of its axles through a low-pass filter of
    this pole [1/s]. Axles without motor keep their sensors. Left out: every axle has a sensor."""
    dropouts: tuple[Dropout, ...] = ()
    """Speed signals that are lost for a time. A unit continues with the axles whose signals remain. A unit without any
    signal uses the reference speed as its own, and detects no slip."""
    blind_share: float = quantity(0.5, "1")
    """Share of its target with which a unit pulls that has no speed signal from any of its axles, 0 to 1."""

    def __post_init__(self) -> None:
        OnboardError.check(
            "sensors",
            self,
            nonnegative=("speed_noise", "speed_quantum", "load_error", "radius_error"),
        )
        for name, most in LARGEST_ERRORS.items():
            if getattr(self, name) > most:
                raise OnboardError(
                    f"sensors: {name} = {getattr(self, name)!r} must lie in 0 to {most:g}; it is a share, 0.01 for 1 %"
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
    """Brakes of the train. A train without air brakes is never blended; one without motors brakes with air alone."""

    blended: bool = True
    """Every car brakes itself: the air brake supplies what the electric brake lacks, and brakes the trailers alone.
    Otherwise the motors brake the whole train. Source: JP5484215, embodiment 3."""
    blend_time: float = quantity(4.0, "s")
    """Time in which the motors take over a full brake from the air brake [s]. Source: assumed: a few times the cylinders'
    lag."""
    inertia_in_estimate: bool = True
    """(18) counts the torque that decelerates the wheelsets, as the observer does. As printed it does not, and finds more
    adhesion than there is at wheels that the brakes are just forcing into a slide. Source: JP5484215 (18), corrected."""
    air_force: Literal["pressure", "command"] = "pressure"
    """Force of the air brake in (18) and beside a limit: that of the cylinders' pressure, or that of the command, behind
    which the cylinders lag. Source: JP5484215 (18) prints the command."""
    slide_protection: SlideProtection = field(default_factory=SlideProtection)
    """What the valves of the air brakes do while wheels slide; without it a trailer's wheels would lock. Source: not in
    JP5484215; see the table."""
    release_speed: float = quantity(0.5, "km/h")
    """Reference speed below which the driver releases the brakes, so that a run ends rolling; 0: brakes stay applied at the
    standstill and beyond [m/s]. Source: assumed."""
    car_shares: tuple[float, ...] | None = quantity(None, "1")
    """Brake force that each car is asked for by weight, relative to the plan, from the front. It applies to cars that brake
    by air alone; the allocation rule limits the others. Left out: 1 for all. Source: this project."""

    def __post_init__(self) -> None:
        shares = () if self.car_shares is None else ("car_shares[]",)
        OnboardError.check("braking", self, ("blend_time",), ("release_speed", *shares))
        OnboardError.check_choice("braking", "air_force", self.air_force, ("pressure", "command"))


@dataclass(frozen=True)
class Belief:
    """What the train assumes to be true. What it has learnt before (`learnt`) replaces all increments.

    Source: this project; a train believes the truth where nothing is said.
    """

    increments: tuple[float, ...] | None = None
    """Growth of the coefficient per axle from the front; None: all zero. Source: JP5484215 (15), Shinkansen."""
    unit_increments: tuple[float, ...] | None = None
    """Increment of the coefficient of each traction unit over the foremost one, as learnt; replaces `increments`. Left out:
    the mean of `increments` over the unit's axles. Source: JP5484215 (5)."""
    unit_deviation: tuple[float, ...] | None = None
    """Standard deviation of each unit's cap about the truth, for rules that take risk into account, from the front. Left
    out: these rules treat the caps as certain."""
    learnt: LearntIncrements | None = None
    """Increments that the train has learnt before and begins with; they replace the increments and their deviation."""
    curve: AdhesionCurve = field(default_factory=PiecewiseCurve)
    """Adhesion curve."""
    loads: tuple[float, ...] | None = None
    """Pay load of each car from the front in place of the load sensors, as learnt from the train's motion [kg]. Left out:
    the values of the load sensors. Source: JP H07-322414."""
    mass_factor: float = 1.0
    """Believed over true empty mass, as used by the reference speed's estimate."""
    resistance_factor: float = 1.0
    """Believed over true running resistance, as used by the reference speed's estimate."""
    coupler_factor: float = 1.0
    """Believed over true stiffness of the draft gear, as used by the reference speed's estimate."""

    def __post_init__(self) -> None:
        factors = ("mass_factor", "coupler_factor")
        OnboardError.check("belief", self, factors, ("resistance_factor",), infinite=())
        if self.loads is not None and not all(math.isfinite(x) and x >= 0.0 for x in self.loads):
            raise OnboardError(
                f"belief: loads = {self.loads} must be finite, 0 or greater, one per car in kg"
            )


@displayed
@dataclass(frozen=True)
class Onboard(BuiltInControllers):
    """Equipment of a train, the readhesion controllers' parameters included; SI units.

    Source: this project.
    """

    detector: Detector = field(default_factory=Detector)
    """Slip detector of every traction unit."""
    observer: Observer = field(default_factory=Observer)
    """Disturbance observer of every traction unit: it estimates the coefficient that the rail carries."""
    telegrams: Telegrams = field(default_factory=Telegrams)
    """Telegrams between the units."""
    sensors: Sensors = field(default_factory=Sensors)
    """Sensors of axle speeds and loads."""
    belief: Belief = field(default_factory=Belief, metadata=NOT_IN_FILES)
    """What the train assumes to be true."""
    braking: Braking = field(default_factory=Braking)
    """Brakes."""
    sanding: Sanding = field(default_factory=Sanding)
    """When the sanders work; a train has those that its cars name."""
    learning: IncrementLearning = field(default_factory=IncrementLearning)
    """Learning of the increments of adhesion along the train."""
    reference: ReferenceSpeed = field(default_factory=ReferenceSpeed)
    """Estimate of the train's speed, from which slip is measured."""
    trigger: Literal["limited", "slip"] = "limited"
    """When a rule is called: while any unit is limited by its own report, or at the foremost unit's slip alone; in the
    latter case limits return to the plan after `hold_time` without slip. Source: JP5484215 says slip; limited is this
    project's."""
    hold_time: float = quantity(5.0, "s")
    """Time without slip after which limits return to the plan, with the trigger slip [s]. Source: JP5484215 has such a time;
    the value is assumed."""
    rise_time: float = quantity(1.0, "s")
    """Time in which a unit's torque rises from zero to the expected torque: the jerk limit [s]. Source: assumed."""
    period: float = quantity(0.01, "s")
    """Control period of the computers on board [s]. Source: assumed."""
    limit_rate: float | None = quantity(None, "1")
    """Largest change of a limit per allocation, for the rules that bound rates. Left out: no bound."""
    inertia_in_limit: bool = True
    """A unit's torque is its limit (6) plus the torque that accelerates its own wheelsets, so that limits, caps and plan are
    all coefficients at the rail. Otherwise it is (6) as printed, which delivers less at the rail than the cap by that
    part. Source: JP5484215 (6), corrected."""
    hosted: Mapping[str, Any] = field(default_factory=dict, hash=False, metadata=NOT_IN_FILES)
    """Settings of controllers in Python by the controller's name; those not named take their defaults."""

    def __post_init__(self) -> None:
        OnboardError.check_choice("on board", "trigger", self.trigger, ("limited", "slip"))
        OnboardError.check("on board", self, positive=("hold_time", "rise_time", "period"))
        if self.limit_rate is not None and not self.limit_rate > 0.0:
            raise OnboardError(f"on board: limit_rate = {self.limit_rate!r} must exceed 0")
        if self.telegrams.period < self.period:
            raise OnboardError(
                f"on board: period = {self.period!r} must not exceed "
                f"telegrams.period = {self.telegrams.period!r}"
            )

    def with_settings(self, settings: Mapping[str, Any]) -> "Onboard":
        """The same equipment except for `settings`: values by the path of their fields, as "detector.pole".

        Raises `OnboardError` for a path that is no field, and for a value out of range.
        """
        changed = self
        for path, value in settings.items():
            part, _, name = path.rpartition(".")
            inner: Any = getattr(changed, part, None) if part else changed
            if name not in ({one.name for one in fields(inner)} if is_dataclass(inner) else ()):
                raise OnboardError(
                    f"a rule's setting {path!r} is no field of the equipment; see alloc.old.onboard.parameters.Onboard"
                )
            inner = replace(inner, **{name: value})
            changed = replace(changed, **{part: inner}) if part else inner
        return changed
