"""A log of a real train: read, checked, and brought to SI units; what is wrong with it is reported, never repaired."""

import csv
import warnings
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from alloc.estimation.measured_run import MeasuredRun, MeasuredTrain
from studies.files.study_error import StudyError
from studies.files.writable import LOG
from studies.logs import checks
from studies.logs.checks import Remark, faulty
from studies.logs.columns import QUANTITIES, Column, near_column, parse_column
from studies.logs.estimated_speed import estimated_speed

Floats = NDArray[np.float64]

DEAD_SHARE = 0.95
"""Share of the time under way for which a wheel's speed is exactly zero, if its sensor is dead and not the wheel locked."""


@dataclass(frozen=True, eq=False)
class MeasuredLog:
    """A log that can be analysed, and the remarks on it."""

    source: str
    run: MeasuredRun
    train: MeasuredTrain
    remarks: tuple[Remark, ...]
    period: float
    """Median time between rows [s]."""


def read_log(path: str | Path, train: MeasuredTrain) -> MeasuredLog:
    """Read a CSV or parquet file; raises `StudyError` naming file, column and row for what cannot be analysed."""
    return check_log(_read_table(Path(path)), train, str(path))


def _read_table(path: Path) -> pd.DataFrame:
    text = repr(str(path))
    ending = path.suffix.lower()
    if ending not in LOG:
        raise StudyError(f"log {text}: ending {path.suffix!r} must be {' or '.join(LOG)}")
    if not path.is_file():
        raise StudyError(f"log {text} does not exist")
    try:
        if ending == ".parquet":
            return pd.read_parquet(path)
        with open(path, newline="", encoding="utf-8-sig") as file:
            header = [name.strip() for name in next(csv.reader(file), [])]
        if len(header) < 2 and any(mark in "".join(header) for mark in ";\t"):
            raise StudyError(f"log {text}: columns must be divided by commas, decimals by points")
        double = sorted({name for name in header if header.count(name) > 1})
        if double:
            raise StudyError(f"log {text}: column {double[0]!r} is there twice")
        with warnings.catch_warnings():
            warnings.simplefilter("error", pd.errors.ParserWarning)
            table = pd.read_csv(path, index_col=False, skipinitialspace=True, low_memory=False)
        table.columns = pd.Index(header)
        return table
    except StudyError:
        raise
    except OSError as error:
        raise StudyError(f"log {text} cannot be read: {error.strerror or error}") from None
    except (ValueError, pd.errors.ParserWarning, csv.Error) as error:
        reason = " ".join(str(error).split())
        raise StudyError(f"log {text} is no table of {ending[1:]}: {reason}") from None


def check_log(table: pd.DataFrame, train: MeasuredTrain, source: str) -> MeasuredLog:
    """Check a table and bring it to SI units; raises `StudyError` for what cannot be analysed."""
    columns, remarks = _columns(table, train, source)
    checks.check_numbers(table, [c.name for c in columns], source)
    by_quantity = {(c.quantity, c.number): c for c in columns}
    time = table["time_s"].to_numpy(float)
    part, found = checks.check_time(time, source)
    remarks += found

    def values(column: Column) -> Floats:
        raw = table[column.name].to_numpy(float)
        remarks.extend(checks.missing_values(column.name, raw, time))
        return raw * QUANTITIES[column.quantity].units[column.unit]

    speed_column = by_quantity.get(("speed", 0))
    speed, deviation = None, None
    if speed_column is not None:
        speed = values(speed_column)
        checks.check_speed(speed_column.name, speed, source)
    rim, force = _axle_series(table, by_quantity, time, train, values, remarks, source)
    if speed_column is not None and speed is not None:
        for (quantity, number), column in by_quantity.items():
            if quantity == "axleN_speed":
                own = rim[:, number - 1]
                checks.check_ratio(column.name, own, speed_column.name, speed, source)
    remarks += _cut_out_stuck(by_quantity, time, speed, rim)
    if speed is None:
        gradient = by_quantity.get(("gradient", 0))
        grade = None if gradient is None else values(gradient)
        ground, found = estimated_speed(time, part, rim, force, grade, train, source)
        speed, deviation = ground.speed, ground.deviation
        remarks += found
    elif not np.isfinite(speed[:, None] * rim).any():
        name = by_quantity["speed", 0].name
        raise faulty(source, name, None, "at no instant are train and a wheel known")
    for i in range(train.radius.size):
        if ("axleN_speed", i + 1) in by_quantity:
            name = by_quantity["axleN_speed", i + 1].name
            share = force[:, i] / train.axle_load[i]
            remarks += checks.check_radius(name, rim[:, i], speed, share)
    remarks += checks.check_balance(time, part, speed, rim, force, train)
    coupler = _all_of("couplerK_force", train.car_mass.size - 1, by_quantity, values, remarks)
    acceleration = _all_of("carK_acceleration", train.car_mass.size, by_quantity, values, remarks)
    return MeasuredLog(
        source=source,
        run=MeasuredRun(time, part, speed, rim, force, coupler, acceleration, deviation),
        train=train,
        remarks=tuple(remarks),
        period=float(np.median(np.diff(time))),
    )


