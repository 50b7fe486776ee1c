"""JP4209318: trains of one to three cars brake from 100 km/h under slide protection; braking distance and wheel damage Q.

Table 2 gives train, brakes and cycle. The adhesion of Fig. 2, how sliding wheels condition the rail, the fuzzy rules and
the three sensitivities are not disclosed. Here they are 15 numbers (`Undisclosed`); Tables 3 and 4 print 8 different ones.
So what follows shows that the model can do what the source reports, not that it is right. ``jp4209318_members.csv`` has 54
sets that reach both tables, and one that was sought without the distance of two cars. For Q (28) of any record there is
`alloc.evaluation.wheel_damage.wheel_damage`, of plain arrays in SI units.
"""

from collections.abc import Iterator
from dataclasses import asdict, dataclass, fields, replace
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr
from matplotlib.figure import Figure
from numpy.typing import NDArray
from scipy.integrate import cumulative_trapezoid

from alloc.evaluation.metrics import damage, distance, locked_time
from alloc.evaluation.wheel_damage import wheel_damage
from alloc.laws import GRAVITY
from alloc.onboard.settings import Fuzzy, Onboard, SlideProtection, Threshold
from alloc.plant.curves import SlipRatioCurve
from alloc.plant.rail import Rail
from alloc.plant.train import Train
from alloc.plant.trains import find_train
from alloc.run.event import DriverCommand, Event
from alloc.run.simulation import simulate
from studies.runner.study import Cell, Row, Study
from studies.statistics import CONDITIONS, FAILS, HOLDS

Floats = NDArray[np.float64]

INITIAL_SPEED, LEAST_SPEED = 100.0 / 3.6, 5.0 / 3.6
"""Of the stop (Table 2); slip counts above the second, below which slide protection does not act [m/s]."""
CYCLE = 0.02
"""Table 2's calculation cycle [s], read as that of the computers on board: the plant has a step of its own."""
STEP = 1e-3
"""Longest step of the plant [s], which halves it by itself to be stable near standstill."""
FULL_BRAKE = -3.0
"""Acceleration asked for [m/s2]: more than the brakes give, so that every cylinder fills to 550 kPa."""
LONGEST = {1: 38.0, 2: 35.0, 3: 32.0}
"""Time [s] by number of cars, longer than any of the stops."""

TABLE_3 = {1: 458.1, 2: 414.0, 3: 385.7}
"""Braking distance [m] by number of cars, at medium sensitivity."""
TABLE_4 = {"low": (385.4, 1673.0), "medium": (385.7, 1518.0), "high": (392.9, 525.8)}
"""Braking distance [m] and Q [kJ] of three cars by sensitivity."""
STOPS = ((1, "medium"), (2, "medium"), (3, "medium"), (3, "low"), (3, "high"))
"""Cars and sensitivity of the stops in both tables."""
SENSITIVITIES = tuple(float(x) for x in np.geomspace(0.4, 12.0, 33))
THRESHOLDS = ((0.01, 0.02), (0.02, 0.04), (0.03, 0.06), (0.05, 0.10), (0.08, 0.15), (0.12, 0.25))
"""Slip ratios at which plain thresholds hold and release the pressure, beside the fuzzy inference."""
NOISE = 1e-4
"""Relative noise on every number of a set (standard deviation)."""


