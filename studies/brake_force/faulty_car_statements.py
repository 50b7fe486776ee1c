"""What the sweep `brake-force` says of a commuter train's faulty car: is it found, and is a sound one accused?"""

import math

import pandas as pd

from studies.core.statement import Statement
from studies.core.verdict import Bound, judged

LACKING = 0.05
"""Share of its allocated force from which on a car counts as short."""
SURE = 0.95
"""Share of stops in which a faulty car must be found."""
RARE = 0.05
"""Share of stops in which a sound car may be accused."""
TENTH = 0.1
"""Share of a car's brake force from which on it is claimed to be missed."""


def faulty_car(stops: pd.DataFrame) -> Statement:
    """Stops under allocation: where the faulty car is named first, and how often a sound one is accused."""
    kinds = {str(kind): rows for kind, rows in stops.groupby("kind", sort=False)}
    short = {
        kind: rows
        for kind, rows in kinds.items()
        if kind != "sound" and rows["true_share"].mean() > LACKING
    }
    bounds = [
        *(Bound(f"named first: {kind}", rows["first"], least=SURE) for kind, rows in short.items()),
        Bound("share of stops in which a sound car is accused", stops["wrong"], most=RARE),
        *(Bound(f"accused all the same: {kind}", rows["found"], most=RARE)
          for kind, rows in kinds.items() if kind not in short and kind != "sound"),
        Bound("another car, truly short, is found too", stops["others_short"]),
        Bound("allocations per stop", stops["rule_calls"]),
    ]  # fmt: skip
    return judged(
        "faulty car found under allocation",
        "the estimate names the car that did not deliver its allocated force, and accuses no other",
        bounds,
        "a sound car falls truly short by less than 5 %; stated for a train: 1 % accused wrongly",
    )


def smallest_shortfall(dry: pd.DataFrame) -> Statement:
    """Dry stops: how small a shortfall is found, and how often another car is accused."""
    bounds = [
        Bound(
            f"found, {missing:.1%} missing",
            dry[dry["missing"] == missing]["found"],
            least=SURE if missing >= TENTH else -math.inf,
        )
        for missing in sorted(set(dry["missing"].astype(float)) - {0.0}, reverse=True)
    ]
    return judged(
        "smallest shortfall found",
        "a tenth of one car's brake force that is missing is found in one stop",
        [
            *bounds,
            Bound("share of stops in which a sound car is accused", dry["wrong"], most=RARE),
            Bound("share in which a car is accused that truly lacks less than 1 %", dry["whole"]),
            Bound("threshold over a car's allocated force", dry["threshold"]),
            Bound("error over the stated deviation", dry["error_in_deviations"]),
        ],
        "dry stops; 10 measurements of each; shares of force that the car's shoes lack, beside 2 % of scatter",
    )
