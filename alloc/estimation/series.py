"""Series of measured values: their kind, shape and size checked, and the stretches in which a condition is true."""

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from pandas.api.types import infer_dtype

from alloc.errors import EstimationError

Floats = NDArray[np.float64]

MOST = {"speed": 160.0, "angular_speed times radius": 160.0, "radius": 1.5, "applied_force": 1e6}
"""Sizes in SI units beyond which a series has another unit, or raw counts: the record on wheels is 159.7 m/s, the largest
driving wheels had 1.2 m, and no axle carries 100 t."""


def seconds(values: ArrayLike) -> Any:
    """Time stamps, with a zone or without, as seconds since the first; spans of time as seconds; others as they are."""
    array: Any = np.ma.asarray(values)
    flat = array.data.ravel()
    if (kind := infer_dtype(flat)).startswith("datetime"):
        flat = pd.to_datetime(flat, utc=True) - pd.to_datetime(flat[0], utc=True)
    elif not kind.startswith("timedelta"):
        return values
    spans = pd.to_timedelta(flat).total_seconds().to_numpy()
    return np.ma.array(spans.reshape(array.shape), mask=array.mask)


def finite_series(name: str, values: ArrayLike, *shapes: tuple[int | None, ...]) -> Floats:
    """`values` as numbers of one of these shapes (None: any length); raises `EstimationError` naming `name`."""
    array: Any = np.ma.asarray(values)
    kind = infer_dtype(array.data.ravel())
    if array.size and kind not in ("floating", "integer", "mixed-integer-float", "decimal"):
        raise EstimationError(f"{name} holds {kind} values; it needs numbers")
    absent = pd.isna(array.data) | np.ma.getmaskarray(array)
    array = np.where(absent, np.nan, array.data).astype(float)

    def fits(shape: tuple[int | None, ...]) -> bool:
        pairs = zip(shape, array.shape, strict=False)
        return len(shape) == array.ndim and all(want in (None, have) for want, have in pairs)

    if shapes and not any(map(fits, shapes)):
        wanted = " or ".join(str(shape).replace("None", "any") for shape in shapes)
        raise EstimationError(f"{name} has shape {array.shape}; it needs {wanted}")
    if shapes and array.size == 0:
        raise EstimationError(f"{name} is empty")
    within = abs(array) <= MOST.get(name, np.finfo(float).max)
    if not np.all(within):
        first = tuple(int(k) for k in np.argwhere(~within)[0])
        told = "leave out or repair such samples first"
        if np.isfinite(array[first]):
            told = f"no train has more than {MOST[name]:g} in SI units"
        raise EstimationError(f"{name} holds {array[first]:g} at {first}; {told}")
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
