"""What turns on what is assumed: each assumed number at half and double, each effect of the plant left out.

The four best pairs meet the first events of the population again under every change. Two orders are watched: sharing
against none, and the MPC against a search by perturb and observe.
"""

from collections.abc import Callable
from functools import reduce
from typing import TYPE_CHECKING, Any

import pandas as pd

from alloc.evaluation.metrics import evaluate
from alloc.onboard.settings import Assumed, Onboard
from alloc.run.simulation import simulate
from alloc.schema.units import unit_of_key
from studies import run_cell
from studies.files.scenario import Scenario
from studies.population import population
from studies.population.draws import Keys
from studies.runner.study import WIDE, Cell, Row, Study
from studies.statistics import Interval, mean

if TYPE_CHECKING:
    from matplotlib.figure import Figure

PAIRS = [(rule, name) for name in ("perturb-observe", "mpc") for rule in ("alone", "cooperative")]
AS_DRAWN = "as drawn"
NUMBERS = (
    "onboard.telegrams.latency_s", "onboard.telegrams.jitter_s", "onboard.telegrams.loss", "onboard.telegrams.silence_s",
    "onboard.rise_time_s", "onboard.period_s", "onboard.braking.blend_time_s",
    "onboard.sensors.speed_noise_kmh", "onboard.sensors.speed_quantum_kmh", "onboard.sensors.radius_error",
    "onboard.sensors.load_error", "belief.mass_factor", "belief.resistance_factor", "belief.lag_factor",
    "belief.inertia_factor", "belief.brake_factor",
    "rail.scatter", "rail.scatter_length_m", "rail.conditioning", "rail.conditioning_slip",
    "receptivity.amplitude", "receptivity.period_s",
    "train.resistance_n", "train.resistance_ns_per_m", "train.resistance_ns2_per_m2",
    "train.coupler.stiffness_n_per_m", "train.coupler.damping_ns_per_m",
    "cars.wheel_inertia_kgm2", "cars.motors.torque_lag_s", "cars.motors.fade_speed_kmh",
    "cars.air_brake.lag_s", "cars.air_brake.dead_time_s",
)  # fmt: skip
"""Keys of the scenario that are assumed or drawn without a source; of `cars`, of all kinds of cars."""
WITHOUT: dict[str, Callable[[Keys], Keys]] = {
    "no patches": lambda s: s | {"rail": s["rail"] | {"patches": []}},
    "no scatter": lambda s: s | {"rail": s["rail"] | {"scatter": 0.0}},
    "no cleaning": lambda s: s | {"rail": s["rail"] | {"conditioning": 0.0}},
    "no growth along the train": lambda s: s | {"rail": s["rail"] | {"increments": {"law": "none"}}},
    "piecewise curve": lambda s: s | {"rail": s["rail"] | {"curve": {"kind": "piecewise"}}},
    "no load transfer": lambda s: s | {"load_transfer": False},
    "no failures": lambda s: s | {"failures": []},
    "a level line": lambda s: s | {"line": {}},
    "rigid train": lambda s: s | {"train": {key: table for key, table in s["train"].items() if key != "coupler"}},
    "all power taken up": lambda s: s | {"receptivity": {}},
    "perfect sensors": lambda s: s | {"onboard": s["onboard"] | {"sensors": {}}},
    "prompt telegrams": lambda s: s | {"onboard": s["onboard"] | {"telegrams": {"period_s": 0.01, "latency_s": 0.0}}},
    "true speed": lambda s: s | {"onboard": s["onboard"] | {"reference": {"source": "truth"}}},
}  # fmt: skip
"""Effects of the plant and of the signals that are left out."""
LARGEST = 14
"""How many changes a figure shows."""
LOOKS = {" × 0.5": (-0.2, "#0072b2"), " × 2": (0.2, "#d55e00"), "": (0.0, "0.55")}
"""Ending of a change's name: where its bar stands in its row, and its colour."""


def list_changes() -> list[str]:
    """Names of all changes, first none."""
    scaled = [f"{key} × {factor:g}" for key in NUMBERS for factor in (0.5, 2.0)]
    return [AS_DRAWN, *scaled, *WITHOUT]


def change_scenario(scenario: Scenario, name: str) -> Scenario:
    """The event under a change; itself where the change has nothing to act on."""
    keys = scenario.model_dump(mode="json", exclude_unset=True)
    if name in WITHOUT:
        return scenario.changed(**WITHOUT[name](keys))
    if name == AS_DRAWN:
        return scenario
    path, _, factor = name.partition(" × ")
    whole, parts = scenario.model_dump(mode="json"), path.split(".")
    if parts[0] != "cars":
        _scale_key(whole, keys, parts, float(factor))
    for kind in keys["train"]["car"] if parts[0] == "cars" else ():
        _scale_key(whole, keys, ["train", "car", kind, *parts[1:]], float(factor))
    return scenario.changed(**keys)


