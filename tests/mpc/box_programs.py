"""Random quadratic programs within bounds, and how far a point is from optimal."""

import numpy as np


def violation(hessian, gradient, lower, upper, x):
    """Greatest slope that could be followed within the bounds, over the size of the terms that slopes consist of."""
    assert np.all((lower <= x) & (x <= upper))
    slope = hessian @ x + gradient
    followed = np.where(slope > 0.0, x > lower, x < upper)
    size = np.abs(gradient).max() + np.abs(hessian).sum(axis=1).max() * np.abs(x).max()
    return np.abs(slope * followed).max() / size if size else 0.0


def program(seed, kind, most=60):
    """A random convex program of up to `most` variables."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, most))
    rows = max(1, n // 2) if kind == "singular" else n
    root = rng.standard_normal((rows, n))
    if kind == "columns of other sizes":
        root *= 10.0 ** rng.uniform(-4.0, 4.0, n)
    if kind == "nearly singular":
        root *= 10.0 ** rng.uniform(-6.0, 0.0, (rows, 1))
    hessian = root.T @ root
    hessian = 0.5 * (hessian + hessian.T)
    if kind == "regular":
        hessian += np.eye(n)
    gradient = rng.standard_normal(n) * 10.0 ** rng.uniform(-3.0, 3.0)
    lower = -rng.uniform(0.0, 1.0, n)
    upper = lower + rng.uniform(0.0, 2.0, n)
    if kind == "equal bounds":
        upper[::3] = lower[::3]
    return hessian, gradient, lower, upper


KINDS = ["regular", "equal bounds", "columns of other sizes", "nearly singular", "singular"]
