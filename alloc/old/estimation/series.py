"""Series of measured values: their shape checked, mean rates, and the stretches in which a condition is true."""

from collections.abc import Callable

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.old.errors import EstimationError

Floats = NDArray[np.float64]

# Series that someone gave, as arrays of the shape that an estimation needs.


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


def bridged_spans(
    flags: NDArray[np.bool_], near: Callable[[int, int], bool]
) -> list[tuple[int, int]]:
    """As `spans`, but neighbours that are close count as one span.

    `near` gets the end of a span and the begin of the next one, as indices, and says whether they are close.
    """
    merged: list[tuple[int, int]] = []
    for begin, end in spans(flags).tolist():
        if merged and near(merged[-1][1], begin):
            merged[-1] = (merged[-1][0], end)
        else:
            merged.append((begin, end))
    return merged
