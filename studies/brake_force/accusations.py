"""Numbers of a passenger train's stops: whether a car that does not deliver its share is found, and no other accused."""

from collections.abc import Sequence

import numpy as np

from studies.brake_force.beliefs import AS_PLANT, BELIEFS, Misbelief
from studies.brake_force.faulty_car import (
    USUAL,
    AllocatedStop,
    Fault,
    allocated_stops,
    commuter_train,
    driven_stops,
)
from studies.brake_force.findings import Row, rms

SHORTFALLS = (0.0, 0.025, 0.05, 0.075, 0.1, 0.15, 0.2, 0.3)
"""Shares of its force that the faulty car does not deliver, in dry stops."""
SOUND = 0.05
"""A car that truly falls short by less than this share of its allocated force is sound: to accuse it is wrong."""
WHOLE = 0.01
"""A car whose true shortfall is below this share delivers its force, except for what nobody measures."""
DRAWS = 10
"""Measurements of each stop of the passenger train, with sensor errors of their own."""
FEW_DRAWS = 3
"""Of each stop of the error budget."""


def allocated_rows(seed: int, draws: int = DRAWS) -> list[Row]:
    """Stops of the passenger train under allocation: sound, and with each kind of fault."""
    draw = np.random.default_rng([seed, 44])
    cars = commuter_train(seed).cars
    motor = int(draw.choice([k for k, car in enumerate(cars) if car.motors is not None]))
    # the lead car is not among them: its wheels slide on these rails all the time, so it is not judged
    trailer = int(draw.choice([k for k, car in enumerate(cars) if k and car.motors is None]))
    faults: dict[str, Fault | None] = {
        "sound": None,
        "trailer, brake cut out": Fault(trailer, (0, 1)),
        "trailer, one bogie cut out": Fault(trailer, (0,)),
        "motor car, motors failed": Fault(motor, (), True),
        "motor car, motors failed and brake cut out": Fault(motor, (0, 1), True),
    }
    rows = []
    for kind, fault in faults.items():
        stops = allocated_stops(fault, seed, draws=draws)
        row = _accusations(stops, None if fault is None else fault.car)
        calls = int(stops[0].run.attrs["rule_calls"])
        rows.append({"part": "allocated", "kind": kind, "rule_calls": calls} | row)
    return rows


def driven_rows(
    seed: int, shortfalls: Sequence[float] = SHORTFALLS, draws: int = DRAWS
) -> list[Row]:
    """Dry stops of the passenger train in which one car, drawn, falls short by each of these shares."""
    car = int(np.random.default_rng([seed, 45]).integers(len(commuter_train(seed).cars)))
    rows = []
    for missing in shortfalls:
        row = _accusations(driven_stops(car, missing, seed, draws), car if missing else None)
        rows.append({"part": "driven", "missing": missing} | row)
    return rows


def sliding_rows(seed: int, draws: int = DRAWS) -> list[Row]:
    """Stops in which a trailer, drawn, slides on rails that carry the others: all brakes sound, or another one's cut out."""
    draw = np.random.default_rng([seed, 47])
    trailers = [k for k, car in enumerate(commuter_train(seed).cars) if car.motors is None]
    slides, faulty = (int(k) for k in draw.permutation(trailers)[:2])
    rows = []
    for kind, fault in (("sound", None), ("another's brake cut out", Fault(faulty, (0, 1)))):
        stops = allocated_stops(fault, seed, draws, USUAL, slides)
        row = _accusations(stops, None if fault is None else faulty)
        blamed = [slides in stop.shortfalls().accused for stop in stops]
        blindly = [slides in stop.shortfalls(all_samples=True).accused for stop in stops]
        of_slides = {"sliding_accused": float(np.mean(blamed)), "accused_blindly": float(np.mean(blindly)),
                     "slides": bool(stops[0].slid[slides])}  # fmt: skip
        rows.append({"part": "sliding", "kind": kind} | row | of_slides)
    return rows


def budget_dry_rows(
    seed: int, beliefs: Sequence[str] = tuple(BELIEFS), draws: int = FEW_DRAWS
) -> list[Row]:
    """Dry stops, sound and with a tenth missing on one car, by estimators that have resistance or gradient wrong."""
    car = int(np.random.default_rng([seed, 45]).integers(len(commuter_train(seed).cars)))
    rows = []
    for belief in (AS_PLANT, *beliefs):
        one = BELIEFS.get(belief, Misbelief())
        if one in (Misbelief(friction=one.friction), Misbelief(pressure_gain=one.pressure_gain,
                   pressure_offset=one.pressure_offset)) and belief != AS_PLANT:  # fmt: skip
            continue  # neither friction nor pressures are read for it
        for missing in (0.0, 0.1):
            stops = driven_stops(car, missing, seed, draws, one)
            row = _accusations(stops, car if missing else None)
            rows.append({"part": "budget dry", "belief": belief, "missing": missing} | row)
    return rows


def _accusations(stops: Sequence[AllocatedStop], faulty: int | None) -> Row:
    """Shares of the measurements in which the faulty car is found, is the first named, and others are accused."""
    said = []
    threshold, error = [], []
    for stop in stops:
        shortfalls, w = stop.shortfalls(), stop.window
        accused, allocated = shortfalls.accused, stop.allocated[w].mean(axis=0)
        sound = stop.true_shortfall < SOUND * allocated
        others = [k for k in accused if k != faulty]
        judged = np.isfinite(shortfalls.shortfall)
        said.append(
            {
                "found": faulty in accused,
                "first": accused.size > 0 and accused[0] == faulty,
                "wrong": np.any(sound[others]),
                "whole": np.any((stop.true_shortfall < WHOLE * allocated)[others]),
                "others_short": np.any(~sound[others]),
                "not_judged": np.mean(~judged),
            }
        )
        threshold.append(float(np.mean((shortfalls.threshold / allocated)[judged])))
        missed = (shortfalls.shortfall - stop.true_shortfall) / shortfalls.deviation
        error.append(missed[judged])
    shortfall = stops[0].true_shortfall / stops[0].allocated[stops[0].window].mean(axis=0)
    return {
        "car": -1 if faulty is None else faulty,
        "true_share": np.nan if faulty is None else float(shortfall[faulty]),
        "error_in_deviations": rms(np.concatenate(error)),
        "shortfall_covered": float(np.mean(np.abs(np.concatenate(error)) < 1.96)),
        "threshold": float(np.mean(threshold)),
        **{name: float(np.mean([one[name] for one in said])) for name in said[0]},
    }
