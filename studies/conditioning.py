"""JP4209318 par. 0051: who should slip for whom, where wheels that slip clean the rail for those behind?

A train in balance, by the plant's laws: the motors of a unit have one torque, and its foremost axle slips most. At best some
foremost units share a slip, and the rest another below the peak; units that are all free reach no more (a test). Baselines:
the best slip for all, and US 10780904, which moves one slip for all to where the mean adhesion of the axles is greatest.
"""

import math
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import matplotlib as mpl
import numpy as np
import pandas as pd
import scipy  # loads `interpolate` when it is needed
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import ArrayLike, NDArray

from alloc import laws
from alloc.evaluation.metrics import METRICS
from alloc.onboard.controllers import CONTROLLERS
from alloc.plant.curves import CURVES, PiecewiseCurve, SlipRatioCurve
from alloc.plant.rail import Rail
from alloc.run.event import DriverCommand, Event
from alloc.run.simulation import Simulation
from studies.files.scenario_files import load_scenario
from studies.population import population
from studies.population.draws import Draw
from studies.runner.study import WIDE, Cell, Row, Study
from studies.standing import Statistic, without_interval
from studies.tuning import PRICE

Floats = NDArray[np.float64]
LOAD, UNITS = 78_453.2, 4
"""Axle load of a motor car [N], and motor cars, of `commuter-8car`."""
MOST = 0.2
"""Greatest slip ratio that is held: assumed, as slide protection allows."""
HALVINGS = 24


def make_rail(law: str, level: float, gain: float, scale: float = 0.02, **keys: Any) -> Rail:
    """A rail that wheels clean by "slip", 63 % at the slip ratio `scale`, or by "energy", up to (1 + `gain`) `level`."""
    if law == "energy":
        return Rail(level, recovered_coefficient=level * (1.0 + gain), **keys)
    return Rail(level, conditioning=gain, conditioning_slip=scale, **keys)


def halve(too_low: Callable[[Floats], NDArray[np.bool_]], low: Floats, high: Floats) -> Floats:
    """Where `too_low` ends between `low` and `high`, by bisection."""
    for _ in range(HALVINGS):
        middle = 0.5 * (low + high)
        rises = too_low(middle)
        low, high = np.where(rises, middle, low), np.where(rises, high, middle)
    return high


@dataclass(frozen=True)
class Balance:
    """A train in balance on such a rail. Forces and powers [m/s] are over load; arguments broadcast."""

    rail: Rail
    speed: float = 10.0
    units: int = UNITS
    axles: int = 4

    def meet(self, clean: Floats, slip: Floats, force: Floats) -> tuple[Floats, Floats]:
        """What the rail offers an axle that finds it `clean` to a degree, and the degree to which it leaves it clean."""
        rail, v = self.rail, self.speed
        if not rail.recovered_coefficient:
            degree = laws.cleaned(slip / (v + slip), rail.conditioning_slip)
            return rail.level * (1.0 + rail.conditioning * clean), degree
        power = LOAD * force * slip
        settled = laws.recovery(0.0, power, v, rail.recovery_energy, 1.0, math.inf)
        degree = laws.both_cleaned(settled, clean)
        offered = laws.recovered(rail.level, degree, rail.recovered_coefficient)
        return offered, rail.recovery_left * degree

    def carries(self, clean: Floats, slip: Floats, force: Floats) -> NDArray[np.bool_]:
        """Whether an axle with this slip carries more than the force."""
        return self.rail.curve(slip, self.meet(clean, slip, force)[0], self.speed) > force

    def find_slip(self, clean: Floats, force: Floats, most: Floats) -> Floats:
        """Least slip [m/s], at most `most`, at which an axle carries the force."""
        offered = self.meet(clean, 0.0 * most, force)[0]
        top = np.minimum(most, self.rail.curve.top(self.speed, offered)[1])
        near = self.carries(clean, top, force)
        low, high = np.where(near, 0.0, top), np.where(near, top, most)
        return halve(lambda slip: ~self.carries(clean, slip, force), low, high)

    def pull(self, clean: Floats, slip: Floats) -> tuple[Floats, Floats, Floats]:
        """Force of a unit, power that slip dissipates, and how clean it leaves the rail; `slip` [m/s] of its first axle.

        Axles behind carry the same force at the least slip at which they can.
        """
        clean, slip = np.broadcast_arrays(clean, slip)
        peak = np.full(slip.shape, self.rail.greatest_peak())
        # more force is more energy, and so cleaner rail
        force = halve(lambda force: self.carries(clean, slip, force), 0.0 * peak, peak)
        clean, power = np.maximum(clean, self.meet(clean, slip, force)[1]), force * slip
        for _ in range(self.axles - 1):
            behind = self.find_slip(clean, force, slip)
            clean = np.maximum(clean, self.meet(clean, behind, force)[1])
            power = power + force * behind
        return force, power / self.axles, clean

    def run(self, *slips: ArrayLike) -> tuple[Floats, Floats]:
        """Mean force and power of units with these slips [m/s] from the foremost on."""
        clean, force, power = np.zeros((3, 1))
        for slip in slips:
            pulled, spent, clean = self.pull(clean, np.asarray(slip))
            force, power = force + pulled, power + spent
        return force / len(slips), power / len(slips)


