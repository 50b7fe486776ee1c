"""A log of a real train: read, brought to common instants and SI units, and checked; defects are reported."""

import math
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.display import displayed
from alloc.estimation.series import usual_period
from studies.logs import checks
from studies.logs.axle_series import applied_forces, at_instants, typical, wheel_speeds
from studies.logs.common_instants import Instants, common_instants, longest, resample
from studies.logs.dead_zone import filled_dead_zone
from studies.logs.estimated_speed import estimated_speed
from studies.logs.forces_as_read import as_read
from studies.logs.gradients import GradientLine
from studies.logs.known_train import MeasuredTrain
from studies.logs.late_recorders import bring_together
from studies.logs.mapping import Mapping
from studies.logs.measured_run import MeasuredRun, SpeedSource
from studies.logs.momentum_check import check_balance, forwards_too
from studies.logs.own_samples import Samples
from studies.logs.period import conclude_period
from studies.logs.radius_correction import make_up_for_radii
from studies.logs.recorder_files import Recording, read_recording, recording_of
from studies.logs.remarks import Remark, faulty
from studies.logs.speed_shape import middle_speed
from studies.logs.told_channels import Sources, open_sources
from studies.logs.train_readings import TrainReadings
from studies.logs.train_speed import LATE, LATE_OF_MEANS, MeasuredSpeed, measured_speed

Floats = NDArray[np.float64]


SLOW = 1.5
"""Ratio of periods, of forces over wheels, above which forces count as slower."""


@displayed
@dataclass(frozen=True, eq=False)
class MeasuredLog:
    """A log that is ready for analysis, and the remarks on it."""

    source: str
    run: MeasuredRun
    train: MeasuredTrain
    remarks: tuple[Remark, ...]
    period: float
    """Median time between the instants of `run` [s]."""
    origin: str = ""
    """Absolute time of second 0, "" where the log does not say."""
    rows: int = 0
    """Rows of the file; 0 where its channels have instants of their own."""
    pressure: Floats | None = None
    """Brake cylinders' pressure of each car [Pa], (instants, cars); None: not measured."""
    position: Floats | None = None
    """Station of the train's front [m], (instants,); None: not measured."""
    grade: Floats | None = None
    """Rise per run at the train, (instants,); None: unknown."""


def read_log(
    path: str | Path,
    train: MeasuredTrain,
    mapping: Mapping | None = None,
    line: GradientLine | None = None,
    owner: str = "mapping file",
) -> MeasuredLog:
    """Read a file of a log; raises `StudyError` naming file, column and row for a log that cannot be analysed.

    `mapping` gives the meaning of the columns, else names and units are guessed; `owner` names its file in messages. `line`
    gives the gradient where the log has the position.
    """
    return measured(read_recording(Path(path)), train, mapping, line, owner)


def check_log(
    table: pd.DataFrame,
    train: MeasuredTrain,
    source: str,
    mapping: Mapping | None = None,
    line: GradientLine | None = None,
) -> MeasuredLog:
    """The same for a table in memory."""
    return measured(recording_of(table, source), train, mapping, line)


