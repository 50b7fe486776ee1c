"""The one population of slip events on which rules and controllers are ranked: drawn broadly, and frozen.

Event k of a seed is a scenario. Every choice has its reason beside it; none was made by what came out. Seeds below 100 are
for judging, the others for tuning.
"""

import math
from functools import cache, partial

import numpy as np

from alloc.laws import GRAVITY
from alloc.plant.train import Train
from studies.files.scenario import Scenario, make_scenario
from studies.files.toml_keys import check_keys
from studies.files.train_keys import TrainKeys
from studies.population import draws

SEED, TUNING = 65, 6500
"""Of the benchmark, and of the events on which controllers are tuned."""
EVENTS = 500
FLEETS = ("multiple unit", "railcar", "locomotive")
GROUPS = {"1C4M": 4, "1C2M": 2, "1C1M": 1}
"""Motors per inverter."""
PATCHES = ("none", "bad front", "bad rear", "short patch", "many patches", "drop", "come and go")
CURVES: dict[str, dict[str, tuple[float, float]]] = {
    "piecewise": {"residual_ratio": (0.4, 0.95)},
    "polach-wet": {},
    "polach-dry": {},
    "polach-by-friction": {},
    "rational": {"peak_slip": (0.05, 0.6), "steepness": (1.8, 12.0)},
    "slip-ratio": {"peak_slip_ratio": (0.008, 0.05), "residual_ratio": (0.4, 0.999)},
    "exponential-difference": {"a": (0.4, 0.8), "b": (1.0, 6.0)},
    "shoulder": {"rise": (0.04, 0.25), "width": (0.3, 1.0)},
    "burckhardt": {"rise": (6.0, 40.0), "fall": (0.1, 0.6)},
}
"""Shapes with the ranges of their parameters, drawn by their logarithms: peaks from 0.02 to 1.5 m/s, sharp and flat."""
SHARES = [0.14, 0.14, 0.03, 0.05, 0.14, 0.14, 0.12, 0.12, 0.12]
"""Of the curves. Nobody knows which are common; the two that rise most steeply take ten times the steps, so they are few."""
BELIEVED = "piecewise"
"""Curve that a train believes in where it does not know the rail's; it has numbers in the readhesion paper."""

# what is drawn


def draw(seed: int, k: int) -> draws.Keys:
    """What is drawn for event `k`; fleets, and starts and stops, come by shares, all else independently."""
    g = draws.Draw(seed, k, 65)
    fleet = g.choose(FLEETS, [0.6, 0.2, 0.2])  # most trains that share are multiple units
    stop = g.uniform(0.0, 1.0) < 0.35  # starts are where rules differ, stops where wheels lock
    curve = g.choose(list(CURVES), SHARES)
    receptive = g.uniform(0.0, 1.0) < 0.5  # lines with and without other trains near
    # a locomotive has an inverter per bogie or axle, other trains all three
    groups = ["1C2M", "1C1M"] if fleet == "locomotive" else list(GROUPS)
    return {
        "fleet": fleet,
        "case": "start" if not stop else "receptive stop" if receptive else "blended stop",
        "curve": curve,
        "group": g.choose(groups),
        "units": g.log_uniform(2.0, 20.0),  # few to many who may help
        "trailers": g.uniform(0.0, 1.0),  # trailers per motor car
        "last_drives": g.uniform(0.0, 1.0) < 0.3,  # push-pull
        "motors": g.choose(("torque", "induction", "induction")),  # most are induction motors
        "lag_s": g.log_uniform(0.005, 0.1),  # readhesion paper; commands over a train bus
        "mass_t": g.uniform(26.0, 44.0),  # of a car; of a locomotive twice as much
        "load_t": g.uniform(0.0, 10.0),
        "tilt": g.uniform(-0.8, 0.8),  # passengers gather at one end of the platform
        "radius_m": g.uniform(0.39, 0.52),
        "gear_ratio": g.uniform(3.0, 7.5),
        "inertia_kgm2": g.uniform(60.0, 220.0),
        "reserve": g.uniform(1.05, 1.9),  # motors' effort over the plan's
        "coupled": g.uniform(0.0, 1.0) < 0.3,
        "stiffness": g.uniform(5e6, 3e7),
        "load_transfer": g.uniform(0.0, 1.0) < 0.5,
        "adhesion": g.uniform(0.08, 0.22),  # that the plan needs: commuter trains to locomotives
        "deceleration": g.uniform(0.5, 1.1),  # service stops [m/s2]
        "kmh": g.uniform(30.0, 140.0) if stop else g.mixture(0.5, 10.0, 100.0, 0.0),
        # the rail offers this share of what the plan needs: out of reach, and within it
        "offered": g.uniform(0.7, 1.3),
        "speed_law": g.choose(("none", "curtius-kniffler", "shinkansen"), [0.5, 0.25, 0.25]),
        "growth": g.uniform(-0.05, 0.25),  # from the first axle to the last, over the level
        "knows_growth": g.uniform(0.0, 1.0) < 0.5,
        "knows_curve": g.uniform(0.0, 1.0) < 0.5,
        "scatter": g.mixture(0.5, 0.01, 0.08, 0.0),  # JP5484215: 0.012 at 0.15
        "scatter_m": g.uniform(5.0, 30.0),
        "conditioning": g.mixture(0.5, 0.05, 0.5, 0.0),  # wheels that slip clean the rail
        "conditioning_slip": g.log_uniform(0.005, 0.05),
        "patches": [g.choose(PATCHES) for _ in range(2)],
        "grade_permille": g.mixture(0.4, -20.0, 20.0, 0.0),  # most stations are level
        "fails": g.uniform(0.0, 1.0) < 0.15,
        "failed_place": g.uniform(0.0, 1.0),
        "failed_at_s": g.uniform(2.0, 8.0),
        "receptivity": 1.0 if receptive else g.uniform(0.4, 0.9),
        "speed_noise_kmh": g.mixture(0.75, 0.0, 0.1, 0.0),  # none to a worn pulse ring's
        "speed_quantum_kmh": g.mixture(0.5, 0.005, 0.05, 0.0),  # pulses timed over a period
        "radius_error": g.mixture(0.5, 0.0005, 0.005, 0.0),  # entered to a millimetre; worn
        "load_error": g.mixture(0.5, 0.0, 0.05, 0.0),  # pressure of air springs
        "telegram_loss": g.mixture(0.5, 0.0, 0.1, 0.0),
        "shape": {key: g.log_uniform(*ends) for key, ends in CURVES[curve].items()},
        "places": [g.uniform(0.0, 1.0) for _ in range(40)],
    }


