"""Synthetic tables of the sweep `headroom`, on which it is known what holds."""

import numpy as np
import pandas as pd

from studies.patent.headroom_study import BASE, BOUND, NUMBERS, OWN, RULES, draw


def headroom_table(
    share: float = 0.9, slip: float = 0.0, events: int = 40, controller: str = "perturb-observe"
) -> pd.DataFrame:
    """Alone reaches the plan less the headroom, cooperative gains a `share` of it back at `slip` [axle s] more."""
    noise = np.random.default_rng(3)
    rows = []
    for k in range(events):
        room = (0.005, 0.02, 0.04, 0.08)[k % 4] * (1.0 + 0.1 * noise.random())
        d = draw(0, k)
        for rule in RULES:
            part = {BASE: 0.0, OWN: share, BOUND: 1.0}.get(rule, 0.2)
            reached = 1.0 - room * (1.0 - part)
            values = dict.fromkeys(NUMBERS, 1.0) | {"plan_use": reached, "bound_use": reached}
            values |= {"headroom": room, "over_delivery": 0.001}
            values["slip_time"] += slip * (rule == OWN) * (1.0 + 0.1 * noise.random())
            arm = {"scenario": f"event-{k}", "rule": rule, "controller": controller, "status": "ok"}
            rows.append(arm | values | d)
    return pd.DataFrame(rows)
