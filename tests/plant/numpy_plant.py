"""What the tests know of the plant beside its right side: its environment and RK4 with NumPy; the compiled rate."""

from collections.abc import Callable
from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.plant import engine as compiled
from alloc.plant.array_model import ArrayModel, Local
from alloc.plant.engine import derivative
from alloc.plant.laws import cleaned_degree, recovered_peak, speed_decline
from alloc.plant.model import Inputs, Model
from alloc.plant.operations import maximum, minimum, sine
from alloc.plant.rail import (
    Patches,
    patch_factor,
    peak_coefficient,
    sanded_peak,
    scatter_knot,
    window,
)
from alloc.plant.train import EFFORT_SPEED_STEP
from tests.compiled_part import from_python


def _table(table: NDArray[np.float64], x: NDArray[np.float64]) -> NDArray[np.float64]:
    """Linear interpolation at `x` (rows,), in grid units, in `table` (points,) or in one per row, (rows, points)."""
    rows, points = np.arange(len(table) if table.ndim == 2 else 1), table.shape[-1]
    bounded = np.clip(x, 0.0, points - 1.000001)
    k = bounded.astype(np.int64)
    flat, place = table.ravel(), points * rows + k
    low, high = (np.take_along_axis(flat, place + one, 0) for one in (0, 1))
    return low + (high - low) * (bounded - k)


def environment_at(
    model: Model,
    time: float,
    state: NDArray[np.float64],
    cleaning: NDArray[np.float64] | None = None,
    arrays: ArrayModel | None = None,
    sand: NDArray[np.float64] | None = None,
) -> Local:
    """The true environment of `state` (rows,) at `time` [s].

    `cleaning` (axles,) is what the wheels ahead left, `sand` (axles,) [kg/m] what lies there, none if None. `arrays`: the
    array form of `model` where it exists already.
    """
    s, n, e = model.structure, model.layout, model.environment
    arrays = arrays or ArrayModel.of(model)
    position = state[n.position][s.axle_body] + s.axle_offset
    speed = state[n.speed][s.axle_body]
    patches = np.ones_like(position)
    for p in map(Patches._make, zip(*e.patch, strict=True)):
        weight = window(position, p.start, p.end, p.edge)
        patches = patches * patch_factor(weight, window(time, p.begin, p.until, p.fade), p.factor)
    scatter = _table(e.noise, scatter_knot(position, e.noise_length))
    conditioning = 0.0 if cleaning is None else e.conditioning * cleaning
    decline = speed_decline(speed, e.law[1])
    peak = peak_coefficient(
        decline, e.law[0], e.law[2], patches, e.increment, scatter, conditioning
    )
    if sand is not None:
        peak = sanded_peak(peak, sand, e.sanded, e.sand_saturation)
    if n.recoveries:
        under = 0.0 if cleaning is None else cleaning
        peak = recovered_peak(peak, cleaned_degree(state[n.recovery], under), e.recovered)
    place = (state[n.position][s.car_body] + s.car_offset - e.line_origin) / e.line_spacing
    rim = arrays.unit_of_axle.T @ (s.radius * arrays.rotor_speeds(state)) / s.unit_axles
    rim = np.abs(rim) / EFFORT_SPEED_STEP
    wave = sine(2.0 * np.pi * time / e.receptivity[2] + e.receptivity[3])
    receptivity = minimum(maximum(e.receptivity[0] + e.receptivity[1] * wave, 0.0), 1.0)
    return Local(
        peak=peak,
        grade=_table(e.line[0], place),
        air_factor=_table(e.line[1], place),
        drive_limit=_table(s.drive_table, rim),
        brake_limit=_table(s.brake_table, rim) * receptivity,
        health=(time < e.failure_time).astype(float),
        curving=_table(e.line[2], place),
    )


def right_side(model: Model, inputs: Inputs) -> Callable[..., Any]:
    """Derivative of a state (rows,) in its true environment, as a function of time [s] and state."""
    arrays = ArrayModel.of(model)

    def rate(time: Any, state: Any) -> Any:
        return arrays.derivative(state, inputs, environment_at(model, time, state, arrays=arrays))

    return rate


def runge_kutta_step(rate: Callable[..., Any], time: Any, step: float, state: Any) -> Any:
    """The state one step of the classical fourth-order method later."""
    a = rate(time, state)
    b = rate(time + 0.5 * step, state + 0.5 * step * a)
    c = rate(time + 0.5 * step, state + 0.5 * step * b)
    d = rate(time + step, state + step * c)
    return state + step / 6.0 * (a + 2.0 * b + 2.0 * c + d)


_pack, _unpack, _derivative = map(from_python, (compiled.pack, compiled.unpack, derivative))


def compiled_rate(model, state, inputs, time=0.0, cleaning=None, sand=None):
    """Derivative of `state` (rows,) at `time` [s], and the peak coefficient of every axle."""
    w = compiled.workspace(model, 1e-3)
    n, c = model.layout, w.scratch
    c.slope[:] = np.nan
    c.command[: n.units], c.target[: n.groups], c.valve[: n.groups], _ = inputs
    if cleaning is not None:
        c.cleaning.under[: n.axles] = cleaning
    if sand is not None:
        c.sand.under[: n.axles] = sand
    _pack(w, state, c.state)
    _derivative(w, time, c.state, c.slope)
    slope = np.empty_like(state)
    _unpack(w, c.slope, slope)
    return slope, c.peak[: n.axles].copy()
