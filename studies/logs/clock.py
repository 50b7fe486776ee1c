"""The instants of a log's rows: numbers, time stamps or texts, brought to seconds that grow.

Rows that are repeated go; rows out of order are sorted. Time stamps of too few digits, as an epoch in single precision or
whole seconds, are spread evenly over the rows that share one.
"""

from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import NDArray

from studies.logs.mapping import factor
from studies.logs.recorder_files import numbers_of
from studies.logs.remarks import Remark, faulty

Floats = NDArray[np.float64]

EPOCHS = ((1e17, 1e-9, "ns"), (1e14, 1e-6, "µs"), (1e11, 1e-3, "ms"))
"""Least value, factor and unit of an epoch that is not in seconds."""
EPOCH = 1e8
"""Seconds above which a time counts from 1970."""
COUNTED = (
    (1e-3, "read as milliseconds"), (1e-6, "read as microseconds"), (1e-9, "read as nanoseconds")
)  # fmt: skip
"""Units of whole numbers that grow by more than one from row to row: the first with which rows are close enough."""
LONGEST_STEP = 2.0
"""Time [s] between two rows that a logger has at most."""
DAYS = 2e-5
"""Step below which a time without a unit counts days: rows are further apart than a fiftieth of a millisecond."""
LONGEST_BACK = 2.0
"""Time [s] by which a row may be out of order; beyond, a clock was set back."""
MOST_SETTINGS = 3
"""Times that a clock is set in a log; if it goes back more often, rows are out of order."""
DAY, HOUR = 86400.0, 3600.0
"""[s] A clock that goes back by a day less an hour at most has no date and passed midnight."""
FEWEST_STAMPS = 3
"""Smallest number of different time stamps from which a period can be determined, where many rows share one."""
SHARED = 0.5
"""Share of rows with the time stamp of the row before, above which they are spread."""
COARSE = 0.05
"""Rounding of single precision over the period of the rows, above which the rows are spread evenly."""
PERIODS = (1e-3, 2e-3, 5e-3, 1e-2, 2e-2, 5e-2, 0.1, 0.2, 0.5, 1.0)
"""Periods of loggers [s], of which one is chosen where it must be concluded."""


@dataclass(frozen=True, eq=False)
class Clock:
    """When the rows of a log were written."""

    time: Floats
    """[s] from the origin, growing; equal only where two recorders wrote a row at the same instant. (rows,)"""
    rows: NDArray[np.int64] | None
    """Which row of the file each is; None: all as they stand."""
    origin: str
    """What second 0 is, "" where the log does not say."""
    remarks: list[Remark]

    def of(self, values: NDArray[Any]) -> NDArray[Any]:
        """The values of a channel in the order of `time`."""
        return values if self.rows is None else values[self.rows]


def read_clock(
    raw: NDArray[Any], name: str, unit: str, source: str, period: float | None = None
) -> Clock:
    """The clock of a time column; `period` [s]: of the rows, where the column does not state it. Raises `Faulty`."""
    single = raw.dtype == np.float32
    seconds, origin, shown = _seconds(raw, name, unit, source)
    remarks = [Remark("time", name, shown)] if shown else []
    missing = np.flatnonzero(~np.isfinite(seconds))
    rows = None
    if missing.size:
        if missing.size > 0.5 * seconds.size:
            raise faulty(source, name, int(missing[0]) + 1, "has no time")
        text = f"{missing.size} row{'s' if missing.size > 1 else ''} without a time left out"
        remarks.append(Remark("time", name, text, int(missing[0]) + 1))
        rows = np.flatnonzero(np.isfinite(seconds))
        seconds = seconds[rows]
    step = np.diff(seconds)
    if np.any(step < HOUR - DAY):
        seconds = np.unwrap(seconds, period=DAY)  # rows of two recorders may interleave here too
        row = int(np.argmin(step)) + 2
        remarks.append(Remark("time", name, "the time of day passes midnight: a day added", row))
        step = np.diff(seconds)
    unsure = single or _of_single_precision(seconds)
    if step.size and np.mean(step == 0.0) > SHARED:
        spread, text = _spread(seconds, period)
        if spread is None:
            raise faulty(source, name, None, text)
        return Clock(spread, rows, origin, [*remarks, Remark("time", name, text)])
    back = np.flatnonzero(step < 0.0)
    if 0 < back.size <= MOST_SETTINGS:
        seconds, told = _set_back(seconds, back, name)
        remarks += told
        back = np.flatnonzero(np.diff(seconds) < 0.0)
    if back.size:
        step = np.diff(seconds)
        worst = int(back[np.argmin(step[back])])
        if np.maximum.accumulate(seconds)[worst] - seconds[worst + 1] > LONGEST_BACK:
            raise faulty(
                source, name, worst + 2,
                f"time goes back: {seconds[worst + 1]:.9g} s after {seconds[worst]:.9g} s; "
                "if these are two logs in one file, divide them",
            )  # fmt: skip
        order = np.argsort(seconds, kind="stable")
        rows = order if rows is None else rows[order]
        seconds = seconds[order]
        text = f"{back.size} row{'s' if back.size > 1 else ''} out of order, sorted by time"
        remarks.append(Remark("time", name, text, worst + 2, float(seconds[worst])))
    if unsure:
        seconds, text = _evened(seconds)
        if text:
            remarks.append(Remark("time", name, text))
    return Clock(seconds, rows, origin, remarks)


