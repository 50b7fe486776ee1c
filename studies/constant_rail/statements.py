"""Statements of the sweep over constant rails: does slip stay bounded, and does torque settle?"""

from collections.abc import Mapping

import pandas as pd

from studies.constant_rail.events import SHAPES
from studies.core.statement import Statement
from studies.core.verdict import LEAST_EVENTS, Numbers, decided

CONTROLLERS = ("mpc", "perturb-observe", "cut-and-ramp")
"""The MPC, and for comparison one that steps and one whose nature a limit cycle is."""
SLIP = 2.0
"""Slip [m/s] that no axle should exceed."""
CYCLE = 0.005
"""Amplitude over the mean torque, without the swing of the search, above which torque counts as cycling."""
AMPLITUDES = {
    "swinging": "amplitude of torque with the swing",
    "beside_swing": "amplitude of torque beside the swing",
    "greatest_line": "greatest line beside the swing",
}


def constant_rail_statements(table: pd.DataFrame) -> list[Statement]:
    """Two statements per controller, on rows that are ok."""
    return [
        one
        for controller in CONTROLLERS
        for one in _statements(table[table["controller"] == controller], controller)
    ]


def _statements(rows: pd.DataFrame, controller: str) -> list[Statement]:
    limited = rows[rows["beside_swing"].notna()]
    beyond, cycling = rows["greatest_slip"] > SLIP, limited["beside_swing"] > CYCLE
    slips: Numbers = {
        "greatest slip [m/s]": rows["greatest_slip"],
        **_shares(rows, beyond, f"beyond {SLIP:g} m/s"),
    }
    swings: Numbers = {text: limited[name] for name, text in AMPLITUDES.items()}
    return [
        decided(
            f"slip: {controller}", f"on constant rail no axle slips by more than {SLIP:g} m/s",
            {f"on {int(beyond.sum())} of {len(rows)} rails": not beyond.any()}, slips,
            "holds if it does on every rail", enough=len(rows) >= LEAST_EVENTS,
        ),
        decided(
            f"rest: {controller}", f"on constant rail torque does not cycle by {CYCLE:.1%} or more beside the swing",
            {f"on {int(cycling.sum())} of {len(limited)} rails": not cycling.any()},
            {**swings, **_shares(limited, cycling, "that cycle")},
            "units that are limited through the last 3 s; holds if it does on every rail",
            enough=len(limited) >= LEAST_EVENTS,
        ),
    ]  # fmt: skip


def _shares(
    rows: pd.DataFrame, which: "pd.Series[bool]", words: str
) -> Mapping[str, "pd.Series[bool]"]:
    """Share of the rails, and of those of each curve."""
    found = {f"share of rails {words}": which}
    return found | {f"{words}, {curve}": which[rows["curve"] == curve] for curve in SHAPES}
