"""Random slip events for the ladder of readhesion controllers: what each of them meets, drawn quantity by quantity."""

from functools import lru_cache
from typing import Any

from alloc.plant.train import Train
from studies.core.drawn_events import DrawnEvents, Quantity, sometimes, uniform
from studies.core.drawn_rails import drawn_curve, rail_offering
from studies.files.units import stated
from studies.scenario.loading import shipped_scenario
from studies.scenario.scenario import Scenario

DURATION = 12.0
"""Length of an event [s]."""
REFERENCE_SPEED = 15.0 / 3.6
"""Speed at which rails of different curves offer the drawn level [m/s]."""

TRAINS: dict[str, tuple[str, dict[str, Any]]] = {
    "one inverter per car": ("wet-start", {"inverter_group": "1C4M"}),
    "one inverter per axle": ("wet-start", {"inverter_group": "1C1M"}),
    "locomotive and wagons": ("freight-start", {}),
}
"""Train -> the shipped scenario whose train, command and draft gear it is, and what is changed of it."""

QUANTITIES: dict[str, Quantity] = {
    "train": Quantity(
        "each of three in its turn",
        "one torque for four axles, one for each, and one for each of a locomotive that couplers shake",
        lambda _, d: list(TRAINS)[d["number"] % len(TRAINS)],
    ),
    "curve": Quantity(
        "piecewise and Polach's of wet rail, each for three events in its turn",
        "a peak at 0.05 m/s with a fall behind it, and one at 0.2 ... 0.6 m/s, wide and moving with speed",
        lambda _, d: ("piecewise", "polach")[d["number"] // len(TRAINS) % 2],
    ),
    "residual_ratio": uniform(
        0.5, 0.9, " of the peak at infinite slip (piecewise only)",
        "readhesion paper leaves it open; at 0.9 adhesion is used whatever the wheels do",
    ),
    "level": uniform(
        0.13, 0.19, ", at 15 km/h",
        "about the planned 0.16: in a third of the events the plan is within reach before the drop",
    ),
    "drop_factor": uniform(0.5, 0.8, "", "readhesion paper, Table 2: 0.12 of 0.18"),
    "drop_begin_s": uniform(2.5, 4.0, " s", "after the torque is up"),
    "drop_length_s": uniform(3.0, 5.0, " s", "long enough for a search"),
    "scatter": sometimes(
        0.6, 0.002, 0.008, ", correlated over 20 m", 0.0,
        "JP5484215 par. on (12)-(15): 0.012 over all its measurements; none: a rail that keeps still for a search",
    ),
    "patch_factor": sometimes(
        0.4, 0.6, 0.9, " times the coefficient, from 10 to 40 m", 1.0, "assumed: met after some seconds, axle after axle"
    ),
    "speed_noise_kmh": uniform(0.0, 0.04, " km/h", "twice the scenario scattered-rail at most"),
    "grade_permille": sometimes(
        0.4, 5.0, 20.0, " per mille uphill", 0.0, "as in the events of the claims"
    ),
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("ladder", QUANTITIES, stream=(7,), numbered=True)
draw, event_name = EVENTS.draw, EVENTS.event_name


@lru_cache
def train_of(name: str) -> Train:
    """The train called `name` in `TRAINS`, as it runs."""
    base, changes = TRAINS[name]
    return shipped_scenario(base).changed(**changes).event().model.train


def rail_keys(curve: str, residual_ratio: float, level: float, train: Train) -> dict[str, Any]:
    """Keys of a rail that offers `level` to `train` at `REFERENCE_SPEED` under this curve."""
    keys = drawn_curve(curve, {"residual_ratio": residual_ratio})
    return rail_offering(keys, level, REFERENCE_SPEED, train)


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]. The train believes in the piecewise curve whatever the rail's is."""
    d = draw(seed, k)
    base, changes = TRAINS[d["train"]]
    drop = {
        "factor": d["drop_factor"],
        "begin_s": d["drop_begin_s"],
        "until_s": d["drop_begin_s"] + d["drop_length_s"],
        "fade_s": 0.1,
    }
    patch = {"factor": d["patch_factor"], "start_m": 10.0, "end_m": 40.0, "edge_m": 4.0}
    return shipped_scenario(base).changed(
        name=event_name(seed, k),
        title=f"random event {k} of the ladder",
        case=None,
        duration_s=duration,
        variation=None,  # drawn here
        rail=rail_keys(d["curve"], d["residual_ratio"], d["level"], train_of(d["train"]))
        | {
            "increments": {"law": "logarithmic"},
            "scatter": d["scatter"],
            "scatter_length_m": 20.0,
            "patches": [drop, *([patch] if d["patch_factor"] < 1.0 else [])],
        },
        line={"sections": [{"start_m": -1000.0, "grade_permille": d["grade_permille"]}]},
        belief={"curve": {"kind": "piecewise"}},
        onboard={"sensors": {"speed_noise_kmh": stated("_kmh", d["speed_noise_kmh"])}},
        **changes,
    )
