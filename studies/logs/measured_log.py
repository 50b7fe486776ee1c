"""A log of a real train: read, brought to common instants and SI units, and checked; defects are reported."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.display import displayed
from alloc.estimation.series import usual_period
from alloc.plant.laws import GRAVITY
from studies.logs.aligned_log import (
    Log,
    check_constant,
    check_instants,
    check_ratio,
    open_log,
    parts_of,
)
from studies.logs.channels import FEWEST_ROWS, Channels, open_channels
from studies.logs.estimator import estimate
from studies.logs.mapping import Mapping
from studies.logs.measured_run import Delay, MeasuredRun, SpeedSource
from studies.logs.motion_fit import Fit
from studies.logs.own_samples import BRIDGED, WORDS, Samples, at, of_counter, own_samples, smoothed
from studies.logs.recorder_files import Recording, read_recording, recording_of
from studies.logs.remarks import Remark, faulty
from studies.logs.train import GradientLine, MeasuredTrain

Floats = NDArray[np.float64]


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
    fit: Fit | None = None
    """What the log was found to be."""


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
    channels = open_channels(recording, train, mapping, owner)
    remarks = channels.remarks
    told = None if mapping is None else mapping.at_contact
    rates = _all_of(channels, "carK_acceleration", train.car_mass.size)
    names, log = _opened(channels, rates)
    times = log.time, parts_of(log.time)
    position, grade = (_other(channels, (name, 0), log.time) for name in ("position", "gradient"))
    if grade is None and line is not None:
        grade = line.along(position, log.time, log.guess())
    if grade is not None:
        log.uphill = GRAVITY * np.nan_to_num(grade)
    remarks += check_instants(log.time[~log.lost])
    remarks += _lacking(train, names, channels)
    found = estimate(log, names, recording.source, told)
    log = found.log
    remarks += log.remarks
    if found.fit.contact and told is None:
        text = (
            "the forces are those between wheel and rail, by the train's momentum; taken so (a mapping file may say "
            'at = "rim" under [forces])'
        )
        remarks.append(Remark("guess", "axleN_force", text))
    coupler = _all_of(channels, "couplerK_force", train.car_mass.size - 1)
    pressure = _all_of(channels, "carK_pressure", train.car_mass.size)
    source: SpeedSource = (
        "estimated" if log.fixes is None else "followed" if found.followed else "measured"
    )
    run = MeasuredRun(
        *times, found.speed, log.rim, log.force, _stacked(coupler, log.time),
        _stacked(rates, log.time), found.unsure.deviation(log.time), log.noise,
        rim_span=log.span, speed_source=source, speed_delay=None if found.delay is None else Delay(*found.delay),
        over_train=log.own, filled=log.filled, unsure=found.unsure,
    )  # fmt: skip
    clock = channels.clock
    return MeasuredLog(
        source=recording.source,
        run=run,
        train=train,
        remarks=tuple(remarks),
        period=usual_period(log.time),
        origin="" if clock is None else clock.origin,
        rows=0 if clock is None else clock.time.size,
        pressure=_stacked(pressure, log.time),
        position=position,
        grade=grade,
        fit=found.fit,
    )


def _opened(channels: Channels, rates: list[Samples]) -> tuple[dict[int, str], Log]:
    """Names of the wheels' columns by axle from 0, -1 for the speed, and all channels at common instants.

    `rates`: accelerations of all cars, or none.
    """
    train, remarks = channels.train, channels.remarks
    speed = channels.speed(("speed", 0)) if ("speed", 0) in channels.assigned else None
    names = {n - 1: channels.assigned["wheel", n].column for n in channels.numbers_of("wheel")}
    wheels = {}
    for i, name in names.items():
        if channels.assigned["wheel", i + 1].quantity == "axleN_pulses":
            wheels[i] = _pulses(channels, i + 1)
        else:
            wheels[i] = channels.speed(("wheel", i + 1))
        _note_left_out(wheels[i], name, remarks)
    if 0.2 < np.mean([w.kind == "counted" for w in wheels.values()]) < 1.0:
        wheels = {i: own_samples(w.time, w.value, speed=True, counts=True) if w.kind == "sampled" else w
                  for i, w in wheels.items()}  # fmt: skip
    wheels = {i: smoothed(w) for i, w in wheels.items() if w.time.size > 1}
    if not wheels:
        raise faulty(channels.source, "axleN_speed", None, "no wheel has a speed")
    for i, w in wheels.items():
        if w.span > 0.0 and w.kind != "quantised":
            remarks.append(Remark("sampling", names[i], WORDS[w.kind].format(span=w.span)))
    if max(w.time.size for w in wheels.values()) < FEWEST_ROWS:
        text = f"fewer than {FEWEST_ROWS} instants of wheels; give more to be analysed"
        raise faulty(channels.source, "axleN_speed", None, text)
    if speed is not None and speed.time.size > 1:
        of_train = channels.assigned["speed", 0].column
        _note_left_out(speed, of_train, remarks)
        for i, w in wheels.items():
            guess = np.interp(w.time, speed.time, speed.value)
            check_ratio(names[i], w.value, of_train, guess, channels.source)
    forces = {n - 1: channels.force(n) for n in channels.numbers_of("effort")}
    for i, samples in forces.items():
        name = channels.assigned["effort", i + 1].column
        remarks += check_constant(name, samples.value, samples.time)
    for car in channels.numbers_of("carK_pressure"):
        one = channels.assigned["carK_pressure", car]
        if one.newton_per_pascal is None:
            continue
        time, values = channels.series(("carK_pressure", car))
        values = -channels.scaled(("carK_pressure", car), values) * one.newton_per_pascal
        del channels.assigned["carK_pressure", car]
        for i in np.flatnonzero(train.axle_car == car - 1).tolist():
            forces.setdefault(i, own_samples(time, values))
    forces = {i: one for i, one in forces.items() if one.time.size > 1}
    log = open_log(speed, wheels, forces, train, rates)
    return names | ({-1: channels.assigned["speed", 0].column} if speed is not None else {}), log


def _pulses(channels: Channels, number: int) -> Samples:
    """Speed of a wheel from a column of pulses, counted so far or since the row before."""
    one = channels.assigned["wheel", number]
    time, count = channels.series(("wheel", number))
    known = np.isfinite(count)
    radius = float(channels.train.radius[number - 1])
    metres = 2.0 * np.pi * radius / float(one.pulses_per_turn or 1.0)
    samples, bridged = of_counter(time[known], count[known] * one.sign, metres)
    if bridged:
        text = f"counter set back {bridged} time{'s' if bridged > 1 else ''}: bridged by the speed around"
        channels.remarks.append(Remark("sampling", one.column, text))
    return samples


def _note_left_out(samples: Samples, name: str, remarks: list[Remark]) -> None:
    if samples.left_out.size:
        row = int(samples.left_out[0]) + 1
        text = f"{samples.left_out.size} values to which no speed jumps left out, the first in row {row}"
        remarks.append(Remark("faulty", name, text, row))


def _lacking(train: MeasuredTrain, names: dict[int, str], channels: Channels) -> list[Remark]:
    """Remarks on axles without a speed or without a force."""
    remarks = []
    efforts = set(channels.numbers_of("effort"))
    for number in range(1, train.radius.size + 1):
        if number - 1 not in names:
            text = f"axle {number} is not analysed: no speed"
            remarks.append(Remark("missing", f"axle{number}_speed", text))
        elif number not in efforts:
            text = f"axle {number}: slips only, neither coefficient nor Q: no torque and no force"
            remarks.append(Remark("missing", f"axle{number}_force", text))
    return remarks


def _other(channels: Channels, place: tuple[str, int], time: Floats) -> Floats | None:
    """A channel of the whole train at the common instants; None if there is none."""
    if place not in channels.assigned:
        return None
    return at(time, channels.plain(place), BRIDGED)


def _all_of(channels: Channels, stem: str, count: int) -> list[Samples]:
    """The channels of a quantity that only all together are of use; none, with a remark, where one lacks."""
    found = channels.numbers_of(stem)
    if not found:
        return []
    if len(found) < count:
        lacking = next(k for k in range(1, count + 1) if k not in found)
        text = f"{len(found)} of {count} are there, number {lacking} is not: none is used"
        channels.remarks.append(Remark("missing", stem, text))
        return []
    return [channels.plain((stem, k)) for k in found]


def _stacked(channels: list[Samples], time: Floats) -> Floats | None:
    """Channels at instants, (instants, channels); None for none."""
    return np.stack([at(time, one, BRIDGED) for one in channels], axis=1) if channels else None
