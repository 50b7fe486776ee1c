"""A synthetic table of the sweep `mismatch`, on which it is known what holds."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pandas as pd

from studies.ladder.mismatch_study import GIVEN, MIDDLE, NOISES, OWN, RAILS, settings_at

Row = dict[str, Any]
NUMBERS = {"utilisation_short": 0.9, "damage": 150.0, "slip_time": 5.0, "torque_fluctuation": 0.04}


def mismatch_table(
    events: int = 12, change: Callable[[Row], Row] = lambda row: row
) -> pd.DataFrame:
    """Every MPC uses two points more than the others, but for noise of the event. `change` alters each row."""
    noise = np.random.default_rng(5)
    rows = []
    for k in range(events):
        for curve in RAILS:
            for level in NOISES:
                common = 0.002 * float(noise.normal())
                settings = [*settings_at(curve, level)]
                if level == MIDDLE:  # as the study has it: a curve of one's own by its name
                    settings += [one for one in GIVEN if one.believed == curve != OWN]
                for setting in settings:
                    own = {"event": k, "curve": curve, "noise": level, "setting": setting.name}
                    gain = 0.02 if setting.controller == "mpc" else 0.0
                    row = {**own, "status": "ok", **NUMBERS}
                    row["utilisation_short"] += gain + common
                    rows.append(change(row))
    return pd.DataFrame(rows)