def _set_back(seconds: Floats, back: NDArray[np.int64], name: str) -> tuple[Floats, list[Remark]]:
    """Seconds that go on where a clock was set back for good, and what was done.

    A row that is out of order is followed by one that jumps forwards again. Beyond `LONGEST_BACK` nothing is done.
    """
    period = float(np.median(np.diff(seconds)))
    remarks = []
    for k in back.tolist():
        by = float(seconds[k] - seconds[k + 1])
        rows = min(int(2.0 * by / period) + 1, seconds.size - k - 2)
        after = np.diff(seconds[k + 1 : k + 2 + rows])
        if not period < by <= LONGEST_BACK or after.size < rows or rows < 1:
            continue
        if np.any(np.abs(after - period) > 0.5 * period):
            continue
        seconds = seconds.copy()
        seconds[k + 1 :] += by + period
        text = f"the clock was set back by {by:.3g} s: what follows goes on from the row before"
        remarks.append(Remark("time", name, text, k + 2, float(seconds[k])))
    return seconds, remarks


def _seconds(raw: NDArray[Any], name: str, unit: str, source: str) -> tuple[Floats, str, str]:
    """Seconds, what second 0 is, and what is to be said of how it was read."""
    if raw.dtype.kind in "OUS" or raw.dtype.kind == "T":
        raw = _stamps(raw, name, source)
    if raw.dtype.kind == "M":
        whole = raw.astype("datetime64[ns]")
        first = whole[~np.isnat(whole)][0]
        seconds = np.where(np.isnat(whole), np.nan, (whole - first).astype(np.int64) * 1e-9)
        return np.asarray(seconds, dtype=float), pd.Timestamp(first).isoformat(), ""
    if raw.dtype.kind == "m":
        spent = raw.astype("timedelta64[ns]").astype(np.int64) * 1e-9
        return np.asarray(spent, dtype=float), "", ""
    values = raw.astype(np.float64)
    if np.isinf(values).any():
        row = int(np.flatnonzero(np.isinf(values))[0])
        raise faulty(source, name, row + 1, "is infinite")
    known = values[np.isfinite(values)]
    if known.size == 0:
        raise faulty(source, name, 1, "has no time")
    scale, shown = 1.0, ""
    size = float(np.median(np.abs(known)))
    if unit and (size <= EPOCHS[-1][0] or unit != "s"):
        scale = 1.0 if unit == "s" else factor(unit, "time") or 1.0
    else:
        for least, own, word in EPOCHS:
            if size > least:
                scale, shown = own, f"read as an epoch in {word}"
                break
        else:
            step = float(np.median(np.abs(np.diff(known)))) if known.size > 1 else 0.0
            if size < EPOCH and step >= 2.0 and np.all(known[:100] == np.round(known[:100])):
                scale, shown = next(
                    (one for one in COUNTED if step * one[0] <= LONGEST_STEP), COUNTED[-1]
                )
            elif 0.0 < step < DAYS:
                scale, shown = DAY, "read as days"
    values = values * scale
    origin = ""
    if abs(values[np.isfinite(values)][0]) > EPOCH:
        first = float(values[np.isfinite(values)][0])
        origin = pd.Timestamp(first, unit="s", tz="UTC").isoformat()
        if raw.dtype.kind in "iu":
            start = raw[0]
            values = (raw - start).astype(np.float64) * scale
        else:
            values = values - first
    return np.asarray(values, dtype=float), origin, shown


