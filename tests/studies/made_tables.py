"""A table of the sweep `wsp-acceptance` in which every aim is met, made by hand."""

from collections.abc import Callable
from dataclasses import asdict
from functools import cache
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from alloc.estimation.increments import DIRECTIONS
from studies.patent.learning_study import ARMS, KINDS
from studies.readhesion_paper import study as readhesion
from studies.readhesion_paper.calibration import NOT_ASKED_OF_ALL, RANGES, draw, grid_tables
from studies.readhesion_paper.findings import CLAIMS
from studies.readhesion_paper.paper import (
    GRADIENTS,
    PAPER_LIMITS,
    PAPER_MARGINS,
    PAPER_WIDTHS,
    UNITS,
)
from studies.slides.electric import STOPS, electric_tasks
from studies.slides.ensemble_study import NOISES
from studies.slides.jp4209318 import CALIBRATED, TABLE_3, TABLE_4
from studies.slides.study import SENSITIVITIES, THRESHOLDS
from studies.stops.sander_trial import DISTANCES, EVENTS, PLACEMENTS, SHARINGS, USUAL
from studies.stops.sanders_study import CARS, TRIALS
from studies.stops.wsp_acceptance_study import drawn_case, event_name, table_cases

Row = dict[str, Any]
Change = Callable[[Row], Row]
GOOD: Row = {
    "stopped": True, "adhesion_used": 0.97, "locked_axle_s": 0.0, "longest_lock_s": 0.0, "damage_kj": 1400.0,
    "air_nl": 500.0, "distance_m": 700.0, "over_perfect": 1.05, "time_s": 40.0,
}  # fmt: skip


def acceptance_table(change: Change = lambda row: row) -> pd.DataFrame:
    """Rows of the default sweep as `studies.stops.wsp_acceptance_study` makes them; `change` alters each."""
    return pd.DataFrame([change(dict(row)) for row in _good_rows()])


@cache
def _good_rows() -> tuple[Row, ...]:
    rows = []
    for case in (*table_cases(), *(drawn_case(0, k) for k in range(12))):
        row = {**case.columns, "event": event_name(case.curve, case.levels, case.grade), **GOOD}
        if case.compared:
            row |= {f"true_speed_{name}": value for name, value in GOOD.items()}
        rows.append(row | {"status": "ok"})
    return tuple(rows)


# Synthetic rows of a comparison: differences between rules are known, and several rules give the same.

SCENARIOS = ("one", "two", "three")
RULES = {"alone": 0.0, "greedy": 0.02, "exact": 0.02, "cooperative": 0.08}
"""What each rule adds to the effort over plan; two of them the same."""


def comparison_table(
    controllers: tuple[str, ...] = ("cut-and-ramp", "mpc"),
    seeds: int = 4,
    scenarios: tuple[str, ...] = SCENARIOS,
) -> pd.DataFrame:
    """Every rule adds its own share of effort, and ten times as much damage [kJ] in per cent; the MPC meets one seed."""
    noise = np.random.default_rng(5)
    rows = []
    for k, scenario in enumerate(scenarios):
        for controller in controllers:
            for seed in range(1 if controller == "mpc" else seeds):
                base = 0.8 + 0.03 * k + 0.01 * noise.standard_normal()
                for rule, more in RULES.items():
                    effort = base + more + (0.002 * noise.standard_normal() if more > 0.05 else 0.0)
                    rows.append({
                        "scenario": scenario, "rule": rule, "controller": controller, "seed": seed, "status": "ok",
                        "reason": "", "cell": f"{scenario}/{rule}/{controller}/{seed}", "effort_ratio": effort,
                        "bound_use": effort, "utilisation": effort, "damage": 100.0 + 1000.0 * more, "jerk_rms": 0.2 - more,
                        "over_delivery": 0.02 if (scenario, rule) == ("two", "greedy") else 0.0,
                    })  # fmt: skip
    return pd.DataFrame(rows)


# Synthetic tables of the sweep `learning`, on which it is known what holds.


def synthetic(error, effort=None, slip=None, excess=0.0, trains=6, stations=4):
    """A table in which the error after each station is `error(arm, station)`; a little noise keeps intervals open."""
    noise = np.random.default_rng(3)
    effort, slip = effort or {}, slip or {}
    rows = []
    for kind in KINDS:
        for train in range(trains):
            for direction in DIRECTIONS:
                for arm in ARMS:
                    for station in range(1, stations + 1):
                        little = 1e-5 * float(noise.normal())
                        biased = excess if ARMS[arm].reference == "received" else 0.0
                        rows.append({
                            **kind._asdict(), "train": train, "direction": direction,
                            "arm": arm, "station": station, "error": error(arm, station) + abs(little),
                            "bias": little, "covered": 1.0, "deviation": 0.005,
                            "effort_ratio": 0.9 + effort.get(arm, 0.0) + little,
                            "slip_time": 10.0 + slip.get(arm, 0.0) + little, "damage": 50.0 + little,
                            "unit_detections": 8.0, "rear_detections": 4.0,
                            "data": 4.0, "excess": biased + little,
                        })  # fmt: skip
    return pd.DataFrame(rows)


