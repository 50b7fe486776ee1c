"""Stability, by trial: constant rails of drawn curves, levels, speeds and loads, without noise."""

import pandas as pd

from studies.core.claims import AT_MOST, Claim, conjunction, how_many
from studies.core.job import Job
from studies.core.statement import Statement
from studies.core.study import EachEvent, Study
from studies.ladder.constant_rail_events import DURATION, EVENTS, SHAPES, measure, scenario
from studies.ladder.ladder_study import RULE

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


def _shares(which: str, words: str) -> dict[str, str]:
    """Share of the rails, and of those of each curve."""
    found = {f"share of rails {words}": which}
    return found | {f"{words}, {curve}": f"{which} if curve == {curve}" for curve in SHAPES}


def claims_of(controller: str) -> tuple[Claim, Claim]:
    """What is claimed of a controller on every rail."""
    beyond, cycling = f"greatest_slip > {SLIP:g}", f"beside_swing > {CYCLE}"
    limited = {text: name for name, text in AMPLITUDES.items()} | _shares(cycling, "that cycle")
    return (
        Claim(
            f"slip: {controller}", f"on constant rail no axle slips by more than {SLIP:g} m/s", beyond, AT_MOST, exact=True,
            reason="slip stays bounded", show=how_many("on", "rails"), method="holds if it does on every rail",
            numbers={"greatest slip [m/s]": "greatest_slip", **_shares(beyond, f"beyond {SLIP:g} m/s")},
        ),
        Claim(
            f"rest: {controller}", f"on constant rail torque does not cycle by {CYCLE:.1%} or more beside the swing",
            cycling, AT_MOST, exact=True, reason="torque comes to rest", show=how_many("on", "rails"),
            only="beside_swing == beside_swing",
            numbers={text: f"{name} if beside_swing == beside_swing" for text, name in limited.items()},
            method="units that are limited through the last 3 s; holds if it does on every rail",
        ),
    )  # fmt: skip


CLAIMS = tuple(claim for controller in CONTROLLERS for claim in claims_of(controller))


def constant_rail_statements(table: pd.DataFrame) -> list[Statement]:
    """Two statements per controller, on rows that are ok."""
    return [
        conjunction(table[table["controller"] == controller], claim)
        for controller in CONTROLLERS
        for claim in claims_of(controller)
    ]


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Rail `k` under every controller."""
    one = scenario(seed, k, duration)
    return [Job(one, RULE, controller, k, measure) for controller in CONTROLLERS]


CONSTANT_RAIL = Study(
    name="constant-rail",
    question="whether slip stays bounded and torque comes to rest on rails that do not change",
    default_events=100,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: constant_rail_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
