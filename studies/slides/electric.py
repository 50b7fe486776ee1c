"""The electric brake in the demonstration of JP4209318: rows of the sweep `slide-protection`, and what they say.

Beyond the source: readhesion controllers and the MPC, each unit alone, in the place of valves.
"""

from collections.abc import Iterator
from typing import Any, get_args

import numpy as np
import pandas as pd

from alloc.metrics import motion
from alloc.plant.equations import GRAVITY
from alloc.plant.train import InverterGroup
from alloc.simulation import simulate
from mpc.hosted import MPC
from studies.core.statement import Statement
from studies.core.verdict import over_cases
from studies.slides.electric_event import FADE_SPEED, electric_event
from studies.slides.front import front
from studies.slides.jp4209318 import CALIBRATED

GROUPS: tuple[InverterGroup, ...] = ("1C4M", "1C1M")
"""Motors per inverter: what one torque serves has to suit the worst of its axles."""
CONTROLLERS = ("cut-and-ramp", "pi-creep", "perturb-observe", "steepest-gradient", MPC.name)
PART = "electric"
DECIDED = 0.5
"""Difference of two distances [m] that counts, ten times what noise of 1e-4 on every parameter makes."""

assert set(GROUPS) <= set(get_args(InverterGroup))


def electric_tasks() -> Iterator[tuple[InverterGroup, str]]:
    """Every run with the electric brake."""
    for group in GROUPS:
        for controller in CONTROLLERS:
            yield group, controller


def electric_row(group: InverterGroup, controller: str) -> dict[str, Any]:
    """One stop; `distance` [m] includes the rest from 5 km/h, where the electric brake fades, under the shoes' force."""
    run = simulate(electric_event(CALIBRATED, group), "alone", controller)
    rest = FADE_SPEED**2 / (2.0 * CALIBRATED.shoe_force_share * GRAVITY)
    return {
        "part": PART,
        "cars": 3,
        "group": group,
        "controller": controller,
        "distance": motion.distance(run) + rest,
        "damage": motion.damage(run),
        "reference_error": float(np.abs(run["reference_speed"] - run["speed"]).max()),
    }


def electric_statement(table: pd.DataFrame) -> Statement:
    """Whether an electric brake under the MPC does better than valves under fuzzy slide protection."""
    own = front(table[table["part"] == "pareto"])
    rows = table[table["part"] == PART]
    by_damage = own.sort_values("damage")
    reach = np.interp(rows["damage"], by_damage["damage"], by_damage["distance"])
    longer = rows["distance"].to_numpy() - reach
    mpc = (rows["controller"] == MPC.name).to_numpy()
    shorter = zip(rows["group"][mpc], longer[mpc] < -DECIDED, strict=True)
    numbers = {
        f"{row.group}, {row.controller}: longer than the front by [m], Q [kJ] {row.damage:.0f}": value
        for row, value in zip(rows.itertuples(), longer.tolist(), strict=True)
    }
    return over_cases(
        "electric brake",
        "an electric brake whose units hold their slip by the MPC brakes shorter than the front at the same Q",
        {f"not with {group}": bool(holds) for group, holds in shorter},
        {**numbers, "largest error of the reference speed [m/s]": rows["reference_error"].max()},
        "front: sensitivities of the fuzzy slide protection that none beats in distance and Q; at its ends the nearest "
        f"holds. Same rail and brake force, each unit alone, believed curve true, no axle runs free; {DECIDED:g} m count",
    )
