"""State of the rail between steps: how far wheels have cleaned it, and the sand that lies on it.

Cells of the rail under the train form a ring. Each axle reads the state under it, and changes the cells that it has just
left behind; the foremost axle initialises those ahead of it. The right-hand side uses the values read at the start of a
step.
"""

import numpy as np

from alloc.compilation import inlined_jit
from alloc.plant.equations import conditioning_deposit, sand_laid


@inlined_jit
def _place_in_cells(w, i):
    """Where axle `i` stands, in lengths of the rail's cells."""
    axle, state = w.axle, w.scratch.state
    return (state[axle.position_row[i]] + axle.offset[i]) / w.rail.cleaning_spacing


@inlined_jit
def _read(w, remembered):
    """A quantity under each axle, between the axle's own cell and the next: both hold what the wheels ahead left."""
    left = remembered.left
    cells = left.size
    for i in range(w.size.axles):
        x = _place_in_cells(w, i)
        base = int(np.floor(x))
        k = base % cells
        here, ahead = left[k], left[k + 1 if k + 1 < cells else 0]
        remembered.under[i] = here + (ahead - here) * (x - base)


@inlined_jit
def _begin(left, first, now):
    """Clear the cells that the foremost axle comes near while it goes from cell `first` to `now`."""
    for k in range(first, now + 1):
        left[(k + 2) % left.size] = 0.0


@inlined_jit
def _clean(w, i, first, now):
    """Axle `i` cleans the cells from `first` to `now`, as far as those ahead have not done so."""
    axle, c = w.axle, w.scratch
    left = c.cleaning.left
    v = c.state[axle.speed_row[i]]
    rim = axle.radius[i] * c.state[w.row.omega + i]
    ratio = (rim - v) / max(max(abs(v), abs(rim)), 1e-3)
    deposit = conditioning_deposit(ratio, w.rail.conditioning_slip)
    for k in range(first, now):
        left[k % left.size] = max(left[k % left.size], deposit)


@inlined_jit
def _sand(w, i, first, now, rate):
    """Axle `i` leaves a part of the sand in the cells from `first` to `now`; its sander lays some just ahead of it."""
    left, s = w.scratch.sand.left, w.axle.sander[i]
    laid = 0.0
    if s >= 0:
        laid = sand_laid(rate[s], w.scratch.state[w.axle.speed_row[i]])
    for k in range(first, now):
        left[k % left.size] *= w.rail.sand_kept
        left[(k + 2) % left.size] += laid


@inlined_jit
def read_rail(w):
    """Fill in the state of the rail under each axle."""
    if w.rail.conditioned:
        _read(w, w.scratch.cleaning)
    if w.rail.sandy:
        _read(w, w.scratch.sand)


@inlined_jit
def leave_rail(w, sand_rate):
    """Each axle changes the cells that it has left behind since the last step; `sand_rate` (sanders,) [kg/s]."""
    c = w.scratch
    cells = max(c.cleaning.left.size, c.sand.left.size)
    for i in range(w.size.axles):
        now = int(np.floor(_place_in_cells(w, i)))
        if c.cell[i] < now - cells or c.cell[i] > now:
            c.cell[i] = now
        first = c.cell[i]
        if w.rail.conditioned:
            if i == 0:
                _begin(c.cleaning.left, first, now)
            _clean(w, i, first, now)
        if w.rail.sandy:
            if i == 0:
                _begin(c.sand.left, first, now)
            _sand(w, i, first, now, sand_rate)
        c.cell[i] = now
