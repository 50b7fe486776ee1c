"""Parameters of the reference speed's estimate. SI units; all assumed, tuned on drawn events of traction and braking."""

from dataclasses import dataclass, field
from typing import Literal

from alloc.errors import OnboardError
from alloc.onboard.quantity import quantity


@dataclass(frozen=True)
class Sounding:
    """When and how force is taken from a few wheels, so that they roll and tell the speed.

    `doubt` [m/s] and `doubt_ratio` (of the speed): deviation of the estimate from which on a unit's torque is cut to `share`
    for `time` [s], and given back within `return_time` [s]; `ease` times that while a unit is within adhesion. At most every
    `pause` [s]. `air_doubt` (of the speed): deviation from which on a bogie is released, and `air_known` at which it brakes
    again; `patience` times that while an axle runs near the estimate.
    """

    doubt: float = quantity(0.05, "km/h")
    doubt_ratio: float = quantity(0.004, "1")
    ease: float = quantity(2.4, "1")
    share: float = quantity(0.4, "1")
    time: float = quantity(0.06, "s")
    return_time: float = quantity(0.06, "s")
    pause: float = quantity(0.3, "s")
    air_doubt: float = quantity(0.06, "1")
    air_known: float = quantity(0.03, "1")
    patience: float = quantity(5.0, "1")

    def __post_init__(self) -> None:
        numbers = set(self.__dataclass_fields__) - {"share"}
        OnboardError.check("sounding", self, sorted(numbers), ("share",))
        OnboardError.check_finite("sounding", self, sorted(numbers))
        if self.share > 1.0:
            raise OnboardError(f"sounding: share = {self.share!r} must lie in [0, 1]")
        OnboardError.check_order("sounding", self, "air_known", "air_doubt")


@dataclass(frozen=True)
class ReferenceSpeed:
    """Kalman filter of the train's speed, see `alloc.onboard.reference_speed.kalman_filter`.

    `source` "truth": the computers are given the true speed instead, which no train has; for comparisons.

    Deviations: `sensor` of a speed reading [m/s at the rim], beside the sensors' own noise; `speed_walk` [m/s per
    root s] and `force_walk` [m/s2 per root s] of speed and unknown specific force; `unknown_force` [m/s2]: of that at the
    start, a gradient above all; `shoe_error`: of the shoes' friction, relative, with `shoe_walk` per root s; `mass_error`:
    relative.
    `slip` [m/s] and `slip_deviation`: micro-slip per coefficient, and its deviation at the start; `creep`: deviation of the
    slip ratio of a wheel that rolls at the full adhesion, of no less than `creep_speed`; it is the same over `repeat`
    samples, `light_repeat` of a wheel with little force, `sounded_repeat` while a unit is sounded.

    `ease_time` [s]: from then on an axle is at ease whose force nobody limits. `light`: share of the force that it
    carried lately at which a wheel is light and rolls. `carried_time`, `slid_time` [s]: in which a wheel's greatest force is
    forgotten, and while it surely slides. `away` [m/s2]: acceleration against the train of a wheel that does not roll;
    `returning`: of one that comes back. `gate`: deviations beyond which an axle at ease slips. `persist` [s]: for which a
    braked axle must tell an odd speed to be believed.
    """

    source: Literal["estimate", "truth"] = "estimate"
    sensor: float = quantity(0.005, "km/h")
    speed_walk: float = quantity(1e-3, "1")
    force_walk: float = quantity(5e-3, "1")
    unknown_force: float = quantity(0.2, "1")
    shoe_error: float = quantity(0.1, "1")
    shoe_walk: float = quantity(0.02, "1")
    mass_error: float = quantity(0.05, "1")
    slip: float = quantity(0.25, "1")
    slip_deviation: float = quantity(0.2, "1")
    creep: float = quantity(0.01, "1")
    creep_speed: float = quantity(5.0, "km/h")
    repeat: float = quantity(100.0, "1")
    light_repeat: float = quantity(16.0, "1")
    sounded_repeat: float = quantity(0.3, "1")
    ease_time: float = quantity(0.3, "s")
    light: float = quantity(0.85, "1")
    carried_time: float = quantity(5.0, "s")
    slid_time: float = quantity(1.0, "s")
    away: float = quantity(0.2, "1")
    returning: float = quantity(0.45, "1")
    gate: float = quantity(3.0, "1")
    persist: float = quantity(0.6, "s")
    sounding: Sounding = field(default_factory=Sounding)

    def __post_init__(self) -> None:
        OnboardError.check_choice("reference speed", "source", self.source, ("estimate", "truth"))
        positive = ("sensor", "speed_walk", "unknown_force", "creep", "carried_time", "slid_time")
        others = set(self.__dataclass_fields__) - {"source", "sounding", *positive}
        OnboardError.check("reference speed", self, positive, nonnegative=sorted(others))
        OnboardError.check_finite("reference speed", self, sorted({*positive, *others}))
