"""What each rule gains where there is something to gain: random starts in which units find more and less than the plan.

Headroom is what only sharing between units can reach, as a share of the plan. Here the growth of adhesion along the train,
rail that is better or worse below its front, or failed motors make it. It is read under the oracle with the same
controller: the train then is where it could be.
"""

from collections.abc import Iterable
from functools import cache, partial

import numpy as np
import pandas as pd
import xarray as xr

from alloc.metrics import Run
from alloc.train_rows import rows_of
from studies import events as e
from studies.claims import CONTROLLERS, table_of
from studies.core import Row, Study
from studies.runs import complete, crossed, paired, run
from studies.scenario import Scenario, load
from studies.statistics import Claim, Numbers, Statement, judge, linearised

BASE, OWN, BOUND = "alone", "cooperative", "oracle"
"""What gains count from; this project's own rule, which has goals; the rule under which headroom is read."""
SHARERS = ("uniform", "preset", "sharing", "greedy", "exact", OWN, "wear")

# the events

DURATION = 12.0
"""Length [s]; at its end the motors still reach the plan."""
BELIEVED = 0.0083 / 0.07
"""Slope of the increments that trains believe in, over the plan: JP5484215 (15), in proportion."""
FAR = 1e4
"""Beyond every train [m]."""
_GENTLE = [{"time_s": 0.0, "acceleration_kmhs": 2.2}]
"""Sixteen cars are asked for less than 2.6 km/h/s, at which motors have a reserve of a tenth."""
TRAINS: dict[str, tuple[str, e.Keys]] = {
    "8 cars, 4 units": ("wet-start", {"inverter_group": "1C4M"}),
    "16 cars, 14 units": ("wet-start", {"train": "high-speed-16car", "command": _GENTLE}),
    "8 cars, 16 units": ("wet-start", {"inverter_group": "1C1M"}),
    "locomotive, 6 units": ("freight-start", {}),
    "8 cars, 8 units": ("wet-start", {"inverter_group": "1C2M"}),
}
"""Train -> the scenario whose train and command it has, and the changes to it."""
WANTED = ((0.0, 0.015), (0.025, 0.05), (0.065, 0.10), (0.10, 0.18))
"""Headroom that its source is to make, by class; a train that moves over the rail meets less."""
SOURCES = ("growth", "bad front", "bad rear", "failed motors")


