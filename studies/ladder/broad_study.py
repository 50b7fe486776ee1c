"""Rules where nothing was tuned: a broad mixture of starts, pulls at speed and stops, with baselines that a rule must beat.

The events are those of other studies, one kind after another: starts with headroom, starts in any weather, starts on a rail
that changes, and blended stops. Drawn on top of that is what these leave out or draw narrowly: seven adhesion curves, kind
and lag of motors, speed, noise and lost telegrams. How much each kind counts is assumed, so results stand by stratum too.
"""

import math
from collections.abc import Callable, Iterable, Mapping, Sequence
from typing import Any

import pandas as pd

from alloc.plant.laws import hyperbolic_speed_law
from alloc.plant.model import offered_by
from alloc.plant.rail import SPEED_LAWS
from studies.core import drawn_events as shared
from studies.core.claims import AT_MOST, Claim, family
from studies.core.drawn_events import (
    COMPARED,
    START_SPEED,
    DrawnEvents,
    Quantity,
    complete,
    in_turn,
    log_uniform,
    one_of,
    paired,
    sometimes,
    uniform,
)
from studies.core.job import Job, check_controller, is_hosted
from studies.core.statement import INTERVALS_OF_MEANS, POINTS, Statement
from studies.core.study import EachEvent, Study
from studies.files.units import stated
from studies.ladder import effects_study
from studies.ladder import events as ladder_events
from studies.lines.named_files import TRAINS as TRAIN_FILES
from studies.patent import claim_events, headroom_study
from studies.scenario.scenario import Scenario
from studies.stops import blended_events

KINDS: Mapping[str, Callable[[int, int], Scenario]] = {
    "start with headroom": headroom_study.scenario,
    "start in any weather": claim_events.scenario,
    "start, rail changes": ladder_events.scenario,
    "stop": blended_events.scenario,
}
"""Kind of event -> the study's generator that draws it by seed and number."""
STOP = "stop"
SHORT = "start in any weather"
"""Kind whose train may be a short one."""
RAILCAR = str(TRAIN_FILES / "br-642.toml")
FASTEST = 120.0
"""Speed at which a stop begins at most [km/h]."""
FULL_EFFORT = 40.0
"""Speed [km/h] up to which motors reach the plan of a start. Beyond it the driver asks for less, as their power allows, and
the rail offers less in the same proportion: else it would not be short."""
GAINED = 36.0
"""Speed [km/h] that a start gains."""

QUANTITIES: dict[str, Quantity] = {
    "kind": in_turn(list(KINDS), "each of four in its turn", "assumed: no record says how often which occurs"),
    "curve": in_turn(
        blended_events.CURVES, "each of seven for four events in its turn (a stop draws its own of the same seven)",
        "every kind that ships; the train believes in the piecewise one", after=len(KINDS),
    ),
    **shared.SHAPE_QUANTITIES,
    "short": one_of(
        ("no", "yes"), "a railcar of two sections in half of the starts in any weather",
        "two units, in place of eight cars; other kinds have 6 to 16 cars",
    ),
    "speed_kmh": sometimes(
        0.4, 20.0, FASTEST, " km/h when the driver asks for effort (starts alone)", 0.0,
        "trains accelerate again after signals and speed restrictions",
    ),
    "motors": effects_study.QUANTITIES["kind"],
    "torque_lag_s": log_uniform(0.005, 0.1, " s", "the readhesion paper has 5 ms; 100 ms where commands pass a train bus"),
    "speed_noise_kmh": uniform(0.0, 0.1, " km/h", "to more than twice what the other studies draw"),
    "telegram_loss": uniform(0.0, 0.1, "", "to twice what the other studies draw"),
}  # fmt: skip
"""What is drawn beside the event itself, in the order of drawing."""
EVENTS = DrawnEvents("broad", QUANTITIES, stream=(53,), numbered=True)


