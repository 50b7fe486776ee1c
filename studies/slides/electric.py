"""The electric brake in the demonstration of JP4209318: rows of the sweep `slide-protection`, and what they say.

Same rail, train and brake force; motors take the place of the shoes, and readhesion controllers and the MPC, each unit
alone, that of valves. Nothing of it is in the source: it asks what its air brake's slide protection is worth beside one
that acts within milliseconds.
"""

import math
from dataclasses import dataclass, replace
from itertools import product
from typing import Any

import numpy as np
import pandas as pd

from alloc.event import DriverCommand, Event
from alloc.metrics import use as motion
from alloc.onboard.parameters import Belief, Onboard
from alloc.plant.laws import GRAVITY
from alloc.plant.model import build
from alloc.plant.train import InverterGroup, Motors, TorqueLimit, Train
from alloc.simulation import simulate
from mpc.hosted import MPC
from studies.core.calibration import median_of
from studies.core.claims import AT_LEAST, AT_MOST, Claim, conjunction
from studies.core.job import run_status
from studies.core.statement import Interval, Statement
from studies.slides.jp4209318 import (
    CALIBRATED,
    INITIAL_SPEED,
    STEP,
    Undisclosed,
    brake,
    brake_event,
    front,
    measures,
    slide_train,
)

GROUPS: tuple[InverterGroup, ...] = ("1C4M", "1C1M")
"""Motors per inverter: what one torque serves has to suit the worst of its axles."""
CONTROLLERS = ("cut-and-ramp", "pi-creep", "perturb-observe", "steepest-gradient", MPC.name)
PART = "electric"
DECIDED = 0.5
"""Difference of two distances [m] that counts, ten times what noise of 1e-4 on every parameter makes."""
GEAR_RATIO = 7.07
"""Of the readhesion paper; it cancels between torque and force."""
FADE_SPEED = 5.0 / 3.6
"""Speed [m/s] below which the electric brake fades, and to which its stops are measured."""
RISE_TIME = 2.5
"""Time [s] in which the brake rises, evenly: as much distance is lost as with the cylinders' lag of 1.2 s and their dead
time of 0.05 s."""
DURATION = 60.0
"""Time [s] longer than any stop here."""


def electric_train(cars: int, group: InverterGroup, shoe_force_share: float) -> Train:
    """The train of Table 2 with a motor on every axle, which brakes with this share of the axle load; no air brake.

    `group`: motors per inverter. The wheelsets' inertia stays that of Table 2.
    """
    train = slide_train(cars, shoe_force_share)
    car = train.cars[0]
    load = float(car.static_axle_loads[0])
    peak = shoe_force_share * load * car.wheel_radius / GEAR_RATIO
    motors = Motors(
        group=group,
        gear_ratio=GEAR_RATIO,
        drive=TorqueLimit(peak=peak, power=1e9),
        brake=TorqueLimit(peak=peak, power=1e9, fade_speed=FADE_SPEED),
    )
    driven = (True,) * len(car.axle_positions)
    return replace(
        train,
        name=f"{train.name} electric",
        cars=tuple(replace(c, driven=driven, motors=motors, air_brake=None) for c in train.cars),
    )


def electric_event(undisclosed: Undisclosed, group: InverterGroup = "1C4M") -> Event:
    """A full electric brake application from 100 km/h; to be run under the rule `alone`.

    The units believe in the rail's true curve. No axle runs free, so their reference speed rests on relief.
    """
    train = electric_train(3, group, undisclosed.shoe_force_share)
    rail = undisclosed.rail()
    # what the brake gives a train that rolls; its rotating parts take their share of the force
    rolling = train.mass / (train.mass + train.rotating_mass)
    wanted = undisclosed.shoe_force_share * GRAVITY * rolling
    return Event(
        name=f"JP4209318, 3 cars, electric brake {group}",
        model=build(train, rail, span=(0.0, 1500.0)),
        command=DriverCommand((0.0,), (-wanted,)),
        onboard=Onboard(
            rise_time=RISE_TIME,
            belief=Belief(curve=rail.curve),
        ),
        duration=DURATION,
        initial_speed=INITIAL_SPEED,
        step=STEP,
        target_speed=FADE_SPEED,
    )


def electric_tasks() -> list[tuple[InverterGroup, str]]:
    """Every run with the electric brake."""
    return list(product(GROUPS, CONTROLLERS))


def electric_row(
    group: InverterGroup, controller: str, undisclosed: Undisclosed = CALIBRATED
) -> dict[str, Any]:
    """One stop; `distance` [m] includes the rest from 5 km/h, where the electric brake fades, under the shoes' force."""
    run = simulate(electric_event(undisclosed, group), "alone", controller)
    rest = FADE_SPEED**2 / (2.0 * undisclosed.shoe_force_share * GRAVITY)
    return {
        "part": PART,
        "cars": 3,
        "group": group,
        "controller": controller,
        "distance": motion.distance(run) + rest,
        "damage": motion.damage(run),
        "reference_error": float(np.abs(run["reference_speed"] - run["speed"]).max()),
        **run_status(run),
    }


