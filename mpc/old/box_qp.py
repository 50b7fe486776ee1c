"""A convex quadratic program within bounds, compiled and without allocation: minimise x.H x / 2 + g.x, lower <= x <= upper.

Newton's steps on the free variables, projected on the bounds (Bertsekas: Projected Newton methods for optimization problems
with simple constraints, SIAM J. Control and Optimization 20 (1982) 221-246). Where the projection spoils a step, the step
ends at the first bound that it meets, and variables at bounds are held until the minimum of the free variables is reached.
This is a primal active set method (Nocedal, Wright: Numerical optimization, 2nd ed., algorithm 16.3), which ends after
finitely many steps.
"""

from typing import NamedTuple

import numpy as np
from numba import boolean, float64, int64, void

from alloc.old.plant.model import Floats, Ints
from alloc.old.plant.operations import WIDTH, load, spread, total
from alloc.old.records import ByReference
from mpc.old.arrays import MATRIX, VECTOR, sweep

TOLERANCE = 1e-12
"""Residual at which a point is accepted as the solution, see `solve_box_qp`."""

ACCEPTED = 1e-10
"""Residual that is good enough where rounding leaves no smaller one."""

PROJECTED = 50
"""Most projected steps; from then on steps end at the first bound they meet."""

PER_VARIABLE = 4
"""Further steps for each variable; more means that it fails."""

SUFFICIENT = 0.1
"""Share of the first-order decrease that a projected step must reach (Armijo's rule)."""

LEAST_PIVOT = 1e-14
"""Least pivot of the factorisation over the Hessian's norm and number of rows: what is singular counts as nearly so."""


class BoxWorkspace(NamedTuple):
    """What `solve_box_qp` works in; of n variables."""

    slope: Floats
    """Gradient at the point, (n,)."""
    direction: Floats
    """Newton's step of the free variables, in their order, (n,)."""
    move: Floats
    """Step of all variables, (n,)."""
    factor: Floats
    """Cholesky factor of the free variables' Hessian, (n, n)."""
    free: Ints
    """Numbers of the free variables, (n,)."""
    held: Ints
    """Whether a variable is held at its bound, (n,)."""


def box_workspace(size: int) -> BoxWorkspace:
    """Workspace for `size` variables."""
    return BoxWorkspace(
        slope=np.zeros(size),
        direction=np.zeros(size),
        move=np.zeros(size),
        factor=np.zeros((size, size)),
        free=np.zeros(size, dtype=np.int64),
        held=np.zeros(size, dtype=np.int64),
    )


WORKSPACE = ByReference(box_workspace(0)).kind


@sweep(float64(VECTOR, VECTOR, int64))
def dot(a, b, size):
    """Sum of the products of the first `size` entries."""
    whole, result = size - size % WIDTH, 0.0
    if whole > 0:
        sums = spread(0.0)
        for k in range(0, whole, WIDTH):
            sums = sums + load(a, k) * load(b, k)
        result = total(sums)
    for k in range(whole, size):
        result += a[k] * b[k]
    return result


@sweep(void(MATRIX, int64, float64, WORKSPACE))
def factorise(hessian, number, least, work):
    """Cholesky factor of the rows and columns `work.free` [: number]; pivots below `least` are raised to it."""
    factor, free = work.factor, work.free
    for b in range(number):
        pivot = hessian[free[b], free[b]] - dot(factor[b], factor[b], b)
        # below a pivot of zero stands nothing but rounding, which must not grow
        singular = pivot <= least
        root = np.sqrt(max(pivot, least))
        factor[b, b] = root
        for a in range(b + 1, number):
            rest = 0.0 if singular else hessian[free[a], free[b]] - dot(factor[a], factor[b], b)
            factor[a, b] = rest / root


@sweep(void(int64, WORKSPACE))
def newton_step(number, work):
    """Fill `work.direction` [: number] with the step to the minimum of the free variables, the others held."""
    factor, direction = work.factor, work.direction
    for a in range(number):
        rest = -work.slope[work.free[a]] - dot(factor[a], direction, a)
        direction[a] = rest / factor[a, a]
    for a in range(number - 1, -1, -1):
        direction[a] /= factor[a, a]
        for b in range(a):
            direction[b] -= factor[a, b] * direction[a]