def _stamps(raw: NDArray[Any], name: str, source: str) -> NDArray[Any]:
    """Texts or objects as numbers or time stamps; words without a digit, such as a repeated heading, are none."""
    texts = pd.Series(raw, dtype=object)
    texts = texts.where(texts.astype(str).str.contains(r"\d"))
    if texts.isna().all():
        raise faulty(source, name, 1, "has no time")
    found = numbers_of(texts.to_numpy(object))
    if np.isfinite(found.values).mean() > 0.9 * texts.notna().mean():
        if found.wrong is not None:
            row = found.wrong
            raise faulty(source, name, row + 1, f"{str(raw[row])!r} is not a number")
        return found.values
    words = texts.astype(str).str.replace(r",(\d+)", r".\1", regex=True)
    # minutes and seconds alone, as a spreadsheet shows them
    words = words.str.replace(r"^(\d{1,2}:\d{2}\.\d+)$", r"00:\1", regex=True)
    for options in ({"format": "ISO8601"}, {"format": "mixed", "dayfirst": True}):
        try:
            stamps = pd.to_datetime(words.where(texts.notna()), utc=True, **options)
            return stamps.dt.tz_localize(None).to_numpy()
        except (ValueError, TypeError, OverflowError):
            continue
    clock = pd.to_timedelta(words.where(texts.notna()), errors="coerce")
    if clock.notna().mean() > 0.9 * texts.notna().mean():
        return clock.to_numpy()
    row = int(np.flatnonzero(np.isnan(found.values) & texts.notna().to_numpy())[0])
    raise faulty(source, name, row + 1, f"{str(raw[row])!r} is no time")


def _of_single_precision(seconds: Floats) -> bool:
    return bool(np.array_equal(seconds, seconds.astype(np.float32)) and seconds.size > 2)


def _spread(seconds: Floats, period: float | None) -> tuple[Floats | None, str]:
    """Instants of rows of which many share a time stamp, and what was done; None, and why, where their period is unknown."""
    change = np.flatnonzero(np.diff(seconds)) + 1
    index = np.arange(seconds.size, dtype=float)
    if period is None and change.size >= FEWEST_STAMPS - 1:
        # the first and the last stamp are cut: only whole ones between tell the period
        rows = change[-1] - change[0]
        period = float((seconds[change[-1]] - seconds[change[0]]) / rows) if rows else None
    if period is None:
        text = f"{change.size + 1} different time stamps in {seconds.size} rows do not tell their period"
        return None, f"{text}; give period_s in a mapping file"
    told = period
    near = min(PERIODS, key=lambda p: abs(np.log(p / told)))
    if abs(near / period - 1.0) < 0.01:
        period = near
    text = f"{seconds.size} rows have {change.size + 1} different time stamps: spread evenly, {period:.6g} s apart"
    return index * period, text


def _evened(seconds: Floats) -> tuple[Floats, str]:
    """Rows whose instants are rounded, on even instants between gaps, where the rounding explains what differs."""
    if seconds.size < 3:
        return seconds, ""
    step = np.diff(seconds)
    rounding = float(np.spacing(np.float32(np.abs(seconds).max())))
    period = float((seconds[-1] - seconds[0]) / (seconds.size - 1))
    usual = float(np.median(step))
    if rounding < COARSE * usual:
        return seconds, ""
    even = seconds.copy()
    bounds = np.flatnonzero(step > 3.0 * max(usual, period) + rounding) + 1
    for begin, end in zip([0, *bounds.tolist()], [*bounds.tolist(), seconds.size], strict=True):
        own = seconds[begin:end]
        if own.size > 2:
            line = np.polynomial.Polynomial.fit(np.arange(own.size), own, 1)(np.arange(own.size))
            if np.abs(line - own).max() > 1.5 * rounding:
                return seconds, ""
            even[begin:end] = line
    return even, f"instants rounded to {rounding:.2g} s evened out"