def _scale_key(whole: Any, keys: Any, path: list[str], factor: float) -> None:
    """Multiply what stands at `path` of the whole table, in `keys`; nothing where there is no number.

    What is left out on board has the default of its record.
    """
    value = reduce(lambda table, key: (table or {}).get(key), path, whole)
    if value is None and path[0] in ("onboard", "belief"):
        unit = unit_of_key(path[-1])
        record = reduce(getattr, path[1:-1], Onboard() if path[0] == "onboard" else Assumed())
        value = getattr(record, path[-1].removesuffix(unit.ending)) / unit.factor
    if value:
        inner = reduce(lambda table, key: table.setdefault(key, {}), path[:-1], keys)
        inner[path[-1]] = factor * value


def cells(events: int, seed: int) -> list[Cell]:
    """Each event under each change that makes another event of it, and under the four pairs."""
    cells = []
    for k in range(events):
        base = population.event(seed, k)
        for name in list_changes():
            scenario = change_scenario(base, name)
            if name != AS_DRAWN and scenario == base:
                continue
            for rule, controller in PAIRS:
                columns = {"scenario": base.name, "change": name, "rule": rule}
                columns["controller"] = controller
                args = scenario, rule, controller, k
                cells.append(Cell("/".join(columns.values()), args, columns))
    return cells


def run(scenario: Scenario, rule: str, controller: str, k: int) -> Row:
    """Use of the bound."""
    metrics = evaluate(simulate(run_cell.event_of(scenario, k), rule, controller))
    return {"bound_use": metrics["bound_use"]}


def _find_gains(rows: pd.DataFrame) -> pd.DataFrame:
    """What is watched, by change and event [points]."""
    good = rows[rows["status"] == "ok"]
    used = 100.0 * good.pivot(
        index=["change", "scenario"], columns=["rule", "controller"], values="bound_use"
    )
    gains = {
        f"sharing under {controller}": used["cooperative", controller] - used["alone", controller]
        for _, controller in PAIRS[::2]
    }
    gains["MPC over the search, alone"] = used["alone", "mpc"] - used["alone", "perturb-observe"]
    return pd.DataFrame(gains)


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Under each change what sharing gains, and what the MPC gains, as means with intervals; which orders turn."""
    gains = _find_gains(rows)
    lines, base = [], {kind: mean(gain.loc[AS_DRAWN]) for kind, gain in gains.items()}
    for name in [name for name in list_changes() if name in gains.index]:
        line: Row = {"change": name, "events": len(gains.loc[name])}
        numbers = {kind: mean(gain.loc[name].dropna()) for kind, gain in gains.items()}
        line |= {str(kind): number.text(2, sign=True) for kind, number in numbers.items()}
        turned = [str(k) for k, number in numbers.items() if _sign(number) * _sign(base[k]) < 0]
        lines.append(line | {"turns": "; ".join(turned) or "–"})
    return pd.DataFrame(lines)


def figure(rows: pd.DataFrame) -> "Figure":
    """By how much a gain moves under the changes that move one most, over the events that they reach."""
    from matplotlib.figure import Figure

    gains = _find_gains(rows)
    moves = gains.drop(AS_DRAWN, level=0).sub(gains.loc[AS_DRAWN], level="scenario")
    largest = moves.groupby("change").mean().abs().max(axis=1)
    keys = largest.groupby(lambda name: name.split(" × ")[0]).max().nlargest(LARGEST).index
    drawn = Figure(figsize=(WIDE, 0.9 + 0.17 * LARGEST), layout="constrained")
    panels = drawn.subplots(1, len(gains.columns), sharey=True)
    for axes, (kind, move) in zip(panels, moves.items(), strict=True):
        for ending, (shift, colour) in LOOKS.items():
            for j, name in enumerate(keys + ending):
                if name in move.index:
                    number = mean(move.loc[name].dropna())
                    axes.barh(j + shift, number.value, 0.36, color=colour)
                    axes.plot(
                        [number.low, number.high], [j + shift] * 2, color="0.2", linewidth=0.7
                    )
        axes.axvline(0.0, color="0.5", linewidth=0.8)
        axes.set(title=kind, xlabel="change of the gain\n[points]")
    panels[0].set_yticks(range(len(keys)), keys)
    panels[0].invert_yaxis()
    panels[0].set_ylabel("number or effect that is changed")
    bars = [panels[0].barh(0.0, 0.0, color=colour).patches[0] for _, colour in LOOKS.values()]
    drawn.legend(
        bars, ["halved", "doubled", "left out or replaced"], loc="outside upper right", ncols=3
    )
    return drawn


def _sign(number: Interval) -> int:
    """Of a mean whose interval does not hold 0."""
    return int(number.low > 0.0) - int(number.high < 0.0)


QUESTION = "Which orders of rules and controllers turn where a number or an effect is changed?"
STUDY = Study("assumptions", QUESTION, cells, run, table, figure, events=60, seed=population.SEED)
