"""A recorded run as a log, with the columns that a real train's recorder would have (`studies.logs.mapping`)."""

from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr

from alloc.estimation.slip_events import SlipCriterion
from alloc.plant.train import Train
from alloc.recording import ATTRIBUTES, MATLAB, load
from alloc.sources import write_whole
from studies.files.limits import check_values
from studies.files.study_error import StudyError
from studies.files.writable import LOG, RUN, as_csv, check_file
from studies.logs.force_reports import BRAKING
from studies.logs.mapping import column_of
from studies.logs.measured_log import MeasuredLog, check_log, read_log
from studies.logs.measured_run import Findings, analyse_run, applied_force, train_acceleration
from studies.logs.recorder_files import ENDINGS, check_matlab, is_text
from studies.logs.train import MeasuredTrain, write_log_train

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
        elif path.suffix.lower() == MATLAB:
            from scipy.io import savemat

            columns = {str(name): values.to_numpy(float) for name, values in table.items()}
            write_whole(path, lambda aside: savemat(aside, columns, oned_as="column"))
        else:
            write_whole(path, lambda aside: table.astype(np.float64).to_parquet(aside, index=False))
        write_log_train(MeasuredTrain.of(train), beside)
    except OSError as error:
        raise StudyError(f"log {str(path)!r} cannot be written: {error.strerror}") from None
    return beside


RULE, CONTROLLER = "greedy", "cut-and-ramp"
"""Of a scenario that is simulated for a comparison."""
NEEDED = (
    "time",
    "speed",
    "rim_speed",
    "rail_force",
    "motor_torque",
    "brake_force",
    "axle_unit",
    "unit_gear",
)
"""Variables of a recorded run that make a log."""
ALIKE = 0.1
"""Difference of mass, as a share, up to which two trains count as the same."""
QUANTITIES = {
    "duration_s": "duration [s]", "first_speed_kmh": "first speed [km/h]", "last_speed_kmh": "last speed [km/h]",
    "braking_ms2": "mean deceleration, braking [m/s2]", "driving_ms2": "mean acceleration, driving [m/s2]",
    "slips": "slips", "slides": "slides", "slipping_s": "time in slips, all axles [s]",
    "onset_coefficient": "coefficient at onsets", "utilisation": "used of it in slips", "damage_kj": "Q [kJ]",
    "damage_error_kj": "standard deviation of Q [kJ]",
}  # fmt: skip


def simulated_log(name: str, train: MeasuredTrain) -> MeasuredLog:
    """The run to compare with: a log or a run that `readhesion simulate` wrote, or a scenario, simulated.

    Raises `StudyError` where the run is of another train.
    """
    path = Path(name)
    if path.suffix.lower() in RUN and not _is_log(path):
        run = recorded_run(path)
        _check_train(
            name, train, str(run.attrs["train"]), run.sizes["axle"], run.attrs["train_mass"]
        )
        return check_log(log_table(run, train), train, name)
    if path.suffix.lower() in ENDINGS or is_text(path):
        return read_log(path, train)
    from studies.core.job import Job, simulate_job
    from studies.scenario.scenario import load_scenario

    scenario = load_scenario(name)
    own = scenario.event(0).model.train
    other = MeasuredTrain.of(own)
    _check_train(name, train, other.name, other.radius.size, float(other.car_mass.sum()))
    run = simulate_job(Job(scenario, RULE, CONTROLLER, 0))
    return check_log(log_table(run, own), other, name)


def recorded_run(path: Path) -> xr.Dataset:
    """A run that `readhesion simulate --out` or `run-line --out` wrote; raises `StudyError` where it is none."""
    import netCDF4

    owner, kind = f"run {str(path)!r}", "netCDF"
    if not path.is_file():
        raise StudyError(f"{owner} does not exist")
    try:
        if path.suffix.lower() == MATLAB:
            kind = "MATLAB"
            check_matlab(path, owner)
        else:
            with netCDF4.Dataset(path) as file:  # what reads runs would begin with all instants
                check_values(owner, sum(one.size for one in file.variables.values()))
        run = load(path)
    except StudyError:
        raise
    except (OSError, ValueError, KeyError) as error:
        raise StudyError(f"{owner} is no file of {kind}: {error}") from None
    missing = [one for one in NEEDED if one not in run] or [
        one for one in ("train", "train_mass") if one not in run.attrs
    ]
    if missing:
        raise StudyError(
            f"run {str(path)!r} has no {missing[0]!r}; give a run that `readhesion simulate --out` wrote"
        )
    return run


def _is_log(path: Path) -> bool:
    """Whether a file of MATLAB is a log: it has no attributes of a run."""
    if path.suffix.lower() != MATLAB or not path.is_file():
        return False
    from scipy.io import whosmat

    try:
        return ATTRIBUTES not in {name for name, *_ in whosmat(path)}
    except (OSError, ValueError, NotImplementedError):  # as of version 7.3, which logs may have
        return True


def _check_train(name: str, train: MeasuredTrain, other: str, axles: int, mass: float) -> None:
    own = float(train.car_mass.sum())
    if train.radius.size == axles and abs(mass - own) <= ALIKE * own:
        return
    raise StudyError(
        f"--against {name}: its train {other!r} has {axles} axles, {1e-3 * mass:.1f} t, that of the log "
        f"{train.radius.size} axles, {1e-3 * own:.1f} t; give a run of the same train"
    )


def compared(
    log: MeasuredLog, found: Findings, other: MeasuredLog, criterion: SlipCriterion
) -> dict[str, Any]:
    """Figures of a log and of a simulated run, by name, for JSON."""
    mine, theirs = (
        figures(log, found),
        figures(other, analyse_run(other.run, other.train, criterion)),
    )
    error = np.hypot(mine["damage_error_kj"] or 0.0, theirs["damage_error_kj"] or 0.0)
    apart = None
    if mine["damage_kj"] is not None and theirs["damage_kj"] is not None:
        apart = abs(mine["damage_kj"] - theirs["damage_kj"])
    return {
        "run": other.source,
        "log": mine,
        "simulated": theirs,
        "damage_differs": None if apart is None else bool(apart > 2.0 * error),
    }


def figures(log: MeasuredLog, found: Findings) -> dict[str, float | None]:
    """What a log comes to, `QUANTITIES` by name; None for what is not known."""
    run = log.run
    known = np.flatnonzero(np.isfinite(run.speed))
    rate = train_acceleration(run, 1.0)
    onsets = np.array([e.onset_coefficient for e in found.events])
    onsets = onsets[np.isfinite(onsets)]
    values = {
        "duration_s": float(run.time[-1] - run.time[0]),
        "first_speed_kmh": 3.6 * float(run.speed[known[0]]),
        "last_speed_kmh": 3.6 * float(run.speed[known[-1]]),
        "braking_ms2": _mean(-rate[rate < -BRAKING]),
        "driving_ms2": _mean(rate[rate > BRAKING]),
        "slips": float(sum(e.kind == "slip" for e in found.events)),
        "slides": float(sum(e.kind == "slide" for e in found.events)),
        "slipping_s": float(found.slipping_time.sum()),
        "onset_coefficient": _mean(onsets),
        "utilisation": found.utilisation,
        "damage_kj": 1e-3 * found.total_damage if found.covered.any() else float("nan"),
        "damage_error_kj": float("nan") if found.errors is None else 1e-3 * found.errors.total,
    }
    return {name: value if np.isfinite(value) else None for name, value in values.items()}


def _mean(values: Any) -> float:
    return float(np.mean(values)) if len(values) else float("nan")