def scenario(seed: int, k: int) -> Scenario:
    """Event `k`."""
    d = EVENTS.draw(seed, k)
    base = KINDS[d["kind"]](seed, k)
    onboard = base.onboard.model_dump(exclude_unset=True)
    onboard["sensors"] = onboard.get("sensors", {}) | {
        "speed_noise_kmh": stated("_kmh", d["speed_noise_kmh"])
    }
    onboard["telegrams"] = {"jitter_s": 0.03, "loss": stated("", d["telegram_loss"])}
    changes: dict[str, Any] = {
        "name": EVENTS.event_name(seed, k), "title": f"broad event {k}: {d['kind']}, {d['curve']}", "onboard": onboard,
        "motors": {"kind": d["motors"], "torque_lag_s": d["torque_lag_s"]},
    }  # fmt: skip
    if d["kind"] == STOP:
        speed = min(base.initial_speed_kmh, FASTEST)
        return base.changed(**changes, initial_speed_kmh=speed)
    if d["kind"] == SHORT and d["short"] == "yes":
        base = _on_railcar(base)
    slower = _share_of_power(d["speed_kmh"])
    command = [
        {"time_s": one.time_s, "acceleration_kmhs": slower * one.acceleration_kmhs} for one in base.command
    ]  # fmt: skip
    return base.changed(
        **changes, command=command, rail=_rail(base, d, slower), belief=_belief(base, slower),
        initial_speed_kmh=d["speed_kmh"], target_speed_kmh=None,
    )  # fmt: skip


def _share_of_power(speed: float) -> float:
    """Share x of a start's plan that motors reach from `speed` [km/h] on: x (speed + x `GAINED`) = `FULL_EFFORT`."""
    found = (math.sqrt(speed**2 + 4.0 * GAINED * FULL_EFFORT) - speed) / (2.0 * GAINED)
    return min(1.0, found)


def _on_railcar(base: Scenario) -> Scenario:
    """The same start by the railcar, asked for what needs the same coefficient."""
    plan = base.event().equipment.planned_share
    changed = base.changed(train=RAILCAR, load_t=None)
    ratio = plan / changed.event().equipment.planned_share
    command = [
        {"time_s": one.time_s, "acceleration_kmhs": ratio * one.acceleration_kmhs} for one in base.command
    ]  # fmt: skip
    return changed.changed(command=command)


def _rail(base: Scenario, d: Mapping[str, Any], share: float) -> dict[str, Any]:
    """The start's rail on the drawn curve: at the speed of the event it offers `share` of what the start's curve offers."""
    rail = base.rail.model_dump()
    key = "level" if rail["law_factor"] is None else "law_factor"
    model, level = base.event().model, rail[key]
    if key == "law_factor":
        level *= hyperbolic_speed_law(START_SPEED, *SPEED_LAWS[rail["speed_law"]])
    own = offered_by(model.rail.curve, level, START_SPEED, model.structure)
    speed = max(START_SPEED, d["speed_kmh"] / 3.6)
    found = shared.rail_offering(shared.drawn_curve(d["curve"], d), share * own, speed, model.train)
    scale = found["level"] / level
    rail |= {"curve": found["curve"], key: scale * rail[key], "scatter": scale * rail["scatter"]}
    rail["increments"] = _grown(rail["increments"], scale)
    return rail


def _belief(base: Scenario, share: float) -> dict[str, Any]:
    belief = base.belief.model_dump(exclude_unset=True) | {"curve": {"kind": "piecewise"}}
    if belief.get("increments"):
        belief["increments"] = _grown(belief["increments"], share)
    return belief


def _grown(increments: dict[str, Any], scale: float) -> dict[str, Any]:
    """Keys of increments in proportion to the level."""
    if increments.get("values") is not None:
        return increments | {"values": [scale * one for one in increments["values"]]}
    ends = ("slope", "offset")
    return increments | {
        name: scale * increments[name] for name in ends if increments.get(name) is not None
    }