@dataclass(frozen=True)
class Undisclosed:
    """What the source does not print. Defaults: calibrated on Tables 3 and 4; in brackets: what was held plausible."""

    front_adhesion: float = 0.097403
    """Adhesion coefficient of the foremost axle at standstill, on rail that no wheel has conditioned [0.07, 0.12]."""
    speed_offset: float = 354.62
    """c of its fall with speed, 1 / (1 + V/c), in km/h [80, 400]."""
    rear_gain: float = 0.6
    """Adhesion far back over the front's at standstill, less 1 [0.02, 0.6]; above 0 by finding (1) of par. 0051."""
    rear_fall: float = 0.1
    """Relative fall with speed far back over the front's [0.1, 0.9]; below 1 by finding (2)."""
    rear_axles: float = 10.5
    """Axles over which adhesion changes from the front's to that far back by 63 % [1, 12]."""
    conditioning: float = 0.03
    """Most by which wheels that slide raise adhesion behind them, as a share [0.03, 0.4]; finding (3), par. 0053."""
    conditioning_slip: float = 0.12
    """Slip ratio that reaches 63 % of it [0.01, 0.12]."""
    peak_slip_ratio: float = 0.016589
    """Slip ratio of the curve's maximum, beyond which it is flat [0.01, 0.05]."""
    shoe_force_share: float = 0.14362
    """Shoe force over axle load at 550 kPa [0.13, 0.15]."""
    slip_medium: float = 0.077716
    """Slip ratio at which the fuzzy set medium peaks [0.02, 0.10]."""
    slip_large: float = 0.17027
    """Slip ratio above which slip is large [0.06, 0.30]."""
    rate_growing: float = 3.5912
    """Slip acceleration above which slip grows, and below whose negative it falls, m/s2 [0.3, 4]."""
    pole: float = 6.6789
    """Pole of the filter that differentiates slip, 1/s [3, 20]."""
    sensitivity_low: float = 0.905
    """Sensitivity low over medium [0.6, 0.99]."""
    sensitivity_high: float = 2.92
    """Sensitivity high over medium [1.5, 8]."""

    def make_rail(self) -> Rail:
        """Fig. 2 and par. 0051 to 0053: adhesion by speed, slip ratio, place in the train, and what slid ahead."""
        front, c = self.front_adhesion, self.speed_offset
        rear = front * (1.0 + self.rear_gain)
        return Rail(
            level=1.0,
            speed_law=(front * c, c, 0.0),
            rear_speed_law=(rear * self.rear_fall * c, c, rear * (1.0 - self.rear_fall)),
            rear_axles=self.rear_axles,
            conditioning=self.conditioning,
            conditioning_slip=self.conditioning_slip,
            curve=SlipRatioCurve(self.peak_slip_ratio, residual_ratio=1.0),
        )

    def make_protection(self, sensitivity: float = 1.0) -> SlideProtection:
        """Fuzzy inference of slip and its rate, by the worst axle of a bogie; at 2 every set is at half its place."""
        slip = (0.0, self.slip_medium, self.slip_large)
        rate = (-self.rate_growing, 0.0, self.rate_growing)
        fuzzy = Fuzzy(sensitivity=sensitivity, slip=slip, rate=rate, pole=self.pole)
        return SlideProtection(period=CYCLE, law="fuzzy", fuzzy=fuzzy)


NAMES = [field.name for field in fields(Undisclosed)]
CALIBRATED = Undisclosed()


def read_members(arm: str = "all") -> list[Undisclosed]:
    """Sets that reach both tables, the calibrated one first; "held out": all but the distance of two cars."""
    # as text, since every digit counts: valves that switch a cycle later turn the last ones into metres
    sets = pd.read_csv(Path(__file__).with_name("jp4209318_members.csv"), dtype=str)
    values = sets.loc[sets["arm"] == arm, NAMES].to_numpy()
    return [Undisclosed(*map(float, row)) for row in values]


def build_train(cars: int = 3, shoe_force_share: float = CALIBRATED.shoe_force_share) -> Train:
    """The train of Table 2 with this number of cars: 8000 kg and 120 kg m2 on each of 4 axles of a car, r = 0.43 m."""
    whole = find_train("jp4209318-3car")
    car, brake = whole.cars[0], whole.cars[0].air_brake
    assert brake is not None
    axle_mass = car.loaded_mass / len(car.axle_positions)
    force = shoe_force_share * axle_mass * GRAVITY
    car = replace(car, air_brake=replace(brake, force=force))
    return replace(whole, name=f"jp4209318-{cars}car", cars=(car,) * cars)


def run_stop(
    numbers: Undisclosed, cars: int, protection: SlideProtection, step: float = STEP
) -> xr.Dataset:
    """A full brake application from 100 km/h to standstill; without motors rule and controller have nothing to do.

    The computers are given the true speed, since how the source's know it is not disclosed.
    """
    settings: dict[str, Any] = {"reference.source": "truth", "braking.release_speed": 0.0}
    settings["braking.slide_protection"] = protection
    train, rail = build_train(cars, numbers.shoe_force_share), numbers.make_rail()
    # applied at once: the cylinders' dead time and lag are all the delay of Table 2
    onboard = Onboard(period=CYCLE, rise_time=CYCLE).with_settings(settings)
    command = DriverCommand((0.0,), (FULL_BRAKE,))
    course: Row = {"duration": LONGEST[cars], "initial_speed": INITIAL_SPEED, "target_speed": 0.0}
    event = Event(f"JP4209318, {cars} cars", train, rail, command, onboard, step=step, **course)
    return simulate(event, "alone", "none")


