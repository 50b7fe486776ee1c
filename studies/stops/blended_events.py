"""Drawn stops in which motors and air brakes act together: train, rail, driver, signals and beliefs."""

from functools import cache, lru_cache
from typing import Any, NamedTuple

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.metrics.registry import force_along, force_available, record_period, series, under_demand
from alloc.metrics.search import LEAST_EPISODE, shortage
from alloc.metrics.use import LOCK_SPEED, STANDING_SPEED
from alloc.plant.laws import GRAVITY
from alloc.plant.model import structure_of
from alloc.plant.train import Train
from studies.core import drawn_events as shared
from studies.core.drawn_events import (
    DrawnEvents,
    Quantity,
    in_turn,
    log_uniform,
    sometimes,
    uniform,
)
from studies.files.units import stated
from studies.lines.named_files import TRAINS as TRAIN_FILES
from studies.scenario.scenario import Scenario, shipped_scenario

ROLLING = 3.0
"""Time [s] for which the train rolls before it brakes, as for slide protection alone: it then knows the gradient."""
DURATION = 17.0
"""Length of an event [s]. Stops from low speed are over by then; the others are cut off while they brake."""
REFERENCE_SPEED = 15.0
"""Speed [m/s] at which a rail of any curve offers the drawn level, as in `studies.stops.wsp_acceptance_study`."""
LEAST_LEVEL = 0.02
"""Least adhesion, that of `studies.stops.wsp_acceptance_study`."""
SLOPE = 0.0083 / 0.07
"""Growth along the train over the coefficient: JP5484215 (15), in proportion."""
SOURCES = ("estimate", "truth")
"""Reference speed of the train's computers: their own estimate, or the true speed for comparison."""


class TrainKind(NamedTuple):
    """A train that ships with motors that brake and air brakes, and the stops that are usual for it."""

    train: str
    """Name of a set, or path of a file."""
    changes: dict[str, Any]
    """Keys of the scenario."""
    loads: tuple[float, ...]
    """Greatest pay load of each car, from the front of the described train [t]."""
    speed: tuple[float, float]
    """Least and greatest speed at the start [km/h]."""
    deceleration: tuple[float, float]
    """Least and greatest of what the driver asks for [km/h/s]: a service stop to an emergency stop."""


_COMMUTER = ((12.0,) * 8, (30.0, 120.0), (2.0, 4.0))
_COACHES = ((0.0, *(20.0,) * 5), (50.0, 160.0), (1.3, 3.2))
_IC2 = str(TRAIN_FILES / "ic2.toml")
TRAINS: dict[str, TrainKind] = {
    "commuter, inverter per car": TrainKind("commuter-8car", {}, *_COMMUTER),
    "locomotive ahead": TrainKind(_IC2, {}, *_COACHES),
    "sixteen cars": TrainKind("high-speed-16car", {}, (6.0,) * 16, (40.0, 240.0), (1.6, 2.8)),
    "commuter, inverter per axle": TrainKind("commuter-8car", {"inverter_group": "1C1M"}, *_COMMUTER),
    "locomotive behind": TrainKind(_IC2, {"reversed": True}, *_COACHES),
    "locomotive and wagons": TrainKind("freight-5", {}, (0.0, *(40.0,) * 5), (30.0, 90.0), (1.2, 2.2)),
}  # fmt: skip
"""Trains by name. The wagons have no speed sensors, so nothing protects their wheels, and couplers."""
HAULED = tuple(name for name in TRAINS if name.startswith("locomotive"))
"""Trains of which the motors brake a small part."""
CURVES = (
    "piecewise", "polach-wet", "slip-ratio", "rational", "polach-dry", "polach-by-friction", "exponential-difference",
)  # fmt: skip
"""Every kind of curve that ships. Its number and that of the trains have no common divisor: in turn, all pairs occur."""

