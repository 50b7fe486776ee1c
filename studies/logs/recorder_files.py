"""Files of measuring systems, read by their libraries: parquet, MDF 3 and 4 (asammdf), TDMS (npTDMS)."""

from collections import Counter
from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any, NamedTuple

import numpy as np
import pyarrow as pa
import pyarrow.compute as pc
from pyarrow import parquet

from studies.files.limits import check_parquet, check_values
from studies.files.study_error import StudyError
from studies.logs.csv_table import COMPRESSED, TEXT, TEXT_VALUE, is_text, of_arrow, read_text_table
from studies.logs.raw_channels import RawChannel, Recording

MDF, TDMS, PARQUET = (".mf4", ".mdf", ".dat4"), (".tdms",), (".parquet", ".pq")
TEXTS = (pa.types.is_string, pa.types.is_large_string, pa.types.is_binary, pa.types.is_large_binary)
"""Kinds of columns that parquet may keep as numbers of a list of texts."""
ENDINGS = (*TEXT, *PARQUET, *MDF, *TDMS)


def read_recording(path: Path) -> Recording:
    """Read a file of a log; raises `StudyError` naming the file where it cannot be read, and the package that is missing."""
    text, ending = f"log {str(path)!r}", path.suffix.lower()
    if not (is_text(path) or ending in ENDINGS):
        known = ", ".join(sorted(ENDINGS))
        raise StudyError(
            f"{text}: ending {ending!r} must be .csv or .parquet, or one of {known}; text may be compressed "
            f"({', '.join(COMPRESSED)})"
        )
    if not path.is_file():
        raise StudyError(f"{text} does not exist")
    if is_text(path):
        return read_text_table(path)
    try:
        if ending in PARQUET:
            return _parquet(path)
        return _mdf(path) if ending in MDF else _tdms(path)
    except StudyError:
        raise
    except OSError as error:
        raise StudyError(f"{text} cannot be read: {error.strerror or error}") from None
    except Exception as error:  # libraries of formats raise what they like
        reason = " ".join(str(error).split()) or type(error).__name__
        raise StudyError(f"{text} is no file of {ending[1:]}: {reason}") from None


def _library(name: str, package: str, path: Path) -> ModuleType:
    """A library of the extra `logs`; raises `StudyError` where it is not installed."""
    try:
        return import_module(name)
    except ImportError:
        raise StudyError(
            f"log {str(path)!r}: reading {path.suffix} needs the package {package}; install it with "
            "`pip install 'readhesion[logs]'`"
        ) from None


def _parquet(path: Path) -> Recording:
    owner = f"log {str(path)!r}"
    try:
        schema = parquet.read_schema(path)
        nested = [one.name for one in schema if pa.types.is_nested(one.type)]
        plain = [name for name in schema.names if name not in nested]
        texts = [one.name for one in schema if _is_text(one.type)]
        # texts that repeat are held once until it is known how much they are written out
        with parquet.ParquetFile(path, read_dictionary=texts) as file:
            check_parquet(owner, file.metadata)
            table = file.read(plain)
        check_values(owner, sum(map(_weight, table.columns)))
    except pa.ArrowException as error:
        reason = " ".join(str(error).split())
        raise StudyError(f"{owner} is no table of parquet: {reason}") from None
    notes = [f"columns of lists left out: {', '.join(nested)}"] if nested else []
    units = {}
    for one in table.schema:
        if pa.types.is_temporal(one.type):
            units[one.name] = "s"  # an index of instants may have any name
        stated = (one.metadata or {}).get(b"unit") or (one.metadata or {}).get(b"units")
        if stated:
            units[one.name] = stated.decode("utf-8", "ignore")
    return of_arrow(table, str(path), units, notes)


def _is_text(kind: Any) -> bool:
    kind = kind.value_type if pa.types.is_dictionary(kind) else kind
    return any(one(kind) for one in TEXTS)


def _weight(column: Any) -> int:
    """Values of a column, each text as the numbers that take as much memory when it is written out."""
    if pa.types.is_dictionary(column.type) and _is_text(column.type):
        lengths = [pc.max(pc.binary_length(one.dictionary)).as_py() or 0 for one in column.chunks]
        return len(column) * (TEXT_VALUE + max(lengths, default=0) // 8)
    return len(column) * (1 if pa.types.is_primitive(column.type) else TEXT_VALUE)


class _Channel(NamedTuple):
    """A channel of a file with groups."""

    group: str
    name: str
    unit: str
    values: Any
    clock: Any
    start: Any = None
    """Instant from which `clock` counts; None: that of the file."""


def _mdf(path: Path) -> Recording:
    library = _library("asammdf", "asammdf", path)
    found = []
    with library.MDF(path) as file:
        groups = [one.channel_group for one in file.groups]
        sizes = zip(groups, file.groups, strict=True)
        check_values(
            f"log {str(path)!r}",
            sum(
                one.cycles_nr * max(one.samples_byte_nr // 8, len(of.channels)) for one, of in sizes
            ),
        )
        for signal in file.iter_channels(skip_master=True):
            if signal.samples.ndim == 1 and signal.samples.dtype.kind in "iufb":
                group = file.groups[signal.group_index].channel_group
                name = str(getattr(group, "acq_name", "") or f"group {signal.group_index + 1}")
                unit = str(signal.unit or "")
                found.append(_Channel(name, signal.name, unit, signal.samples, signal.timestamps))
    return _recording(path, found)


def _tdms(path: Path) -> Recording:
    library = _library("nptdms", "npTDMS", path)
    found = []
    with library.TdmsFile.open(path) as told:
        every = [one for group in told.groups() for one in group.channels()]
        check_values(f"log {str(path)!r}", sum(map(len, every)))
    file = library.TdmsFile.read(path)
    for group in file.groups():
        for one in group.channels():
            values = one[:]
            if not len(values):
                continue
            told = one.properties
            unit = str(told.get("unit_string") or told.get("unit") or "")
            clock = None
            if float(told.get("wf_increment") or 0.0) > 0.0:
                clock = np.asarray(one.time_track(), dtype=float)
            found.append(
                _Channel(
                    group.name, one.name, unit, np.asarray(values), clock, told.get("wf_start_time")
                )
            )
    return _recording(path, found)


def _recording(path: Path, found: list[_Channel]) -> Recording:
    """Channels of groups, on one clock: a name of several groups gets that of its group before it."""
    starts = [np.datetime64(one.start) for one in found if one.start is not None]
    same_start = len(starts) < len(found) or len(set(starts)) < 2
    notes = []
    if starts and len(starts) < len(found) and len(set(starts)) > 1:
        notes.append(
            "some channels state when they begin, others do not: all are taken to begin together"
        )
    times = Counter(one.name for one in found)
    channels: dict[str, RawChannel] = {}
    for one in found:
        clock = None if one.clock is None else np.asarray(one.clock, dtype=float)
        if clock is not None and not same_start:
            clock = clock + (np.datetime64(one.start) - min(starts)) / np.timedelta64(1, "s")
        name = one.name if times[one.name] == 1 else f"{one.group} {one.name}"
        free, k = name, 2
        while free in channels:
            free, k = f"{name} ({k})", k + 1
        channels[free] = RawChannel(free, one.unit, lambda v=one.values: np.asarray(v), clock)  # type: ignore[misc]
    return Recording(str(path), channels, notes)