def measured(
    recording: Recording,
    train: MeasuredTrain,
    mapping: Mapping | None = None,
    line: GradientLine | None = None,
    owner: str = "mapping file",
) -> MeasuredLog:
    """The same for the content of a file."""
    if mapping is not None:
        train = mapping.train(train, owner)
    sources = open_sources(recording, train, mapping, owner)
    if sources.clock is not None and not sources.clock.known:
        conclude_period(sources)
    remarks = sources.remarks
    fixes = sources.speed(("speed", 0)) if ("speed", 0) in sources.assigned else None
    wheels = wheel_speeds(sources, fixes)
    if not wheels:
        raise faulty(recording.source, "axleN_speed", None, "no wheel has a speed")
    instants = common_instants(wheel.time for wheel in wheels.values())
    if instants.time.size < checks.FEWEST_ROWS:
        text = f"{instants.time.size} instants of wheels; give {checks.FEWEST_ROWS} or more to be analysed"
        raise faulty(recording.source, "axleN_speed", None, text)
    remarks += checks.check_instants(instants)
    axles = train.radius.size
    rim = np.full((instants.time.size, axles), np.nan, order="F")
    rim_deviation, spans = np.full(axles, np.nan), np.zeros(axles)
    for number in sorted(wheels):
        wheel = wheels.pop(number)
        series = at_instants(wheel, instants)
        rim[:, number - 1], rim_deviation[number - 1] = series.value, typical(series)
        spans[number - 1] = wheel.span
    force, force_deviation, slowest = applied_forces(sources, instants)
    names = {n: sources.assigned["wheel", n].column for n in sources.numbers_of("wheel")}
    remarks += _lacking(train, names, sources)
    if fixes is not None:
        of_train = sources.assigned["speed", 0].column
        fixes = checks.without_outliers(fixes, of_train, remarks)
        fixes = checks.without_stuck(fixes, instants, rim, of_train, remarks)
        guess = _guess(fixes, instants)
        for number, name in names.items():
            own = rim[:, number - 1]
            checks.check_ratio(name, own, of_train, guess, recording.source)
    as_measured = middle_speed(rim) if fixes is None else guess
    backwards = any(remark.kind == "sign" for remark in remarks)
    force, turned = forwards_too(instants, as_measured, rim, force, train, backwards)
    remarks += turned
    unknown, dead = filled_dead_zone(names, as_measured, rim)
    remarks += dead
    remarks += checks.cut_out_stuck(names, instants.time, as_measured, rim, force, train)
    position = _other(sources, ("position", 0), instants)
    grade = _other(sources, ("gradient", 0), instants)
    if grade is None and line is not None:
        grade = line.along(position, instants, as_measured)
    # an error that lasts for a span counts as white noise that is as much larger
    lasts = np.sqrt(np.maximum(spans / usual_period(instants.time), 1.0))
    smoothed = (rim_deviation * lasts)[spans > 0.0]
    noise = float(np.nanmedian(smoothed)) if smoothed.size else 0.0
    exact = noise == 0.0 and slowest < SLOW * usual_period(instants.time)
    told = None if mapping is None else mapping.at_contact
    least_delay = LATE if exact else LATE_OF_MEANS
    worst = float(np.nanmax(rim_deviation))
    readings = TrainReadings(
        *instants, rim, force, train, grade, worst, float(spans.max()), slowest
    )
    readings, together, unsure = bring_together(readings, fixes)
    rim, force = readings.rim, readings.force
    remarks += together
    speed, extra = _speed(sources, fixes, readings, noise, least_delay, told)
    remarks += extra
    if unsure and speed.delay is not None:
        wider = math.hypot(speed.delay.deviation, unsure)
        speed = replace(speed, delay=speed.delay._replace(deviation=wider))
    force, read = as_read(readings, speed, told)
    remarks += read
    if fixes is not None:
        of_train = sources.assigned["speed", 0].column
        remarks += make_up_for_radii(
            names, instants, speed, rim, force, train, of_train, rim_deviation
        )
    if unknown is not None:
        rim[unknown] = np.nan
    remarks += check_balance(instants, speed.speed, rim, force, train, grade)
    coupler = _all_of(sources, "couplerK_force", train.car_mass.size - 1, instants)
    acceleration = _all_of(sources, "carK_acceleration", train.car_mass.size, instants)
    pressure = _all_of(sources, "carK_pressure", train.car_mass.size, instants)
    source: SpeedSource = (
        "estimated" if fixes is None else "followed" if speed.followed else "measured"
    )
    run = MeasuredRun(
        instants.time, instants.part, speed.speed, rim, force, coupler, acceleration, speed.deviation,
        rim_deviation, force_deviation, spans, source, speed.delay,
    )  # fmt: skip
    clock = sources.clock
    return MeasuredLog(
        source=recording.source,
        run=run,
        train=train,
        remarks=tuple(remarks),
        period=usual_period(instants.time),
        origin="" if clock is None else clock.origin,
        rows=0 if clock is None else clock.time.size,
        pressure=pressure,
        position=position,
        grade=grade,
    )


def _lacking(train: MeasuredTrain, names: dict[int, str], sources: Sources) -> list[Remark]:
    """Remarks on axles without a speed or without a force."""
    remarks = []
    efforts = set(sources.numbers_of("effort"))
    for number in range(1, train.radius.size + 1):
        if number not in names:
            text = f"axle {number} is not analysed: no speed"
            remarks.append(Remark("missing", f"axle{number}_speed", text))
        elif number not in efforts:
            text = f"axle {number}: slips only, neither coefficient nor Q: no torque and no force"
            remarks.append(Remark("missing", f"axle{number}_force", text))
    return remarks


def _guess(fixes: Samples, instants: Instants) -> Floats:
    """The train's speed as it stands, on straight lines between its samples; nan where they are far apart."""
    if fixes.time.size < 2:
        return np.full(instants.time.size, np.nan)
    guess = np.interp(instants.time, fixes.time, fixes.value)
    reach = max(longest(fixes.period), 3.0)
    after = np.clip(np.searchsorted(fixes.time, instants.time), 1, fixes.time.size - 1)
    guess[np.abs(fixes.time[after] - fixes.time[after - 1]) > reach] = np.nan
    return guess


def _speed(
    sources: Sources,
    fixes: Samples | None,
    readings: TrainReadings,
    noise: float,
    least_delay: float,
    told: bool | None,
) -> tuple[MeasuredSpeed, list[Remark]]:
    """The train's speed: measured, followed between measurements, or estimated; raises `Faulty` where nothing tells it."""
    source = sources.recording.source
    if fixes is None:
        ground, remarks = estimated_speed(readings, source, noise)
        return MeasuredSpeed(ground.speed, ground.deviation, None, False, ""), remarks
    name = sources.assigned["speed", 0].column
    found = measured_speed(readings, fixes, least_delay, told)
    if not np.isfinite(found.speed[:, None] * readings.rim).any():
        raise faulty(source, name, None, "at no instant are train and a wheel known")
    return found, []


def _other(sources: Sources, place: tuple[str, int], instants: Instants) -> Floats | None:
    """A channel of the whole train at the common instants; None if there is none."""
    if place not in sources.assigned:
        return None
    return resample(sources.plain(place), instants.time).value


def _all_of(sources: Sources, stem: str, count: int, instants: Instants) -> Floats | None:
    """The channels of a quantity that only all together are of use, (instants, count); None, with a remark, otherwise."""
    found = sources.numbers_of(stem)
    if not found:
        return None
    if len(found) < count:
        lacking = next(k for k in range(1, count + 1) if k not in found)
        text = f"{len(found)} of {count} are there, number {lacking} is not: none is used"
        sources.remarks.append(Remark("missing", stem, text))
        return None
    series = [resample(sources.plain((stem, k)), instants.time).value for k in found]
    return np.stack(series, axis=1)
