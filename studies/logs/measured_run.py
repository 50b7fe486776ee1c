"""A measured run of a train: slips and slides, coefficients, wheel damage, adhesion used, brake force per car.

Every axle is analysed part by part between gaps, and nothing is interpolated over one; `studies.logs.aligned_log`
brings channels to common instants before. What sensors, sampling and delays leave open is stated as standard deviations.

Errors against the plant, for logs of simulated runs (a wet patch under traction with cut and ramp; a braked slide that
readheres) by sampling and by white noise of all speeds:

    sampling, noise        coefficient (rms)   at onset (largest)   Q
    10 ms, none            0.0011  0.0002      0.007  0.0001        0.001 %  0.001 %
    50 ms, none            0.0012  0.0003      0.007  0.0003        0.4 %    0.04 %
    100 ms, none           0.0013  0.0008      0.018  0.0007        1.3 %    0.2 %
    10 ms, 0.02 km/h       0.0013  0.0007      0.006  0.0019        0.6 %    0.05 %
    10 ms, 0.1 km/h        0.0035  0.0033      0.006  0.025         2.8 %    0.3 %

The patch's larger errors are those of a rail that changes within the window of the forces, and of torques that jump between
two rows. By the car's own acceleration, a car's brake force is right to 3 N of 24 kN without noise, and to 640 N (rms) with
noise of 0.02 m/s2. By the train's acceleration it is right to 320 N (rms), and to 1 N on average over a brake application.
"""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING, Literal, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.display import displayed
from alloc.errors import EstimationError
from alloc.estimation.brake_force import car_brake_forces
from alloc.estimation.series import mean_rate, spans, usual_period
from alloc.estimation.slip_events import CERTAIN, SMALL, SlipCriterion, SlipEvent, apart, find_slips
from alloc.estimation.wheel_damage import tangential_force, wheel_damage
from alloc.plant.train import Train
from studies.logs.aligned_log import UNKNOWN, UNSURE
from studies.logs.train import MeasuredTrain

if TYPE_CHECKING:
    from studies.logs.estimator import Unsure


Floats = NDArray[np.float64]

WINDOW = 0.1
"""Time [s] over which tangential forces are averaged: a slip grows within some tenths of a second."""
SpeedSource = Literal["measured", "followed", "estimated"]
"""Source of a train's speed: its own channel, that channel with repairs where it is sparse or late, or wheels and forces."""

SHORTEST_PART = 3
"""A part of a log must have more instants than this."""


class Delay(NamedTuple):
    """How late a speed was measured."""

    value: float
    """[s]"""
    deviation: float
    """Its standard deviation [s]."""


@displayed
@dataclass(frozen=True, eq=False)
class MeasuredRun:
    """Series in SI units; nan where a channel has no usable value."""

    time: Floats
    """Increasing instants [s], (instants,)."""
    part: NDArray[np.int64]
    """Number of the part, from gap to gap, that each instant belongs to, (instants,)."""
    speed: Floats
    """Speed of the train [m/s], (instants,)."""
    rim_speed: Floats
    """Circumferential speed [m/s], (instants, axles)."""
    applied_force: Floats
    """Force of motors and brakes at the rim [N], positive in traction, (instants, axles)."""
    coupler_force: Floats | None = None
    """Tension positive [N], (instants, cars - 1)."""
    car_acceleration: Floats | None = None
    """(instants, cars) [m/s2]"""
    speed_deviation: Floats | None = None
    """Standard deviation of the speed [m/s], (instants,); None: not known."""
    rim_deviation: Floats | None = None
    """Standard deviation of each rim speed [m/s], (axles,); None: not known."""
    force_deviation: Floats | None = None
    """Standard deviation of each applied force [N], (axles,); None: not known."""
    rim_span: Floats | None = None
    """Time over which each rim speed is a mean [s], 0 if not averaged, (axles,); None: none is averaged."""
    speed_source: SpeedSource = "measured"
    speed_delay: Delay | None = None
    """Delay of the speed, which has been corrected; None: it cannot be determined."""
    over_train: Floats | None = None
    """Speed of each axle's car less the train's [m/s], (instants, axles); None: a rigid train, or not known."""
    filled: NDArray[np.bool_] | None = None
    """Where wheels were unknown and are filled in, (instants, axles); None: nowhere."""
    unsure: "Unsure | None" = None
    """Errors of the speed; None: those of `speed_deviation`, which last for some seconds."""


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


