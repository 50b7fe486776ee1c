"""Arms of a paired comparison: a rule under a controller, and how two of them differ over the same events."""

from typing import NamedTuple

import pandas as pd

COMPARED = ("cut-and-ramp", "perturb-observe")
"""Default controllers for a comparison of rules: one waits for a slip signal, one limits torque without any. Rules differ in
what they need to act."""


class Arm(NamedTuple):
    """A rule under a controller."""

    rule: str
    controller: str


def arm_difference(rows: pd.DataFrame, one: Arm, other: Arm, metric: str) -> "pd.Series[float]":
    """Difference of a metric by event, `one` less `other`; nan where only one has met the event."""
    values = []
    for arm in (one, other):
        chosen = (rows["rule"] == arm.rule) & (rows["controller"] == arm.controller)
        values.append(rows[chosen].set_index("event")[metric])
    return (values[0] - values[1]).astype(float)
