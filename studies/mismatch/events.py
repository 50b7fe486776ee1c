"""The ladder's events of multiple units on rails of every curve, with every noise."""

from functools import lru_cache
from typing import Any, NamedTuple

from studies.core.drawn_rails import rail_offering
from studies.files.units import stated
from studies.ladder.events import REFERENCE_SPEED, TRAINS, draw, event_name, train_of
from studies.ladder.events import scenario as ladder_event
from studies.mismatch.rails import curve_keys
from studies.mismatch.settings import Setting
from studies.scenario.scenario import Scenario, safe_name

DURATION = 9.0
"""Length of an event [s]: the latest drop is over then."""
MULTIPLE_UNITS = 2
"""Trains of the ladder that have a free axle; they come first in its turn."""


class Place(NamedTuple):
    """An event with its rail's curve and the noise of its sensors."""

    seed: int
    k: int
    curve: str
    noise: float
    """[km/h]"""

    @property
    def number(self) -> int:
        """The event's number on the ladder."""
        return len(TRAINS) * (self.k // MULTIPLE_UNITS) + self.k % MULTIPLE_UNITS

    def name(self, setting: Setting) -> str:
        """Name of the scenario under a controller's setting."""
        event = event_name(self.seed, self.number)
        return safe_name(f"{event}-{self.curve}-{self.noise:g}-{setting.name}")


@lru_cache(maxsize=32)
def _base(seed: int, number: int, duration: float) -> Scenario:
    """An event of the ladder; every place of event k asks for the same."""
    return ladder_event(seed, number, duration)


@lru_cache(maxsize=64)
def _rail(seed: int, number: int, curve: str) -> dict[str, Any]:
    """Level and curve of its rail; the level of Polach's curves takes longer to find than all the rest of an event."""
    d = draw(seed, number)
    keys = curve_keys(curve, d["residual_ratio"])
    return rail_offering(keys, d["level"], REFERENCE_SPEED, train_of(d["train"]))


def scenario(place: Place, setting: Setting, duration: float = DURATION) -> Scenario:
    """The event at this place, of `duration` [s], for a train with this setting."""
    base = _base(place.seed, place.number, duration)
    believed = setting.on(place.curve).believed
    ratio = draw(place.seed, place.number)["residual_ratio"]
    onboard = {"sensors": {"speed_noise_kmh": stated("_kmh", place.noise)}}
    return base.changed(
        name=place.name(setting),
        rail=base.rail.model_dump() | _rail(place.seed, place.number, place.curve),
        belief={"curve": curve_keys(believed, ratio)},
        onboard=onboard | ({"mpc": dict(setting.mpc)} if setting.mpc else {}),
    )