@displayed
@dataclass(frozen=True, eq=False)
class Findings:
    """Results of a measured run; series are nan where the run does not determine them."""

    events: list[SlipEvent]
    run: MeasuredRun
    """The analysed run."""
    coefficient: Floats
    """Tangential force over load at rest, mean over the window, positive in traction, (instants, axles)."""
    damage: Floats
    """Wheel damage Q accumulated over the parts [J], (instants, axles); nan for an axle without forces."""
    covered: Floats
    """Time for which each axle's coefficient and damage are known [s], (axles,)."""
    slipping_time: Floats
    """Time in slips and slides [s], (axles,)."""
    car_force: Floats | None
    """Brake force of each car exerted by rail and resistance, positive braking [N], (instants, cars)."""
    window: float
    """Time over which forces were averaged [s]."""
    small_events: tuple[SlipEvent, ...] = ()
    """Slips that do not meet the criterion, by `slip_events.SMALL`."""
    least_slip: Floats | None = None
    """Slip velocity below which a small slip cannot be distinguished from noise [m/s], (axles,)."""
    errors: DamageErrors | None = None
    """Uncertainty of the wheel damage; None where no errors are known."""
    filled_damage: float = 0.0
    """Wheel damage where wheels were unknown and are filled in [J]."""
    over_car: Floats | None = None
    """Speed of each axle's car [m/s], (instants, axles), which the wheels slip against; None: it is the train's."""

    @property
    def slip_velocity(self) -> Floats:
        """(instants, axles) [m/s]; computed on request, to save memory with long logs."""
        return self.run.rim_speed - (
            self.run.speed[:, None] if self.over_car is None else self.over_car
        )

    @property
    def axle_damage(self) -> Floats:
        """Wheel damage Q of each axle [J], (axles,)."""
        return np.asarray(self.damage[-1])

    @property
    def total_damage(self) -> float:
        """Wheel damage Q of all axles whose forces are known [J]."""
        return float(np.nansum(self.axle_damage))

    @property
    def utilisation(self) -> float:
        """Coefficient used in slips over that at their onsets, weighted with time; nan if none has known forces."""
        known = [e for e in self.events if np.isfinite(e.utilisation) and e.end > e.start]
        seen = sum(e.onset_coefficient * (e.end - e.start) for e in known)
        used = sum(e.utilisation * e.onset_coefficient * (e.end - e.start) for e in known)
        return used / seen if seen else float("nan")


def parts(valid: NDArray[np.bool_], part: NDArray[np.int64]) -> Iterator[slice]:
    """Stretches of valid instants (instants,) without a gap that are long enough to analyse."""
    gaps = np.flatnonzero(np.diff(part)) + 1
    for first, last in spans(valid).tolist():
        inside = gaps[np.searchsorted(gaps, first, "right") : np.searchsorted(gaps, last)]
        for begin, end in pairwise([first, *inside.tolist(), last]):
            if end - begin > SHORTEST_PART:
                yield slice(begin, end)


def analyse_run(
    run: MeasuredRun,
    train: MeasuredTrain,
    criterion: SlipCriterion | None = None,
    window: float = WINDOW,
) -> Findings:
    """Analyse a measured run; `window` [s] is extended to two samplings where it is shorter.

    The coefficient uses the axle load at rest: in a measured train the load that the pitch of car and bogies moves from axle
    to axle is unknown. Raises `EstimationError` if run and train do not fit.
    """
    count, axles = run.time.size, train.radius.size
    for name in ("rim_speed", "applied_force"):
        if getattr(run, name).shape != (count, axles):
            raise EstimationError(
                f"{name}: shape {getattr(run, name).shape} must be ({count}, {axles})"
            )
    criterion = criterion or SlipCriterion()
    period = usual_period(run.time)
    window = max(window, 2.0 * period)
    coefficient, damage = (np.full((count, axles), np.nan, order="F") for _ in range(2))
    covered, slipping = np.zeros(axles), np.zeros(axles)
    events: list[SlipEvent] = []
    small: list[SlipEvent] = []
    noise = slip_noise(run)
    over_car = None if run.over_train is None else run.speed[:, None] + run.over_train
    filled = 0.0
    of_car = 0.0 if train.coupler is None else UNKNOWN if over_car is None else UNSURE
    by_half = 0.0
    for i in range(axles):
        speed = run.speed if over_car is None else over_car[:, i]
        turning = np.isfinite(run.rim_speed[:, i]) & np.isfinite(speed)
        known = turning & np.isfinite(run.applied_force[:, i])
        gained = np.zeros(count)
        for inside in parts(known, run.part):
            arguments = (
                run.time[inside], run.applied_force[inside, i : i + 1],
                run.rim_speed[inside, i : i + 1] / train.radius[i],
            )  # fmt: skip
            inertia, radius = train.inertia[i], train.radius[i]
            longest = float(np.diff(run.time[inside]).max())
            force = tangential_force(*arguments, inertia, radius, max(window, longest))
            coefficient[inside, i] = force[:, 0] / train.axle_load[i]
            lost = wheel_damage(*arguments, speed[inside], inertia, radius)[:, 0]
            by_half += lost[-1] - _by_every_second(*arguments, speed[inside], inertia, radius)
            gained[inside] += np.diff(lost, prepend=0.0)
            covered[i] += run.time[inside][-1] - run.time[inside][0]
        if covered[i] > 0.0:
            damage[:, i] = np.cumsum(gained)
            filled += 0.0 if run.filled is None else float(gained[run.filled[:, i]].sum())
        has_force = np.isfinite(coefficient[:, i])
        # where the forces are missing the slips are still there
        for kind in (has_force, turning & ~has_force):
            for inside in parts(kind, run.part):
                with_force = bool(kind is has_force)
                series = (
                    i, run.time[inside], speed[inside], run.rim_speed[inside, i],
                    coefficient[inside, i] if with_force else None,
                    damage[inside, i] if with_force else None,
                )  # fmt: skip
                span = 0.0 if run.rim_span is None else float(run.rim_span[i])
                found = find_slips(*series, criterion, noise.rim[i], span)
                found = [_without_onset(event, run) for event in found]
                events += found
                small += apart(find_slips(*series, SMALL, noise.slip[i], span), found)
        slipping[i] = sum(e.end - e.start for e in events if e.axle == i)
    return Findings(
        events=sorted(events, key=lambda event: (event.start, event.axle)),
        run=run,
        coefficient=coefficient,
        damage=damage,
        covered=covered,
        slipping_time=slipping,
        car_force=_car_forces(run, train, window),
        window=window,
        small_events=tuple(sorted(small, key=lambda event: (event.start, event.axle))),
        least_slip=np.maximum(SMALL.velocity, CERTAIN * noise.slip),
        errors=damage_errors(
            run, coefficient, train.axle_load, by_half, of_car, np.nan_to_num(damage[-1]), filled
        ),
        filled_damage=filled,
        over_car=over_car,
    )


