"""Stability, by trial: constant rails of drawn curves, levels, speeds and loads, without noise."""

from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from alloc.metrics.registry import record_period
from mpc.settings import SlipSearch
from studies.core.claims import AT_MOST, Claim, conjunction, how_many
from studies.core.drawn_events import (
    SHAPE_QUANTITIES,
    DrawnEvents,
    Quantity,
    drawn_curve,
    drawn_scenario,
    in_turn,
    rail_offering,
    uniform,
)
from studies.core.job import Job
from studies.core.statement import Statement
from studies.core.study import EachEvent, Study
from studies.ladder.ladder_study import RULE
from studies.scenario.scenario import Scenario, shipped_scenario

# Random rails that stay as they are, for trains that ask for more than they offer; nothing is noisy.

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


SETTLED = 3.0
"""Length of the end of a run [s] in which torque should have settled."""
LIMITED = 0.999
"""Share of its target below which a unit is limited."""
Floats = NDArray[np.float64]


def measure(run: xr.Dataset) -> dict[str, float]:
    """Movement of the torque commands of the units that are limited to the end of a run; nan where none is.

    The first three are amplitudes over the mean torque, of the unit where they are greatest.

    - `swinging`: deviation from a parabola over time (root of twice the variance, a sine's amplitude).
    - `beside_swing`: residual after a parabola is fitted to each phase of the swing. It excludes the swing, its harmonics,
      and their slow changes.
    - `greatest_line`: greatest spectral line of that residual (Hann window).
    - `greatest_slip` [m/s]: of the whole run.
    - `limited_units`: number of units.
    """
    count = round(SETTLED / record_period(run))
    factor = np.abs(run["torque_factor"].values[-count:])
    command = np.abs(run["torque_command"].values[-count:])[:, (factor < LIMITED).all(axis=0)]
    slip = run["slip_velocity"].values[:, run["axle_unit"].values >= 0]
    result = {"greatest_slip": float(np.abs(slip).max()), "limited_units": float(command.shape[1])}
    names = ("swinging", "beside_swing", "greatest_line")
    if command.shape[1] == 0:
        return result | dict.fromkeys(names, np.nan)
    time = np.arange(count) * record_period(run)
    mean = command.mean(axis=0)
    # a command of 0 all the time moves nothing
    relative = command / np.where(mean > 0.0, mean, 1.0) - (mean > 0.0)
    about = _without(relative, _trend(time))
    beside = _beside_swing(relative, max(1, round(SlipSearch().swing_time / record_period(run))))
    values = (_amplitude(about), _amplitude(beside), _greatest_line(beside))
    return result | {name: float(one.max()) for name, one in zip(names, values, strict=True)}


def _trend(time: ArrayLike) -> Floats:
    """The course of the event: a parabola over time."""
    scaled = np.asarray(time, dtype=float)
    scaled = scaled / scaled[-1]
    return np.column_stack([np.ones_like(scaled), scaled, scaled**2])


def _beside_swing(values: Floats, ticks: int) -> Floats:
    """What a parabola over the periods of the swing, each of so many ticks, leaves of each phase.

    Enlarged by the degrees of freedom that it takes.
    """
    periods = values.shape[0] // ticks
    phases = values[: periods * ticks].reshape(periods, -1)
    base = _trend(np.arange(float(periods)))
    left = _without(phases, base).reshape(periods * ticks, -1)
    return left * np.sqrt(periods / (periods - base.shape[1]))


def _without(values: Floats, base: Floats) -> Floats:
    """What least squares with the columns of `base` leave of `values`."""
    left: Floats = values - base @ np.linalg.lstsq(base, values, rcond=None)[0]
    return left


def _amplitude(values: Floats) -> Floats:
    """Amplitude of a sine of the same variance, column by column."""
    found: Floats = np.sqrt(2.0 * (values**2).mean(axis=0))
    return found


def _greatest_line(values: Floats) -> Floats:
    """Amplitude of the greatest line of the spectrum, column by column."""
    window = np.hanning(values.shape[0])[:, None]
    found: Floats = 2.0 * np.abs(np.fft.rfft(values * window, axis=0)).max(axis=0) / window.sum()
    return found


CONTROLLERS = ("mpc", "perturb-observe", "cut-and-ramp")
"""The MPC, and for comparison one that steps and one whose nature a limit cycle is."""
SLIP = 2.0
"""Slip [m/s] that no axle should exceed."""
CYCLE = 0.005
"""Amplitude over the mean torque, without the swing of the search, above which torque counts as cycling."""
AMPLITUDES = {
    "swinging": "amplitude of torque with the swing",
    "beside_swing": "amplitude of torque beside the swing",
    "greatest_line": "greatest line beside the swing",
}


def _shares(which: str, words: str) -> dict[str, str]:
    """Share of the rails, and of those of each curve."""
    found = {f"share of rails {words}": which}
    return found | {f"{words}, {curve}": f"{which} if curve == {curve}" for curve in SHAPES}


def claims_of(controller: str) -> tuple[Claim, Claim]:
    """What is claimed of a controller on every rail."""
    beyond, cycling = f"greatest_slip > {SLIP:g}", f"beside_swing > {CYCLE}"
    limited = {text: name for name, text in AMPLITUDES.items()} | _shares(cycling, "that cycle")
    return (
        Claim(
            f"slip: {controller}", f"on constant rail no axle slips by more than {SLIP:g} m/s", beyond, AT_MOST, exact=True,
            reason="slip stays bounded", show=how_many("on", "rails"), method="holds if it does on every rail",
            numbers={"greatest slip [m/s]": "greatest_slip", **_shares(beyond, f"beyond {SLIP:g} m/s")},
        ),
        Claim(
            f"rest: {controller}", f"on constant rail torque does not cycle by {CYCLE:.1%} or more beside the swing",
            cycling, AT_MOST, exact=True, reason="torque comes to rest", show=how_many("on", "rails"),
            only="beside_swing == beside_swing",
            numbers={text: f"{name} if beside_swing == beside_swing" for text, name in limited.items()},
            method="units that are limited through the last 3 s; holds if it does on every rail",
        ),
    )  # fmt: skip


CLAIMS = tuple(claim for controller in CONTROLLERS for claim in claims_of(controller))


def constant_rail_statements(table: pd.DataFrame) -> list[Statement]:
    """Two statements per controller, on rows that are ok."""
    return [
        conjunction(table[table["controller"] == controller], claim)
        for controller in CONTROLLERS
        for claim in claims_of(controller)
    ]


def cells(seed: int, k: int, duration: float = DURATION) -> list[Job]:
    """Rail `k` under every controller."""
    one = scenario(seed, k, duration)
    return [Job(one, RULE, controller, k, measure) for controller in CONTROLLERS]


CONSTANT_RAIL = Study(
    name="constant-rail",
    question="whether slip stays bounded and torque comes to rest on rails that do not change",
    default_events=100,
    cells=EachEvent(cells),
    finish=EVENTS.joined,
    judge=lambda table: constant_rail_statements(table[table["status"] == "ok"]),
    claims=CLAIMS,
)
