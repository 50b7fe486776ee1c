"""The registry of metrics, and what several of them need of a run.

"Under demand" means while the driver asks for traction or braking. All results are floats; nan where a metric does not
apply to the run (no coupler, target speed not reached).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.registry import Registry

SLIP_FACTOR = 2.0
"""An axle counts as slipping where its slip velocity exceeds this multiple of the curve's peak slip velocity."""


class Metric(NamedTuple):
    """A figure of merit."""

    name: str
    unit: str
    description: str
    function: Callable[[xr.Dataset], float]
    better: int = 0
    """-1: less is better, +1: more is better, 0: neither."""


METRICS: Registry[Metric] = Registry("metric", "readhesion.metrics", package="alloc.metrics")
"""Every metric by name."""


def metric(
    name: str, unit: str, description: str, better: int = 0
) -> Callable[[Callable[[xr.Dataset], float]], Callable[[xr.Dataset], float]]:
    """Decorator that registers a function of a run as a metric: name, unit, meaning, and which way is better."""

    def register(function: Callable[[xr.Dataset], float]) -> Callable[[xr.Dataset], float]:
        made = Metric(name, unit, description, function, better)
        METRICS.register(name, made, function.__module__)
        return function

    return register


def evaluate(run: xr.Dataset) -> dict[str, float]:
    """All metrics of a run, by name."""
    return {name: float(metric.function(run)) for name, metric in METRICS.items()}


def under_demand(run: xr.Dataset) -> NDArray[np.bool_]:
    """Whether the driver asks for effort, (time,)."""
    return np.asarray(run["driver_command"].values != 0.0)


def direction(run: xr.Dataset) -> NDArray[np.float64]:
    """Sign of what the driver asks for, (time,)."""
    return np.sign(run["driver_command"].values)


def acting_axles(run: xr.Dataset) -> NDArray[np.bool_]:
    """Axles that pull or brake, (time, axle): the driven ones, and every axle while the train brakes with air too."""
    driven = run["axle_unit"].values >= 0
    all_brake = (direction(run) < 0.0) & bool(run.attrs["blended_brakes"])
    return np.asarray(driven[None, :] | all_brake[:, None])


def adhesion_used(run: xr.Dataset, counted: NDArray[np.bool_]) -> float:
    """Rail force over available force where `counted` (time, axle)."""
    used = (direction(run)[:, None] * run["rail_force"].values)[counted].sum()
    available = (run["adhesion_limit"].values * run["axle_load"].values)[counted].sum()
    return float(used / available) if available else float("nan")


def mean_or_nan(values: NDArray[np.float64]) -> float:
    """Mean; nan of nothing."""
    return float(values.mean()) if values.size else float("nan")


def record_period(run: xr.Dataset) -> float:
    """Time between two recorded instants [s]."""
    time = run["time"].values
    return float((time[-1] - time[0]) / (time.size - 1)) if time.size > 1 else float("nan")
