"""Series of measured values: their shape checked, mean rates, and the stretches in which a condition is true."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.errors import EstimationError

Floats = NDArray[np.float64]


def finite_series(name: str, values: ArrayLike, *shapes: tuple[int | None, ...]) -> Floats:
    """`values` as an array of one of these shapes (None: any length); raises `EstimationError` naming `name`."""
    array = np.asarray(values, dtype=float)
    fits = any(
        len(shape) == array.ndim
        and all(want in (None, have) for want, have in zip(shape, array.shape, strict=True))
        for shape in shapes
    )
    if not fits:
        wanted = " or ".join(str(shape).replace("None", "any") for shape in shapes)
        raise EstimationError(f"{name} has shape {array.shape}; it needs {wanted}")
    if array.size == 0:
        raise EstimationError(f"{name} is empty")
    if not np.all(np.isfinite(array)):
        first = tuple(int(k) for k in np.argwhere(~np.isfinite(array))[0])
        raise EstimationError(
            f"{name} holds {array[first]} at {first}; leave out or repair such samples first"
        )
    return array


def positive_series(name: str, values: ArrayLike, *shapes: tuple[int | None, ...]) -> Floats:
    """The same, of numbers above 0."""
    array = finite_series(name, values, *shapes)
    if np.any(array <= 0.0):
        raise EstimationError(f"{name} = {array} must exceed 0")
    return array


def mean_rate(time: Floats, values: Floats, window: float, at: Floats | None = None) -> Floats:
    """Rate of change of `values` (instants,): mean over `window` around each instant, at the ends over what there is.

    `at`: the instants around which it is wanted; all of them by default.
    """
    around = time if at is None else at
    begin = np.maximum(around - 0.5 * window, time[0])
    end = np.minimum(around + 0.5 * window, time[-1])
    gained = np.interp(end, time, values) - np.interp(begin, time, values)
    return np.asarray(gained / (end - begin))


def spans(flags: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First instant and first one after it of every stretch in which `flags` (instants,) are true, (spans, 2)."""
    padded = np.zeros(flags.size + 2, dtype=np.bool_)
    padded[1:-1] = flags
    return np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2)
