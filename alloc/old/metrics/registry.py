"""The registry of metrics, and what several of them need of a run.

"Under demand" means while the driver asks for traction or braking. All results are floats; nan where a metric does not
apply to the run (no coupler, target speed not reached).
"""

import math
import threading
from collections.abc import Callable
from functools import wraps
from typing import Any, NamedTuple, TypeVar, cast

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.old.balance import ROUNDING
from alloc.old.display import displayed
from alloc.old.errors import UnsoundRun
from alloc.old.registry import Registry

Found = TypeVar("Found")

SLIP_FACTOR = 2.0
"""An axle counts as slipping where its slip velocity exceeds this multiple of the curve's peak slip velocity."""


UNLIMITED = (-math.inf, math.inf)
"""Range of a quantity without bounds."""
NEVER_NEGATIVE = (0.0, math.inf)
SHARE = (0.0, 1.0)
EITHER_WAY = (-1.0, 1.0)
"""Range of a force over the largest possible force; the force may point the other way."""


@displayed
class Metric(NamedTuple):
    """A figure of merit."""

    name: str
    unit: str
    description: str
    function: Callable[[xr.Dataset], float]
    better: int = 0
    """-1: less is better, +1: more is better, 0: neither."""
    within: tuple[float, float] = UNLIMITED
    """Smallest and largest value that the metric can have; intervals of its mean end there."""


METRICS: Registry[Metric] = Registry("metric", "readhesion.metrics", package="alloc.old.metrics")
"""Every metric by name."""


def metric(
    name: str,
    unit: str,
    description: str,
    better: int = 0,
    within: tuple[float, float] = UNLIMITED,
) -> Callable[[Callable[[xr.Dataset], float]], Callable[[xr.Dataset], float]]:
    """Decorator that registers a function of a run as a metric: name, unit, meaning, which way is better, and its range."""

    def register(function: Callable[[xr.Dataset], float]) -> Callable[[xr.Dataset], float]:
        made = Metric(name, unit, description, function, better, within)
        METRICS.register(name, made, function.__module__)
        return function

    return register


class _Known(threading.local):
    """What `series` and functions with `once_per_run` found of the run that this thread evaluates, if it does one."""

    def __init__(self) -> None:
        self.run: xr.Dataset | None = None
        self.found: dict[Any, Any] = {}


_KNOWN = _Known()


def evaluate(run: xr.Dataset) -> dict[str, float]:
    """All metrics of a run, by name; raises `UnsoundRun` where one is outside the range that it declares."""
    _KNOWN.run, _KNOWN.found = run, {}
    try:
        values = {name: float(metric.function(run)) for name, metric in METRICS.items()}
    finally:
        _KNOWN.run, _KNOWN.found = None, {}
    for name, value in values.items():
        least, most = METRICS[name].within
        if value < least - ROUNDING or value > most + ROUNDING or math.isinf(value):
            raise UnsoundRun(
                f"metric {name!r} = {value:g} is outside its range, {least:g} to {most:g}"
            )
    return values


def once_per_run(function: Callable[[xr.Dataset], Found]) -> Callable[[xr.Dataset], Found]:
    """Decorator of a quantity that several metrics need: `evaluate` computes it once per run. Do not change the result."""

    @wraps(function)
    def find(run: xr.Dataset) -> Found:
        if _KNOWN.run is not run:
            return function(run)
        if function not in _KNOWN.found:
            _KNOWN.found[function] = function(run)
        return cast(Found, _KNOWN.found[function])

    return find


def series(run: xr.Dataset, name: str) -> NDArray[Any]:
    """Recorded values of a variable; `run[name].values` is the same, but takes twenty times as long to look up."""
    if _KNOWN.run is not run:
        return np.asarray(run.variables[name].values)
    if name not in _KNOWN.found:
        _KNOWN.found[name] = np.asarray(run.variables[name].values)
    return cast(NDArray[Any], _KNOWN.found[name])


@once_per_run
def under_demand(run: xr.Dataset) -> NDArray[np.bool_]:
    """Whether the driver asks for effort, (time,)."""
    return np.asarray(series(run, "driver_command") != 0.0)


@once_per_run
def direction(run: xr.Dataset) -> NDArray[np.float64]:
    """Sign of what the driver asks for, (time,)."""
    return np.sign(series(run, "driver_command"))


@once_per_run
def acting_axles(run: xr.Dataset) -> NDArray[np.bool_]:
    """Axles that pull or brake, (time, axle): the driven ones, and every axle while the train brakes with air too."""
    driven = series(run, "axle_unit") >= 0
    all_brake = (direction(run) < 0.0) & bool(run.attrs["blended_brakes"])
    return np.asarray(driven[None, :] | all_brake[:, None])


@once_per_run
def force_along(run: xr.Dataset) -> NDArray[np.float64]:
    """Rail force in the direction of the demand [N], (time, axle)."""
    return np.asarray(direction(run)[:, None] * series(run, "rail_force"))


@once_per_run
def force_available(run: xr.Dataset) -> NDArray[np.float64]:
    """Largest rail force that the rail offers [N], (time, axle); at least the one that it carries.

    The recorded limit is that of a driving wheel. By Polach's law a braked one finds 0.2 % more.
    """
    offered = series(run, "adhesion_limit") * series(run, "axle_load")
    return np.maximum(offered, np.abs(series(run, "rail_force")), out=offered)


def adhesion_used(run: xr.Dataset, counted: NDArray[np.bool_]) -> float:
    """Rail force over available force where `counted` (time, axle)."""
    used = force_along(run)[counted].sum()
    available = force_available(run)[counted].sum()
    return float(used / available) if available else float("nan")


def mean_or_nan(values: NDArray[np.float64]) -> float:
    """Mean; nan if there are no values."""
    return float(values.mean()) if values.size else float("nan")


@once_per_run
def record_period(run: xr.Dataset) -> float:
    """Time between two recorded instants [s]; nan where there is one."""
    time = series(run, "time")
    return float((time[-1] - time[0]) / (time.size - 1)) if time.size > 1 else float("nan")


def instants_in(run: xr.Dataset, time: float) -> int:
    """Number of periods between recorded instants next to `time` [s]; a run of one instant is shorter than any time."""
    period = record_period(run)
    return 2 if math.isnan(period) else round(time / period)
