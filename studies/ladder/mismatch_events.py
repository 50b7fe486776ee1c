"""The ladder's events of multiple units on rails of every curve, with every noise, and the controllers that meet them.

Rails of five adhesion curves offer the same peak to the same train. Two controllers have no model; the MPC seeks its slip,
or was given it.
"""

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple

from studies.core.drawn_scenarios import START_SPEED, rail_offering
from studies.files.units import stated
from studies.ladder.events import TRAINS, draw, event_name, train_of
from studies.ladder.events import scenario as ladder_event
from studies.scenario.scenario import Scenario, safe_name

RAILS: dict[str, dict[str, Any]] = {
    "piecewise": {"kind": "piecewise"},
    "Polach dry": {"kind": "polach-dry"},
    "Polach wet": {"kind": "polach-wet"},
    "slip ratio": {"kind": "slip-ratio"},
    "double exponential": {"kind": "exponential-difference"},
}
"""Name -> keys of `[rail.curve]`. Peaks at 0.05 m/s, at 0.05 to 0.6 m/s moving with speed, and at 1.2 m/s."""


def curve_keys(curve: str, residual_ratio: float) -> dict[str, Any]:
    """Keys of the curve called `curve`; `residual_ratio` is the piecewise one's."""
    return RAILS[curve] | ({"residual_ratio": residual_ratio} if curve == "piecewise" else {})


# controllers

NOISES = (0.0, 0.02, 0.04)
"""Standard deviation of measured axle speeds [km/h]."""
MIDDLE = 0.02
"""Noise in the runs of an MPC that holds a given slip."""
OWN = "its own"
"""Believed curve: that of the rail."""
USUAL = "piecewise"
"""Curve that trains believe in where nothing is said."""


class Setting(NamedTuple):
    """A controller with its settings, and the curve that its train believes in."""

    name: str
    controller: str
    mpc: Mapping[str, Any] = MappingProxyType({})
    """Keys of `[onboard.mpc]`."""
    believed: str = USUAL

    def on(self, curve: str) -> "Setting":
        """The same where the believed curve is named."""
        return self._replace(believed=curve) if self.believed == OWN else self


def _given(share: float, believed: str, name: str) -> Setting:
    keys = {"search": {"seek": False, "given_share": share}}
    return Setting(name, "mpc", keys, believed)


REFERENCE = Setting("cut-and-ramp", "cut-and-ramp")
SEARCHER = Setting("perturb-observe", "perturb-observe")
SOUGHT = Setting("mpc", "mpc")
DELAYED = Setting("mpc, delayed", "mpc", {"computing_delay": 1})
"""Its commands act a control period after the readings that they follow from."""
EVERYWHERE = (REFERENCE, SEARCHER, SOUGHT, DELAYED)
"""Those that meet every noise."""
SHARES = {0.5: "half its peak", 1.0: "its peak", 1.5: "1.5 times its peak"}
RIGHT = SHARES[1.0]
GIVEN = (
    *(_given(share, OWN, name) for share, name in SHARES.items()),
    *(
        _given(1.0, curve, f"peak of {curve}")
        for curve in ("piecewise", "Polach wet", "slip ratio")
    ),
)
"""MPC that holds the slip of a believed curve's peak, which Railway Sciences 4(1):22 (2025) assumes to be known: that of the
rail's own curve, right and wrong by half, and that of another curve."""
SAME_BELIEF = tuple(
    Setting(f"mpc, believes {curve}", "mpc", {}, curve) for curve in ("Polach wet", "slip ratio")
)
"""MPC that seeks its slip under other beliefs; met on one curve, to show that belief makes no difference."""


def settings_at(curve: str, noise: float) -> tuple[Setting, ...]:
    """Every setting that meets a rail of `curve` with this noise, each once."""
    if noise != MIDDLE:
        return EVERYWHERE
    # to believe in the rail's curve by its name, or as its own, is the same run
    given = [one for one in GIVEN if one.believed != curve]
    return (*EVERYWHERE, *given, *(SAME_BELIEF if curve == next(iter(RAILS)) else ()))


# events

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
    return rail_offering(keys, d["level"], START_SPEED, train_of(d["train"]))


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
