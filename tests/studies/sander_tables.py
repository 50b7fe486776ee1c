"""A table of the sweep `sanders` in which the trial comes out and sharing by sand helps where sand lies far back."""

import numpy as np
import pandas as pd

from studies.stops.sander_trial import DISTANCES, EVENTS, PLACEMENTS, SHARINGS, USUAL
from studies.stops.sanders_study import CARS, TRIALS

BEST = "axles 1 and 5 of each unit"
REAR = "axle 1 of car 5"


def sander_table(events: int = 12, best: float = 0.95, gain: float = 0.1) -> pd.DataFrame:
    """Rows as the study makes them: `best` at `BEST` over the usual placement, `gain` of sharing at `REAR`."""
    rows = [
        {"part": "trial", "kind": kind, "units": units, "curve": curve, "distance": 1.02 * metres}
        for units, curve in TRIALS
        for kind, metres in DISTANCES.items()
    ]
    rows += [
        {"part": "pair", "first": a, "second": b, "distance": 400.0 + 10.0 * a + 5.0 * b}
        for a in range(CARS)
        for b in range(a, CARS)
    ]
    noise = np.random.default_rng(0)
    for k in range(events):
        metres = 400.0 * (1.0 + 0.1 * noise.standard_normal())
        for place in PLACEMENTS:
            ratio = {USUAL: 1.0, BEST: best, REAR: 1.3}.get(place, 1.1)
            for sharing in SHARINGS:
                less = gain if (place, sharing) == (REAR, SHARINGS[1]) else 0.0
                own = 0.002 * noise.standard_normal() * (place != USUAL)
                rows.append({"part": "placement", "event": k, "placement": place, "sharing": sharing,
                             "distance": metres * (ratio - less + own), "damage": 2000.0, **EVENTS.draw(0, k)})  # fmt: skip
    return pd.DataFrame(rows).assign(status="ok")
