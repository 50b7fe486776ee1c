"""Parameters of the reference speed's estimate. SI units; all assumed, tuned on drawn events of traction and braking."""

from dataclasses import dataclass, field
from typing import Literal

from alloc.errors import OnboardError
from alloc.onboard.quantity import quantity

COMPARED = 1e-4
"""Relative deviation of radii that were compared: 3 s at 10 m/s and with 10 mm/s of noise in a reading leave as much."""


@dataclass(frozen=True)
class Sounding:
    """When and how force is taken from a few wheels, so that they roll and show the speed.

    Source: assumed; tuned on drawn events of traction and braking.
    """

    doubt: float = quantity(0.05, "km/h")
    """Deviation of the estimate above which a unit's torque is cut [m/s]."""
    doubt_ratio: float = quantity(0.004, "1")
    """The same deviation over the speed; the larger of the two bounds applies."""
    ease: float = quantity(2.4, "1")
    """Factor of both deviations while a unit is within adhesion."""
    share: float = quantity(0.4, "1")
    """Share of its torque that a sounded unit keeps, 0 to 1."""
    time: float = quantity(0.06, "s")
    """Time for which its torque is cut at least [s]."""
    longest: float = quantity(0.2, "s")
    """The same at most, where no wheel has settled and told the speed, at least `time` [s]."""
    return_time: float = quantity(0.06, "s")
    """Time in which its torque returns [s]."""
    pause: float = quantity(0.3, "s")
    """Shortest time from one sounding to the next [s]."""
    air_doubt: float = quantity(0.06, "1")
    """Deviation over the speed above which a bogie is released."""
    air_known: float = quantity(0.03, "1")
    """Deviation over the speed at which it brakes again, less than `air_doubt`."""
    patience: float = quantity(5.0, "1")
    """Factor of `air_doubt` while an axle runs near the estimate."""

    def __post_init__(self) -> None:
        numbers = set(self.__dataclass_fields__) - {"share"}
        OnboardError.check("sounding", self, sorted(numbers), ("share",))
        OnboardError.check_finite("sounding", self, sorted(numbers))
        if self.share > 1.0:
            raise OnboardError(f"sounding: share = {self.share!r} must lie in [0, 1]")
        OnboardError.check_order("sounding", self, "air_known", "air_doubt")
        OnboardError.check_order("sounding", self, "time", "longest", equal=True)


@dataclass(frozen=True)
class ReferenceSpeed:
    """Kalman filter of the train's speed, see `alloc.onboard.reference_speed.kalman_filter`.

    Source: assumed; tuned on drawn events of traction and braking.
    """

    source: Literal["estimate", "truth"] = "estimate"
    """The computers estimate the train's speed, or they get the true one, for comparisons; no train has the true one.
    Source: this project."""
    sensor: float = quantity(0.005, "km/h")
    """Deviation of a speed reading, beside the sensors' own noise, at the rim [m/s]."""
    speed_walk: float = quantity(1e-3, "1")
    """Deviation by which the speed changes unforeseen, per root s [m/s]."""
    force_walk: float = quantity(5e-3, "1")
    """Deviation by which the unknown specific force changes, per root s [m/s2]."""
    unknown_force: float = quantity(0.2, "1")
    """Deviation of the unknown specific force at the start, mainly a gradient [m/s2]."""
    shoe_error: float = quantity(0.1, "1")
    """Deviation of the shoes' friction, relative."""
    shoe_walk: float = quantity(0.02, "1")
    """Deviation by which the shoes' friction changes, relative, per root s."""
    mass_error: float = quantity(0.05, "1")
    """Deviation of the mass, relative."""
    slip: float = quantity(0.25, "1")
    """Micro-slip per coefficient of force [m/s]."""
    slip_deviation: float = quantity(0.2, "1")
    """Deviation of the micro-slip per coefficient at the start [m/s]."""
    creep: float = quantity(0.01, "1")
    """Deviation of the slip ratio of a wheel that rolls at the full adhesion."""
    creep_speed: float = quantity(5.0, "km/h")
    """Below this speed `creep` has its value at this speed [m/s]."""
    repeat: float = quantity(100.0, "1")
    """Number of samples over which the creep of a wheel is the same."""
    light_repeat: float = quantity(16.0, "1")
    """The same of a wheel with little force."""
    sounded_repeat: float = quantity(0.3, "1")
    """The same while a unit is sounded."""
    ease_time: float = quantity(0.3, "s")
    """An axle whose force nobody limits is at ease after this time [s]."""
    light: float = quantity(0.85, "1")
    """Share of the force that it carried lately below which a wheel is light and rolls."""
    carried_time: float = quantity(5.0, "s")
    """Time in which a wheel's largest force is forgotten [s]."""
    slid_time: float = quantity(1.0, "s")
    """The same while it certainly slides [s]."""
    away: float = quantity(0.2, "1")
    """Acceleration against the train of a wheel that does not roll [m/s2]."""
    returning: float = quantity(0.45, "1")
    """Acceleration against the train of a wheel that returns from a slide [m/s2]."""
    gate: float = quantity(3.0, "1")
    """Number of deviations beyond which an axle at ease counts as slipping."""
    persist: float = quantity(0.6, "s")
    """Time for which a braked axle must show a deviating speed to be believed [s]."""
    radius_deviation: float = quantity(0.01, "1")
    """Deviation of the wheels' believed radii before any comparison, relative. The computers compare them while the train
    rolls; 0: they never do."""
    radii_compared: bool = True
    """Whether the train has rolled before the run, so that only the error that all radii have in common is left."""
    sounding: Sounding = field(default_factory=Sounding)
    """When force is taken from a few wheels to learn the speed."""

    def __post_init__(self) -> None:
        OnboardError.check_choice("reference speed", "source", self.source, ("estimate", "truth"))
        positive = ("sensor", "speed_walk", "unknown_force", "creep", "carried_time", "slid_time")
        others = set(self.__dataclass_fields__) - {
            "source",
            "radii_compared",
            "sounding",
            *positive,
        }
        OnboardError.check("reference speed", self, positive, nonnegative=sorted(others))
        OnboardError.check_finite("reference speed", self, sorted({*positive, *others}))

    @property
    def radius_prior(self) -> float:
        """Deviation of the believed radii from their mean at the start of a run, relative; 0: they are never compared."""
        return min(COMPARED if self.radii_compared else 1.0, self.radius_deviation)
