"""Claim 3 and effect (3) of JP5484215: redistribution in drawn blended stops of multiple units, and its equations there.

Motors brake first, the line takes up part of it, the air brake fills (embodiment 3, Figs. 15 and 16). Every layer of the
patent and its prior art meet the same stops.
"""

from collections.abc import Iterable
from functools import cache, partial
from itertools import product
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from alloc.laws import GRAVITY
from alloc.plant.rows import rows_of_train
from alloc.plant.train import Train
from alloc.rules import RULES
from studies import claims
from studies.claims import CONTROLLERS, CORRECTED, LAYERS
from studies.files.scenario import Scenario
from studies.files.scenario_files import load_scenario
from studies.population import draws as e
from studies.run_cell import complete, paired, run
from studies.runner.study import NARROW, Cell, Study
from studies.standing import Statistic
from studies.statistics import Claim, Statement, draw_forest, judge

COMPARED = ("alone", *claims.PRIOR_ART, *LAYERS)
AS_PRINTED: e.Arms = {
    **claims.AS_PRINTED,
    # the torque that decelerates the wheelsets counts as force of the rail
    "(18) without inertia": {"braking": {"inertia_in_estimate": False}},
    # the air brake's force lags behind its command
    "(18) with the command": {"braking": {"air_force": "command"}},
}
"""Deviation of the equipment that is taken back -> its keys."""
ARMS = {CORRECTED: AS_PRINTED}

# the stops: all that is drawn is assumed

ROLLING, DURATION = 3.0, 17.0
"""Time before the brakes, in which the train learns the gradient, and length [s]: fast trains still brake then."""
REFERENCE_SPEED, LEAST_LEVEL = 15.0, 0.02
"""Speed [m/s] at which a rail of any curve offers the drawn coefficient; the least one."""
SLOPE = 0.0083 / 0.07
"""Growth along the train over the coefficient: (15), in proportion."""


class Kind(NamedTuple):
    """A train, and the stops that are usual for it."""

    keys: e.Keys
    most_load: float
    """Of a car [t]."""
    speed: tuple[float, float]
    """[km/h]"""
    deceleration: tuple[float, float]
    """Deceleration of a service stop and of an emergency stop [km/h/s]."""


_COMMUTER = (12.0, (30.0, 120.0), (2.0, 4.0))
DRAWN_TRAINS = {
    "inverter per car": Kind({"train": "commuter-8car"}, *_COMMUTER),
    "sixteen cars": Kind({"train": "high-speed-16car"}, 6.0, (40.0, 240.0), (1.6, 2.8)),
    "inverter per axle": Kind({"train": "commuter-8car", "inverter_group": "1C1M"}, *_COMMUTER),
}
NUMBERS = (0, 2, 3)
"""What a stop's draws follow from, by its train and beside six for each round: so stops stay what they were."""
CURVES = ("piecewise", "polach-wet", "slip-ratio", "rational", "polach-dry", "polach-by-friction",
          "exponential-difference")  # fmt: skip
"""Every kind that ships; trains believe in the first."""


