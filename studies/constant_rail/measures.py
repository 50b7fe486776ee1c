"""How much torque moves on a rail that does not change, with the swing that the search makes itself and without it."""

import numpy as np
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from alloc.metrics.registry import record_period
from mpc.settings import SlipSearch

SETTLED = 3.0
"""Length of the end of a run [s] in which torque should have settled."""
LIMITED = 0.999
"""Share of its target below which a unit is limited."""
Floats = NDArray[np.float64]


def measure(run: xr.Dataset) -> dict[str, float]:
    """Movement of the torque commands of the units that are limited to the end of a run; nan where none is.

    The first three are amplitudes over the mean torque, of the unit where they are greatest.

    - `swinging`: deviation from a parabola over time (root of twice the variance, a sine's amplitude).
    - `beside_swing`: residual after a parabola is fitted to each phase of the swing. It excludes the swing, its harmonics,
      and their slow changes.
    - `greatest_line`: greatest spectral line of that residual (Hann window).
    - `greatest_slip` [m/s]: of the whole run.
    - `limited_units`: number of units.
    """
    count = round(SETTLED / record_period(run))
    factor = np.abs(run["torque_factor"].values[-count:])
    command = np.abs(run["torque_command"].values[-count:])[:, (factor < LIMITED).all(axis=0)]
    slip = run["slip_velocity"].values[:, run["axle_unit"].values >= 0]
    result = {"greatest_slip": float(np.abs(slip).max()), "limited_units": float(command.shape[1])}
    names = ("swinging", "beside_swing", "greatest_line")
    if command.shape[1] == 0:
        return result | dict.fromkeys(names, np.nan)
    time = np.arange(count) * record_period(run)
    mean = command.mean(axis=0)
    # a command of 0 all the time moves nothing
    relative = command / np.where(mean > 0.0, mean, 1.0) - (mean > 0.0)
    about = _without(relative, _trend(time))
    beside = _beside_swing(relative, max(1, round(SlipSearch().swing_time / record_period(run))))
    values = (_amplitude(about), _amplitude(beside), _greatest_line(beside))
    return result | {name: float(one.max()) for name, one in zip(names, values, strict=True)}


def _trend(time: ArrayLike) -> Floats:
    """The course of the event: a parabola over time."""
    scaled = np.asarray(time, dtype=float)
    scaled = scaled / scaled[-1]
    return np.column_stack([np.ones_like(scaled), scaled, scaled**2])


def _beside_swing(values: Floats, ticks: int) -> Floats:
    """What a parabola over the periods of the swing, each of so many ticks, leaves of each phase.

    Enlarged by the degrees of freedom that it takes.
    """
    periods = values.shape[0] // ticks
    phases = values[: periods * ticks].reshape(periods, -1)
    base = _trend(np.arange(float(periods)))
    left = _without(phases, base).reshape(periods * ticks, -1)
    return left * np.sqrt(periods / (periods - base.shape[1]))


def _without(values: Floats, base: Floats) -> Floats:
    """What least squares with the columns of `base` leave of `values`."""
    left: Floats = values - base @ np.linalg.lstsq(base, values, rcond=None)[0]
    return left


def _amplitude(values: Floats) -> Floats:
    """Amplitude of a sine of the same variance, column by column."""
    found: Floats = np.sqrt(2.0 * (values**2).mean(axis=0))
    return found


def _greatest_line(values: Floats) -> Floats:
    """Amplitude of the greatest line of the spectrum, column by column."""
    window = np.hanning(values.shape[0])[:, None]
    found: Floats = 2.0 * np.abs(np.fft.rfft(values * window, axis=0)).max(axis=0) / window.sum()
    return found
