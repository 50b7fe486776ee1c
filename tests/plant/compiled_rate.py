"""The compiled right side, called by itself."""

import numpy as np

from alloc.plant import engine as compiled
from alloc.plant.engine import derivative
from tests.compiled_part import from_python

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