def run(numbers: Undisclosed, cars: int, protection: SlideProtection) -> Row:
    """Distance [m], Q [kJ], locked axle-seconds, mean slip ratio and slide [m/s] of axles; what laws say of the record."""
    recording = run_stop(numbers, cars, protection)
    speed = recording["speed"].values
    moving = speed > LEAST_SPEED
    slide = np.maximum(-recording["slip_velocity"].values[moving], 0.0)
    means = {"slip": (slide / speed[moving, None]).mean(axis=0), "slide": slide.mean(axis=0)}
    return {
        "distance": distance(recording),
        "Q": damage(recording),
        "locked": locked_time(recording),
        **{f"{name}_{k + 1}": x for name, of in means.items() for k, x in enumerate(of.tolist())},
        **check_laws(recording, build_train(cars)),
    }


def check_laws(recording: xr.Dataset, braked: Train) -> dict[str, float]:
    """Q by (28) [kJ], the share of energy that (27) misses, and how far both forms of the motion stray [m/s].

    All from the record alone, a cycle apart: shoe force F_b [N], angular speed omega [rad/s] and, for the motion, rail force
    [N] of each axle, and the train's speed v [m/s]; magnitudes, as the source has them. The train has no resistance F_r.
    """
    car = braked.cars[0]
    time, v = recording["time"].values, recording["speed"].values
    m, j, r = braked.mass, car.wheel_inertia, car.wheel_radius
    omega = recording["rim_speed"].values / r
    shoe, rail = recording["brake_force"].values, -recording["rail_force"].values

    def integrate(rate: Floats) -> Floats:
        return np.asarray(cumulative_trapezoid(rate, time, axis=0, initial=0))

    q = wheel_damage(time, -shoe, omega, v, j, r).sum(axis=1)  # (28); driving counts positive there
    lost = 0.5 * m * (v[0] ** 2 - v**2) + 0.5 * j * (omega[0] ** 2 - omega**2).sum(axis=1)  # (24)
    missed = lost - q - integrate((shoe * r * omega).sum(axis=1))  # (27)
    row = {"Q_28": float(q[-1] / 1e3), "energy": float(np.abs(missed).max() / lost[-1])}
    turning = j / r**2
    force = rail - turning * recording["acceleration"].values[:, None]  # (12): F_m
    common = force.sum(axis=1) / (m + turning * omega.shape[1])  # (15)
    forms = {
        "form_1": (rail.sum(axis=1) / m, (shoe - rail) / turning),  # (7), (8)
        "form_2": (common, (shoe - force) / turning + common[:, None]),  # (15), (16)
    }
    for name, (of_train, of_rims) in forms.items():
        strayed = v[0] - integrate(of_train) - v, (omega[0] - omega) * r - integrate(of_rims)
        row[name] = float(max(np.abs(stray[v > LEAST_SPEED]).max() for stray in strayed))
    return row


# the stops


def list_stops(numbers: Undisclosed) -> Iterator[tuple[str, int, str, SlideProtection]]:
    """Kind, cars, setting and slide protection of every stop of a set; first those of both tables."""
    places = {"low": numbers.sensitivity_low, "medium": 1.0, "high": numbers.sensitivity_high}
    for cars, setting in STOPS:
        yield "tables", cars, setting, numbers.make_protection(places[setting])
    for sensitivity in SENSITIVITIES:
        yield "sensitivity", 3, f"{sensitivity:.4g}", numbers.make_protection(sensitivity)
    for hold, release in THRESHOLDS:
        plain = Threshold(hold=hold, release=release)
        protection = SlideProtection(period=CYCLE, law="threshold", threshold=plain)
        yield "threshold", 3, f"{hold:g}, {release:g}", protection
    yield "none", 3, "", SlideProtection(period=CYCLE, law="none")


def cells(events: int, seed: int) -> Iterator[Cell]:
    """All stops of `events` sets, the calibrated one first; those of the tables under noise, and of sets held out."""
    noise = NOISE * np.random.default_rng(seed).standard_normal((events, len(NAMES)))
    noisy = np.array(list(asdict(CALIBRATED).values())) * (1.0 + noise)
    sets = {"member": read_members(), "noise": [Undisclosed(*row) for row in noisy.tolist()]}
    sets["held out"] = read_members("held out")
    for part, group in sets.items():
        for k, numbers in enumerate(group[:events]):
            for kind, cars, setting, protection in list_stops(numbers):
                if kind == "tables" or part == "member":
                    columns: Row = {"part": part, "set": k, "kind": kind, "cars": cars}
                    columns["setting"] = setting
                    name = " ".join(map(str, columns.values()))
                    yield Cell(name, (numbers, cars, protection), columns)


