"""What sliding wheels cost under brakes: locked wheels, and compressed air."""

import numpy as np
import xarray as xr

from alloc.metrics.registry import NEVER_NEGATIVE, metric, record_period, series

LOCK_SPEED = 5.0 / 3.6
"""Train speed [m/s] above which a standing wheel counts as locked; slide protection is inactive below it."""

STANDING_SPEED = 0.1
"""Rim speed [m/s] below which a wheel counts as standing."""

ATMOSPHERE = 101325.0
"""Pressure [Pa] of a normal litre."""


@metric(
    "locked_time", "s", "time that wheels stood above 5 km/h, summed over axles", -1, NEVER_NEGATIVE
)
def locked_time(run: xr.Dataset) -> float:
    """Axle-seconds in which a wheel stands while its train runs faster than `LOCK_SPEED`."""
    standing = np.abs(series(run, "rim_speed")) < STANDING_SPEED
    running = np.abs(series(run, "speed")) > LOCK_SPEED
    return float((standing & running[:, None]).sum() * record_period(run))


@metric(
    "air_consumption",
    "l",
    "air let into the brake cylinders, at atmospheric pressure",
    -1,
    NEVER_NEGATIVE,
)
def air_consumption(run: xr.Dataset) -> float:
    """Volume of the brake cylinders times all rises of their pressure over that of the atmosphere [normal litres].

    Isothermal; the first application of the brakes counts too. nan for a train without air brakes.
    """
    pressure = series(run, "cylinder_pressure")
    if pressure.shape[1] == 0:
        return float("nan")
    rises = np.maximum(np.diff(pressure, axis=0), 0.0).sum(axis=0)
    return float(1e3 * (series(run, "group_volume") * rises).sum() / ATMOSPHERE)
