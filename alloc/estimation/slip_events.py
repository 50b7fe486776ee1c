"""Slips and slides of an axle, found in its measured series.

In a measurement the adhesion curve is unknown. So a slip is defined as exceeding a slip velocity and a slip ratio that no
axle reaches in micro slip. At its beginning the coefficient passes the curve's maximum: the largest coefficient seen there
estimates the adhesion.
"""

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.display import displayed
from alloc.errors import EstimationError
from alloc.estimation.series import bridged_spans
from alloc.plant.laws import faster_speed, slip_ratio

Floats = NDArray[np.float64]

ONSET_TIME = 0.1
"""Time [s] after the detection of a slip in which the maximum coefficient is still sought."""

CERTAIN = 4.0
"""Smallest bound of a slip, in standard deviations of the slip velocity."""
LASTING = 0.25
"""Share of the averaging time, before and after its largest value, for which a slip must exceed its bound."""
BRIDGED = 0.1
"""Time [s] for which a slip may seem to be over without having ended, because of sensor noise near the bound."""


@displayed
@dataclass(frozen=True)
class SlipCriterion:
    """An axle slips where its slip velocity exceeds `velocity` [m/s] and `ratio` times the larger of rim and train speed.

    The slip lasts from the instant at which it passed half of that bound until it is below it again.
    """

    velocity: float = 0.2
    """More than twice the slip velocity at which the default adhesion curve has its maximum on wet rail."""
    ratio: float = 0.05
    """Twice the creep at which published curves have their maximum (1 to 3 %), so that a slip begins at about that creep;
    large enough for errors of wheel radii."""

    def __post_init__(self) -> None:
        EstimationError.check("slip criterion", self, positive=("velocity", "ratio"))

    def bound(self, speed: Floats, rim_speed: Floats, noise: float = 0.0) -> Floats:
        """Slip velocity [m/s] above which an axle slips; `noise` [m/s]: standard deviation of the measured one."""
        least = max(self.velocity, CERTAIN * noise)
        return np.maximum(least, self.ratio * faster_speed(speed, rim_speed))


SMALL = SlipCriterion(0.1, 0.02)
"""Criterion of small slips, where the noise allows: wheels that do not slip creep less, and radii are more accurate."""


@displayed
class SlipEvent(NamedTuple):
    """One slip (driving) or slide (braking) of one axle; times in s, slip velocities in m/s, coefficients as magnitudes."""

    axle: int
    """0 = foremost."""
    start: float
    """[s]"""
    end: float
    """[s]"""
    cut: bool
    """Whether it continues beyond the part of the log in which it was found."""
    largest_slip: float
    """Signed: positive for a slip, negative for a slide."""
    slip_ratio: float
    """Largest slip velocity over the larger of rim and train speed at that instant, a magnitude up to 1."""
    onset_coefficient: float
    """Estimate of the adhesion coefficient: the largest between the start and `ONSET_TIME` after the slip passed its bound.
    nan without forces, and where the slip began before the part of the log."""
    onset_time: float
    """Instant of the onset's coefficient [s]."""
    utilisation: float
    """Mean coefficient during the event over that at its onset; above 1 where the rail improved. nan without an onset."""
    damage: float
    """Wheel damage Q during the event [J]. nan without forces."""

    @property
    def kind(self) -> str:
        """ "slip" where the wheel turns too fast, "slide" where it turns too slowly."""
        return "slip" if self.largest_slip > 0.0 else "slide"


def find_slips(
    axle: int,
    time: Floats,
    speed: Floats,
    rim_speed: Floats,
    coefficient: Floats | None,
    damage: Floats | None,
    criterion: SlipCriterion,
    noise: float = 0.0,
    span: float = 0.0,
) -> list[SlipEvent]:
    """Slips and slides of one axle in series (instants,) without gaps; `coefficient` and accumulated `damage` if known.

    `noise` [m/s]: standard deviation of the slip velocity, after averaging over `span` [s]. A slip must exceed its bound on
    average over that time, because the largest of many noisy values exceeds it too often.
    """
    slip = rim_speed - speed
    bound = criterion.bound(speed, rim_speed, noise)
    share = slip / bound
    events = []
    for sign in (1.0, -1.0):
        for begin, end in bridged_spans(
            sign * share > 0.5, lambda end, begin: time[begin] - time[end - 1] < BRIDGED
        ):
            inside = slice(begin, end)
            beyond = np.flatnonzero(sign * share[inside] > 1.0)
            if beyond.size == 0:
                continue
            worst = begin + int(np.argmax(sign * slip[inside]))
            if span > 0.0:
                reach = LASTING * span
                near = inside_of(time, time[worst] - reach, time[worst] + reach)
                if np.mean(sign * slip[near] - bound[near]) <= 0.0:
                    continue
            ratio = slip_ratio(slip[worst], speed[worst], rim_speed[worst], 0.0)
            onset, onset_time, used, lost = (float("nan"),) * 4
            if coefficient is not None and begin > 0:
                last = np.searchsorted(time, time[begin + beyond[0]] + ONSET_TIME, "right")
                # the mean over a window looks back: right at the start it still tells of before
                first = min(
                    np.searchsorted(time, time[begin] + 0.5 * ONSET_TIME), begin + beyond[0]
                )
                top = first + int(np.argmax(sign * coefficient[first:last]))
                onset, onset_time = float(sign * coefficient[top]), float(time[top])
                used = float(np.mean(sign * coefficient[inside])) / onset if onset > 0.0 else used
            if damage is not None:
                lost = float(damage[end - 1] - damage[max(begin - 1, 0)])
            events.append(
                SlipEvent(
                    axle, float(time[begin]), float(time[end - 1]),
                    begin == 0 or end == time.size, float(slip[worst]),
                    float(abs(ratio)), onset, onset_time, used, lost,
                )
            )  # fmt: skip
    return sorted(events, key=lambda event: event.start)


def inside_of(time: Floats, first: float, last: float) -> slice:
    """The instants from `first` to `last` [s]."""
    return slice(int(np.searchsorted(time, first)), int(np.searchsorted(time, last, "right")))


def apart(events: list[SlipEvent], others: list[SlipEvent]) -> list[SlipEvent]:
    """Those of `events` that overlap none of the `others`, all of one axle."""
    start, end = np.array([(o.start, o.end) for o in others]).reshape(-1, 2).T
    return [e for e in events if not np.any((e.start <= end) & (start <= e.end))]
