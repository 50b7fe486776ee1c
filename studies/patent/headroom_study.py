"""What sharing gains where there is something to gain: every rule meets the same random events with headroom."""

from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.use import train_bounds
from alloc.plant.model import structure_of
from studies.core import drawn_events as shared
from studies.core.claims import AT_LEAST, AT_MOST, Claim, family, quantity
from studies.core.drawn_events import (
    COMPARED,
    DrawnEvents,
    Quantity,
    complete,
    in_turn,
    one_of,
    paired,
    uniform,
)
from studies.core.job import Job, check_controller, is_hosted
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, POINTS, Statement, in_words
from studies.core.study import EachEvent, Study
from studies.scenario.scenario import Scenario, shipped_scenario

# The random events with headroom: what is drawn, and their scenarios. Units find more and less than the plan asks.

DURATION = 12.0
"""Length of an event [s]; at its end the motors still reach the plan."""
BELIEVED_SLOPE = 0.0083 / 0.07
"""Slope of the increments that every train believes in, over its plan: JP5484215 (15), in proportion."""
SPREAD_OF_GROWTH = 0.1
"""Headroom over the growth from the first axle to the last, where it is logarithmic and the mean meets the plan."""
STRONGEST = 0.75
"""Strongest growth over the plan: the first axle finds a bit less than half of it."""
FAR = 1e4
"""Beyond every train [m]."""
TRAINS: dict[str, tuple[str, dict[str, Any]]] = {
    "8 cars, 4 units": ("wet-start", {"inverter_group": "1C4M"}),
    "16 cars, 14 units": ("wet-start", {"train": "high-speed-16car", "command": [
        {"time_s": 0.0, "acceleration_kmhs": 2.2}]}),
    "8 cars, 16 units": ("wet-start", {"inverter_group": "1C1M"}),
    "locomotive, 6 units": ("freight-start", {}),
    "8 cars, 8 units": ("wet-start", {"inverter_group": "1C2M"}),
}  # fmt: skip
"""Train -> the shipped scenario whose train and command it has, and the changes to it. The 16 cars are asked for less than
2.6 km/h/s, at which motors have a reserve of a tenth."""
SOURCES = ("growth", "bad front", "bad rear", "failed motors")
"""What makes most of the headroom."""
WANTED = ((0.0, 0.015), (0.025, 0.05), (0.065, 0.10), (0.10, 0.18))
"""Headroom that the source is to make, by class; a train that moves over the rail meets less."""

