"""Rules and baselines where nothing was tuned: a broad mixture of starts, pulls at speed and blended stops.

The events are those of four studies, one kind after another. Drawn on top of them is what these leave out or draw narrowly:
seven adhesion curves, kind and lag of motors, speed, noise, lost telegrams, a short train. That each kind counts a quarter
is assumed, so results stand by kind too.
"""

import math
from collections.abc import Callable
from itertools import product
from pathlib import Path

import pandas as pd
from matplotlib.figure import Figure

from alloc.laws import speed_law
from alloc.rail import SPEED_LAWS
from alloc.rules import RULES
from alloc.train_rows import offered_by
from studies import braking, claims, headroom, ladder
from studies import events as e
from studies.core import WIDE, Row, Study
from studies.headroom import BASE, BOUND, COSTS
from studies.runs import complete, crossed, paired, run
from studies.scenario import Increments, Scenario
from studies.statistics import Claim, Statement, forest, judge, mean, means, share

CONTROLLERS = (*claims.CONTROLLERS, "mpc")
ARMS = (BASE, "uniform", "erp", "greedy", "exact", "cooperative", "wear", BOUND)
RULES_OF_TRAINS = ARMS[1:-1]
"""Those that a train can carry out, and that share."""

# the events

WEATHER, STOP = "start in any weather", "stop"
KINDS: dict[str, Callable[[int, int], Scenario]] = {
    "start with headroom": headroom.event,
    WEATHER: claims.event,
    "start, rail changes": ladder.event,
    STOP: braking.stop,
}
RAILCAR = str(Path(__file__).with_name("broad_railcar.toml"))
"""Two sections on three bogies: two units, in place of eight cars in half of the starts in any weather."""
FASTEST = 120.0
"""Speed [km/h] at which an event begins at most."""
FULL_EFFORT, GAINED = 40.0, 36.0
"""Speed [km/h] up to which motors reach the plan of a start, and speed that a start gains."""