STRATA = ("fleet", "case", "curve", "group", "lag_s", "speed_noise_kmh", "coupled", "fails")
"""What rows say of their event."""

# the train


@cache
def train_of(seed: int, k: int) -> draws.Keys:
    """Keys of the train of event `k`: motor cars M and trailers T, or locomotives L and coaches T."""
    d = draw(seed, k)
    per_car = 4 // GROUPS[d["group"]]
    if d["fleet"] == "locomotive":
        coaches = 3 + round(6 * d["trailers"])
        formation, driving = "L" + "T" * coaches + ("L" if d["last_drives"] else ""), "L"
    else:
        most = d["units"] if d["fleet"] == "multiple unit" else min(d["units"], 8.0)
        motor_cars = max(2 if per_car == 1 else 1, round(most / per_car))
        if d["fleet"] == "railcar":
            motor_cars = min(motor_cars, 2)
        formation, driving = _spread_trailers(motor_cars, round(d["trailers"] * motor_cars)), "M"
    mass = d["mass_t"] * (2.0 if driving == "L" else 1.0)
    cars = {driving: _car_keys(mass, d), "T": _car_keys(0.85 * d["mass_t"], d)}
    tonnes = sum(cars[kind]["mass_t"] for kind in formation)
    axles = 4 * formation.count(driving)
    force = d["adhesion"] * GRAVITY * mass / 4.0  # of an axle at the plan [kN]
    planned = force * axles / (1.08 * tonnes)
    # a locomotive's train and a heavy load of trailers ask for less than they could
    scale = min(1.0, 1.2 / planned)
    torque = 1e3 * scale * force * d["reserve"] * d["radius_m"] / d["gear_ratio"]
    cars[driving]["wheel_inertia_kgm2"] = d["inertia_kgm2"] * (1.6 if driving == "L" else 1.0)
    cars[driving]["motors"] = {
        "inverter_group": d["group"],
        "kind": d["motors"],
        "torque_lag_s": d["lag_s"],
        "gear_ratio": d["gear_ratio"],
        "torque_nm": torque,
        # up to 40 km/h above the speed at which the event begins the plan stays in reach
        "power_kw": scale * force * d["reserve"] * (d["kmh"] + 40.0) / 3.6,
    }
    coupler = {"stiffness_n_per_m": d["stiffness"], "damping_ns_per_m": 1e-2 * d["stiffness"]}
    keys = {
        "name": f"population-{seed}-{k:04d}",
        "formation": formation,
        "planned_acceleration_kmhs": 3.6 * scale * planned,
        "resistance_n": 12.0 * tonnes,
        "resistance_ns_per_m": 0.4 * tonnes,
        "resistance_ns2_per_m2": 4.0 + 0.9 * len(formation),
        "car": {kind: car for kind, car in cars.items() if kind in formation},
    }
    return keys | ({"coupler": coupler} if d["coupled"] else {})


def _spread_trailers(motor_cars: int, trailers: int) -> str:
    """Trailers between motor cars, evenly."""
    places = [round((j + 0.5) * motor_cars / trailers) for j in range(trailers)]
    return "".join("T" * places.count(j) + "M" * (j < motor_cars) for j in range(motor_cars + 1))


def _car_keys(mass: float, d: draws.Drawn) -> draws.Keys:
    return {
        "length_m": 20.0,
        "mass_t": mass,
        "axle_positions_m": [2.2, 4.7, 15.3, 17.8],
        "bogie_of_axle": [0, 0, 1, 1],
        "wheel_radius_m": d["radius_m"],
        "wheel_inertia_kgm2": 0.45 * d["inertia_kgm2"],
        # an emergency stop of 1.35 m/s2 with its load
        "air_brake": {
            "pressure_kpa": 400.0,
            "force_kn": 1.35 * (mass + d["load_t"]) / 4.0,
            "lag_s": 0.5,
            "dead_time_s": 0.1,
        },
    }


