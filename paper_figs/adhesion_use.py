"""How much of the adhesion that there is a unit uses, and what it is allowed to: one strip over time."""

from typing import NamedTuple

import numpy as np
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from numpy.typing import NDArray

from paper_figs.palette import BLACK, DARK
from paper_figs.style import Look

AVAILABLE = "#c6dcef"
"""Fill of the adhesion that there is."""
LIMIT: Look = {"color": BLACK, "linewidth": 0.7, "linestyle": (0, (2.5, 1.5))}
USED_WIDTH = 0.9
MOST_INSTANTS = 750
"""Of a strip: more than a page can print."""
SHOWN_UNITS = 4
"""Most units that get a strip of their own."""
ROOM = 1.3
"""What a strip shows, over the largest limit: adhesion far above it serves nothing."""


class AdhesionUse(NamedTuple):
    """Series of some axles over time, each as a coefficient [-], (time,)."""

    time: NDArray[np.float64]
    available: NDArray[np.float64]
    """Adhesion that there is: maximum over the slip, weighted by the axles' loads."""
    used: NDArray[np.float64]
    """Force between wheels and rail over load, its magnitude."""
    limit: NDArray[np.float64]
    """Limit by the rule; of several units the mean weighted by their loads."""


def use_of_units(run: xr.Dataset, units: list[int]) -> AdhesionUse:
    """What these units of a recorded run have, use and may use."""
    own = np.isin(run["axle_unit"].values, units)
    load = run["axle_load"].values[:, own]
    whole = load.sum(axis=1)
    weight = run["unit_static_load"].values[units]
    return AdhesionUse(
        run["time"].values,
        (run["adhesion_limit"].values[:, own] * load).sum(axis=1) / whole,
        np.abs(run["rail_force"].values[:, own].sum(axis=1)) / whole,
        run["limit"].values[:, units] @ weight / weight.sum(),
    )


def shown_units(run: xr.Dataset) -> list[int]:
    """Units that get a strip: all, or `SHOWN_UNITS` from the foremost to the rearmost."""
    count = run.sizes["unit"]
    return sorted(set(np.linspace(0, count - 1, min(count, SHOWN_UNITS)).round().astype(int)))


def draw_use(axes: Axes, use: AdhesionUse, colour: str) -> None:
    """A strip: filled what there is, a line what is used, dashed what is allowed."""
    shown = AdhesionUse(*(values[:: -(-use.time.size // MOST_INSTANTS)] for values in use))
    axes.fill_between(
        shown.time, 0.0, shown.available, color=AVAILABLE, linewidth=0.0, label="available"
    )
    axes.plot(shown.time, shown.limit, label="limit", **LIMIT)
    axes.plot(shown.time, shown.used, color=colour, linewidth=USED_WIDTH, label="used")


def use_handles() -> list[Patch | Line2D]:
    """What explains strips, whose line has the rule's colour."""
    return [
        Patch(facecolor=AVAILABLE, label="adhesion available"),
        Line2D([], [], color=DARK, linewidth=USED_WIDTH, label="used"),
        Line2D([], [], label="limit by the rule", **LIMIT),
    ]
