"""Parameters of the wheel slide protection. SI units; what no source prints is "assumed" or calibrated."""

import math
from dataclasses import dataclass, field
from typing import Literal

from alloc.errors import OnboardError
from alloc.onboard.quantity import quantity
from alloc.onboard.slide_protection import LAWS

SENSITIVITIES: dict[str, float] = {"low": 0.915, "medium": 1.0, "high": 3.1374}
"""Detection sensitivities of JP4209318, Table 4, as numbers for `Fuzzy.sensitivity`; calibrated with its sets."""


def _check_growing(name: str, knots: tuple[float, float, float]) -> None:
    numbers = all(isinstance(x, (int, float)) and math.isfinite(x) for x in knots)
    if len(knots) != 3 or not numbers or not knots[0] < knots[1] < knots[2]:
        raise OnboardError(
            f"fuzzy slide protection: {name} = {knots} must be three growing numbers"
        )


@dataclass(frozen=True)
class Threshold:
    """Plain switching points of the slip ratio.

    Source: assumed.
    """

    release: float = quantity(0.15, "1")
    """Slip ratio above which a bogie's pressure is released."""
    hold: float = quantity(0.08, "1")
    """Slip ratio above which a bogie's pressure is held, at most `release`."""

    def __post_init__(self) -> None:
        OnboardError.check("threshold slide protection", self, positive=("release", "hold"))
        OnboardError.check_order("threshold slide protection", self, "hold", "release", equal=True)


@dataclass(frozen=True)
class Fuzzy:
    """Fuzzy inference on slip and slip rate; the rules are `alloc.onboard.slide_protection.fuzzy.RULES`.

    JP4209318 discloses neither rules nor sets. These are one of several sets of numbers with which
    `studies.slides.jp4209318` reaches its tables.

    Source: JP4209318; one of the sets of `studies.slides.ensemble`.
    """

    sensitivity: float = quantity(SENSITIVITIES["medium"], "1", SENSITIVITIES)
    """Detection sensitivity: at 2 every set is at half its slip and rate. Low, medium and high are those of JP4209318, Table
    4."""
    slip: tuple[float, float, float] = quantity((0.0, 0.077716, 0.17027), "1")
    """Increasing slip ratios at which the sets small, medium and large peak."""
    rate: tuple[float, float, float] = quantity((-3.5912, 0.0, 3.5912), "km/h/s")
    """Increasing slip accelerations at which the sets falling, steady and growing peak [m/s2]."""
    pole: float = quantity(6.6789, "1/s")
    """Pole of the filter that differentiates the slip [1/s]."""

    def __post_init__(self) -> None:
        OnboardError.check("fuzzy slide protection", self, positive=("sensitivity", "pole"))
        _check_growing("slip", self.slip)
        _check_growing("rate", self.rate)


@dataclass(frozen=True)
class SlideProtection:
    """Wheel slide protection of a train's air brakes, one computer per car, a pair of valves per bogie.

    Slip is measured from the train's reference speed; its estimator may ask for a bogie to be released for a moment. An axle
    that stands while its car runs is released.

    Source: assumed, as usual.
    """

    law: Literal["none", "threshold", "fuzzy"] = "threshold"
    """Law that moves the valves. Source: fuzzy is that of JP4209318; threshold is this project's."""
    threshold: Threshold = field(default_factory=Threshold)
    """Numbers of the law threshold."""
    fuzzy: Fuzzy = field(default_factory=Fuzzy)
    """Numbers of the law fuzzy."""
    period: float = quantity(0.01, "s")
    """Period of its decisions, rounded to control periods [s]."""
    cut_out_speed: float = quantity(5.0 / 3.6, "km/h")
    """Speed below which the valves do not act [m/s]."""
    time_out: float = quantity(10.0, "s")
    """A valve that has not supplied for this time supplies for `refill`, whatever the law says: sliding wheels must not make
    a train lose its brakes for good [s]."""
    refill: float = quantity(0.5, "s")
    """Time for which it then supplies [s]."""

    def __post_init__(self) -> None:
        OnboardError.check(
            "slide protection",
            self,
            ("period", "time_out", "refill"),
            ("cut_out_speed",),
        )
        OnboardError.check_choice("slide protection", "law", self.law, LAWS)
