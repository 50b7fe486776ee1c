"""Arms of a paired comparison: a rule under a controller, and how two of them differ over the same events."""

from typing import NamedTuple

import pandas as pd

from studies.core.statement import Interval, mean_interval


class Arm(NamedTuple):
    """A rule under a controller."""

    rule: str
    controller: str


def arm_difference(rows: pd.DataFrame, one: Arm, other: Arm, metric: str) -> Interval:
    """Mean over events of a metric's difference, `one` less `other`; events that both have met count."""
    values = []
    for arm in (one, other):
        chosen = (rows["rule"] == arm.rule) & (rows["controller"] == arm.controller)
        values.append(rows[chosen].set_index("event")[metric])
    return mean_interval(values[0] - values[1])