def falling(arm, station):
    """Learners halve the error from station to station, the others keep it."""
    return 0.02 if arm in ("no learning", "truth", "truth, held") else 0.02 * 0.3**station


# Synthetic tables of the readhesion paper's sweep and of its calibration, on which it is known what holds.


def limit_of(margin: float, width: float) -> float:
    """Limit adhesion coefficient of the synthetic controller, off the grid; none from a_w = 0.6 on."""
    return 0.0903 + 0.02 * margin + 0.1 * width if width < 0.59 else np.inf


def index_rows(limit=limit_of, limits=PAPER_LIMITS) -> pd.DataFrame:
    """Indices as the paper found them: a half-slip at 0.16, more adhesion used with a larger a_w."""
    rows = []
    for margin, width in grid_tables(PAPER_MARGINS, PAPER_WIDTHS):
        for mu in limits:
            possible = mu >= limit(margin, width)
            used = mu * (0.95 + 0.02 * width) + 0.001 * margin if possible else 0.8 * mu
            half = abs(mu - 0.16) < 1e-9 and 0.15 < width < 0.35
            rows.append(
                {
                    "margin": margin,
                    "width": width,
                    "limit": mu,
                    "possible": possible,
                    "used_coefficient": 0.13 if half else used,
                    "utilisation": (0.13 if half else used) / mu,
                    "longest_slip": 2.0 if half else 0.3 if possible else 8.0,
                }
            )
    return pd.DataFrame(rows)


def sweep_table(narrow_limit=limit_of, monotone: bool = True) -> pd.DataFrame:
    """A whole table of the sweep `readhesion`; the narrow parabola may have limits of its own.

    Two members in each unit do as the set in use does. Downhill a_0 of case A lacks room in both units.
    """
    parts: list[pd.DataFrame] = []
    for name, limit in ((readhesion.PRINTED, limit_of), (readhesion.NARROW, narrow_limit)):
        limits = pd.DataFrame(grid_tables(), columns=["margin", "width"])
        values = [limit(m, w) for m, w in zip(limits["margin"], limits["width"], strict=True)]
        limits["limit_coefficient"] = np.where(np.isfinite(values), values, np.nan)
        limits["monotone"] = monotone | (np.arange(len(limits)) > 0)
        both = pd.concat([index_rows(limit).assign(part="indices"), limits.assign(part="limit")])
        parts.append(both.assign(parabola=name))
    cases = [name for name in CLAIMS if name[:2] in ("A ", "B ") or name == "slips at the drop"]
    parts.append(
        pd.DataFrame(
            {"part": "case", "finding": cases, "met": True, "quantity": "number", "value": 1.0}
        )
    )
    printed = [
        part
        for part in parts
        if "parabola" not in part or (part["parabola"] == readhesion.PRINTED).all()
    ]
    parts += [
        part.drop(columns="parabola", errors="ignore").assign(unit=unit, member=k)
        for unit in UNITS
        for k in range(2)
        for part in printed
    ]
    hills = pd.DataFrame(
        product(UNITS, PAPER_MARGINS, GRADIENTS), columns=["read_in", "margin", "gradient"]
    )
    gravity = -0.04 * hills["gradient"]
    kept = 1.0 - 0.3 * (gravity - hills["margin"]).clip(lower=0.0)
    hills = hills.assign(part="downhill", gravity=gravity, kept=kept, expected=kept, slip=0.3)
    return pd.concat([*parts, hills], ignore_index=True)


def calibration_table(samples: int = 40) -> pd.DataFrame:
    """Sets drawn as ever; those with T_u < 2 s in km/h/s meet all findings but the half-slip's."""
    rows = []
    for unprinted in draw(samples, 0):
        row = {name: getattr(unprinted, name) for name in (*RANGES, "unit")}
        good = unprinted.rise < 2.0 and unprinted.unit == "km/h/s"
        met = {name: good and name not in NOT_ASKED_OF_ALL for name in CLAIMS}
        rows.append(
            {
                **row,
                "objective": (2.0 if good else 10.0) + abs(unprinted.rise - 1.0),
                "met": sum(met.values()),
                **{f"met: {name}": value for name, value in met.items()},
                "stage": "wide",
            }
        )
    rows[0]["stage"] = "assumed"
    return pd.DataFrame(rows).assign(seed=0, samples=samples)


# A table of the sweep `sanders` in which the trial comes out and sharing by sand helps where sand lies far back.

BEST = "axles 1 and 5 of each unit"
REAR = "axle 1 of car 5"