ELECTRIC_BRAKE = Claim(
    "electric brake",
    "an electric brake whose units hold their slip by the MPC brakes shorter than the front at the same Q",
    "longer", AT_MOST, -DECIDED, each="arm", some=True, exact=True, reason="a difference that noise does not make",
    method="front: sensitivities of the fuzzy slide protection that none beats in distance and Q; at its ends the nearest "
    f"holds. Same rail and brake force, each unit alone, believed curve true, no axle runs free; {DECIDED:g} m count",
)  # fmt: skip


def electric_statement(table: pd.DataFrame) -> Statement:
    """Whether an electric brake under the MPC does better than valves under fuzzy slide protection."""
    own = front(table[table["part"] == "pareto"]).sort_values("damage")
    rows = table[table["part"] == PART]
    reach = np.interp(rows["damage"], own["damage"], own["distance"])
    rows = rows.assign(longer=rows["distance"] - reach, arm="with " + rows["group"])
    numbers = {
        f"{row['group']}, {row['controller']}: {words}": float(row[name])
        for _, row in rows.iterrows()
        for words, name in (("longer than the front by [m]", "longer"), ("Q [kJ]", "damage"))
    }
    numbers["largest error of the reference speed [m/s]"] = rows["reference_error"].max()
    return conjunction(rows[rows["controller"] == MPC.name], ELECTRIC_BRAKE, numbers=numbers)


# What the tables of JP4209318 do not have: stops from other speeds, of longer trains, on other rail.

BEYOND_PART = "beyond"
AGREED_DISTANCE, AGREED_DAMAGE = 0.02, 0.20
"""Sets agree about a stop where half their range is at most this share of its middle; chosen before any was run."""
STOP_DURATION = 80.0
"""Time [s] longer than any of these stops."""


@dataclass(frozen=True)
class Beyond:
    """What a stop changes of three cars from 100 km/h at medium sensitivity."""

    cars: int = 3
    speed: float = INITIAL_SPEED
    """m/s"""
    adhesion: float = 1.0
    """Over that of the set."""
    sensitivity: float = 1.0


STOPS: dict[str, Beyond] = {
    "from 60 km/h": Beyond(speed=60.0 / 3.6),
    "from 80 km/h": Beyond(speed=80.0 / 3.6),
    "from 130 km/h": Beyond(speed=130.0 / 3.6),
    "4 cars": Beyond(cars=4),
    "8 cars": Beyond(cars=8),
    "adhesion 20 % lower": Beyond(adhesion=0.8),
    "adhesion 20 % higher": Beyond(adhesion=1.2),
    "sensitivity 2": Beyond(sensitivity=2.0),
}
"""Stops by name."""


def beyond_event(undisclosed: Undisclosed, stop: Beyond) -> Event:
    """The stop of a train after this set."""
    event = brake_event(undisclosed, stop.cars, stop.sensitivity)
    rail = replace(event.model.rail, level=stop.adhesion)
    model = build(event.model.train, rail, span=(0.0, 3000.0))
    return replace(event, model=model, duration=STOP_DURATION, initial_speed=stop.speed)


def beyond_row(undisclosed: Undisclosed, name: str) -> dict[str, Any]:
    """Measures of the stop; `stopped`: whether the train came to a stand in time."""
    run = brake(beyond_event(undisclosed, STOPS[name]))
    stopped = float(run["speed"][-1]) < 0.1
    return {"part": BEYOND_PART, "stop": name, "stopped": stopped, **measures(run)}


BEYOND = Claim(
    "beyond", "the sets that reach the tables agree about stops that the tables do not have",
    f"measure == distance and half <= {AGREED_DISTANCE} or measure == Q and half <= {AGREED_DAMAGE}", AT_LEAST, 1.0,
    each="about", some=True, exact=True, reason="chosen before any was run",
    method=f"median and 5 to 95 % of the ensemble; agreed: half of that width at most {100 * AGREED_DISTANCE:g} % of the "
    f"distance and {100 * AGREED_DAMAGE:g} % of Q; three cars from 100 km/h but for what is named",
)  # fmt: skip


def beyond_statement(table: pd.DataFrame) -> Statement:
    """Whether the ensemble agrees about stops that no table has."""
    rows = table[(table["part"] == BEYOND_PART) & table["member"].notna()]
    cases: list[tuple[str, str, float]] = []
    numbers: dict[str, Interval] = {}
    for name, own in rows.groupby("stop", sort=False):
        for word, column, unit in (("distance", "distance", "m"), ("Q", "damage", "kJ")):
            found = median_of(own[column])
            half = (found.high - found.low) / (found.high + found.low)
            cases.append((f"about the {word} {name}: half width {100.0 * half:.1f} %", word, half))
            numbers[f"{name}: {word} [{unit}]"] = found
    stopped = float(rows["stopped"].mean()) if len(rows) else 1.0
    numbers["share of the stops that end"] = Interval(stopped, math.nan, math.nan, len(rows))
    return conjunction(
        pd.DataFrame(cases, columns=["about", "measure", "half"]), BEYOND, numbers=numbers
    )
