"""Uncertainty of the wheel damage Q of a measured run.

Q = sum_i integral of F_t,i (R omega_i - v) dt. An error of the train's speed acts on all axles at once, and persists: that
of the delay all the time, the rest for `CORRELATED` seconds. Noise of a wheel or of a force averages out within a window.
What happens between two instants is unknown: every second of them alone would give another Q, and that much is stated. Of
what is filled in, a share is uncertain.
"""

from dataclasses import dataclass
from typing import TYPE_CHECKING, NamedTuple

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.series import usual_period

if TYPE_CHECKING:
    from studies.logs.measured_run import MeasuredRun


Floats = NDArray[np.float64]

CORRELATED = 5.0
"""Time [s] for which an error of the train's speed persists."""
WINDOW = 0.2
"""Time [s] for which noise of a wheel or of a force persists."""
PERMILLE = 1e-3
LEAST = 2e-3
"""Error of Q, as a share, that every log has: by rounding, by forces between instants, by the load that pitch moves."""

FORCES = 0.03
"""Standard deviation of the measured force of an axle, as a share, beside what the momentum of the train says of all."""
FILLED = 0.3
"""Error of what is filled in, as a share: 0.1 for gaps of half a second in simulated runs, 0.5 for two seconds."""


class SlipNoise(NamedTuple):
    """Standard deviations of measured slip velocities [m/s], (axles,) each."""

    rim: Floats
    """Due to the wheel alone."""
    slip: Floats
    """With the error of the train's speed."""


def slip_noise(run: "MeasuredRun") -> SlipNoise:
    """Noise of the slip velocity of each axle."""
    axles = run.rim_speed.shape[1]
    rim = np.zeros(axles) if run.rim_deviation is None else np.nan_to_num(run.rim_deviation)
    own = 0.0
    if run.speed_deviation is not None and np.isfinite(run.speed_deviation).any():
        own = float(np.nanmedian(run.speed_deviation))
    return SlipNoise(rim, np.hypot(rim, own))


@dataclass(frozen=True)
class DamageErrors:
    """Standard deviations of Q of all axles [J], and the quantities on which it depends."""

    total: float
    by_speed: float
    """Due to the error of the train's speed without its delay."""
    by_delay: float
    """Due to the uncertainty of the delay."""
    by_sensors: float
    """Due to noise of wheels and forces."""
    by_sampling: float
    """Due to what happens between two instants."""
    by_filled: float
    """Due to what is filled in."""
    by_forces: float
    """Due to what forces of single axles may be wrong by."""
    of_radius: float
    """Change of Q if all wheels were larger by 1 per mille; it is not in `total`."""
    per_second: float
    """Change of Q by a delay of the speed [J/s]."""
    of_delay: float
    """Change of Q if the estimated delay had been left in the speed; 0 if there is none."""


def damage_errors(
    run: "MeasuredRun",
    coefficient: Floats,
    axle_load: Floats,
    by_half: float,
    of_car: float,
    damage: Floats,
    filled: float,
) -> DamageErrors | None:
    """Errors of Q of a `run`, from the `coefficient` of its axles (instants, axles) and their load [N] (axles,).

    `by_half` [J]: Q less that by every second instant. `damage` [J]: Q of each axle (axles,). `filled` [J]: the part that is
    filled in. `of_car`: standard deviation of the speed of the cars against their train [m/s], which lasts throughout.
    """
    time = run.time
    step = np.diff(time, append=time[-1])
    step[:-1][np.diff(run.part) != 0] = 0.0
    total, sensors = np.zeros(time.size), 0.0
    period = usual_period(time)
    lasts = max(WINDOW, period)
    for i in range(axle_load.size):
        force = coefficient[:, i] * axle_load[i]
        own = np.nan_to_num(force)
        total += own
        if run.rim_deviation is not None and np.isfinite(run.rim_deviation[i]):
            sensors += run.rim_deviation[i] ** 2 * lasts * float(step @ own**2)
        if run.force_deviation is not None and np.isfinite(run.force_deviation[i]):
            slip = np.nan_to_num(run.rim_speed[:, i] - run.speed)
            pulled = np.where(np.isfinite(force), slip, 0.0)
            sensors += run.force_deviation[i] ** 2 * lasts * float(step @ pulled**2)
    if not total.any():
        return None
    speed = np.nan_to_num(run.speed)
    rate = np.gradient(speed, time) if time.size > 1 else np.zeros(1)
    by_delay = of_delay = 0.0
    weight = step * total
    per_second = float(weight @ rate)
    if run.speed_delay is not None:
        late = np.interp(time - run.speed_delay.value, time, speed)
        of_delay = float(weight @ (speed - late))
    if run.unsure is not None:
        by_speed, by_delay = run.unsure.of(weight)
    else:
        deviation = np.zeros(time.size) if run.speed_deviation is None else np.nan_to_num(run.speed_deviation)  # fmt: skip
        blocks = np.floor((time - time[0]) / CORRELATED).astype(np.int64)
        each = np.bincount(blocks, weights=step * np.abs(total) * deviation)
        by_speed = float(np.sqrt(np.sum(each**2)))
    by_speed = float(np.hypot(by_speed, of_car * float(step @ np.abs(total))))
    by_sensors = float(np.sqrt(sensors))
    radius = PERMILLE * float(step @ (total * speed))
    floor, by_filled = LEAST * abs(float(damage.sum())), FILLED * abs(filled)
    by_forces = FORCES * float(np.linalg.norm(damage))
    squares = (
        by_speed**2 + by_delay**2 + sensors + by_half**2 + floor**2 + by_filled**2 + by_forces**2
    )
    return DamageErrors(
        float(np.sqrt(squares)), by_speed, by_delay, by_sensors, abs(by_half), by_filled, by_forces,
        radius, per_second, of_delay,
    )  # fmt: skip
