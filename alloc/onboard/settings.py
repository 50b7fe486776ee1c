"""Settings of the computers on board, of their signals, and what the train believes. SI units, validated.

Files give them by the units that each field states; `alloc.onboard.rows` makes rows of them.
"""

import math
from collections.abc import Iterator, Mapping
from dataclasses import MISSING, dataclass, field, fields, is_dataclass, replace
from itertools import pairwise
from typing import Any, Literal

from alloc.schema.errors import OnboardError
from alloc.schema.parameters import NOT_IN_FILES, Bounds, Parameters, quantity

SENSITIVITIES: dict[str, float] = {"low": 0.905, "medium": 1.0, "high": 2.92}
"""Detection sensitivities of JP4209318, Table 4, as numbers for `Fuzzy.sensitivity`; calibrated with its sets."""
SlideLaw = Literal["none", "threshold", "fuzzy"]
"""Laws of the slide protection, in the order of their numbers in `SLIDE.protection`."""


class OnboardParameters(Parameters):
    """A record of the computers on board."""

    error = OnboardError


@dataclass(frozen=True)
class ReferenceSpeed(OnboardParameters):
    """Reference speed of the train, `alloc.onboard.reference_speed`.

    Source: this project.
    """

    source: Literal["estimate", "truth"] = "estimate"
    """The computers estimate the train's speed, or they get the true one, for comparisons; no train has the true one."""
    radii_compared: bool = True
    """Whether the train has compared its wheels while it rolled before the run, so that only the error that all radii have
    in common is left."""


@dataclass(frozen=True)
class Detector(OnboardParameters):
    """Slip detector with hysteresis: mean computed axle acceleration of the unit, in the direction of the demand.

    Source: JP5484215, Fig. 5; the values are assumed.
    """

    on: float = quantity(1.5, "km/h/s", above=0.0)
    """The slip signal is on above this acceleration."""
    off: float = quantity(0.75, "km/h/s", least=-math.inf)
    """The slip signal is off at or below this acceleration, which is less than `on`."""
    pole: float | None = quantity(None, "1/s", above=0.0)
    """Pole of the differentiator that computes the accelerations. Left out: it follows the noise of the sensors, see
    `alloc.onboard.rows.detector_pole`."""
    speed_on: float = quantity(0.6, "km/h", above=0.0)
    """The signal is also on where the slip of the unit's worst axle against the reference speed exceeds this; off again
    below half of it. A small deficit accelerates the wheels too little for `on`, and one slipping axle of four moves the
    mean too little. A large value switches it off. Source: assumed; not in JP5484215."""

    def _find_faults(self) -> Iterator[str]:
        if not self.off < self.on:
            yield "`off` must be below `on`"


@dataclass(frozen=True)
class Observer(OnboardParameters):
    """Minimal-order disturbance observer.

    Source: JP5484215 (3); the value is assumed.
    """

    pole: float = quantity(25.0, "1/s", above=0.0)
    """Pole a of the observer."""


@dataclass(frozen=True)
class Telegrams(OnboardParameters):
    """Periodic telegrams of the train monitor system.

    Source: JP5484215 has telegrams, without numbers; the values are assumed.
    """

    period: float = quantity(0.1, "s", above=0.0)
    """Time from one telegram of a unit to its next."""
    latency: float = quantity(0.05, "s")
    """Time from sending to receiving."""
    jitter: float = quantity(0.0, "s")
    """Largest time that is added to `latency`, drawn uniformly for each telegram."""
    loss: float = quantity(0.0, "1", most=1.0)
    """Probability that a telegram is lost."""
    silence: float = quantity(1.0, "s", above=0.0, infinite=True)
    """A unit that has received nothing for this time falls back to its planned limit."""


@dataclass(frozen=True)
class Dropout(OnboardParameters):
    """Loss of the speed signal of an axle for a time; the computers notice it.

    Source: this project.
    """

    axle: int = quantity(MISSING, "1")
    """Number of the axle in the train, 0 = foremost."""
    begin: float = quantity(MISSING, "s", least=-math.inf)
    """Instant from which the signal is lost."""
    until: float = quantity(math.inf, "s", least=-math.inf, infinite=True)
    """Instant at which the signal returns. Left out: it never returns."""

    def _find_faults(self) -> Iterator[str]:
        if not self.begin < self.until:
            yield "`begin` must lie before `until`"


