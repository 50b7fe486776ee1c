"""A table of the sweep `slide-protection` in which everything is as the source prints, made by hand."""

from dataclasses import asdict

import numpy as np
import pandas as pd

from studies.slides.electric import STOPS, electric_tasks
from studies.slides.ensemble_study import NOISES
from studies.slides.jp4209318 import CALIBRATED, TABLE_3, TABLE_4
from studies.slides.study import SENSITIVITIES, THRESHOLDS

SLIP = {f"slip_{i + 1}": 0.08 - 0.004 * i - 0.002 * (i % 2) for i in range(12)}
MEASURES = {"locked_time": 0.0, "air": 300.0, "time_outs": 0.0, "computing": 4.0, **SLIP}
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


def slide_table(members: int = 3) -> pd.DataFrame:
    """Rows as `studies.slides.study` makes them; every member runs as the set in use does."""
    rows = [*set_rows(("tables", "halved"))]
    noise = np.random.default_rng(0).standard_normal(8)
    rows += [{"part": "jitter", **AS_PRINTED, "distance 3": TABLE_3[3] + 0.02 * x} for x in noise]
    for k in range(members):
        rows += [{"member": k, **row} for row in (*set_rows(("tables",)), *member_rows())]
        rows.append({"part": "held out", **AS_PRINTED, "distance 2": 413.0 + 0.1 * k})
    return pd.DataFrame(rows)


def set_rows(parts: tuple[str, ...]) -> list[dict]:
    """Stops of one set."""
    rows = []
    for part in parts:
        for cars, metres in TABLE_3.items():
            rows.append({"part": part, "cars": cars, "setting": "medium", "distance": metres,
                         "damage": 1518.0 if cars == 3 else 900.0, **MEASURES})  # fmt: skip
        for setting in ("low", "high"):
            metres, damage = TABLE_4[setting]
            rows.append({"part": part, "cars": 3, "setting": setting, "distance": metres,
                         "damage": damage, **MEASURES})  # fmt: skip
    for value in SENSITIVITIES:
        damage = 1518.0 * value**-0.7
        metres = 385.0 + 0.9 * (1518.0 / damage) ** 2
        rows.append({"part": "pareto", "cars": 3, "sensitivity": value, "distance": metres,
                     "damage": damage, **MEASURES})  # fmt: skip
    for hold, release in THRESHOLDS:
        rows.append({"part": "threshold", "cars": 3, "hold": hold, "release": release,
                     "distance": 395.0, "damage": 4e4 * hold, **MEASURES})  # fmt: skip
    rows.append({"part": "none", "cars": 3, "distance": 383.0, "damage": 21e3,
                 **(MEASURES | {"locked_time": 160.0})})  # fmt: skip
    for group, controller in electric_tasks():
        held = controller == "mpc"
        rows.append({"part": "electric", "cars": 3, "group": group, "controller": controller,
                     "distance": 384.0 if held else 470.0, "damage": 900.0,
                     "reference_error": 0.4})  # fmt: skip
    return rows


def member_rows() -> list[dict]:
    """What a member has beside its stops."""
    stops = [
        {"part": "beyond", "stop": name, "stopped": True, "distance": 400.0, "damage": 900.0}
        for name in STOPS
    ]
    noise = [{"part": "noise", "noise": size, **AS_PRINTED} for size in NOISES]
    return [{"part": "member", **asdict(CALIBRATED), **AS_PRINTED}, *noise, *stops]
