"""What effects that the shipped trains and rails leave out do to the ranking of rules and controllers.

Each effect is switched on alone in the drawn starts with headroom (`studies.patent.headroom_study`), and every arm meets the
same starts: motors in parallel, a torque that lags, drives that twist, adhesion that the energy of slip recovers, and a rail
as a full-scale rig found it. At last all of them act at once, as drawn.
"""

from collections.abc import Mapping
from typing import Any, NamedTuple

import pandas as pd

from alloc.plant.model import offered_by
from studies.core import drawn_events as shared
from studies.core.claims import AT_LEAST, Claim, family
from studies.core.drawn_events import (
    START_SPEED,
    Arm,
    DrawnEvents,
    Quantity,
    complete,
    log_uniform,
    one_of,
    paired,
    with_parts,
)
from studies.core.job import Job
from studies.core.statement import INTERVALS_OF_MEANS, POINTS
from studies.core.study import EachEvent, Study
from studies.patent import headroom_study
from studies.scenario.scenario import Scenario


class Effect(NamedTuple):
    """Keys of `[motors]`, and keys of `[rail]` in place of those of a start."""

    motors: Mapping[str, Any] = {}
    rail: Mapping[str, Any] = {}


NONE, DRAWN = "none", "all, as drawn"
ROTOR = {"rotor_inertia_kgm2": 1.0}
"""Assumed; at the wheel 5 to 32 % of the wheelset's inertia, by train."""
RECOVERED = {"recovered_coefficient": 0.28, "conditioning": 0.0}
"""Assumed for clean wheels on wet rail, in place of what a start has of wheels that clean."""
RIG = {"curve": {"kind": "polach-rig"}}
EFFECTS: Mapping[str, Effect] = {
    NONE: Effect(),
    "induction": Effect({"kind": "induction"}),
    "series": Effect({"kind": "series"}),
    "lag 50 ms": Effect({"torque_lag_s": 0.05}),
    "lag 100 ms": Effect({"torque_lag_s": 0.1}),
    "torsion": Effect(ROTOR),
    "soft torsion": Effect(ROTOR | {"shaft_stiffness_nm_per_rad": 1e6}),
    "recovery": Effect(rail=RECOVERED),
    "strong recovery": Effect(rail=RECOVERED | {"recovery_energy_j_per_m": 1000.0}),
    "rig curve": Effect(rail=RIG),
    DRAWN: Effect(),
}
"""By name; what `DRAWN` has follows from `QUANTITIES`."""
QUANTITIES: dict[str, Quantity] = {
    "kind": one_of(("torque", "induction", "series"), "each equally likely", "trains have all three"),
    "torque_lag_s": log_uniform(0.005, 0.1, " s", "the readhesion paper has 5 ms; 100 ms where commands pass a train bus"),
    "shaft_stiffness_nm_per_rad": log_uniform(1e6, 1e7, " N m/rad", "a steel axle has 5e6; couplings of rubber have less"),
    "recovery": one_of(("yes", "no"), "equally likely", "wet rail recovers, dry rail has nothing to recover"),
    "recovery_energy_j_per_m": log_uniform(1e3, 1e4, " J/m", "assumed: from a quarter to two and a half of the usual value"),
    "curve": one_of(("own", "rig"), "equally likely", "the start's own curve, or one with its peak below 1 % slip"),
}  # fmt: skip
EVENTS = DrawnEvents("effects", QUANTITIES, stream=(41,))


def effect_of(name: str, seed: int, k: int) -> Effect:
    """The effect of this name in start `k`."""
    if name != DRAWN:
        return EFFECTS[name]
    d = EVENTS.draw(seed, k)
    motors = {key: d[key] for key in ("kind", "torque_lag_s", "shaft_stiffness_nm_per_rad")}
    rail = {**RECOVERED, "recovery_energy_j_per_m": d["recovery_energy_j_per_m"]}
    return Effect(
        ROTOR | motors,
        (rail if d["recovery"] == "yes" else {}) | (RIG if d["curve"] == "rig" else {}),
    )


