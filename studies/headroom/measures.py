"""What the study reads from a run beside the metrics: how much of the plan was delivered."""

import numpy as np
import xarray as xr

from alloc.metrics.use import train_bounds


def measure(run: xr.Dataset) -> dict[str, float]:
    """plan_use: effort, instant by instant the plan at most, over the plan; `headroom` has the same scale."""
    found = train_bounds(run)
    return {"plan_use": float(np.minimum(found.force, found.plan).sum() / found.plan.sum())}