def _axle_series(
    table: pd.DataFrame,
    by_quantity: dict[tuple[str, int], Column],
    time: Floats,
    train: MeasuredTrain,
    values: Callable[[Column], Floats],
    remarks: list[Remark],
    source: str,
) -> tuple[Floats, Floats]:
    """Rim speeds [m/s] and forces at the rim [N] of all axles, (instants, axles); nan where there are none."""
    rim, force = (np.full((time.size, train.radius.size), np.nan) for _ in range(2))
    for i in range(train.radius.size):
        turning = by_quantity.get(("axleN_speed", i + 1))
        column = by_quantity.get(("axleN_torque", i + 1)) or by_quantity.get(("axleN_force", i + 1))
        if turning is None:
            remarks.append(
                Remark("missing", f"axle{i + 1}_speed", f"axle {i + 1} is not analysed: no speed")
            )
        elif turning.unit == "rads":
            raw = table[turning.name].to_numpy(float)
            remarks += checks.missing_values(turning.name, raw, time)
            rim[:, i] = raw * train.radius[i]
        else:
            rim[:, i] = values(turning)
        if turning is not None:
            checks.check_speed(turning.name, rim[:, i], source)
        if column is not None:
            lever = train.radius[i] if column.quantity == "axleN_torque" else 1.0
            force[:, i] = values(column) / lever
            checks.check_force(column.name, force[:, i], float(train.axle_load[i]), source)
            remarks += checks.check_constant(column.name, force[:, i], time)
        elif turning is not None:
            text = f"axle {i + 1}: slips only, neither coefficient nor Q: no torque and no force"
            remarks.append(Remark("missing", f"axle{i + 1}_force", text))
    return rim, force


def _columns(
    table: pd.DataFrame, train: MeasuredTrain, source: str
) -> tuple[list[Column], list[Remark]]:
    """Known columns, and remarks on the others; raises where one that is required is missing, doubled or out of place."""
    columns, remarks = [], []
    for name in map(str, table.columns):
        column = parse_column(name)
        if column is None:
            near = near_column(name)
            hint = f"; did you mean {near!r}?" if near else ""
            remarks.append(Remark("unknown", name, f"is not known and not used{hint}"))
        else:
            columns.append(column)
    axles, cars = train.radius.size, train.car_mass.size
    most = {"axleN": axles, "couplerK": cars - 1, "carK": cars}
    seen: dict[tuple[str, int], str] = {}
    for column in columns:
        kind = column.quantity.split("_")[0]
        if column.number > most.get(kind, 0):
            raise faulty(
                source, column.name, None,
                f"train {train.name!r} has {axles} axles and {cars} cars",
            )  # fmt: skip
        key = (column.quantity.replace("torque", "force"), column.number)
        if key in seen:
            raise faulty(source, column.name, None, f"is the same as {seen[key]!r}; give one")
        seen[key] = column.name
    for stem, quantity in QUANTITIES.items():
        if any(key[0] == stem for key in seen):
            continue
        meant = [r.column for r in remarks if _quantity_meant(r.column) == stem]
        # a speed that is only misspelt shall not be estimated
        if quantity.required or (stem == "speed" and meant):
            hint = f"; is it {meant[0]!r}?" if meant else ""
            wanted = " or ".join(f"{stem}_{unit}" for unit in quantity.units)
            raise faulty(source, wanted, None, f"is missing: {quantity.description}{hint}")
    return columns, remarks


def _quantity_meant(name: str) -> str | None:
    """Quantity of the column that a misspelt name resembles."""
    column = parse_column(near_column(name) or "")
    return None if column is None else column.quantity


def _all_of(
    stem: str,
    count: int,
    by_quantity: dict[tuple[str, int], Column],
    values: Callable[[Column], Floats],
    remarks: list[Remark],
) -> Floats | None:
    """The columns of a quantity that only all together are of use; None, with a remark if some are there, otherwise."""
    found = [by_quantity[stem, k] for k in range(1, count + 1) if (stem, k) in by_quantity]
    if not found:
        return None
    if len(found) < count:
        lacking = next(k for k in range(1, count + 1) if (stem, k) not in by_quantity)
        text = f"{len(found)} of {count} are there, number {lacking} is not: none is used"
        remarks.append(Remark("missing", stem, text))
        return None
    return np.stack([values(column) for column in found], axis=1)


def _cut_out_stuck(
    by_quantity: dict[tuple[str, int], Column], time: Floats, speed: Floats | None, rim: Floats
) -> list[Remark]:
    """Cut out, in place, speeds that do not move while the others do; a wheel at rest may be locked and stays.

    Without the train's speed the wheels' median stands for it.
    """
    remarks = []
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", RuntimeWarning)  # rows without any wheel
        wheels = np.nanmedian(rim, axis=1)

    def note(name: str, inside: slice, text: str) -> None:
        begin, end = inside.start, inside.stop - 1
        text += f", {time[begin]:.6g} s to {time[end]:.6g} s"
        remarks.append(Remark("stuck", name, text, begin + 1, float(time[begin])))

    if speed is None:
        speed = wheels
    else:
        for inside in list(checks.stuck(speed, wheels, time)):
            note(by_quantity["speed", 0].name, inside, "stuck: the wheels' speeds change; cut out")
            speed[inside] = np.nan
    under_way = speed > checks.STUCK_CHANGE
    for (quantity, number), column in by_quantity.items():
        if quantity != "axleN_speed":
            continue
        own = rim[:, number - 1]
        dead = bool(under_way.any()) and np.mean(own[under_way] == 0.0) > DEAD_SHARE
        for inside in list(checks.stuck(own, speed, time)):
            at_rest = own[inside.start] == 0.0
            if at_rest and not dead:
                note(
                    column.name,
                    inside,
                    "zero while the train runs: a locked wheel, and taken for one",
                )
                continue
            note(column.name, inside, "stuck: the train's speed changes; cut out")
            own[inside] = np.nan
    return remarks
