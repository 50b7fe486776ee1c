"""Files of measuring systems, read by their libraries: parquet, MDF 3 and 4 (asammdf), TDMS (npTDMS)."""

from importlib import import_module
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from studies.files.study_error import StudyError
from studies.logs.csv_table import COMPRESSED, TEXT, is_text, of_arrow, read_text_table
from studies.logs.raw_channels import RawChannel, Recording

MDF, TDMS, PARQUET = (".mf4", ".mdf", ".dat4"), (".tdms",), (".parquet", ".pq")
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
    try:
        table = parquet.read_table(path)
    except pa.ArrowException as error:
        reason = " ".join(str(error).split())
        raise StudyError(f"log {str(path)!r} is no table of parquet: {reason}") from None
    units = {}
    for one in table.schema:
        stated = (one.metadata or {}).get(b"unit") or (one.metadata or {}).get(b"units")
        if stated:
            units[one.name] = stated.decode("utf-8", "ignore")
    return of_arrow(table, str(path), units, [])


def _mdf(path: Path) -> Recording:
    library = _library("asammdf", "asammdf", path)
    channels: dict[str, RawChannel] = {}
    with library.MDF(path) as file:
        for signal in file.iter_channels(skip_master=True):
            if signal.samples.ndim == 1 and signal.samples.dtype.kind in "iufb":
                add(
                    channels, signal.name, str(signal.unit or ""), signal.samples, signal.timestamps
                )
    return Recording(str(path), channels)


def _tdms(path: Path) -> Recording:
    library = _library("nptdms", "npTDMS", path)
    channels: dict[str, RawChannel] = {}
    file = library.TdmsFile.read(path)
    for group in file.groups():
        for one in group.channels():
            values = one[:]
            if not len(values):
                continue
            unit = str(one.properties.get("unit_string") or one.properties.get("unit") or "")
            clock = None
            if "wf_increment" in one.properties and float(one.properties["wf_increment"]) > 0.0:
                clock = np.asarray(one.time_track(), dtype=float)
            add(channels, one.name, unit, np.asarray(values), clock)
    return Recording(str(path), channels)


def add(channels: dict[str, RawChannel], name: str, unit: str, values: Any, clock: Any) -> None:
    """Add a channel; one of a name that is there already gets a number."""
    free = name
    k = 2
    while free in channels:
        free, k = f"{name} ({k})", k + 1
    own = None if clock is None else np.asarray(clock, dtype=float)
    channels[free] = RawChannel(free, unit, lambda: np.asarray(values), own)