@dataclass(frozen=True)
class Sensors(OnboardParameters):
    """Axle speed sensors and load signals; `seed` draws their errors.

    Source: assumed; without a key the sensors are perfect.
    """

    speed_noise: float = quantity(0.0, "km/h")
    """Standard deviation of a sample of an axle's speed, at the rim."""
    speed_quantum: float = quantity(0.0, "km/h")
    """Step to which an axle's speed is rounded, at the rim; 0: none."""
    load_error: float = quantity(0.0, "1", most=1.0)
    """Standard deviation of the relative error of the load signals, drawn once per run, a share: 0.01 is 1 %."""
    radius_error: float = quantity(0.0, "1", most=0.5)
    """Largest relative error of the wheel radii that the computers believe in, as wear leaves it; drawn uniformly."""
    seed: int = field(default=0, metadata=NOT_IN_FILES | {"bounds": Bounds(least=0.0)})
    """What draws the errors, and losses and delays of telegrams."""
    dropouts: tuple[Dropout, ...] = ()
    """Speed signals that are lost for a time, at most once per axle. A unit continues with its other axles."""

    def _find_faults(self) -> Iterator[str]:
        lost = [dropout.axle for dropout in self.dropouts]
        if len(set(lost)) < len(lost):
            yield f"dropouts of the axles {lost}; give one per axle at most"


@dataclass(frozen=True)
class Threshold(OnboardParameters):
    """Plain switching points of the slip ratio.

    Source: assumed.
    """

    release: float = quantity(0.15, "1", above=0.0, infinite=True)
    """Slip ratio above which a bogie's pressure is released."""
    hold: float = quantity(0.08, "1", above=0.0, infinite=True)
    """Slip ratio above which a bogie's pressure is held, at most `release`."""

    def _find_faults(self) -> Iterator[str]:
        if self.hold > self.release:
            yield "`hold` must not exceed `release`"


@dataclass(frozen=True)
class Fuzzy(OnboardParameters):
    """Fuzzy inference on slip and slip rate; the rules are those of `alloc.laws.fuzzy_valve`.

    JP4209318 discloses neither rules nor sets. These are one of several sets of numbers with which `studies.jp4209318`
    reaches its tables.

    Source: JP4209318; assumed, one of many sets that reach its tables.
    """

    sensitivity: float = quantity(SENSITIVITIES["medium"], "1", above=0.0)
    """Detection sensitivity: at 2 every set is at half its slip and rate. Low, medium and high are those of JP4209318, Table
    4."""
    slip: tuple[float, float, float] = quantity((0.0, 0.077716, 0.17027), "1", least=-math.inf)
    """Increasing slip ratios at which the sets small, medium and large peak."""
    rate: tuple[float, float, float] = quantity((-3.5912, 0.0, 3.5912), "km/h/s", least=-math.inf)
    """Increasing slip accelerations at which the sets falling, steady and growing peak."""
    pole: float = quantity(6.6789, "1/s", above=0.0)
    """Pole of the filter that differentiates the slip."""

    def _find_faults(self) -> Iterator[str]:
        for name in ("slip", "rate"):
            knots = getattr(self, name)
            if len(knots) != 3 or any(b <= a for a, b in pairwise(knots)):
                yield f"`{name}` must be three growing numbers"


@dataclass(frozen=True)
class SlideProtection(OnboardParameters):
    """Wheel slide protection of a train's air brakes, a pair of valves per bogie; slip is measured from the reference speed.

    An axle that stands while its train runs is released.

    Source: assumed, as usual.
    """

    law: SlideLaw = "threshold"
    """Law that moves the valves. Source: fuzzy is that of JP4209318; threshold is this project's."""
    threshold: Threshold = field(default_factory=Threshold)
    """Numbers of the law threshold."""
    fuzzy: Fuzzy = field(default_factory=Fuzzy)
    """Numbers of the law fuzzy."""
    period: float = quantity(0.01, "s", above=0.0)
    """Period of its decisions, rounded to control periods."""
    cut_out_speed: float = quantity(5.0 / 3.6, "km/h")
    """Speed below which the valves do not act."""