def _without_onset(event: SlipEvent, run: MeasuredRun) -> SlipEvent:
    """A slip that began where its wheel was unknown has no onset."""
    k = int(np.searchsorted(run.time, event.start))
    if run.filled is None or not run.filled[max(k - 1, 0) : k + 1, event.axle].any():
        return event
    nan = float("nan")
    return event._replace(cut=True, onset_coefficient=nan, onset_time=nan, utilisation=nan)


def _by_every_second(
    time: Floats, force: Floats, omega: Floats, speed: Floats, inertia: float, radius: float
) -> float:
    """Wheel damage [J] of an axle by every second instant, and the last one."""
    some = np.append(np.arange(0, time.size - 1, 2), time.size - 1)
    return float(
        wheel_damage(time[some], force[some], omega[some], speed[some], inertia, radius)[-1, 0]
    )


def _car_forces(run: MeasuredRun, train: MeasuredTrain, window: float) -> Floats | None:
    """Brake force of each car where all coupler forces are measured; the train's acceleration stands in for the cars'."""
    if run.coupler_force is None:
        return None
    rate = run.car_acceleration
    if rate is None:
        rate = train_acceleration(run, window)
    known = np.isfinite(run.coupler_force).all(axis=1)
    known &= np.isfinite(rate.reshape(rate.shape[0], -1)).all(axis=1)
    force = np.full((rate.shape[0], train.car_mass.size), np.nan)
    if known.any():
        force[known] = car_brake_forces(rate[known], run.coupler_force[known], train.car_mass)
    return force


def train_acceleration(run: MeasuredRun, window: float) -> Floats:
    """Acceleration of the train [m/s2], mean over `window` [s] around each instant, (instants,); nan in gaps."""
    rate = np.full(run.time.size, np.nan)
    for inside in parts(np.isfinite(run.speed), run.part):
        rate[inside] = mean_rate(run.time[inside], run.speed[inside], window)
    return rate


def applied_force(run: xr.Dataset, train: Train | MeasuredTrain) -> Floats:
    """Force [N] of motors and shoes at the rims of a recorded run, (instants, axles): a real train's log has it as torques.

    `train` is the one of the run; raises `EstimationError` for any other number of axles.
    """
    known = MeasuredTrain.of(train) if isinstance(train, Train) else train
    if run.sizes["axle"] != known.radius.size:
        raise EstimationError(
            f"run of {run.sizes['axle']} axles: train {known.name!r} has {known.radius.size}"
        )
    unit = run["axle_unit"].values
    driven = unit >= 0
    motor = np.zeros(run["rail_force"].shape)
    motor[:, driven] = (run["motor_torque"].values * run["unit_gear"].values)[:, unit[driven]]
    return np.asarray(motor / known.radius - run["brake_force"].values)


CORRELATED = 5.0
"""Time [s] for which an error of the train's speed persists."""
NOISE_LASTS = 0.2
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
    lasts = max(NOISE_LASTS, period)
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