def draw(seed: int, k: int) -> e.Keys:
    """What is drawn for stop `k`; trains and curves take turns."""
    number = 6 * (k // 3) + NUMBERS[k % 3]
    g = e.Draw(seed, number, 19)
    return {
        "train": list(DRAWN_TRAINS)[k % 3],
        "curve": CURVES[number % 7],
        "residual_ratio": g.uniform(0.3, 0.98),  # steep to flat behind the peak
        "peak_slip": g.log_uniform(0.15, 0.8),
        "peak_slip_ratio": g.log_uniform(0.01, 0.1),
        "steepness": g.log_uniform(8.0, 20.0),
        "load": g.uniform(0.0, 1.0),  # of the greatest
        "speed": g.uniform(0.0, 1.0),  # of the way from the least to the greatest
        "end_kmh": g.mixture(0.4, 20.0, 35.0, 0.0),  # the end of a stop: the electric brake fades
        "deceleration": g.uniform(0.0, 1.0),  # of the way from a service to an emergency stop
        "share": g.uniform(0.4, 1.1),  # of the coefficient that the command needs: most slide
        "growth": g.uniform(0.0, 1.2),  # of the believed growth along the train
        "drop_factor": g.mixture(0.6, 0.5, 0.85, 1.0),
        "drop_begin_s": g.uniform(1.3, 5.0),  # after the brakes are up
        "drop_length_s": g.uniform(2.0, 7.0),
        "patch_factor": g.mixture(0.5, 0.5, 1.6, 1.0),  # leaves, or cleaner rail
        "patch_start_m": g.uniform(0.0, 150.0),
        "patch_length_m": g.uniform(20.0, 150.0),  # a car to a train
        "scatter_share": g.mixture(0.5, 0.01, 0.06, 0.0),
        "conditioning": g.mixture(0.4, 0.05, 0.3, 0.0),  # wheels that slide clean the rail
        "grade_permille": g.mixture(0.5, -20.0, 20.0, 0.0),
        "receptivity": g.mixture(0.4, 0.3, 0.9, 1.0),  # taken up of the electric brake, mean
        "fails": (fails := g.uniform(0.0, 1.0) < 0.15),  # a unit: air makes up for its motors
        "failed_place": g.uniform(0.0, 1.0) if fails else 0.0,
        "failed_at_s": g.uniform(2.0, 6.0) if fails else 0.0,
        "law": ("threshold", "fuzzy")[int(g.generator.integers(2))],  # of slide protection
        "speed_noise_kmh": g.uniform(0.0, 0.04),
        "speed_quantum_kmh": g.mixture(0.5, 0.005, 0.05, 0.0),  # pulses timed over a period
        # diameters of 0.86 m entered to a millimetre, to wheels that wore by 4 mm since
        "radius_error": 0.0005 * 10.0 ** g.mixture(0.5, 0.0, 1.0, -np.inf),  # 0 in the others
        "load_error": g.uniform(0.0, 0.05),
        "mass_factor": g.uniform(0.97, 1.03),  # what a works scale leaves
        "resistance_factor": g.uniform(0.8, 1.2),  # wind, and formulas that fit a class
        "unused": g.uniform(0.0, 1.0),  # for the sake of the draws behind it
        "telegram_loss": g.mixture(0.5, 0.0, 0.05, 0.0),
        "day": int(g.generator.integers(1, 2**31)),
    }


@cache
def empty_train(name: str) -> Train:
    """Empty."""
    return (
        load_scenario("wet-stop").changed(variation=None, **DRAWN_TRAINS[name].keys).event().train
    )


def event(seed: int, k: int) -> Scenario:
    """Stop `k`."""
    d = draw(seed, k)
    kind, train = DRAWN_TRAINS[d["train"]], empty_train(d["train"])
    deceleration = _interpolate(kind.deceleration, d["deceleration"]) / 3.6
    speed = d["end_kmh"] or _interpolate(kind.speed, d["speed"])
    offered = max(LEAST_LEVEL, d["share"] * deceleration / GRAVITY)
    drop = e.spell(d["drop_factor"], ROLLING + d["drop_begin_s"], d["drop_length_s"], 0.3)
    rail = e.rail_keys(e.curve_keys(d["curve"], d), offered, train, REFERENCE_SPEED)
    rail |= {
        "increments": _growth(d["growth"] * rail["level"], train),
        "conditioning": d["conditioning"],
        "scatter": d["scatter_share"] * rail["level"],
        "scatter_length_m": 20.0,
        "patches": [*drop, *e.patch_keys(d, speed / 3.6 * ROLLING)],
    }
    onboard = e.signal_keys(d) | {"braking": {"slide_protection": {"law": d["law"]}}}
    factors = ("mass_factor", "resistance_factor")
    increments = _growth(deceleration / GRAVITY, train)
    believed = {"curve": {"kind": CURVES[0]}, "increments": increments}
    return e.drawn_event(
        load_scenario("wet-stop"),
        f"blended-{seed}-{k:04d}",
        f"drawn stop {k}: {d['train']}, {d['curve']}",
        duration_s=DURATION,
        target_speed_kmh=None,
        initial_speed_kmh=speed,
        line=e.line_keys(d, -1e4),
        load_t=[e.drop_tiny("_t", d["load"] * kind.most_load)] * len(train.cars),
        rail=rail,
        onboard=onboard,
        command=[{"time_s": ROLLING, "acceleration_kmhs": -3.6 * deceleration}],
        failures=e.failure_keys(d, rows_of_train(train).drives.size, ROLLING),
        receptivity=e.receptivity_keys(d),
        belief=believed | {name: d[name] for name in factors},
        **kind.keys,
    )


def _interpolate(limits: tuple[float, float], share: float) -> float:
    return limits[0] + share * (limits[1] - limits[0])


def _growth(level: float, train: Train) -> e.Keys:
    """Growth in proportion to `level`, 0 on the mean of the axles."""
    slope = SLOPE * level
    mean_log = float(np.log(np.arange(1.0, train.axle_count + 1.0)).mean())
    return {"law": "logarithmic", "slope": slope, "offset": -slope * mean_log}


def cells(events: int, seed: int) -> list[Cell]:
    """Every stop under every rule, arm and controller, the same day."""
    cells = []
    for k in range(events):
        stop, d = event(seed, k), draw(seed, k)
        drawn = {name: d[name] for name in ("train", "curve")}
        cells += claims.make_arms(stop, COMPARED, ARMS, d["day"], claims.count_slips, **drawn)
    return cells


# what is claimed; all thresholds are zero, and were set before the stops were drawn

GAIN = "acceleration_ratio"
WORTH = 0.01
"""Headroom over the plan that is worth sharing."""


def select_stops(
    rows: pd.DataFrame, controller: str, rule: str, bases: Iterable[str]
) -> pd.DataFrame:
    """One row per stop in which a unit slides under alone: only these call for the patent."""
    runs = paired(rows, controller, rule, dict.fromkeys((*bases, "alone")))
    return runs[runs["slipping_units_alone"] >= 1]


def statements(rows: pd.DataFrame) -> list[Statement]:
    """Every rule over alone and every layer over dynamic sharing, a family of 24; and the deviations, one of ten."""
    good, gains = complete(rows), []
    pairs = [*((rule, "alone") for rule in COMPARED[1:]), *((rule, "sharing") for rule in LAYERS)]
    for controller, (rule, reference) in product(CONTROLLERS, pairs):
        runs = select_stops(good, controller, rule, (reference,))
        wide = runs["headroom_alone"] > WORTH
        parts = {"headroom above 1 % of the plan": wide, "headroom up to 1 %": ~wide}
        gain = 100.0 * (runs[GAIN] - runs[f"{GAIN}_{reference}"])
        text = f"decelerates more than {reference}: deceleration [points of plan]"
        name = f"{rule} over {reference} under {controller}"
        gains.append(Claim(name, text, gain, least=0.0, parts=parts, digits=2))
    return judge(gains) + judge(claims.claim_deviations(AS_PRINTED, partial(select_stops, good)))


COSTS = {name: column for name, column in claims.COLUMNS.items() if "bound" not in name}
COLUMNS = {"deceleration [points of plan]": Statistic(GAIN, 2, 100.0), **COSTS}


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """What each rule adds to alone, with the verdict on it, and each deviation to the corrected patent."""
    pair, arms = partial(select_stops, complete(rows)), claims.list_compared(COMPARED, ARMS)
    verdict = "decelerates more", "{} over {} under {}", statements(rows)
    return claims.tabulate_pairs(arms, pair, COLUMNS, verdict)


def figure(rows: pd.DataFrame) -> Figure:
    """Every rule over alone."""
    drawn = Figure(figsize=(NARROW, 2.4), layout="constrained")
    axes, judged = drawn.subplots(), statements(rows)
    numbers = {statement.claim.name: statement.number for statement in judged}
    names = {
        rule: [f"{rule} over alone under {name}" for name in CONTROLLERS] for rule in COMPARED[1:]
    }
    pairs = {rule: [numbers[name] for name in pair] for rule, pair in names.items()}
    draw_forest(axes, pairs, RULES, 0.0)
    axes.set(title=claims.MARKERS, xlabel="deceleration over alone [points of plan]")
    return drawn


QUESTION = "Does redistribution by JP5484215 improve deceleration in drawn blended stops (claim 3)?"
STUDY = Study("braking", QUESTION, cells, run, table, figure, statements, events=120, seed=90)
