"""Random rails that stay as they are, for trains that ask for more than they offer; nothing is noisy."""

from typing import NamedTuple

from studies.core.drawn_events import DrawnEvents, Quantity, in_turn, uniform
from studies.core.drawn_scenarios import (
    SHAPE_QUANTITIES,
    drawn_curve,
    drawn_scenario,
    rail_offering,
)
from studies.scenario.loading import shipped_scenario
from studies.scenario.scenario import Scenario

DURATION = 7.0
"""Length of an event [s]."""


class Start(NamedTuple):
    """A shipped start with its train and command, and the coefficient that the plan needs there."""

    scenario: str
    planned: float
    """Coefficient that the plan needs at the rail."""
    cars: int
    most_load: float
    """Load of a car up to which the motors reach the plan [t]."""


STARTS = {
    "one inverter per car": Start("wet-start", 0.160, 8, 8.0),
    "one inverter per axle": Start("wet-start", 0.160, 8, 8.0),
    "sixteen cars": Start("long-train", 0.071, 16, 5.0),
}
TURN = 16
"""Groups of rails in which the two trains of many units, whose MPC takes several times as long, have one each."""
INVERTERS = {"one inverter per axle": "1C1M"}
SHAPES = ("piecewise", "polach-dry", "polach-wet", "slip-ratio", "rational")


QUANTITIES: dict[str, Quantity] = {
    "curve": in_turn(SHAPES, "each of five in its turn", "peaks and flanks of all shapes"),
    "train": Quantity(
        "one inverter per car for fourteen of sixteen groups of five, else the others in their turn",
        "two inertias of a wheelset over the axle load, one or four axles per torque",
        lambda _, d: list(STARTS)[{0: 1, TURN // 2: 2}.get(d["number"] // len(SHAPES) % TURN, 0)],
    ),
    "load": uniform(0.0, 1.0, " of the load that the motors master", "axle load"),
    "share": uniform(0.3, 0.8, " of what the plan needs", "every unit is short of adhesion"),
    "speed_kmh": uniform(2.0, 40.0, " km/h at the begin", "beyond it the motors' power ends the shortage"),
    **SHAPE_QUANTITIES,
}  # fmt: skip
"""Every drawn quantity in the order of drawing."""
EVENTS = DrawnEvents("constant-rail", QUANTITIES, stream=(17,), numbered=True)


def scenario(seed: int, k: int, duration: float = DURATION) -> Scenario:
    """Event `k` as a scenario of `duration` [s]."""
    d = EVENTS.draw(seed, k)
    start = STARTS[d["train"]]
    base = shipped_scenario(start.scenario)
    rail = rail_offering(
        drawn_curve(d["curve"], d), d["share"] * start.planned, d["speed_kmh"] / 3.6,
        base.event().model.train,
    )  # fmt: skip
    return drawn_scenario(
        base, EVENTS.event_name(seed, k), f"constant rail {k}", duration, rail | {"increments": {"law": "none"}},
        target_speed_kmh=None, initial_speed_kmh=d["speed_kmh"], inverter_group=INVERTERS.get(d["train"]),
        load_t=(d["load"] * start.most_load,) * start.cars, belief={"curve": {"kind": "piecewise"}},
    )  # fmt: skip