@dataclass(frozen=True)
class Braking(OnboardParameters):
    """Brakes of the train. A train without air brakes is never blended; one without motors brakes with air alone."""

    blended: bool = True
    """Every car brakes itself: the air brake supplies what the electric brake lacks, and brakes the trailers alone.
    Otherwise the motors brake the whole train. Source: JP5484215, embodiment 3."""
    blend_time: float = quantity(4.0, "s", above=0.0)
    """Time in which the motors take over a full brake from the air. Source: assumed: a few times the cylinders' lag."""
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
    standstill and beyond. Source: assumed."""
    car_shares: tuple[float, ...] | None = quantity(None, "1")
    """Brake force that each car is asked for by weight, relative to the plan, from the front. It applies to cars that brake
    by air alone; the allocation rule limits the others. Left out: 1 for all. Source: this project."""


@dataclass(frozen=True)
class Assumed(OnboardParameters):
    """What the train assumes to be true.

    Source: this project; a train believes the truth where nothing is said.
    """

    hashed_as = "Belief"  # in hashes of events, which stay

    increments: tuple[float, ...] | None = quantity(None, "1", least=-math.inf)
    """Growth of the coefficient per axle from the front; None: all zero. Source: JP5484215 (15), Shinkansen."""
    unit_increments: tuple[float, ...] | None = quantity(None, "1", least=-math.inf)
    """Increment of the coefficient of each traction unit over the foremost one, as learnt; replaces `increments`. Left out:
    the mean of `increments` over the unit's axles. Source: JP5484215 (5)."""
    unit_deviation: tuple[float, ...] | None = quantity(None, "1")
    """Standard deviation of each unit's cap about the truth, for rules that take risk into account, from the front. Left
    out: these rules treat the caps as certain."""
    curve: Any = None
    """Adhesion curve; no computer here needs one. Left out: that of the rail."""
    mass_factor: float = quantity(1.0, "1", above=0.0, most=100.0)
    """Believed over true mass, as used by the reference speed's estimate."""
    resistance_factor: float = quantity(1.0, "1", most=100.0)
    """Believed over true running resistance, as used by the reference speed's estimate."""
    lag_factor: float = quantity(1.0, "1", above=0.0, most=100.0, later=True)
    """Believed over true time constant of the torque."""
    inertia_factor: float = quantity(1.0, "1", most=100.0, later=True)
    """Believed over true inertia of the wheelsets."""
    brake_factor: float = quantity(1.0, "1", above=0.0, most=100.0, later=True)
    """Believed over true force of the brake shoes, which is pressure times gain and friction."""


@dataclass(frozen=True)
class Onboard(OnboardParameters):
    """Computers of a train, their signals and its brakes.

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
    belief: Assumed = field(default_factory=Assumed, metadata=NOT_IN_FILES)
    """What the train assumes to be true."""
    braking: Braking = field(default_factory=Braking)
    """Brakes."""
    reference: ReferenceSpeed = field(default_factory=ReferenceSpeed)
    """The train's speed, from which slip is measured."""
    hold_time: float = quantity(5.0, "s", above=0.0, infinite=True)
    """Time without slip after which limits return to the plan, with rules asked on slip. Source: JP5484215 has such a time;
    the value is assumed."""
    rise_time: float = quantity(1.0, "s", above=0.0)
    """Time in which a unit's torque rises from zero to the expected torque: the jerk limit. Source: assumed."""
    period: float = quantity(0.01, "s", above=0.0)
    """Control period of the computers on board. Source: assumed."""
    limit_rate: float | None = quantity(None, "1", above=0.0, infinite=True)
    """Largest change of a limit per allocation, for the rules that bound rates. Left out: no bound."""
    inertia_in_limit: bool = True
    """A unit's torque is its limit (6) plus the torque that accelerates its own wheelsets, so that limits, caps and plan are
    all coefficients at the rail. Otherwise it is (6) as printed, which delivers less at the rail than the cap by that
    part. Source: JP5484215 (6), corrected."""

    @property
    def owner(self) -> str:
        """As in `Parameters`."""
        return "on board"

    def _find_faults(self) -> Iterator[str]:
        if self.telegrams.period < self.period:
            yield "`period` must not exceed `telegrams.period`"

    def with_settings(self, settings: Mapping[str, Any]) -> "Onboard":
        """The same equipment except for `settings`: values by the path of their fields, as "detector.pole".

        Raises `OnboardError` for a path that is no field, and for a value out of range.
        """
        changed = self
        for path, value in settings.items():
            changed = _with_setting(changed, path.split("."), value, path)
        return changed


def _with_setting(record: Any, parts: list[str], value: Any, path: str) -> Any:
    """`record` with `value` at the end of these names of fields."""
    name, *inner = parts
    if not is_dataclass(record) or name not in (item.name for item in fields(record)):
        raise OnboardError(f"setting {path!r} is no field of alloc.onboard.settings.Onboard")
    value = _with_setting(getattr(record, name), inner, value, path) if inner else value
    return replace(record, **{name: value})  # type: ignore[type-var]