BASE, BOUND = "alone", "oracle"
RULES = (BASE, "uniform", "erp", "greedy", "exact", "cooperative", "wear", BOUND)
"""Rules that every event meets."""
FEW = (BASE, "uniform", "cooperative", "wear", BOUND)
"""Those that it meets under a controller that lives in Python."""
WORSE = 0.003
"""Use of the bound lost from which on an event counts as worse."""
NUMBERS = (
    "bound_use",
    "over_delivery",
    "headroom",
    "slip_time",
    "damage",
    "excess_damage",
    "jerk_rms",
)
COSTS = headroom_study.COSTS
STRATA: Mapping[str, str] = {
    **{name: f"kind == '{name}'" for name in KINDS},
    "headroom above 1 %": f"headroom > {headroom_study.WORTH_SHARING}",
    "noise up to 0.05 km/h": "speed_noise_kmh <= 0.05",
    "noise above 0.05 km/h": "speed_noise_kmh > 0.05",
    "lag up to 22 ms": "torque_lag_s <= 0.022",
    "lag above 22 ms": "torque_lag_s > 0.022",
    "starts at speed": "speed_kmh > 0",
}
DRAWN = ("kind", "curve", "motors", "speed_kmh", "torque_lag_s", "speed_noise_kmh", "telegram_loss")
METHOD = f"paired by event; {INTERVALS_OF_MEANS}; after Holm over all claims"


def more(rule: str, metric: str = "bound_use") -> str:
    """A metric of `rule` less that of alone."""
    return f"{metric}@{rule} - {metric}@{BASE}"


def pairs_of(table: pd.DataFrame, controller: str) -> pd.DataFrame:
    """One row per event under `controller`: what was drawn, every number as ``number@rule``, and its `headroom`."""
    wide = paired(table[table["controller"] == controller], "rule", NUMBERS, DRAWN)
    return wide.assign(headroom=wide[f"headroom@{BOUND}"])


def rules_of(controller: str) -> tuple[str, ...]:
    """Rules that an event meets under a controller."""
    return FEW if is_hosted(controller) else RULES


def claims_of(controllers: Iterable[str] = COMPARED) -> list[Claim]:
    """Under each controller, each rule that a train can carry out uses more of the bound than alone."""
    return [_gains(rule, one) for one in controllers for rule in rules_of(one)[1:-1]]


def _gains(rule: str, controller: str) -> Claim:
    return Claim(
        f"{rule}, {controller}", f"{rule} uses more of the bound than alone under {controller}", more(rule),
        reason="a method that does not beat doing nothing is none", parts=STRATA, show=POINTS, method=METHOD,
        besides=(
            Claim("delivery beyond the plan", mean=f"over_delivery@{rule}", side=AT_MOST, value=0.01,
                  reason="what exceeds the plan is no use of the bound"),
        ),
        numbers={
            "bound used": f"bound_use@{rule}",
            "bound used, alone": f"bound_use@{BASE}",
            "bound used, oracle": f"bound_use@{BOUND}",
            "gain": more(rule),
            **{f"gain, {name}": f"{more(rule)} if {part}" for name, part in STRATA.items()},
            "share of events that are worse": f"{more(rule)} < -{WORSE}",
            "share of events that are better": f"{more(rule)} > {WORSE}",
            "delivered beyond the plan": f"over_delivery@{rule}",
            **{f"{text}, less alone": more(rule, metric) for metric, text in COSTS.items()},
        },
    )  # fmt: skip


def statements(table: pd.DataFrame) -> list[Statement]:
    """One statement per rule and controller; all of them are one family."""
    found = list(dict.fromkeys(table["controller"]))
    return family(*((pairs_of(table, one), claims_of([one])) for one in found))


def cells(seed: int, k: int, controllers: Sequence[str] = COMPARED) -> list[Job]:
    """Event `k` under every controller and its rules."""
    for controller in controllers:
        check_controller(controller)
    one = scenario(seed, k)
    return [Job(one, rule, name, k) for name in controllers for rule in rules_of(name)]


BROAD = Study(
    name="broad",
    question="what rules and baselines gain over alone where nothing was tuned: starts, pulls at speed and stops",
    default_events=28,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: statements(complete(table)),
    claims=claims_of,
)
