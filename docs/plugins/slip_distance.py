"""A metric of one's own: by how much wheels have turned too far or too little."""

import numpy as np

from alloc.metrics import metric


@metric(
    "slip_distance", "m", "way of the wheels beyond that of the train, summed over axles", better=-1
)
def slip_distance(run):
    """Integral of the magnitude of the slip velocity, summed over axles [m]."""
    slip = np.abs(run["slip_velocity"].values).sum(axis=1)
    return np.trapezoid(slip, run["time"].values)
