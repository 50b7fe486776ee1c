"""Slide protections on a rail that recovers by dissipated energy: the stop of JP4209318, protection by protection.

`docs/numbers.toml` takes the table of docs/wheel-damage.md from here.
"""

from dataclasses import replace
from itertools import product

import pandas as pd

from alloc.plant.model import build
from studies.slides.jp4209318 import CALIBRATED, brake, brake_event, measures, slide_protection

RAILS = {
    "no recovery": {},
    "recovery": {"recovered_coefficient": 0.15},
    "strong recovery": {"recovered_coefficient": 0.15, "recovery_energy": 1000.0},
}
"""What a rail without conditioning recovers: up to the source's greatest plausible coefficient on wet rail."""
PROTECTIONS = ("low", "medium", "high", "threshold")


def measured(**_: object) -> pd.DataFrame:
    """A row per protection and rail: `measures` of the stop of three cars."""
    rows = []
    for protection, (rail, recovery) in product(PROTECTIONS, RAILS.items()):
        if protection == "threshold":
            event = brake_event(CALIBRATED, protection=slide_protection(law="threshold"))
        else:
            event = brake_event(CALIBRATED, sensitivity=CALIBRATED.sensitivities[protection])
        own = event.model
        model = build(
            own.train, replace(own.rail, conditioning=0.0, **recovery), own.line, span=own.span
        )
        found = measures(brake(replace(event, model=model)))
        rows.append({"protection": protection, "rail": rail, **found})
    return pd.DataFrame(rows)