def sander_table(events: int = 12, best: float = 0.95, gain: float = 0.1) -> pd.DataFrame:
    """Rows as the study makes them: `best` at `BEST` over the usual placement, `gain` of sharing at `REAR`."""
    rows = [
        {"part": "trial", "kind": kind, "units": units, "curve": curve, "distance": 1.02 * metres}
        for units, curve in TRIALS
        for kind, metres in DISTANCES.items()
    ]
    rows += [
        {"part": "pair", "first": a, "second": b, "distance": 400.0 + 10.0 * a + 5.0 * b}
        for a in range(CARS)
        for b in range(a, CARS)
    ]
    noise = np.random.default_rng(0)
    for k in range(events):
        metres = 400.0 * (1.0 + 0.1 * noise.standard_normal())
        for place in PLACEMENTS:
            ratio = {USUAL: 1.0, BEST: best, REAR: 1.3}.get(place, 1.1)
            for sharing in SHARINGS:
                less = gain if (place, sharing) == (REAR, SHARINGS[1]) else 0.0
                own = 0.002 * noise.standard_normal() * (place != USUAL)
                rows.append({"part": "placement", "event": k, "placement": place, "sharing": sharing,
                             "distance": metres * (ratio - less + own), "damage": 2000.0, **EVENTS.draw(0, k)})  # fmt: skip
    return pd.DataFrame(rows).assign(status="ok")


# A table of the sweep `slide-protection` in which everything is as the source prints, made by hand.

SLIP = {f"slip_{i + 1}": 0.08 - 0.004 * i - 0.002 * (i % 2) for i in range(12)}
MEASURES = {"locked_time": 0.0, "air": 300.0, "time_outs": 0.0, "computing": 4.0, **SLIP}
AS_PRINTED = {
    **{f"distance {cars}": metres for cars, metres in TABLE_3.items()},
    "Q medium": 1518.0,
    "Q low": 1.10,
    "Q high": 0.346,
    "longer high": 1.9,
    "longer low": -0.08,
    "locked": 0.0,
    "time-outs": 0.0,
    "slides": 0.0,
}


def slide_table(members: int = 3) -> pd.DataFrame:
    """Rows as `studies.slides.study` makes them; every member runs as the set in use does."""
    rows = [*set_rows(("tables", "halved"))]
    noise = np.random.default_rng(0).standard_normal(8)
    rows += [{"part": "jitter", **AS_PRINTED, "distance 3": TABLE_3[3] + 0.02 * x} for x in noise]
    for k in range(members):
        rows += [{"member": k, **row} for row in (*set_rows(("tables",)), *member_rows())]
        rows.append({"part": "held out", **AS_PRINTED, "distance 2": 413.0 + 0.1 * k})
    return pd.DataFrame(rows)


def set_rows(parts: tuple[str, ...]) -> list[dict]:
    """Stops of one set."""
    rows = []
    for part in parts:
        for cars, metres in TABLE_3.items():
            rows.append({"part": part, "cars": cars, "setting": "medium", "distance": metres,
                         "damage": 1518.0 if cars == 3 else 900.0, **MEASURES})  # fmt: skip
        for setting in ("low", "high"):
            metres, damage = TABLE_4[setting]
            rows.append({"part": part, "cars": 3, "setting": setting, "distance": metres,
                         "damage": damage, **MEASURES})  # fmt: skip
    for value in SENSITIVITIES:
        damage = 1518.0 * value**-0.7
        metres = 385.0 + 0.9 * (1518.0 / damage) ** 2
        rows.append({"part": "pareto", "cars": 3, "sensitivity": value, "distance": metres,
                     "damage": damage, **MEASURES})  # fmt: skip
    for hold, release in THRESHOLDS:
        rows.append({"part": "threshold", "cars": 3, "hold": hold, "release": release,
                     "distance": 395.0, "damage": 4e4 * hold, **MEASURES})  # fmt: skip
    rows.append({"part": "none", "cars": 3, "distance": 383.0, "damage": 21e3,
                 **(MEASURES | {"locked_time": 160.0})})  # fmt: skip
    for group, controller in electric_tasks():
        held = controller == "mpc"
        rows.append({"part": "electric", "cars": 3, "group": group, "controller": controller,
                     "distance": 384.0 if held else 470.0, "damage": 900.0,
                     "reference_error": 0.4})  # fmt: skip
    return rows


def member_rows() -> list[dict]:
    """What a member has beside its stops."""
    stops = [
        {"part": "beyond", "stop": name, "stopped": True, "distance": 400.0, "damage": 900.0}
        for name in STOPS
    ]
    noise = [{"part": "noise", "noise": size, **AS_PRINTED} for size in NOISES]
    return [{"part": "member", **asdict(CALIBRATED), **AS_PRINTED}, *noise, *stops]
