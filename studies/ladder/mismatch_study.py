"""The MPC where curve, noise and computing time are others than it was built on, beside two controllers without a model."""

from collections.abc import Mapping
from functools import lru_cache
from types import MappingProxyType
from typing import Any, NamedTuple

import pandas as pd

from studies.core.claims import Claim, conjunction, quantity
from studies.core.drawn_events import START_SPEED, paired, rail_offering, with_meaning
from studies.core.job import Job
from studies.core.statement import CONFIDENCE, INTERVALS_OF_MEANS, Statement
from studies.core.study import EachEvent, Study
from studies.files.units import stated
from studies.ladder.events import TRAINS, draw, event_name, train_of
from studies.ladder.events import scenario as ladder_event
from studies.ladder.ladder_study import RULE
from studies.scenario.scenario import Scenario, safe_name

# The ladder's events of multiple units on rails of every curve, with every noise, and the controllers that meet them.
#
# Rails of five adhesion curves offer the same peak to the same train. Two controllers have no model; the MPC seeks its
# slip, or was given it.

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


LOSS = 0.01
"""Share of the adhesion that may be lost to another controller and still counts as none."""
METRICS = {
    "utilisation_short": "adhesion used where short",
    "damage": "wheel damage [kJ]",
    "slip_time": "slip [axle s]",
    "torque_fluctuation": "torque fluctuation over plan",
}
"""Metric -> what a statement calls it."""
METHOD = (
    f"means of paired differences of the adhesion used where short above -{LOSS:g} in every cell; "
    f"{INTERVALS_OF_MEANS}, {CONFIDENCE:.0%} each"
)


def _loses(name: str, claim: str, cells: Mapping[str, tuple[str, float, str, str]]) -> Claim:
    """That no cell loses; `cells`: words of each -> curve, noise and the two settings."""
    return Claim(
        name, claim, method=METHOD,
        cases=tuple(
            Claim(f"with {words}", mean=less(*cell, "utilisation_short"), value=-LOSS,
                  reason="a hundredth is what the choice of a controller is about")
            for words, cell in cells.items()
        ),
        numbers={
            f"{text}, {words}": less(*cell, metric)
            for metric, text in METRICS.items() for words, cell in cells.items()
        },
    )  # fmt: skip


def less(curve: str, noise: float, one: str, other: str, metric: str) -> str:
    """A metric under setting `one` less that under `other`, at one curve and noise [km/h]."""
    return f"'{metric}@{curve}/{noise:g}/{one}' - '{metric}@{curve}/{noise:g}/{other}'"


BASE = next(iter(RAILS))
CLAIMS = (
    *(
        _loses(
            f"{curve}: mpc, {other.name}",
            f"on {curve} rail the MPC loses less than a point of adhesion to {other.name}, whatever noise and computing "
            "time",
            {
                f"{setting.name}, {noise:g} km/h of noise": (curve, noise, setting.name, other.name)
                for setting in (SOUGHT, DELAYED) for noise in NOISES
            },
        )
        for other in (REFERENCE, SEARCHER) for curve in RAILS
    ),
    *(
        _loses(
            f"given slip: {one.name}",
            f"an MPC that holds the slip at {one.name} loses less than a point of adhesion to {REFERENCE.name} on every "
            "rail",
            {f"{curve} rail": (curve, MIDDLE, one.name, REFERENCE.name) for curve in RAILS},
        )
        for one in GIVEN
    ),
)  # fmt: skip
"""What is claimed of adhesion; that belief makes no difference has no threshold."""


def mismatch_statements(table: pd.DataFrame) -> list[Statement]:
    """Statements on the rows of a table of `studies.ladder.mismatch_study` that are ok."""
    arm = table["curve"] + "/" + table["noise"].map("{:g}".format) + "/" + table["setting"]
    events = paired(table.assign(scenario=table["event"], arm=arm), "arm", METRICS, [])
    return [*(conjunction(events, claim) for claim in CLAIMS), _believed(events)]


def difference(
    table: pd.DataFrame, curve: str, noise: float, one: str, other: str, metric: str
) -> "pd.Series[float]":
    """A metric under setting `one` less that under `other`, by event, at one curve and noise [km/h]."""
    rows = table[(table["curve"] == curve) & (table["noise"] == noise)]
    values = [rows[rows["setting"] == name].set_index("event")[metric] for name in (one, other)]
    return (values[0] - values[1]).astype(float)


def _believed(events: pd.DataFrame) -> Statement:
    numbers = {
        f"{text}, {other.name} less {SOUGHT.name}": quantity(
            events, less(BASE, MIDDLE, other.name, SOUGHT.name, metric)
        ).astype(float)
        for metric, text in METRICS.items()
        for other in SAME_BELIEF
    }
    claim = Claim(
        "belief", "an MPC that seeks its slip does the same whatever curve it believes in",
        method="holds if no number of any event differs",
    )  # fmt: skip
    same = all(bool((values == 0.0).all()) for values in numbers.values())
    enough = all(values.notna().any() for values in numbers.values())
    return conjunction(events, claim, {"to the last digit": same}, numbers=numbers, enough=enough)


def places(seed: int, k: int) -> list[Place]:
    """Every rail and noise that event `k` has."""
    return [Place(seed, k, curve, noise) for curve in RAILS for noise in NOISES]


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Event `k` at every place under every setting that meets it."""
    return [
        Job(scenario(place, setting, duration), RULE, setting.controller, place.number)
        for place in places(seed, k)
        for setting in settings_at(place.curve, place.noise)
    ]


def meant(table: pd.DataFrame, seed: int, events: int) -> pd.DataFrame:
    """The rows with "event", "curve", "noise" [km/h] and "setting"."""
    names = {
        place.name(setting): (k, place.curve, place.noise, setting.name)
        for k in range(events)
        for place in places(seed, k)
        for setting in settings_at(place.curve, place.noise)
    }
    table = with_meaning(table, names, "event", "curve", "noise", "setting")
    # who believes in the rail's curve by its name believes in the rail's own
    same = [
        table[(table["curve"] == one.believed) & (table["setting"] == RIGHT)].assign(
            setting=one.name
        )
        for one in GIVEN
        if one.believed != OWN
    ]
    return pd.concat([table, *same], ignore_index=True)


MISMATCH = Study(
    name="mismatch",
    question=f"the MPC on rails of {len(RAILS)} curves, with noise, with computing time, and with a given slip "
    f"(at {MIDDLE:g} km/h of noise)",
    default_events=12,
    cells=EachEvent(cells),
    finish=meant,
    judge=lambda table: mismatch_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