QUANTITIES: dict[str, Quantity] = {
    "train": in_turn(
        list(TRAINS), "each of six in its turn",
        "all motors or few of them, trailers with and without sensors, a unit of four axles, two, one",
    ),
    "curve": in_turn(
        CURVES, "each of seven in its turn", "every kind that ships; the train believes in the piecewise one"
    ),
    **shared.SHAPE_QUANTITIES,
    # air brakes slide wheels by metres per second, where the rational curve falls to nothing unless it is wide and steep
    "peak_slip": log_uniform(0.15, 0.8, " m/s (rational)", "at 3 m/s three tenths of the peak are left, at least"),
    "steepness": log_uniform(8.0, 20.0, " (rational)", "the same"),
    "load": uniform(0.0, 1.0, " of the greatest pay load of each car", "empty to full"),
    "speed": uniform(0.0, 1.0, " of the way from the least to the greatest speed of the train", "what it runs at"),
    "end_kmh": sometimes(
        0.4, 20.0, 35.0, " km/h in its place", 0.0, "the end of a stop: the electric brake fades, the train comes to a stand"
    ),
    "deceleration": uniform(0.0, 1.0, " of the way from a service stop to an emergency stop", "what a driver asks for"),
    "share": uniform(
        0.4, 1.1, " of the coefficient that the command needs, at least 0.02", "most stops slide, a few only in a patch"
    ),
    "growth": uniform(0.0, 1.2, " of the believed growth along the train", "JP5484215 (15); the belief is 1"),
    "drop_factor": sometimes(
        0.6, 0.5, 0.85, " times the coefficient, for a time", 1.0, "as the ladder: the same instant for every controller"
    ),
    "drop_begin_s": uniform(1.3, 5.0, " s after the command", "after the brakes are up"),
    "drop_length_s": uniform(2.0, 7.0, " s", "long enough for a search"),
    "patch_factor": sometimes(
        0.5, 0.5, 1.6, " times the coefficient, on a stretch", 1.0, "met axle after axle; leaves, or cleaner rail"
    ),
    "patch_start_m": uniform(0.0, 150.0, " m after the command", "met during the stop"),
    "patch_length_m": uniform(20.0, 150.0, " m", "a car to a train"),
    "scatter_share": shared.SCATTER_SHARE,
    "conditioning": shared.CONDITIONING,
    "grade_permille": sometimes(0.5, -20.0, 20.0, " per mille", 0.0, "up or down; met before the brakes"),
    "receptivity": sometimes(
        0.4, 0.3, 0.9, " of the electric brake is taken up, on the mean", 1.0, "the scenario wet-stop: 0.5"
    ),
    "failed": Quantity(
        "one unit in 15 % of the stops, from 2 to 6 s after the command", "air makes up for its motors",
        lambda g, _: (float(g.uniform()), float(g.uniform(2.0, 6.0))) if g.random() < 0.15 else None,
    ),
    "law": Quantity(
        "threshold or fuzzy", "both laws of slide protection that ship",
        lambda g, _: ("threshold", "fuzzy")[int(g.integers(2))],
    ),
    "speed_noise_kmh": shared.SPEED_NOISE,
    "speed_quantum_kmh": sometimes(
        0.5, 0.005, 0.05, " km/h", 0.0, "pulses timed over a period; the scenario noisy-sensors: 0.02"
    ),
    "radius_error": Quantity(
        "0 in 50 %, else uniform in its logarithm, 0.0005 ... 0.005 of the radius, at most",
        "diameters of 0.86 m entered to a millimetre, to wheels that wore by 4 mm since",
        lambda g, _: float(0.0005 * 10.0 ** g.uniform()) if g.random() < 0.5 else 0.0,
    ),
    "load_error": shared.LOAD_ERROR,
    "mass_factor": uniform(0.97, 1.03, " of the empty mass", "what a works scale leaves"),
    "resistance_factor": uniform(0.8, 1.2, " of the running resistance", "wind, and formulas that fit a class"),
    "coupler_factor": uniform(0.9, 1.1, " of the couplers' stiffness", "rubber ages"),
    "telegram_loss": sometimes(0.5, 0.0, 0.05, "", 0.0, "the scenario scattered-rail at most"),
    "day": Quantity("a whole number", "draws noise, wheel radii and scatter", lambda g, _: int(g.integers(1, 2**31))),
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("blended", QUANTITIES, stream=(19,), numbered=True)


@lru_cache
def train_of(name: str) -> Train:
    """The train called `name` in `TRAINS`, empty."""
    kind = TRAINS[name]
    return _base().changed(train=kind.train, load_t=None, **kind.changes).event().model.train


@cache
def _base() -> Scenario:
    return shipped_scenario("wet-stop").changed(case=None, variation=None, target_speed_kmh=None)


@lru_cache(maxsize=64)
def rail_of(seed: int, k: int) -> dict[str, Any]:
    """Keys of level and curve of the rail of stop `k`; the empty train finds the drawn adhesion there."""
    d = EVENTS.draw(seed, k)
    offered = max(LEAST_LEVEL, d["share"] * asked_of(d) / GRAVITY)
    return shared.rail_offering(
        shared.drawn_curve(d["curve"], d), offered, REFERENCE_SPEED, train_of(d["train"])
    )


def asked_of(d: dict[str, Any]) -> float:
    """Deceleration that the driver of a drawn stop asks for [m/s2]."""
    return between(TRAINS[d["train"]].deceleration, d["deceleration"]) / 3.6


def peak_of(seed: int, k: int) -> float:
    """Slip velocity of the peak of the rail of stop `k` at `REFERENCE_SPEED` [m/s]."""
    rail = rail_of(seed, k)
    return float(np.mean(shared.curve_of(rail["curve"]).limit(rail["level"], REFERENCE_SPEED)[1]))


def between(limits: tuple[float, float], share: float) -> float:
    """So much of the way from the first limit to the second."""
    return limits[0] + share * (limits[1] - limits[0])


def event_name(seed: int, k: int, source: str = SOURCES[0]) -> str:
    """Name of stop `k`; that with the true reference speed says so."""
    return EVENTS.event_name(seed, k) + ("" if source == SOURCES[0] else f"-{source}")


def scenario(seed: int, k: int, source: str = SOURCES[0], duration: float = DURATION) -> Scenario:
    """Stop `k` as a scenario of `duration` [s]."""
    d = EVENTS.draw(seed, k)
    kind, train, rail = TRAINS[d["train"]], train_of(d["train"]), rail_of(seed, k)
    asked, speed = asked_of(d), d["end_kmh"] or between(kind.speed, d["speed"])
    patches = shared.drawn_drop(d, 0.3, ROLLING), shared.drawn_patch(d, speed / 3.6 * ROLLING)
    return shared.drawn_scenario(
        _base(), event_name(seed, k, source), f"drawn stop {k}: {d['train']}, {d['curve']}", duration,
        rail
        | {
            "increments": _increments(d["growth"] * rail["level"], train.axle_count),
            "conditioning": d["conditioning"],
        }
        | shared.uneven(d["scatter_share"] * rail["level"], *patches),
        d,
        {
            "sensors": {name: d[name] for name in ("speed_quantum_kmh", "radius_error")},
            "braking": {"slide_protection": {"law": d["law"]}},
            "reference": {"source": source},
        },
        train=kind.train,
        load_t=tuple(stated("_t", d["load"] * most) for most in kind.loads),
        initial_speed_kmh=speed,
        command=[{"time_s": ROLLING, "acceleration_kmhs": -3.6 * asked}],
        failures=_failures(d, train),
        line=shared.graded(d, -1e4),
        receptivity={"mean": d["receptivity"], "amplitude": 0.6 * (1.0 - d["receptivity"]), "period_s": 7.0},
        belief={
            "curve": {"kind": "piecewise"},
            "increments": _increments(asked / GRAVITY, train.axle_count),
            **{name: d[name] for name in ("mass_factor", "resistance_factor", "coupler_factor")},
        },
        **kind.changes,
    )  # fmt: skip


def _increments(level: float, axles: int) -> dict[str, Any]:
    """Logarithmic growth along the train in proportion to `level`; its mean over the axles is zero."""
    slope = SLOPE * level
    offset = -slope * float(np.log(np.arange(1.0, axles + 1.0)).mean())
    return {"law": "logarithmic", "slope": slope, "offset": offset}


def _failures(d: dict[str, Any], train: Train) -> list[dict[str, Any]]:
    if d["failed"] is None:
        return []
    place, time = d["failed"]
    units = int(structure_of(train)[0].axle_unit.max()) + 1
    return [{"unit": 1 + int(place * units), "time_s": ROLLING + time}]


# What a blended stop is judged by beside the metrics: the error of the reference speed, the weakest unit, locked
# wheels.

LEAST_SPEED = 2.0
"""Speed [m/s] below which the error counts no more: slide protection has long ceased to act."""
WITHIN = 2.0
"""Number of stated deviations within which an error is expected, 95 % of them if they are normal."""

Floats = NDArray[np.float64]


def measure(run: xr.Dataset) -> dict[str, float]:
    """Numbers of a recorded stop.

    - reference_error, reference_rms, reference_bias [m/s]: largest magnitude, root mean square and mean of the reference
      speed's error; positive where it is above the speed. reference_worst_time [s]: instant of the largest.
    - reference_ratio: root mean square of error over stated deviation; 1 where that is right. reference_within: share of
      instants at which the error is at most `WITHIN` deviations. Both are nan where the computers have the true speed.
    - least_unit_use: adhesion used where short by the unit that uses least; nan where none is short for a second.
      least_unit: its number, 1 = foremost.
    - air_of_units: air brake force commanded to the units, over their part of the plan; what motors could have done counts.
    - locked_driven [s]: time that driven wheels stood above 5 km/h, summed over axles.
    """
    error, deviation = reference_error(run)
    counted = series(run, "speed") > LEAST_SPEED
    time, error, deviation = series(run, "time")[counted], error[counted], deviation[counted]
    known = bool(counted.any())
    worst = int(np.abs(error).argmax()) if known else 0
    stated = known and run_estimates(deviation)
    uses = unit_use(run)
    short = bool(np.isfinite(uses).any())
    return {
        "reference_error": float(np.abs(error[worst])) if known else np.nan,
        "reference_rms": float(np.sqrt((error**2).mean())) if known else np.nan,
        "reference_bias": float(error.mean()) if known else np.nan,
        "reference_worst_time": float(time[worst]) if known else np.nan,
        "reference_ratio": float(np.sqrt(((error / deviation) ** 2).mean())) if stated else np.nan,
        "reference_within": float((np.abs(error) <= WITHIN * deviation).mean())
        if stated
        else np.nan,
        "least_unit_use": float(np.nanmin(uses)) if short else np.nan,
        "least_unit": float(1 + np.nanargmin(uses)) if short else np.nan,
        "air_of_units": air_of_units(run),
        "locked_driven": locked_driven(run),
    }


def run_estimates(deviation: Floats) -> bool:
    """Whether the computers estimate the speed; the true one has no deviation."""
    return bool((deviation > 0.0).all())


def reference_error(run: xr.Dataset) -> tuple[Floats, Floats]:
    """Reference speed less the speed of the foremost unit's car, and the stated deviation, (time,) each [m/s]."""
    unit, car = series(run, "axle_unit"), series(run, "axle_car")
    foremost = int(car[np.flatnonzero(unit == 0)[0]])
    cars = series(run, "car_speed") if "car_speed" in run.variables else None
    true = series(run, "speed") if cars is None else cars[:, min(foremost, cars.shape[1] - 1)]
    return series(run, "reference_speed") - true, series(run, "reference_deviation")


def unit_use(run: xr.Dataset) -> Floats:
    """Adhesion that each unit used where it was short, (unit,); nan where it was short for less than a second."""
    unit, short = series(run, "axle_unit"), shortage(run)
    force, available = force_along(run), force_available(run)
    found = np.full(run.sizes["unit"], np.nan)
    for j in range(found.size):
        counted = short[:, j]
        if counted.sum() * record_period(run) >= LEAST_EPISODE:
            own = unit == j
            found[j] = force[counted][:, own].sum() / available[counted][:, own].sum()
    return found


def air_of_units(run: xr.Dataset) -> float:
    """Air brake force commanded to the units over what the plan asks of them, summed over time; nan without demand."""
    asked = under_demand(run)
    unit, load = series(run, "axle_unit"), series(run, "unit_static_load")
    axles = np.bincount(unit[unit >= 0], minlength=run.sizes["unit"])
    plan = float(series(run, "planned_coefficient")[asked].sum() * load.sum())
    return float((series(run, "air_brake_force")[asked] @ axles).sum() / plan) if plan else np.nan


def locked_driven(run: xr.Dataset) -> float:
    """Axle-seconds in which a driven wheel stands while its train runs faster than `LOCK_SPEED`."""
    driven = series(run, "axle_unit") >= 0
    standing = np.abs(series(run, "rim_speed"))[:, driven] < STANDING_SPEED
    running = np.abs(series(run, "speed")) > LOCK_SPEED
    return float((standing & running[:, None]).sum() * record_period(run))