# the event

ROLLING, FADE = 3.0, 0.2
"""Time [s] before the brakes, in which the train learns the gradient; and in which adhesion falls and comes back."""
DURATION = {"start": 12.0, "stop": 15.0}


def event(seed: int, k: int) -> Scenario:
    """Event `k`."""
    d = draw(seed, k)
    train_keys = train_of(seed, k)
    train = check_keys(TrainKeys, train_keys).train
    stop, speed = d["case"] != "start", d["kmh"] / 3.6
    n, begin = train.axle_count, ROLLING if stop else 0.0
    acceleration = -d["deceleration"] if stop else train.planned_acceleration
    cars = zip(train_keys["formation"], draws.car_loads(d, len(train.cars)), strict=True)
    loads = [0.0 if kind == "L" else load for kind, load in cars]
    # the plan of a stop is every axle's, that of a start the driven ones'
    driven = sum(sum(car.powered) for car in train.cars)
    on_driven = sum(car.loaded_mass * sum(car.powered) / len(car.powered) for car in train.cars)
    needs = abs(acceleration) / GRAVITY * (1.0 if stop else 1.08 * (train.mass / on_driven))
    meets = max(draws.START_SPEED, speed)
    rail = draws.rail_keys({"kind": d["curve"]} | d["shape"], d["offered"] * needs, train, meets)
    level = rail["level"]
    grown = np.log(np.arange(1.0, n + 1.0)) / math.log(n)
    increments = (level * d["growth"] * (grown - grown.mean())).tolist()
    rail = draws.level_keys(level, d["speed_law"], meets) | {
        "curve": rail["curve"],
        "increments": {"law": "given", "values": increments},
        "scatter": d["scatter"] * level,
        "scatter_length_m": d["scatter_m"],
        "conditioning": d["conditioning"],
        "conditioning_slip": d["conditioning_slip"],
        "patches": _patch_keys(d, train, speed, begin),
    }
    units = 4 // GROUPS[d["group"]] * (driven // 4)
    knows: draws.Keys = {} if d["knows_curve"] else {"curve": {"kind": BELIEVED}}
    if not d["knows_growth"]:
        knows["increments"] = {"law": "none"}
    keys = {
        "name": train_keys["name"],
        "title": f"event {k}: {d['case']}, {d['fleet']}, {d['curve']}",
        "train": train_keys,
        "load_t": loads,
        "load_transfer": d["load_transfer"],
        "duration_s": DURATION["stop" if stop else "start"],
        "initial_speed_kmh": d["kmh"],
        "command": [{"time_s": begin, "acceleration_kmhs": 3.6 * acceleration}],
        "rail": rail,
        "line": draws.line_keys(d, -1e4),
        "failures": draws.failure_keys(d, units),
        "receptivity": draws.receptivity_keys(d),
        "belief": knows,
        "onboard": draws.signal_keys(d),
        "record_period_s": 0.02,
    }
    return make_scenario(keys, f"event {k} of seed {seed}")


def _patch_keys(d: draws.Drawn, train: Train, speed: float, begin: float) -> list[draws.Keys]:
    """Two kinds of patches one over the other, each with its own places."""
    ahead, patches = speed * (begin + 1.0), list[draws.Keys]()
    for j, kind in enumerate(d["patches"]):
        p: list[float] = d["places"][20 * j : 20 * j + 20]
        between = partial(_scale_place, p)
        if kind in ("bad front", "bad rear"):
            border = ahead - train.length * between(0, 0.1, 0.9)
            ends = (border, 1e4) if kind == "bad front" else (-1e4, border)
            patches += draws.stretch(between(1, 0.5, 0.9), *ends)
        if kind == "short patch":  # ice and leaves, from a wheelset's length to three cars'
            start = ahead + between(0, 5.0, 25.0)
            patches += draws.stretch(between(1, 0.3, 0.8), start, start + between(2, 10.0, 60.0))
        if kind == "many patches":
            place = ahead
            for i in range(0, 18, 3):
                place += between(i, 10.0, 30.0 + 2.0 * speed)
                end = place + between(i + 1, 5.0, 20.0 + speed)
                patches += draws.stretch(between(i + 2, 0.5, 0.95), place, end)
                place = end
        if kind == "drop":  # readhesion paper, Table 2: 0.12 of 0.18 for some seconds
            patches += draws.spell(between(0, 0.45, 0.85), begin + 3.0, between(1, 2.0, 6.0), FADE)
        if kind == "come and go":
            for i in range(3):
                lasts = between(2 * i + 1, 1.0, 3.0)
                patches += draws.spell(between(2 * i, 0.6, 0.9), begin + 2.5 + 3.5 * i, lasts, FADE)
    return patches


def _scale_place(places: list[float], j: int, low: float, high: float) -> float:
    return low + places[j] * (high - low)