@sweep(boolean(MATRIX, VECTOR, VECTOR, VECTOR, int64, WORKSPACE))
def projected_step(hessian, lower, upper, x, number, work):
    """Take the whole step, projected on the bounds, if it lowers the cost enough; False if it does not."""
    move, clipped = work.move, False
    for i in range(x.size):
        move[i] = 0.0
    for a in range(number):
        i = work.free[a]
        end = x[i] + work.direction[a]
        move[i] = min(max(end, lower[i]), upper[i]) - x[i]
        clipped = clipped or end < lower[i] or end > upper[i]
    if clipped:
        first, second = dot(work.slope, move, x.size), 0.0
        for i in range(x.size):
            if move[i] != 0.0:
                second += move[i] * dot(hessian[i], move, x.size)
        if not (first < 0.0 and first + 0.5 * second <= SUFFICIENT * first):
            return False
    for a in range(number):
        i = work.free[a]
        x[i] = min(max(x[i] + work.direction[a], lower[i]), upper[i])
    return True


@sweep(boolean(VECTOR, VECTOR, VECTOR, int64, WORKSPACE))
def step_to_a_bound(lower, upper, x, number, work):
    """Go along the step until the first bound, and hold the variables there; False if the whole step meets none."""
    length, met = 1.0, False
    for a in range(number):
        i, d = work.free[a], work.direction[a]
        room = upper[i] - x[i] if d > 0.0 else lower[i] - x[i]
        if abs(d) * length > abs(room):
            length, met = room / d, True
    for a in range(number):
        i, d = work.free[a], work.direction[a]
        room = upper[i] - x[i] if d > 0.0 else lower[i] - x[i]
        if met and abs(d) * length >= abs(room):
            x[i] = upper[i] if d > 0.0 else lower[i]
            work.held[i] = 1
        else:
            x[i] = min(max(x[i] + length * d, lower[i]), upper[i])
    return met


@sweep(int64(MATRIX, VECTOR, VECTOR, VECTOR, VECTOR, WORKSPACE))
def solve_box_qp(hessian, gradient, lower, upper, x, work):
    """Solve, starting at `x`, whose bounds are the first guess of the active ones; returns the number of steps, or -1.

    The residual is the largest violation of the conditions of optimality: a slope that is not zero, or at a bound points
    inwards, over the size of the terms that make it up. -1: it stays above `ACCEPTED`, or a value is not a number; `x` is
    then useless. The Hessian is symmetric and positive semidefinite, and lower <= upper; a variable without bounds needs
    curvature.
    """
    n = gradient.size
    norm, steepest = 0.0, 0.0
    for i in range(n):
        row = 0.0
        for j in range(n):
            row += abs(hessian[i, j])
        norm, steepest = max(norm, row), max(steepest, abs(gradient[i]))
        x[i] = min(max(x[i], lower[i]), upper[i])
        if not (row < np.inf and abs(gradient[i]) < np.inf and lower[i] <= upper[i]):
            return -1
    least = LEAST_PIVOT * n * norm if norm > 0.0 else 1.0
    releases = True
    for step in range(PROJECTED + PER_VARIABLE * n + 1):
        number, violation, farthest = 0, 0.0, 0.0
        for i in range(n):
            slope = gradient[i] + dot(hessian[i], x, n)
            work.slope[i] = slope
            farthest = max(farthest, abs(x[i]))
            outwards = (x[i] <= lower[i] and slope >= 0.0) or (x[i] >= upper[i] and slope <= 0.0)
            if not abs(slope) < np.inf:
                return -1
            if not (outwards or lower[i] == upper[i]):
                violation = max(violation, abs(slope))
            if releases:
                work.held[i] = outwards or lower[i] == upper[i]
            if not work.held[i]:
                work.free[number] = i
                number += 1
        size = steepest + norm * farthest
        if violation <= TOLERANCE * size:
            return step
        factorise(hessian, number, least, work)
        newton_step(number, work)
        projects = step < PROJECTED and releases
        if projects and projected_step(hessian, lower, upper, x, number, work):
            continue
        releases = not step_to_a_bound(lower, upper, x, number, work)
    return PROJECTED + PER_VARIABLE * n if violation <= ACCEPTED * size else -1