FIXED, SLIP = Arm("alone", "pi-creep"), 0.25
"""An arm that holds this slip [m/s], wherever the peak is."""
FIXED_SLIP = "-fixed-slip"
"""What its scenario's name ends with."""
ARMS = (
    *(Arm("alone", controller) for controller in ("cut-and-ramp", "perturb-observe", "mpc")),
    *(Arm(rule, "perturb-observe") for rule in ("greedy", "cooperative")),
    Arm("oracle", "perturb-observe"),
    FIXED,
)
ORDERS = (
    (ARMS[1], ARMS[0]), (ARMS[2], ARMS[1]), (ARMS[4], ARMS[1]), (ARMS[4], ARMS[3]), (ARMS[1], FIXED),
)  # fmt: skip
"""Arms of which the first is claimed to use no less than the second, as it does without the effects."""
NUMBERS = {
    "bound_use": "bound used",
    "equal_torque_use": "used of the bound of equal torques",
    "slip_time": "slip [axle s]",
    "damage": "wheel damage [kJ]",
    "severe_work": "share of the damage above 200 N",
}
"""Metric -> what a statement calls it."""
METHOD = f"paired by start; {INTERVALS_OF_MEANS}; after Holm over all claims"


def column(metric: str, arm: Arm, effect: str) -> str:
    """Column of a metric of an arm under an effect."""
    return f"{metric}@{arm.rule}/{arm.controller}/{effect}"


def _order(effect: str, one: Arm, other: Arm) -> Claim:
    name = f"{effect}: {' under '.join(one)} before {' under '.join(other)}"
    own, base = column("bound_use", one, effect), column("bound_use", other, effect)
    return Claim(
        name, "the order of the two is that without the effect", f"{own} - {base}", AT_LEAST,
        reason="an order that the effect turns round was one of the plant left out", show=POINTS, method=METHOD,
        numbers={
            f"{words}, {' under '.join(arm)}": column(metric, arm, effect)
            for arm in (one, other) for metric, words in NUMBERS.items()
        } | {f"{words}, difference": f"{column(metric, one, effect)} - {column(metric, other, effect)}"
             for metric, words in NUMBERS.items()},
    )  # fmt: skip


CLAIMS = tuple(_order(effect, *pair) for effect in EFFECTS for pair in ORDERS)
"""One family."""


def pairs_of(table: pd.DataFrame) -> pd.DataFrame:
    """One row per start that succeeded in every arm, with numbers as ``number@rule/controller/effect``."""
    rows = complete(table.assign(scenario=table["event"]))
    arm = rows["rule"] + "/" + rows["controller"] + "/" + rows["effect"]
    return paired(rows.assign(arm=arm), "arm", NUMBERS, ())


def scenario(seed: int, k: int, effect: str, duration: float = headroom_study.DURATION) -> Scenario:
    """Start `k` under an effect."""
    event = headroom_study.scenario(seed, k, duration)
    motors, rail = effect_of(effect, seed, k)
    return event.changed(
        name=event.name + _part(effect), motors=dict(motors) or None, rail=_rail(event, rail)
    )


def _rail(event: Scenario, keys: Mapping[str, Any]) -> dict[str, Any]:
    """The start's rail with other keys; another curve offers what its own does at 15 km/h, and what grows with it grows."""
    rail: dict[str, Any] = event.rail.model_dump() | dict(keys)
    if "curve" in keys:
        model, level = event.event().model, rail["level"]
        own = offered_by(model.rail.curve, level, START_SPEED, model.structure)
        rail |= shared.rail_offering(keys["curve"], own, START_SPEED, model.train)
        scale = rail["level"] / level
        rail["increments"]["values"] = [scale * one for one in rail["increments"]["values"]]
        rail["scatter"] *= scale
    return rail


def cells(seed: int, k: int, duration: float = headroom_study.DURATION) -> list[Job]:
    """Start `k` in every arm under every effect."""
    found = []
    for effect in EFFECTS:
        one = scenario(seed, k, effect, duration)
        creep = one.onboard.model_dump() | {"creep": {"reference_kmh": 3.6 * SLIP}}
        fixed = one.changed(name=one.name + FIXED_SLIP, onboard=creep)
        found += [Job(fixed if arm == FIXED else one, *arm, k) for arm in ARMS]
    return found


def _part(effect: str) -> str:
    return "" if effect == NONE else f"-{effect.replace(', ', ' ').replace(' ', '-')}"


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event" and "effect"."""
    parts = {_part(effect) + arm: (effect,) for effect in EFFECTS for arm in ("", FIXED_SLIP)}
    return with_parts(table, parts, "effect")


EFFECTS_STUDY = Study(
    name="effects",
    question="motors, lags, torsion, recovery, a rig's curve: what they do to the ranking of rules and controllers",
    default_events=60,
    cells=EachEvent(cells),
    finish=meant,
    judge=lambda table: family((pairs_of(table), CLAIMS)),
    claims=CLAIMS,
)