def draw(seed: int, k: int) -> e.Keys:
    """What is drawn for event `k` on top of the event of its kind; kinds and curves take turns."""
    g = e.Draw(seed, k, 53)
    return {
        "kind": list(KINDS)[k % 4],
        "curve": braking.CURVES[k // 4 % 7],  # a stop draws its own of the same seven
        "residual_ratio": g.uniform(0.3, 0.98),  # steep to flat behind the peak
        "peak_slip": g.log_uniform(0.03, 0.8),  # the slips that a search is bound to
        "peak_slip_ratio": g.log_uniform(0.01, 0.1),
        "steepness": g.log_uniform(1.5, 20.0),  # as the piecewise curve to as Polach's
        "short": g.one_of(("no", "yes")),
        # trains accelerate again after signals and speed restrictions
        "speed_kmh": g.sometimes(0.4, 20.0, FASTEST, 0.0),
        # a third of the trains control every motor, the others have several on one frequency
        "motors": g.one_of(("torque", "induction", "induction")),
        # 5 ms in the readhesion paper, 100 ms where commands pass a train bus
        "torque_lag_s": g.log_uniform(0.005, 0.1),
        "speed_noise_kmh": g.uniform(0.0, 0.1),  # to more than twice what other studies draw
        "telegram_loss": g.uniform(0.0, 0.1),  # to twice
    }


def event(seed: int, k: int) -> Scenario:
    """Event `k`."""
    d = draw(seed, k)
    base = KINDS[d["kind"]](seed, k)
    changes: e.Keys = {
        "name": f"broad-{seed}-{k:04d}",
        "title": f"broad event {k}: {d['kind']}, {d['curve']}",
        "onboard": e.equipped(base, e.signals(d)),
        "motors": {"kind": d["motors"], "torque_lag_s": d["torque_lag_s"]},
    }
    if d["kind"] == STOP:
        return base.changed(**changes, initial_speed_kmh=min(base.initial_speed_kmh, FASTEST))
    if d["kind"] == WEATHER and d["short"] == "yes":
        base = _on_railcar(base)
    power = _share_of_power(d["speed_kmh"])
    belief: e.Keys = {"curve": {"kind": braking.CURVES[0]}}
    if base.belief.increments:
        belief["increments"] = _grown(base.belief.increments, power)
    changes |= {"initial_speed_kmh": d["speed_kmh"], "target_speed_kmh": None, "belief": belief}
    return base.changed(**changes, command=_asked(base, power), rail=_rail(base, d, power))


def _share_of_power(speed: float) -> float:
    """Share x of a start's plan that motors reach from `speed` [km/h] on: x (speed + x `GAINED`) = `FULL_EFFORT`.

    The driver asks for so much less, and the rail offers so much less: else it would not be short.
    """
    found = (math.sqrt(speed**2 + 4.0 * GAINED * FULL_EFFORT) - speed) / (2.0 * GAINED)
    return min(1.0, found)


def _asked(base: Scenario, factor: float) -> list[e.Keys]:
    """The commands of a start times `factor`."""
    return [
        {"time_s": one.time_s, "acceleration_kmhs": factor * one.acceleration_kmhs}
        for one in base.command
    ]


def _on_railcar(base: Scenario) -> Scenario:
    """The same start by the railcar, asked for what needs the same coefficient."""
    changed = base.changed(train=RAILCAR, load_t=None)
    plans = [one.event().world().onboard.planned[0] for one in (base, changed)]
    return changed.changed(command=_asked(base, float(plans[0] / plans[1])))


def _rail(base: Scenario, d: e.Drawn, power: float) -> e.Keys:
    """The start's rail on the drawn curve: at the event's speed it offers `power` of what the start's own curve offers."""
    keys = base.rail.model_dump(mode="json")
    key = "level" if base.rail.law_factor is None else "law_factor"
    level = keys[key]
    if key == "law_factor":
        level *= speed_law(e.START_SPEED, *SPEED_LAWS[keys["speed_law"]])
    made = base.event()
    own = offered_by(made.rail.curve, level, e.START_SPEED, made.train)
    speed = max(e.START_SPEED, d["speed_kmh"] / 3.6)
    found = e.offering(e.curve(d["curve"], d), power * own, made.train, speed)
    scale = found["level"] / level
    changed = {"curve": found["curve"], key: scale * keys[key], "scatter": scale * keys["scatter"]}
    return keys | changed | {"increments": _grown(base.rail.increments, scale)}


def _grown(growth: Increments, scale: float) -> e.Keys:
    """Growth along the train in proportion to the level."""
    if growth.values is not None:
        return {"law": growth.law, "values": [scale * one for one in growth.values]}
    return {"law": growth.law, "slope": scale * growth.slope, "offset": scale * growth.offset}


DRAWN = ("kind", "curve", "motors", "speed_kmh", "torque_lag_s", "speed_noise_kmh", "telegram_loss")  # fmt: skip


# what comes out

WORSE = 0.3
"""Points of the bound lost from which on an event counts as worse."""
HEADROOM = "headroom above 1 point"
SHOWN = (*KINDS, HEADROOM)
"""Parts of the events in the table."""


def pairs(rows: pd.DataFrame, controller: str, rule: str) -> pd.DataFrame:
    """One row per event, with `gain` over `BASE` [points of the bound]."""
    good = complete(rows[rows["controller"] == controller])
    own = paired(good, controller, rule, (BASE, BOUND), DRAWN)
    return own.assign(gain=100.0 * (own["bound_use"] - own[f"bound_use_{BASE}"]))


def parts_of(own: pd.DataFrame) -> "dict[str, pd.Series[bool]]":
    """Events by kind, headroom, noise, lag, speed."""
    noisy, late = own["speed_noise_kmh"] > 0.05, own["torque_lag_s"] > 0.022
    return {name: own["kind"] == name for name in KINDS} | {
        HEADROOM: own[f"headroom_{BOUND}"] > 0.01,
        "noise up to 0.05 km/h": ~noisy,
        "noise above 0.05 km/h": noisy,
        "lag up to 22 ms": ~late,
        "lag above 22 ms": late,
        "starts at speed": own["speed_kmh"].where(own["kind"] != STOP, 0.0) > 0.0,
    }


def statements(rows: pd.DataFrame) -> list[Statement]:
    """Each rule that a train can carry out uses more of the bound than alone, without much beyond the plan; one family."""
    found = []
    for law, rule in product(CONTROLLERS, RULES_OF_TRAINS):
        own = pairs(rows, law, rule)
        beyond = Claim("", "beyond the plan, % of it", 100.0 * own["over_delivery"], most=1.0)
        text = "uses more of the bound than alone: points"
        claim = Claim(f"{rule}, {law}", text, own["gain"], least=0.0, parts=parts_of(own))
        found.append(claim._replace(besides=[beyond._replace(digits=2)], digits=2))
    return judge(found)


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Each rule, and its gain over alone, also by part of the events; costs are less those of alone."""
    lines = []
    for law, rule in product(CONTROLLERS, ARMS):
        own, less = pairs(rows, law, rule), BASE if rule != BASE else ""
        gain, parts = own["gain"], parts_of(own)
        gains = {"gain over alone": gain, **{name: gain[parts[name]] for name in SHOWN}}
        worse = share(gain < -WORSE).text(0, 100.0)
        line: Row = {"controller": law, "rule": rule, "events": len(own)}
        line |= means(own, {"bound used [%]": ("bound_use", 1, 100.0)})
        for words, values in gains.items():
            line[f"{words} [points]"] = mean(values).text(2, sign=True) if less else "–"
        line["worse by 0.3 points [% of events]"] = worse if less else "–"
        line |= means(own, {"beyond the plan [% of it]": ("over_delivery", 2, 100.0)})
        lines.append(line | means(own, COSTS, less))
    return pd.DataFrame(lines)


def figure(rows: pd.DataFrame) -> Figure:
    """Gain over alone of each rule that a train can carry out."""
    drawn = Figure(figsize=(WIDE, 2.3), layout="constrained")
    for axes, law in zip(drawn.subplots(1, 3), CONTROLLERS, strict=True):
        numbers = {}
        for rule in RULES_OF_TRAINS:
            own = pairs(rows, law, rule)
            numbers[rule] = [mean(own["gain"]), mean(own["gain"][parts_of(own)[HEADROOM]])]
        forest(axes, numbers, RULES, 0.0)
        axes.set(title=law, xlabel="gain over alone [points]")
    drawn.supxlabel(f"circles: all events, squares: {HEADROOM}")
    return drawn


QUESTION = "What do rules and baselines gain over units that act alone where nothing was tuned?"
cells = crossed(event, draw, DRAWN, ARMS, CONTROLLERS)
STUDY = Study("broad", QUESTION, cells, run, table, figure, statements, events=140, seed=3100)
