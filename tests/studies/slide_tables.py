"""A table of the sweep `slide-protection` in which everything is as the source prints, made by hand."""

import numpy as np
import pandas as pd

from studies.slides.electric import electric_tasks
from studies.slides.jp4209318 import RIVALS
from studies.slides.study import SENSITIVITIES, THRESHOLDS
from studies.slides.targets import TABLE_3, TABLE_4

SLIP = {f"slip_{i + 1}": 0.08 - 0.004 * i - 0.002 * (i % 2) for i in range(12)}
AS_PRINTED = {
    **{f"distance {cars}": metres for cars, metres in TABLE_3.items()},
    "Q medium": 1518.0,
    "Q low": 1.10,
    "Q high": 0.346,
    "longer high": 1.9,
    "longer low": -0.08,
    "locked": 0.0,
    "time-outs": 0.0,
    "slides": 0.0,
}


def slide_table() -> pd.DataFrame:
    """Rows as `studies.slides.study.run` makes them."""
    rows = []
    common = {"locked_time": 0.0, "air": 300.0, "time_outs": 0.0, "computing": 4.0, **SLIP}
    for part in ("tables", "halved"):
        for cars, metres in TABLE_3.items():
            rows.append({"part": part, "cars": cars, "setting": "medium", "distance": metres,
                         "damage": 1518.0 if cars == 3 else 900.0, **common})  # fmt: skip
        for setting in ("low", "high"):
            metres, damage = TABLE_4[setting]
            rows.append({"part": part, "cars": 3, "setting": setting, "distance": metres,
                         "damage": damage, **common})  # fmt: skip
    for value in SENSITIVITIES:
        damage = 1518.0 * value**-0.7
        metres = 385.0 + 0.9 * (1518.0 / damage) ** 2
        rows.append({"part": "pareto", "cars": 3, "sensitivity": value, "distance": metres,
                     "damage": damage, **common})  # fmt: skip
    for hold, release in THRESHOLDS:
        rows.append({"part": "threshold", "cars": 3, "hold": hold, "release": release,
                     "distance": 395.0, "damage": 4e4 * hold, **common})  # fmt: skip
    rows.append({"part": "none", "cars": 3, "distance": 383.0, "damage": 21e3,
                 **(common | {"locked_time": 160.0})})  # fmt: skip
    for group, controller in electric_tasks():
        held = controller == "mpc"
        rows.append({"part": "electric", "cars": 3, "group": group, "controller": controller,
                     "distance": 384.0 if held else 470.0, "damage": 900.0,
                     "reference_error": 0.4})  # fmt: skip
    noise = np.random.default_rng(0).standard_normal(8)
    rows += [{"part": "jitter", **AS_PRINTED, "distance 3": TABLE_3[3] + 0.02 * x} for x in noise]
    rows += [{"part": "rival", **AS_PRINTED} for _ in RIVALS]
    rows.append({"part": "held out", **AS_PRINTED, "distance 2": 413.0})
    return pd.DataFrame(rows)
