"""Blended stops against an objective for air brakes and motors together: what the true optimum would save at equal effort.

`docs/numbers.toml` takes a table of docs/sharing.md from here. At each sampled instant of a stop the train's effort is split
anew, with the truth at hand (`alloc.metrics.least_damage`): among the driven axles alone, or among all of them, with a force
for each unit and for each brake group of a trailer, which its own part of the plan bounds, or nothing. The effort of every
instant, and with it the stopping distance, stays as it was.
"""

import numpy as np
import pandas as pd
import xarray as xr

from alloc.metrics import evaluate
from alloc.metrics.least_damage import SAMPLED, curve_of, least_split, sampled
from alloc.metrics.registry import direction, series
from alloc.simulation import simulate
from studies.stops import blended_events


def split_anew(run: xr.Dataset) -> dict[str, float]:
    """Friction work at the rail [kJ] of all axles, and work of the shoes [kJ], in the run and with its efforts split anew.

    - rail: as it was. held: each axle with its own force, below the peak. motors: the driven axles share theirs. within: all
      axles that brake share, those of trailers up to their part of the plan. all: without that bound.
    - shoes, shoes_all: work of the shoes, as it was and where all share, motors first.
    """
    chosen, curve = sampled(run), curve_of(run)
    braked = np.flatnonzero((series(run, "axle_unit") >= 0) | (series(run, "axle_group") >= 0))
    unit, group = series(run, "axle_unit")[braked], series(run, "axle_group")[braked]
    share = np.where(unit >= 0, unit, run.sizes["unit"] + group)
    order = np.argsort(share, kind="stable")
    braked, unit, share = braked[order], unit[order], share[order]
    free = np.full((chosen.size, braked.size), np.inf)
    first = np.flatnonzero(np.append(True, np.diff(share) != 0))
    planned = (
        series(run, "expected")[chosen][:, None] * series(run, "axle_static_load")[braked[first]]
    )
    planned = np.where(unit[first] < 0, planned, np.inf)
    force = direction(run)[chosen][:, None] * series(run, "rail_force")[chosen][:, braked]
    slip = series(run, "slip_velocity")[chosen][:, braked]

    def least(some: np.ndarray, most: np.ndarray = free) -> tuple[np.ndarray, np.ndarray]:
        shares = np.unique(share[some]).size
        return least_split(
            run, curve, chosen, braked[some], share[some], most[:, :shares], force[:, some].sum(axis=1)
        )  # fmt: skip

    held = np.column_stack([least(np.array([a]))[0] for a in range(braked.size)])
    driven = np.flatnonzero(unit >= 0)
    together, split = least(np.arange(braked.size))
    within, _ = least(np.arange(braked.size), planned)
    axles = np.unique(share, return_counts=True)[1]
    at_rail = series(run, "unit_gear") / series(run, "unit_radius")
    motors = at_rail * series(run, "brake_limit")[chosen]
    units = np.unique(unit[driven])
    split[:, : units.size] -= np.minimum(split[:, : units.size], motors[:, units])
    speed = np.abs(series(run, "speed")[chosen])
    shoes = series(run, "brake_force")[chosen] * np.abs(series(run, "rim_speed")[chosen])
    found = {
        "rail": np.abs(slip * force).sum(axis=1),
        "held": held.sum(axis=1),
        "motors": least(driven)[0] + np.delete(held, driven, axis=1).sum(axis=1),
        "within": within,
        "all": together,
        "shoes": shoes.sum(axis=1),
        "shoes_all": (split * axles).sum(axis=1) * speed,
    }
    return {name: float(power.sum()) * SAMPLED / 1e3 for name, power in found.items()}


def measured(seed: int, events: int, rules: list[str], controllers: list[str]) -> pd.DataFrame:
    """A row per stop, rule and controller: `split_anew`, what each split saves of the work as it was, and `bound_use`."""
    rows = []
    for k in range(events):
        train = blended_events.EVENTS.draw(seed, k)["train"]
        event = blended_events.scenario(seed, k).event(k)
        for rule in rules:
            for controller in controllers:
                run = simulate(event, rule, controller)
                found = split_anew(run)
                saved = {
                    "saved_sliding": 1.0 - found["held"] / found["rail"],
                    "saved_motors": (found["held"] - found["motors"]) / found["rail"],
                    "saved_within": (found["motors"] - found["within"]) / found["rail"],
                    "saved_all": (found["motors"] - found["all"]) / found["rail"],
                    "shoes_ratio": found["shoes_all"] / max(found["shoes"], 1e-3),
                }
                rows.append(
                    {"event": k, "train": train, "rule": rule, "controller": controller}
                    | found | saved | {"bound_use": evaluate(run)["bound_use"]}
                )  # fmt: skip
    return pd.DataFrame(rows)