# what the source says of them


class Finding(NamedTuple):
    """A number of a set's stops: it is as in the source where it is above `least`, and at most `most`."""

    source: str
    """Where it stands, or "here"."""
    value: float
    least: float = -np.inf
    most: float = np.inf
    printed: float = np.nan

    def is_reached(self, value: Any) -> Any:
        """Whether a number, or each of a series, is as the source says."""
        return (value > self.least) & (value <= self.most)

    def format_bounds(self) -> str:
        """Bounds in words."""
        bounds = ((">", self.least), ("at most", self.most))
        return ", ".join(f"{sign} {value:.4g}" for sign, value in bounds if np.isfinite(value))


def near_printed(source: str, value: float, printed: float, tolerance: float) -> Finding:
    """That a number is the printed one, within a tolerance."""
    return Finding(source, value, printed - tolerance, printed + tolerance, printed)


def list_findings(rows: pd.DataFrame) -> dict[str, Finding]:
    """Of the stops of a set; those that compare with other laws only where all stops are among its rows.

    Slips and slides are means at medium setting; of several differences the least counts, of several errors the greatest.
    """
    kinds: Any = dict(list(rows.groupby("kind")))
    five = kinds["tables"]
    by_cars = five[five["setting"] == "medium"].set_index("cars")["distance"]
    three = five[five["cars"] == 3].set_index("setting")
    longer, q = 100.0 * (three["distance"] / three.loc["medium", "distance"] - 1.0), three["Q"]
    slip, slide = (
        three.loc["medium", [f"{name}_{k + 1}" for k in range(12)]].to_numpy(float)
        for name in ("slip", "slide")
    )
    slip, of_cars = 100.0 * slip, slide.reshape(3, 4).mean(axis=1)
    q_28 = 100.0 * (five["Q_28"] / five["Q"] - 1.0).abs().max()
    findings = {
        **{f"distance, {n} car{'s' * (n > 1)} [m]": near_printed("Table 3", by_cars[n], metres, 0.003 * metres)
           for n, metres in TABLE_3.items()},
        "every further car shortens it by [m]": Finding("par. 0061", -np.diff(by_cars).max(), 0.0),
        "Q, medium [kJ]": near_printed("Table 4", q["medium"], TABLE_4["medium"][1], 0.03 * TABLE_4["medium"][1]),
        "Q, low over medium": near_printed("Table 4", q["low"] / q["medium"], 1.10, 0.03),
        "Q, high over medium": near_printed("Table 4", q["high"] / q["medium"], 0.346, 0.02),
        "high brakes longer than medium by [%]": near_printed("Table 4", longer["high"], 1.9, 0.5),
        "low brakes longer than medium by [%]": Finding("Table 4", longer["low"], most=0.0, printed=-0.08),
        "axle 1 slides more than any other by [points]": Finding("par. 0058", slip[0] - slip[1:].max(), 0.0),
        "each car behind slides less by [points]":
            Finding("par. 0058", -np.diff(slip.reshape(3, 4).mean(axis=1)).max(), 0.0),
        "each car behind slides less by [m/s]": Finding("par. 0058", -np.diff(of_cars).max(), 0.0),
        "rear axle of a bogie slides less by [points]": Finding("par. 0059", (slip[0::2] - slip[1::2]).min(), 0.0),
        "wheels stand for [axle s]": Finding("par. 0037", five["locked"].sum(), most=0.0),
        "speeds from forces, first form: off by [m/s]": Finding("(5) to (11)", five["form_1"].max(), most=0.1),
        "speeds from forces, second form: off by [m/s]": Finding("(12) to (19)", five["form_2"].max(), most=0.1),
        "energy that the balance misses [%]": Finding("(27)", 100.0 * five["energy"].max(), most=0.1),
        "Q from the record, beside the plant's: off by [%]": Finding("(28)", q_28, most=0.1),
    }  # fmt: skip
    if "none" in kinds:
        tried, plain, none = kinds["sensitivity"], kinds["threshold"], kinds["none"].iloc[0]
        better = tried[["distance", "Q"]].to_numpy()[:, None] < three[["distance", "Q"]].to_numpy()
        beaten = Finding("par. 0064", int(better.all(axis=2).any(axis=0).sum()), most=0.0)
        findings["settings that another sensitivity beats in both"] = beaten
        best = pareto_front(tried)[::-1]
        at_equal_q = plain["distance"] - np.interp(plain["Q"], best["Q"], best["distance"])
        for setting, value in zip(plain["setting"], at_equal_q, strict=True):
            name = f"thresholds {setting}: longer at equal Q by [m]"
            findings[name] = Finding("here", value, 0.0)
        apart = none["distance"] - three.loc["medium", "distance"]
        findings["without protection: longer than medium by [m]"] = Finding("here", apart)
        findings["without protection: Q over medium"] = Finding("here", none["Q"] / q["medium"])
    return findings