QUANTITIES: dict[str, Quantity] = {
    "train": in_turn(
        list(TRAINS), "each of five in its turn",
        "few units and many, trailers between them or none, a torque for four axles, for two, for one",
    ),
    "wanted": Quantity(
        f"uniform in each of {', '.join(f'{a:g} ... {b:g}' for a, b in WANTED)}, each for five events in its turn",
        "small and large headroom alike; the random events of the claims have 0.0014 in the median",
        lambda g, d: float(g.uniform(*WANTED[d["number"] // len(TRAINS) % len(WANTED)])),
    ),
    "source": one_of(
        SOURCES,
        "growth along the train 40 %, bad rail in front, bad rail at the rear, failed motors 20 % each",
        "JP5484215 (15); a shower or leaves that begin below the train; rail cleaned or sanded as far as there",
        [0.4, 0.2, 0.2, 0.2],
    ),
    "growth": uniform(
        -0.05, 0.2, " of the plan from the first axle to the last, where something else makes the headroom",
        "JP5484215 (15): 0.0083 ln 16 where the plan needs 0.07 is a third",
    ),
    "border": uniform(0.1, 0.9, " of the train's length behind its head", "where good and bad rail meet at the start"),
    "failed_place": uniform(0.0, 1.0, " of the units, from the front", "any unit may fail"),
    "failed_at_s": uniform(1.0, 5.0, " s", "before and after the torque is up"),
    "level_ratio": uniform(
        0.96, 1.06, " times the plan's coefficient, on the mean of the driven axles",
        "the train as a whole reaches the plan or nearly so: where it is far above or below, nothing can be gained",
    ),
    "demand": uniform(0.85, 1.0, " of the usual acceleration", "motors have 17 to 70 % in hand"),
    "curve": one_of(
        shared.TWO_PEAKS,
        "piecewise and Polach's of wet rail, equally likely",
        "a narrow peak and a wide one; the train believes in the narrow one",
    ),
    "residual_ratio": shared.RESIDUAL_RATIO,
    "scatter_share": shared.SCATTER_SHARE,
    "conditioning": shared.CONDITIONING,
    "patch_factor": shared.BAD_PATCH,
    "patch_start_m": uniform(5.0, 30.0, " m", "met during the event"),
    "patch_length_m": uniform(10.0, 60.0, " m", "half a car to three cars"),
    "load_t": uniform(0.0, 6.0, " t per car on the mean (not the locomotive's train)", "motors reach the plan throughout"),
    "tilt": shared.TILT,
    "load_error": shared.LOAD_ERROR,
    "speed_noise_kmh": shared.SPEED_NOISE,
    "telegram_loss": shared.TELEGRAM_LOSS,
    "grade_permille": shared.UPHILL,
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("headroom", QUANTITIES, stream=(14,), numbered=True)
draw, event_name = EVENTS.draw, EVENTS.event_name


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]."""
    d = draw(seed, k)
    base, changes = TRAINS[d["train"]]
    start = shipped_scenario(base).changed(**changes)
    asked = d["demand"] * start.command[0].acceleration_kmhs
    loaded = start.changed(
        **({} if start.load_t is not None else {"load_t": shared.tilted_loads(d, _cars(start))})
    )
    event = loaded.event()
    plan = event.equipment.planned_share * asked / 3.6
    mean = plan * d["level_ratio"]
    fails = d["source"] == "failed motors"
    if fails:
        mean *= 1.0 + 1.3 * d["wanted"]
    train = event.model.train
    rail = shared.rail_offering(shared.drawn_curve(d["curve"], d), mean, shared.START_SPEED, train)
    # a curve makes of the increments what it makes of the coefficient at rest
    plan_at_rest = plan * rail["level"] / mean
    growth = d["growth"]
    if d["source"] == "growth":
        growth = min(d["wanted"] / SPREAD_OF_GROWTH, STRONGEST)
    structure = structure_of(train)[0]
    units = int(structure.axle_unit.max()) + 1
    increments = tuple((plan_at_rest * growth * _growth(structure.axle_unit)).tolist())
    length = sum(car.length for car in train.cars)
    return shared.drawn_scenario(
        loaded, event_name(seed, k), f"random event {k} with headroom", duration,
        rail
        | {"increments": {"law": "given", "values": increments}, "conditioning": d["conditioning"]}
        | shared.uneven(d["scatter_share"] * plan, *_sides(d, length), shared.drawn_patch(d)),
        d,
        target_speed_kmh=None,
        command=[{"time_s": 0.0, "acceleration_kmhs": asked}],
        failures=[{"unit": int(d["failed_place"] * units) + 1, "time_s": d["failed_at_s"]}] if fails else [],
        line=shared.graded(d, -FAR),
        belief={
            "curve": {"kind": "piecewise"},
            "increments": {"law": "logarithmic", "slope": BELIEVED_SLOPE * plan, "offset": 0.0},
        },
    )  # fmt: skip


@cache
def _cars(start: Scenario) -> int:
    return len(start.event().model.train.cars)


def _growth(axle_unit: NDArray[np.int64]) -> NDArray[np.float64]:
    """Logarithmic growth along the train by 1 from the first axle to the last, 0 on the mean of the driven axles."""
    grown = np.log(np.arange(1.0, axle_unit.size + 1.0)) / np.log(axle_unit.size)
    centred: NDArray[np.float64] = grown - grown[axle_unit >= 0].mean()
    return centred


def _sides(d: dict[str, Any], length: float) -> tuple[shared.Keys | None, ...]:
    """Rail better and worse than the mean on either side of a place below the train."""
    if d["source"] not in ("bad front", "bad rear"):
        return ()
    spread = 2.0 * d["wanted"] * (1.0 if d["source"] == "bad front" else -1.0)
    border = -length * d["border"]
    return shared.stretch(1.0 + spread, -FAR, border), shared.stretch(1.0 - spread, border, FAR)


def measure(run: xr.Dataset) -> dict[str, float]:
    """plan_use: effort, instant by instant the plan at most, over the plan; `headroom` has the same scale."""
    found = train_bounds(run)
    return {"plan_use": float(np.minimum(found.force, found.plan).sum() / found.plan.sum())}


BASE, BOUND = "alone", "oracle"
"""What gains count from, and the rule under which an event's headroom is read: the train then is where it could be."""
SHARERS = ("uniform", "preset", "sharing", "greedy", "exact", "cooperative", "wear")
RULES = (BASE, *SHARERS, BOUND)
OWN = "cooperative"
"""This project's own rule, which has goals."""
NEEDED = (BASE, OWN, BOUND)
"""Rules that its goals are judged by; controllers that live in Python run no others."""

STRATA: Mapping[str, tuple[float, float]] = {
    "0 to 1 points": (-1.0, 0.01),
    "1 to 3 points": (0.01, 0.03),
    "3 to 5 points": (0.03, 0.05),
    "above 5 points": (0.05, 1.0),
}
"""Headroom above the first bound and up to the second, as a share of the plan."""
WORTH_SHARING = 0.01
"""Headroom above which a share of it is a number that says something."""
GOAL_OF_BOUND, GOAL_OF_HEADROOM, GOAL_OF_EXCESS = 0.995, 0.8, 0.005
"""Least use of the bound and least share of the headroom, most delivery beyond the plan."""

NUMBERS = (
    "bound_use", "held_back", "plan_use", "headroom", "over_delivery", "slip_time", "damage", "excess_damage",
    "jerk_rms",
)  # fmt: skip
COSTS = {
    "slip_time": "slip [axle s]",
    "damage": "wheel damage [kJ]",
    "jerk_rms": "jerk rms [m/s3]",
}
"""Metric -> what a statement calls it."""
METHOD = (
    f"paired by event; {INTERVALS_OF_MEANS}; share of headroom: ratio of means, linearised; {CONFIDENCE:.0%}, "
    "parts after Bonferroni; headroom as under the oracle with the same controller"
)
PERCENT = in_words("{:.2f} [{:.2f}, {:.2f}] %, n = {}", 100)


def pairs_of(table: pd.DataFrame, controller: str) -> pd.DataFrame:
    """One row per event under `controller`: what was drawn, every number as ``number@rule``, and its `headroom`."""
    own = table[table["controller"] == controller]
    wide = paired(own, "rule", NUMBERS, ("train", "source", "curve"))
    return wide.assign(headroom=wide[f"headroom@{BOUND}"])


def rules_of(events: pd.DataFrame) -> tuple[str, ...]:
    """Rules in the pairs of a controller."""
    return tuple(rule for rule in RULES if f"bound_use@{rule}" in events)


def _between(name: str) -> str:
    low, high = STRATA[name]
    return f"headroom > {low:g} and headroom <= {high:g}"


def in_stratum(events: pd.DataFrame, name: str) -> "pd.Series[bool]":
    """Events of a stratum."""
    found: pd.Series[bool] = quantity(events, _between(name))
    return found


BY_TRAIN_AND_PEAK = {
    **{name: f"train == '{name}'" for name in TRAINS},
    "a narrow peak (piecewise)": "curve == piecewise",
    "a wide peak (Polach)": "curve == polach",
}
PARTS = {f"headroom of {name}": _between(name) for name in STRATA} | BY_TRAIN_AND_PEAK


def more(rule: str, metric: str = "plan_use") -> str:
    """A metric of `rule` less that of alone."""
    return f"{metric}@{rule} - {metric}@{BASE}"


def gain(events: pd.DataFrame, rule: str, metric: str = "plan_use") -> "pd.Series[float]":
    """A metric of `rule` less that of alone, event by event."""
    return quantity(events, more(rule, metric)).astype(float)


def share_gained(rule: str) -> str:
    """The mean gain over the mean headroom, of events with a headroom that is worth sharing."""
    return f"{more(rule)} per headroom if headroom > {WORTH_SHARING}"


def _numbers(rule: str) -> dict[str, str]:
    return {
        "bound used": f"bound_use@{rule}",
        **{f"bound used, {name}": f"bound_use@{rule} if {_between(name)}" for name in STRATA},
        "bound used, alone": f"bound_use@{BASE}",
        "lost by controllers at the units they limit": f"held_back@{rule}",
        "left by the sharing": f"1 - bound_use@{rule} - held_back@{rule}",
        f"share of headroom gained, above {100 * WORTH_SHARING:g} point": share_gained(rule),
        **{f"gain over plan, {name}": f"{more(rule)} if {_between(name)}" for name in STRATA},
        "delivered beyond the plan": f"over_delivery@{rule}",
        "wheel damage beyond the least of the same effort": f"excess_damage@{rule}",
        **{f"{text}, less alone": more(rule, metric) for metric, text in COSTS.items()},
    }


def claims_of(controller: str, rules: Iterable[str] = RULES) -> list[Claim]:
    """What is claimed under a controller: what each of these rules gains, and the goals of this project's own."""
    gains = [
        Claim(
            f"{rule}, {controller}", f"{rule} delivers more of the plan than alone under {controller}", more(rule),
            reason="sharing is there to deliver more", parts=PARTS, show=POINTS, numbers=_numbers(rule), method=METHOD,
        )
        for rule in rules if rule in SHARERS
    ]  # fmt: skip
    costs = [
        Claim(f"{COSTS[metric]}, less alone", mean=more(OWN, metric), side=AT_MOST,
              reason="what is won is not paid for elsewhere")
        for metric in ("slip_time", "damage")
    ]  # fmt: skip
    excess = Claim(
        "delivery beyond the plan", mean=f"over_delivery@{OWN}", side=AT_MOST, value=GOAL_OF_EXCESS,
        reason="what exceeds the plan is no use of the bound",
    )  # fmt: skip
    return [
        *gains,
        Claim(
            f"bound, {controller}",
            f"{OWN} uses {GOAL_OF_BOUND:.1%} of the bound under {controller}, at no more slip and wheel damage than alone",
            f"bound_use@{OWN}", AT_LEAST, GOAL_OF_BOUND, reason="goal of this project", parts=PARTS, show=PERCENT,
            besides=(*costs, excess), numbers=_numbers(OWN), method=METHOD,
        ),
        Claim(
            f"headroom gained, {controller}",
            f"{OWN} gains {GOAL_OF_HEADROOM:.0%} of a headroom above {100 * WORTH_SHARING:g} point under {controller}",
            share_gained(OWN), AT_LEAST, GOAL_OF_HEADROOM, reason="goal of this project", parts=BY_TRAIN_AND_PEAK,
            show=PERCENT, method=METHOD,
            numbers={
                name: f"{more(OWN)} per headroom if {part} and headroom > {WORTH_SHARING}"
                for name, part in BY_TRAIN_AND_PEAK.items()
            },
        ),
    ]  # fmt: skip


def headroom_claims(controllers: Iterable[str] = COMPARED) -> list[Claim]:
    """What is claimed under these controllers."""
    return [claim for controller in controllers for claim in claims_of(controller)]


def headroom_statements(table: pd.DataFrame) -> list[Statement]:
    """Per controller: what each rule gains, and the goals of this project's own; all of them are one family."""
    found = {one: pairs_of(table, one) for one in dict.fromkeys(table["controller"])}
    return family(*((events, claims_of(one, rules_of(events))) for one, events in found.items()))


def cells(
    seed: int, k: int, duration: float = DURATION, controllers: Sequence[str] = COMPARED
) -> list[Job]:
    """Event `k` under every controller and rule; under a controller that lives in Python, under the rules of the goals."""
    for controller in controllers:
        check_controller(controller)
    one = scenario(seed, k, duration)
    return [
        Job(one, rule, controller, k, measure)
        for controller in controllers
        for rule in (NEEDED if is_hosted(controller) else RULES)
    ]


HEADROOM = Study(
    name="headroom",
    question="what each rule gains over alone by how much there is to gain, and what it costs",
    default_events=60,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: headroom_statements(complete(table)),
    claims=headroom_claims,
)
