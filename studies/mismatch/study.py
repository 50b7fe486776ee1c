"""The MPC where curve, noise and computing time are others than it was built on, beside two controllers without a model."""

import pandas as pd

from studies.core.job import Job
from studies.core.study import EachEvent, Study
from studies.ladder.study import RULE
from studies.mismatch.events import (
    DURATION,
    GIVEN,
    MIDDLE,
    NOISES,
    OWN,
    RAILS,
    RIGHT,
    Place,
    scenario,
    settings_at,
)
from studies.mismatch.statements import CLAIMS, mismatch_statements


def places(seed: int, k: int) -> list[Place]:
    """Every rail and noise that event `k` has."""
    return [Place(seed, k, curve, noise) for curve in RAILS for noise in NOISES]


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` at every place under every setting that meets it."""
    return [
        Job(scenario(place, setting, duration), RULE, setting.controller, place.number)
        for place in places(seed, k)
        for setting in settings_at(place.curve, place.noise)
    ]


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event", "curve", "noise" [km/h] and "setting"."""
    names = {
        place.name(setting): (k, place.curve, place.noise, setting.name)
        for k in range(events)
        for place in places(seed, k)
        for setting in settings_at(place.curve, place.noise)
    }
    meaning = pd.DataFrame(
        table["scenario"].map(names).tolist(),
        columns=["event", "curve", "noise", "setting"],
        index=table.index,
    )
    table = pd.concat([table, meaning], axis=1)
    # who believes in the rail's curve by its name believes in the rail's own
    same = [
        table[(table["curve"] == one.believed) & (table["setting"] == RIGHT)].assign(
            setting=one.name
        )
        for one in GIVEN
        if one.believed != OWN
    ]
    return pd.concat([table, *same], ignore_index=True)


MISMATCH = Study(
    name="mismatch",
    question=f"the MPC on rails of {len(RAILS)} curves, with noise, with computing time, and with a given slip "
    f"(at {MIDDLE:g} km/h of noise)",
    default_events=12,
    cells=EachEvent(cells),
    finish=meant,
    judge=lambda table: mismatch_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