def score(force: ArrayLike, power: ArrayLike) -> Floats:
    """Effort less the price of damage that tuning has [%]: 22 % more damage cost a point."""
    return np.asarray(100.0 * np.log(force) - PRICE * np.log(power))


def find_best(balance: Balance, nodes: int = 64) -> Row:
    """Slips [m/s]: `uniform`, the best for all; `mean`, of the greatest mean adhesion; `lead` of `leaders`, `rest`: optimum.

    `won`, `lost`: score of the optimum over that of `uniform`, and of that over `mean`. `effort_won`, `damage_won`: over
    `uniform` at equal damage, and at equal effort. `nodes`: slips of the foremost units; a third as many of the rest.
    """
    n, curve, v = balance.units, balance.rail.curve, balance.speed
    held = np.geomspace(1e-3, MOST / (1.0 - MOST) * v, 4 * nodes)
    force, power = balance.run(*n * [held])
    u, p = int(score(force, power).argmax()), int(force.argmax())
    reached, spent, scores = force[u], power[u], score(force, power)
    options, efforts, least = [(float(scores[u]), held[u], held[u], n)], [reached], [spent]
    lost = scores[u] - scores[p]
    rest = np.linspace(0.05, 1.0, nodes // 3) * curve.top(v, balance.rail.greatest_peak())[1]
    for k in range(1, n):
        lead = held[::4]
        force, power = balance.run(*k * [lead[:, None]], *(n - k) * [rest])
        scores = score(force, power)
        i, j = np.unravel_index(int(scores.argmax()), scores.shape)
        options.append((float(scores[i, j]), lead[i], rest[j], k))
        for f, q in zip(np.maximum.accumulate(force, axis=1), power, strict=True):
            if q[0] <= spent:
                efforts.append(np.interp(spent, q, f))
            if f[0] <= reached <= f[-1]:
                least.append(np.interp(reached, f, q))
    best, first, behind, leaders = max(options)
    numbers = {
        "uniform": held[u], "mean": held[p], "lead": first, "rest": behind,
        "won": best - options[0][0], "lost": lost, "effort_won": max(efforts) / reached - 1.0,
        "damage_won": 1.0 - min(least) / spent, "leaders": leaders,
    }  # fmt: skip
    return {name: float(number) for name, number in numbers.items()}


LEVELS, GAINS, SHOWN = np.linspace(0.06, 0.15, 5), np.geomspace(0.03, 3.0, 13), [4, 6, 8]
MIDDLE = float(LEVELS[2])
Case = tuple[str, dict[str, Any], dict[str, Any]]
"""Law of cleaning, and what differs of rail and train."""
WIDE_PEAK = SlipRatioCurve(0.03, 0.8)
MAPS: dict[str, Case] = {
    "by slip": ("slip", {}, {}),
    "by slip, wide peak": ("slip", {"curve": WIDE_PEAK}, {}),
    "by energy": ("energy", {}, {}),
}
CASES: dict[str, Case] = {
    "5 m/s": ("slip", {}, {"speed": 5.0}),
    "20 m/s": ("slip", {}, {"speed": 20.0}),
    "63 % at 0.005": ("slip", {"scale": 0.005}, {}),
    "63 % at 0.05": ("slip", {"scale": 0.05}, {}),
    "2 units": ("slip", {}, {"units": 2}),
    "8 units": ("slip", {}, {"units": 8}),
    "motors one by one": ("slip", {}, {"axles": 1}),
    "a tenth of the energy": ("energy", {"recovery_energy": 420.0}, {}),
    "that, and all is left": ("energy", {"recovery_energy": 420.0, "recovery_left": 1.0}, {}),
}
"""Beside the maps, at the level `MIDDLE` and the gains `SHOWN`."""
RATIOS = 1.25 ** np.arange(-4.0, 5.0)
"""Slips for all that a start is run with, over the best one of a train in balance."""
LATE = 13.0
"""Instant [s] from which most trains have run from the foremost unit to the hindmost, 100 m."""
OPTIMUM, SEARCH, UNIFORM = "optimum", "perturb-observe", "one slip"


def make_start(seed: int, k: int, law: str) -> Event:
    """Start `k`: rail, curve and first speed are drawn; motors are strong, so that adhesion alone limits the effort."""
    g = Draw(seed, k, 76)
    level, speed = g.uniform(0.06, 0.15), g.uniform(15.0, 45.0) / 3.6
    gain, scale = min(g.log_uniform(0.15, 1.5), 0.22 / level - 1.0), g.log_uniform(0.005, 0.05)
    kind = g.choose(("piecewise", "rational", "slip-ratio"), [0.5, 0.25, 0.25])
    shape = {key: g.log_uniform(*ends) for key, ends in population.CURVES[kind].items()}
    rail = make_rail(law, level, gain, scale, curve=CURVES[kind](**shape))
    event = load_scenario("wet-start").changed(variation=None, duration_s=20.0).event(0)
    cars = tuple(
        replace(car, motors=car.motors and replace(car.motors, power=5e5))
        for car in event.train.cars
    )
    train, command = replace(event.train, cars=cars), DriverCommand((0.0,), (1.4,))
    return replace(event, train=train, rail=rail, command=command, initial_speed=speed)


def simulate_held(event: Event, controller: str, slips: Any = math.nan) -> xr.Dataset:
    """The run in which units hold `slips` [m/s] under "pi-creep", or begin with them under a search."""
    start = Simulation(event, "alone", controller)
    memory = start.world.memory.view(np.uint8).view(CONTROLLERS[controller].memory.dtype)
    memory["reference"][:, 0] = slips
    start.run_to_end()
    return start.recorded()


def run(kind: str, law: str, number: float, start: int = 0) -> list[Row]:
    """The optimum over gains at a level of a map or a case; or a start under everything that its units may hold."""
    if kind != "start":
        by, keys, train = (MAPS | CASES)[law]
        gains = GAINS if kind == "map" else GAINS[SHOWN]
        rails = {gain: make_rail(by, number, gain, **keys) for gain in gains.tolist()}
        return [{"gain": g} | find_best(Balance(rail, **train)) for g, rail in rails.items()]
    event = make_start(int(number), start, law)
    runs = {SEARCH: simulate_held(event, SEARCH)}
    best = find_best(Balance(event.rail, float(runs[SEARCH]["speed"].mean())))
    leaders = int(best["leaders"])
    slips = {OPTIMUM: np.repeat([best["lead"], best["rest"]], [leaders, UNITS - leaders])}
    slips |= {f"{UNIFORM} {ratio:.2f}": ratio * best["uniform"] for ratio in RATIOS}
    runs |= {name: simulate_held(event, "pi-creep", held) for name, held in slips.items()}
    peak = "narrow" if isinstance(event.rail.curve, PiecewiseCurve) else "drawn"
    rows = []
    for held, record in runs.items():
        late = record.isel(time=record["time"].values >= LATE, axle=record["axle_unit"].values >= 0)
        power = late["rail_force"] * late["slip_velocity"]
        row: Row = {
            name: float(METRICS[name].function(record)) for name in ("effort_ratio", "damage")
        }
        row |= {"late": float(score(late["rail_force"].mean(), power.mean()))}
        rows.append(row | {"held": held, "peak": peak, "won": best["won"]})
    return rows


def cells(events: int, seed: int) -> list[Cell]:
    """Maps level by level, cases, then each start on a rail that either law cleans."""
    args: list[Any] = [("map", name, level) for name in MAPS for level in LEVELS.tolist()]
    args += [("case", name, MIDDLE) for name in CASES]
    args += [("start", law, seed, k) for k in range(events) for law in ("slip", "energy")]
    heads = ("kind", "law", "number")  # the level, or the start
    return [
        Cell("/".join(map(str, x)), x, dict(zip(heads, (*x[:2], x[-1]), strict=True))) for x in args
    ]


def compare_starts(rows: pd.DataFrame) -> pd.DataFrame:
    """Starts with `equal`, effort over that of the best slip for all at the same damage, and scores over its own."""
    starts = rows[(rows["status"] == "ok") & (rows["kind"] == "start")].copy()
    starts["score"] = score(starts["effort_ratio"], starts["damage"])
    for _, part in starts.groupby(["law", "number"]):
        front = part[part["held"].str.startswith(UNIFORM)].sort_values("damage")
        damage, effort = np.log(front["damage"]), np.maximum.accumulate(front["effort_ratio"])
        reach = scipy.interpolate.PchipInterpolator(damage, effort, extrapolate=False)
        starts.loc[part.index, "equal"] = part["effort_ratio"] / reach(np.log(part["damage"])) - 1.0
        for name in ("score", "late"):
            starts.loc[part.index, f"{name}_ahead"] = part[name] - front[name].max()
    return starts


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Starts by law and peak: what is reached over the best slip for all of each start."""
    columns = {
        "promised [points]": Statistic("won", 1),
        "in the last 7 s": Statistic("late_ahead", 1),
        "in the whole start": Statistic("score_ahead", 1),
        "worst": Statistic("score_ahead", 1, average=without_interval(pd.Series.min)),
        "effort at equal damage [%]": Statistic("equal", 1, 100.0),
    }
    lines = []
    for (law, peak), part in compare_starts(rows).groupby(["law", "peak"]):
        for name in (OPTIMUM, SEARCH):
            runs = part[part["held"] == name]
            line: Row = {"cleaned by": law, "peak": peak, "starts": len(runs), "units hold": name}
            line |= {head: column.text(runs) for head, column in columns.items()}
            lines.append(line | ({} if name == OPTIMUM else {"promised [points]": "–"}))
    return pd.DataFrame(lines)


def map_table(rows: pd.DataFrame) -> pd.DataFrame:
    """Optimum of maps and cases at the level `MIDDLE` and the gains `SHOWN`."""
    good = rows[(rows["status"] == "ok") & (rows["number"] == MIDDLE)]
    return pd.DataFrame(
        {
            "rail": row.law, "gain": f"{row.gain:.2f}", "leaders": f"{row.leaders:.0f}",
            "slips [m/s]": f"{row.lead:.2f}, {row.rest:.2f}", "one slip [m/s]": f"{row.uniform:.2f}",
            "effort won [%]": f"{100.0 * row.effort_won:.1f}", "damage won [%]": f"{100.0 * row.damage_won:.0f}",
            "slip of greatest mean adhesion [m/s]": f"{row.mean:.2f}", "lost there [points]": f"{row.lost:.1f}",
        }
        for row in good[good["gain"].isin(GAINS[SHOWN])].itertuples()
    )  # fmt: skip


def figure(rows: pd.DataFrame) -> Figure:
    """Phase diagrams: slip of the foremost units over that of the rest, what it wins, where one slip for all is a slide."""
    drawn = Figure(figsize=(WIDE, 2.4), layout="constrained")
    panels = drawn.subplots(1, len(MAPS), sharey=True)
    norm = mpl.colors.LogNorm(1.0, 30.0)
    for axes, name in zip(panels, MAPS, strict=True):
        good = rows[(rows["status"] == "ok") & (rows["law"] == name)]
        lead, rest, won, uniform = (
            good.pivot(index="gain", columns="number", values=key)
            for key in ("lead", "rest", "effort_won", "uniform")
        )
        mesh = axes.pcolormesh(
            LEVELS, GAINS, lead / rest, norm=norm, cmap="cividis", shading="gouraud"
        )
        for values, levels, text, colour in (
            (100.0 * won, [2.0, 8.0], "%g %%", "white"),
            (uniform, [1.0], "all at 1 m/s", "#e69f00"),
        ):
            if values.to_numpy().min() < levels[0] < values.to_numpy().max():
                axes.clabel(axes.contour(LEVELS, GAINS, values, levels, colors=colour), fmt=text)
        axes.set(yscale="log", xlabel="level of the rail [1]", title=name)
    panels[0].set_ylabel("gain of clean rail [1]")
    bar = drawn.colorbar(mesh, ax=panels, label="slip of the foremost over the others' [1]")
    bar.set_ticks([1.0, 3.0, 10.0, 30.0], labels=["1", "3", "10", "30"])
    return drawn


QUESTION = "Which units should slip more, where wheels that slip clean the rail for those behind?"
STUDY = Study(
    "conditioning", QUESTION, cells, run, table, figure,
    events=15, seed=7602, more_tables={"map": map_table},
)  # fmt: skip
