"""A recorded run as a log, with the columns that a real train's recorder would have (`studies.logs.columns`)."""

from pathlib import Path

import numpy as np
import pandas as pd
import xarray as xr

from alloc.plant.train import Train
from alloc.sources import write_whole
from studies.files.study_error import StudyError
from studies.files.writable import LOG, as_csv, check_file
from studies.logs.columns import column_of
from studies.logs.known_train import MeasuredTrain
from studies.logs.measured_run import applied_force
from studies.logs.measured_train import write_log_train

DECIMALS = {"s": 4, "kmh": 3, "kn": 3, "ms2": 4}
"""Decimals of a CSV file by unit: a tenth of a millimetre per second, 1 N."""


def log_table(run: xr.Dataset, train: Train | MeasuredTrain, every: int = 1) -> pd.DataFrame:
    """The log of `run`, every so many of its records; `train` is the one that it was made with.

    Raises `EstimationError` if it is another.
    """
    columns = {
        "time_s": run["time"].values,
        "speed_kmh": 3.6 * run["speed"].values,
    }
    for i, values in enumerate(run["rim_speed"].values.T, 1):
        columns[column_of("axleN_speed", i, "kmh")] = 3.6 * values
    for i, values in enumerate(applied_force(run, train).T, 1):
        columns[column_of("axleN_force", i, "kn")] = 1e-3 * values
    if run.sizes.get("coupler", 0):
        for k, values in enumerate(run["coupler_force"].values.T, 1):
            columns[column_of("couplerK_force", k, "kn")] = 1e-3 * values
        for k, values in enumerate(run["car_acceleration"].values.T, 1):
            columns[column_of("carK_acceleration", k, "ms2")] = values
    return pd.DataFrame(columns).iloc[::every].reset_index(drop=True)


def rounded(table: pd.DataFrame) -> pd.DataFrame:
    """The log with the decimals of a CSV file."""
    return table.round({name: DECIMALS[str(name).rsplit("_", 1)[1]] for name in table})


def train_beside(path: Path) -> Path:
    """File of the train's data beside a log."""
    return path.with_suffix(".train.toml")


def write_log(run: xr.Dataset, train: Train, path: Path) -> Path:
    """Write a run as a log, and beside it the train's data as TOML; returns the latter's path.

    Raises `StudyError` if a file cannot be written.
    """
    check_file(path, LOG)
    table = log_table(run, train)
    beside = train_beside(path)
    try:
        if path.suffix.lower() == ".csv":
            text = as_csv(rounded(table).replace(-0.0, 0.0))
            write_whole(path, lambda aside: aside.write_text(text, "utf-8", newline=""))
        else:
            write_whole(path, lambda aside: table.astype(np.float64).to_parquet(aside, index=False))
        write_log_train(MeasuredTrain.of(train), beside)
    except OSError as error:
        raise StudyError(f"log {str(path)!r} cannot be written: {error.strerror}") from None
    return beside
