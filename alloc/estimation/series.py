"""Series of measured values: their shape checked, and the stretches in which a condition is true."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from alloc.errors import EstimationError

Floats = NDArray[np.float64]


def finite_series(name: str, values: ArrayLike, *shapes: tuple[int | None, ...]) -> Floats:
    """`values` as an array of one of these shapes (None: any length); raises `EstimationError` naming `name`."""
    array = np.asarray(values, dtype=float)

    def fits(shape: tuple[int | None, ...]) -> bool:
        pairs = zip(shape, array.shape, strict=False)
        return len(shape) == array.ndim and all(want in (None, have) for want, have in pairs)

    if not any(map(fits, shapes)):
        wanted = " or ".join(str(shape).replace("None", "any") for shape in shapes)
        raise EstimationError(f"{name} has shape {array.shape}; it needs {wanted}")
    if array.size == 0:
        raise EstimationError(f"{name} is empty")
    if not np.all(np.isfinite(array)):
        first = tuple(int(k) for k in np.argwhere(~np.isfinite(array))[0])
        told = f"{array[first]} at {first}; leave out or repair such samples first"
        raise EstimationError(f"{name} holds {told}")
    return array


def positive_series(name: str, values: ArrayLike, *shapes: tuple[int | None, ...]) -> Floats:
    """The same, of numbers above 0."""
    array = finite_series(name, values, *shapes)
    if np.any(array <= 0.0):
        raise EstimationError(f"{name} = {array} must exceed 0")
    return array


def spans(flags: NDArray[np.bool_]) -> NDArray[np.int64]:
    """First instant and first one after it of every stretch in which `flags` (instants,) are true, (spans, 2)."""
    padded = np.zeros(flags.size + 2, dtype=np.bool_)
    padded[1:-1] = flags
    return np.flatnonzero(padded[1:] != padded[:-1]).reshape(-1, 2)
