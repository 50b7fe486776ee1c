"""Series of measured values: their kind, shape and size checked, and the stretches in which a condition is true."""

from typing import Any

import numpy as np
import pandas as pd
from numpy.typing import ArrayLike, NDArray
from pandas.api.types import infer_dtype

from alloc.schema.errors import EstimationError

Floats = NDArray[np.float64]

MOST = {"speed": 160.0, "angular_speed times radius": 160.0, "radius": 1.5, "applied_force": 1e6}
"""Sizes [SI] beyond which a series has another unit, or raw counts: the fastest train on wheels ran at 159.7 m/s, the
largest wheels had a radius of 1.2 m, no axle carries 100 t."""


def finite_series(name: str, values: ArrayLike, *shapes: tuple[int | None, ...]) -> Floats:
    """`values` as numbers, times as seconds, of one of these shapes (None: any length); `EstimationError` names `name`."""
    marked: Any = np.ma.asarray(values)
    flat: Any = marked.data.ravel()
    kind = infer_dtype(flat)
    if name in ("time", "window") and kind.startswith(("datetime", "timedelta")):
        if kind.startswith("datetime"):  # since the first, with a zone or without
            flat = pd.to_datetime(flat, utc=True) - pd.to_datetime(flat[:1], utc=True)[0]
        kind, flat = "floating", pd.to_timedelta(flat).total_seconds()
    if flat.size and kind not in ("floating", "integer", "mixed-integer-float", "decimal"):
        raise EstimationError(f"{name} holds {kind} values; it needs numbers")
    absent = pd.isna(flat) | np.ma.getmaskarray(marked).ravel()
    array = np.where(absent, np.nan, flat).astype(float).reshape(marked.shape)

    def fits(shape: tuple[int | None, ...]) -> bool:
        pairs = zip(shape, array.shape, strict=False)
        return len(shape) == array.ndim and all(want in (None, have) for want, have in pairs)

    if shapes and not any(map(fits, shapes)):
        wanted = " or ".join(str(shape).replace("None", "any") for shape in shapes)
        raise EstimationError(f"{name} has shape {array.shape}; it needs {wanted}")
    if shapes and array.size == 0:
        raise EstimationError(f"{name} is empty")
    if not np.all(within := abs(array) <= MOST.get(name, np.finfo(float).max)):
        first = tuple(int(k) for k in np.argwhere(~within)[0])
        advice = "leave out or repair such samples first"
        if np.isfinite(array[first]):
            advice = f"no train has more than {MOST[name]:g} in SI units"
        raise EstimationError(f"{name} holds {array[first]:g} at {first}; {advice}")
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