@cache
def draw(seed: int, k: int) -> e.Keys:
    """What is drawn for event `k`. Trains take turns, and so do classes of headroom, each for five events."""
    g = e.Draw(seed, k, 14)
    return {
        "train": list(TRAINS)[k % 5],
        "wanted": g.uniform(*WANTED[k // 5 % 4]),
        "source": g.one_of(SOURCES, [0.4, 0.2, 0.2, 0.2]),
        # of the plan from the first axle to the last, where something else makes the headroom
        "growth": g.uniform(-0.05, 0.2),
        "border": g.uniform(0.1, 0.9),  # where good and bad rail meet, of the train's length
        "failed_place": g.uniform(0.0, 1.0),  # any unit may fail
        "failed_at_s": g.uniform(1.0, 5.0),  # before and after the torque is up
        "level_ratio": g.uniform(0.96, 1.06),  # times the plan: far from it nothing can be gained
        "demand": g.uniform(0.85, 1.0),  # motors have 17 to 70 % in hand
        # a narrow peak, in which trains believe; a wide one
        "curve": g.one_of(("piecewise", "polach")),
        "residual_ratio": g.uniform(0.5, 0.9),
        "scatter_share": g.sometimes(0.5, 0.01, 0.06, 0.0),
        "conditioning": g.sometimes(0.4, 0.05, 0.3, 0.0),  # wheels that slip clean the rail
        "patch_factor": g.sometimes(0.3, 0.6, 0.9, 1.0),
        "patch_start_m": g.uniform(5.0, 30.0),
        "patch_length_m": g.uniform(10.0, 60.0),
        **g.signals_of_start(6.0),
    }


def event(seed: int, k: int) -> Scenario:
    """Event `k`."""
    d = draw(seed, k)
    base, changes = TRAINS[d["train"]]
    start = load(base).changed(**changes)
    asked = d["demand"] * start.command[0].acceleration_kmhs
    if start.load_t is None:
        start = start.changed(load_t=e.loads(d, len(start.event().train.cars)))
    train, fails = start.event().train, d["source"] == "failed motors"
    rows = rows_of(train)
    plan, unit = float(rows.plant["planned"]) * asked / 3.6, rows.axles.unit
    offered = plan * d["level_ratio"] * (1.0 + 1.3 * d["wanted"] if fails else 1.0)
    rail = e.offering(e.curve(d["curve"], d), offered, train)
    failed = int(d["failed_place"] * rows.units.size) + 1
    # ten points of growth make one of headroom; at 0.75 the first axle finds less than half of the plan
    growth = min(d["wanted"] / 0.1, 0.75) if d["source"] == "growth" else d["growth"]
    grown = np.log(np.arange(1.0, unit.size + 1.0)) / np.log(unit.size)
    # a curve makes of the increments what it makes of the coefficient at rest
    increments = plan * rail["level"] / offered * growth * (grown - grown[unit >= 0].mean())
    length = sum(car.length for car in train.cars)
    rail |= {
        "increments": {"law": "given", "values": increments.tolist()},
        "conditioning": d["conditioning"],
        "scatter": d["scatter_share"] * plan,
        "scatter_length_m": 20.0,
        "patches": [*_sides(d, length), *e.patch(d)],
    }
    believed = {"law": "logarithmic", "slope": BELIEVED * plan, "offset": 0.0}
    return e.drawn(
        start,
        f"headroom-{seed}-{k:04d}",
        f"random event {k} with headroom",
        duration_s=DURATION,
        target_speed_kmh=None,
        rail=rail,
        onboard=e.signals(d),
        command=[{"time_s": 0.0, "acceleration_kmhs": asked}],
        failures=[{"unit": failed, "time_s": d["failed_at_s"]}] if fails else [],
        line=e.line(d, -FAR),
        belief={"curve": {"kind": "piecewise"}, "increments": believed},
    )


def _sides(d: e.Drawn, length: float) -> list[e.Keys]:
    """Rail better and worse than the mean on either side of a place below the train."""
    if d["source"] not in ("bad front", "bad rear"):
        return []
    spread = 2.0 * d["wanted"] * (1.0 if d["source"] == "bad front" else -1.0)
    border = -length * d["border"]
    return e.stretch(1.0 + spread, -FAR, border) + e.stretch(1.0 - spread, border, FAR)


def measure(found: xr.Dataset) -> Row:
    """plan_use: effort, instant by instant the plan at most, over the plan; the metric headroom has the same scale."""
    bound = Run(found).bounds
    return {"plan_use": float(np.minimum(bound.force, bound.plan).sum() / bound.plan.sum())}


DRAWN = ("train", "source", "curve")


# what comes out

GOAL, SHARE, EXCESS = 99.5, 80.0, 0.5
"""Goals: use of the bound [%], share of the headroom gained [%], most delivery beyond the plan [% of it]."""
WORTH = 1.0
"""Headroom [points of the plan] above which a share of it says something."""


def pairs(rows: pd.DataFrame, controller: str, rule: str, _: Iterable[str] = ()) -> pd.DataFrame:
    """One row per event: `room`, the headroom, `gain` over `BASE` [points of the plan], `left`, see `USE`, and `gained`.

    This is the share [%] of the headroom: values whose mean is all gains over all headrooms.
    """
    own = paired(rows, controller, rule, (BASE, BOUND), DRAWN)
    room = 100.0 * own[f"headroom_{BOUND}"]
    gain = 100.0 * (own["plan_use"] - own[f"plan_use_{BASE}"])
    worth = (room > WORTH) & (rule in SHARERS)
    gained = 100.0 * linearised(gain[worth], room[worth])
    left = 1.0 - own["bound_use"] - own["held_back"]
    return own.assign(room=room, gain=gain, gained=gained, left=left)


def parts_of(own: pd.DataFrame) -> dict[str, "pd.Series[bool]"]:
    """Events by headroom, train, and width of the curve's peak."""
    classes = ("up to 1 point", "of 1 to 3 points", "of 3 to 5 points", "above 5 points")
    rooms = pd.cut(own["room"], [-np.inf, 1.0, 3.0, 5.0, np.inf], labels=list(classes))
    peaks = {"a narrow peak": "piecewise", "a wide peak": "polach"}
    return {
        **{f"headroom {name}": rooms == name for name in classes},
        **{name: own["train"] == name for name in TRAINS},
        **{name: own["curve"] == kind for name, kind in peaks.items()},
    }


def statements(rows: pd.DataFrame) -> list[Statement]:
    """What each rule gains, and the goals of this project's own; one family."""
    good, claims = complete(rows), []
    for law in CONTROLLERS:
        for rule in SHARERS:
            own = pairs(good, law, rule)
            text = "delivers more than alone: effort up to the plan [points of plan]"
            parts = parts_of(own)
            claims.append(Claim(f"{rule}, {law}", text, own["gain"], 0.0, parts=parts, digits=2))
        own = pairs(good, law, OWN)
        slip, damage = (own[name] - own[f"{name}_{BASE}"] for name in ("slip_time", "damage"))
        over = 100.0 * own["over_delivery"]
        besides = [
            Claim("", "slip over alone [axle s]", slip, most=0.0, digits=2),
            Claim("", "wheel damage over alone [kJ]", damage, most=0.0, digits=2),
            Claim("", "beyond the plan [% of it]", over, most=EXCESS, digits=2),
        ]
        text, used = f"uses {GOAL:g} % of the bound, at no cost: bound used [%]", own["bound_use"]
        claims.append(Claim(f"{OWN}, {law}: bound", text, 100.0 * used, GOAL,
                            parts=parts_of(own), besides=besides, digits=2))  # fmt: skip
        text = f"gains {SHARE:g} % of headrooms above one point: share gained [%]"
        claims.append(Claim(f"{OWN}, {law}: headroom", text, own["gained"], SHARE, digits=1))
    return judge(claims)


USE: Numbers = {
    "bound used [%]": ("bound_use", 1, 100.0),
    "left by the sharing [%]": ("left", 1, 100.0),
    "beyond the plan [%]": ("over_delivery", 2, 100.0),
    "Q over the least at this effort [%]": ("excess_damage", 1, 100.0),
    "headroom gained [%]": ("gained", 1, 1.0),
}
"""What the sharing leaves of the bound is what units miss that no controller limits."""
COSTS: Numbers = {"slip [axle s]": ("slip_time", 1, 1.0), "wheel damage Q [kJ]": ("damage", 0, 1.0)}


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Per controller and rule: use of the bound, share of the headroom, and what it costs, less that of alone."""
    pair, rules = partial(pairs, complete(rows)), {"": (BASE,), BASE: (*SHARERS, BOUND)}
    verdict = "delivers more than alone", "{0}, {2}", statements(rows)
    return table_of(rules, pair, USE, COSTS, verdict)


QUESTION = "What does each rule gain where there is something to gain, and what does it cost?"
cells = crossed(event, draw, DRAWN, (BASE, *SHARERS, BOUND), CONTROLLERS, measure)
STUDY = Study("headroom", QUESTION, cells, run, table, statements=statements, events=300, seed=200)