def pareto_front(rows: pd.DataFrame) -> pd.DataFrame:
    """Stops that none beats in both distance and Q, by growing distance."""
    ordered = rows.sort_values(["distance", "Q"])
    return ordered[ordered["Q"] < ordered["Q"].cummin().shift(fill_value=np.inf)]


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Numbers of the calibrated set beside the printed ones, their range over the sets, and their spread under noise.

    What the calibrated set reaches and fewer than 95 % of the sets do not share holds with conditions.
    """
    groups = rows.groupby(["part", "set"], sort=False)
    of_sets = {key: list_findings(stops) for key, stops in groups}
    values = pd.DataFrame(
        [{name: finding.value for name, finding in row.items()} for row in of_sets.values()],
        index=pd.MultiIndex.from_tuples(of_sets),
    )
    numbers, sets = of_sets["member", 0], values.loc["member"]
    predicted = values.loc["held out", "distance, 2 cars [m]"].mean()
    logarithm = np.interp(np.log(2.0), np.log([1.0, 3.0]), [TABLE_3[1], TABLE_3[3]])
    for by, metres in (("a set sought without them", predicted), ("a logarithm", logarithm)):
        off = abs(metres - TABLE_3[2])
        numbers[f"2 cars by {by}: off by [m]"] = Finding("here", off, most=0.01 * TABLE_3[2])
    lines = []
    for name, finding in numbers.items():
        line: Row = {"source": finding.source, "number": name, "printed": finding.printed}
        line |= {"found": finding.value, "bound": finding.format_bounds()}
        spread = sets[name] if name in sets else pd.Series([finding.value])
        shared = finding.is_reached(spread)
        whole = HOLDS if shared.mean() >= 0.95 else CONDITIONS
        verdict = whole if finding.is_reached(finding.value) else FAILS
        line["verdict"] = verdict if line["bound"] else ""
        if name in sets:
            line["5 % of the sets"], line["95 %"] = spread.quantile((0.05, 0.95))
            line["sets"] = f"{shared.sum()} of {len(spread)}" if line["bound"] else ""
            line["noise of 1e-4"] = values.loc["noise", name].std()
        lines.append(line)
    return pd.DataFrame(lines)


def figure(rows: pd.DataFrame) -> Figure:
    """Q over distance of three cars: other sensitivities, plain thresholds, and Table 4 beside the printed numbers."""
    drawn = Figure(figsize=(5.0, 3.4), layout="constrained")
    axes = drawn.subplots()
    stops = rows[(rows["part"] == "member") & (rows["cars"] == 3)]
    for k, of_set in stops[stops["kind"] == "sensitivity"].groupby("set"):
        best = pareto_front(of_set)
        look = {"color": "0.85"} if k else {"color": "tab:blue", "label": "fuzzy", "zorder": 3.0}
        axes.plot(best["distance"], best["Q"], **look)
    first = stops[stops["set"] == 0].set_index("kind")
    plain, settings = first.loc["threshold"], first.loc["tables"].set_index("setting")
    axes.plot(plain["distance"], plain["Q"], "s", color="tab:orange", ms=4, label="thresholds")
    points = settings.loc[list(TABLE_4), ["distance", "Q"]].to_numpy()
    axes.plot(*points.T, "o", color="tab:blue", zorder=4, label="low, medium, high")
    axes.plot(*np.array(list(TABLE_4.values())).T, "kx", zorder=5, label="printed (Table 4)")
    axes.set(xlabel="braking distance of 3 cars [m]", xlim=(372.0, None))
    axes.set(ylabel="wheel damage Q [kJ]", yscale="log")
    axes.legend(title="grey: other sets")
    return drawn


QUESTION = "Does slide protection give distances and wheel damage of JP4209318, Tables 3 and 4?"
STUDY = Study("jp4209318", QUESTION, cells, run, table, figure, events=54)
