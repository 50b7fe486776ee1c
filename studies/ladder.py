"""Readhesion controllers on random starts in which adhesion falls short; no unit helps another.

The ladder of this project's controllers, from none to the MPC, and five after publications of others meet the same events
with the same noise. What others say of their controllers is tested in the metric that is nearest to their words.
"""

from functools import cache
from itertools import pairwise, product
from typing import NamedTuple

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from alloc.onboard.controllers import CONTROLLERS
from alloc.train import Train
from studies import events as e
from studies.core import WIDE, Study
from studies.runs import complete, crossed, run
from studies.scenario import Scenario, load
from studies.statistics import Claim, Numbers, Statement, forest, judge, mean, means

LADDER = ("none", "table", "cut-and-ramp", "pi-creep", "perturb-observe", "steepest-gradient", "mpc")  # fmt: skip
"""This project's, from the simplest on."""
PUBLISHED = ("fuzzy-creep", "fuzzy-tracking", "swarm-tracking", "swarm-slip", "cubature-seeking")
"""Built after abstracts; `alloc/onboard/searches.py` and `swarms.py` say what had to be assumed."""
ARMS = (*LADDER, *PUBLISHED)
RULE = "alone"
"""Units exchange nothing, so a run depends on its readhesion controller alone."""

# the events

DURATION = 12.0
"""Length [s]."""
LOCOMOTIVE = "locomotive and wagons"
TRAINS: dict[str, tuple[str, e.Keys]] = {
    "one inverter per car": ("wet-start", {"inverter_group": "1C4M"}),
    "one inverter per axle": ("wet-start", {"inverter_group": "1C1M"}),
    LOCOMOTIVE: ("freight-start", {}),
}
"""Train -> the scenario whose train and command it is, and what is changed of it. The locomotive has no free axle that
would show the speed, and couplings shake it."""
PEAKS = {"piecewise": "narrow peak", "polach": "wide peak"}
"""Curve -> its peak: at 0.05 m/s with a fall behind it, or at 0.2 to 0.6 m/s, moving with speed."""


def draw(seed: int, k: int) -> e.Keys:
    """What is drawn for event `k`."""
    g = e.Draw(seed, k, 7)
    return {
        "train": list(TRAINS)[k % 3],
        "curve": list(PEAKS)[k // 3 % 2],
        # the readhesion paper leaves it open; at 0.9 adhesion is used whatever the wheels do
        "residual_ratio": g.uniform(0.5, 0.9),
        # at 15 km/h; in a third of the events the plan of 0.16 is within reach before the drop
        "level": g.uniform(0.13, 0.19),
        "drop_factor": g.uniform(0.5, 0.8),  # readhesion paper, Table 2: 0.12 of 0.18
        "drop_begin_s": g.uniform(2.5, 4.0),  # after the torque is up
        "drop_length_s": g.uniform(3.0, 5.0),  # long enough for a search
        "scatter": g.sometimes(0.6, 0.002, 0.008, 0.0),  # JP5484215: 0.012 over all measurements
        "patch_factor": g.sometimes(0.4, 0.6, 0.9, 1.0),
        "speed_noise_kmh": g.uniform(0.0, 0.04),
        "grade_permille": g.sometimes(0.4, 5.0, 20.0, 0.0),
    }


def event(seed: int, k: int) -> Scenario:
    """Event `k`. The train believes in the piecewise curve whatever the rail's is."""
    d = draw(seed, k)
    base, changes = TRAINS[d["train"]]
    drop = [one | {"fade_s": 0.1} for one in e.drop(d)]
    patches = drop + e.stretch(d["patch_factor"], 10.0, 40.0)
    rail = e.offering(e.curve(d["curve"], d), d["level"], train_of(d["train"]))
    return e.drawn(
        load(base),
        f"ladder-{seed}-{k:04d}",
        f"random event {k} of the ladder",
        duration_s=DURATION,
        rail=rail
        | {"increments": {"law": "logarithmic"}, "patches": patches}
        | {"scatter": d["scatter"], "scatter_length_m": 20.0},
        onboard={"sensors": {"speed_noise_kmh": e.stated("_kmh", d["speed_noise_kmh"])}},
        line=e.line(d),
        belief={"curve": {"kind": "piecewise"}},
        **changes,
    )


@cache
def train_of(name: str) -> Train:
    """The train called `name` in `TRAINS`."""
    base, changes = TRAINS[name]
    return load(base).changed(**changes).event().train


# what is claimed

DRAWN = ("train", "curve", "scatter", "patch_factor")
"""What parts of the events are made of."""
USED = "utilisation_short"
TOLD = {
    USED: ("adhesion used where short", 1, 100.0),
    "search_time": ("search time", 2, 1.0),
    "torque_fluctuation": ("torque fluctuation", 1, 100.0),
}
"""Metric -> its words, digits and scale."""
ARXIV = "arXiv 2406.13650"
YARDSTICKS = [
    (90.0, "cubature-seeking", "Applied Sciences 15(19), 10524"),
    *((95.0, name, "JP5484215 expects it of readhesion control on its own") for name in ARMS[1:]),
]
"""Adhesion [%] that a controller uses where a unit is short of it, and who says so."""


class Said(NamedTuple):
    """That a controller has more of a metric than another, or less, as a bound on the difference; and who says so."""

    name: str
    other: str
    source: str
    metric: str = USED
    least: float = 0.0
    most: float = np.inf


SEARCHING = ("perturb-observe", "steepest-gradient")
"""Creep controllers that look for the peak; pi-creep is the same loop without a search."""
RESTLESS = f"restless, by 1 % of the plan, {ARXIV}"
SAID = [
    *(Said(name, below, "a rung of the ladder") for below, name in pairwise(LADDER)),
    Said("fuzzy-creep", "pi-creep", "Tian, Daniel, Meehan 2014"),
    Said("swarm-slip", "pi-creep", "Zirek, Onat 2020"),
]
for _name, _other in product(("fuzzy-tracking", "swarm-tracking"), SEARCHING):
    SAID += [Said(_name, _other, ARXIV), Said(_name, _other, ARXIV, "search_time", -np.inf, 0.0)]
SAID += [Said(name, "mpc", f"slow, {ARXIV}", "search_time") for name in SEARCHING]
SAID += [Said(name, "pi-creep", RESTLESS, "torque_fluctuation", 0.01) for name in SEARCHING]


def statements(rows: pd.DataFrame) -> list[Statement]:
    """Everything that is said of the controllers, as one family, over the events in which none failed."""
    good = complete(rows)
    d = good.groupby("scenario")[list(DRAWN)].first()
    even = (d["scatter"] == 0.0) & (d["patch_factor"] == 1.0)
    parts = {name: d["train"] == name for name in TRAINS}
    parts |= {f"a {peak}": d["curve"] == kind for kind, peak in PEAKS.items()}
    parts |= {"even rail": even, "scatter or a patch": ~even}
    of = {name: good[good["controller"] == name].set_index("scenario") for name in ARMS}
    claims = []
    for percent, name, source in YARDSTICKS:
        text = f"{name} uses {percent:.0f} % of the adhesion where a unit is short of it ({source})"
        label, values = f"{percent:.0f} %: {name}", 100.0 * of[name][USED]
        claims.append(Claim(label, text, values, percent, parts=parts, digits=1))
    for name, other, source, metric, least, most in SAID:
        (words, digits, scale), word = TOLD[metric], "more" if most == np.inf else "less"
        text = f"{name} has {word} {words} than {other} ({source})"
        label, values = f"{words}: {name}, {other}", of[name][metric] - of[other][metric]
        claim = Claim(label, text, values, least, most, parts, digits=digits, scale=scale)
        claims.append(claim)
    return judge(claims)


# table and figure

GROUPS = ("multiple units", "locomotive")
TABLE: Numbers = {
    "adhesion used where short [%]": (USED, 1, 100.0),
    **{f"{words} [%]": (kind, 1, 100.0) for kind, words in PEAKS.items()},
    "search time [s]": ("search_time", 2, 1.0),
    "unfinished searches [%]": ("unfinished_searches", 0, 100.0),
    "torque fluctuation [% of plan]": ("torque_fluctuation", 1, 100.0),
    "slip [axle s]": ("slip_time", 1, 1.0),
    "wheel damage Q [kJ]": ("damage", 0, 1.0),
    "effort [% of plan]": ("effort_ratio", 0, 100.0),
}


def groups(rows: pd.DataFrame) -> list[pd.DataFrame]:
    """Rows of multiple units, and of the locomotive; with the adhesion used on each kind of curve."""
    good = complete(rows)
    good = good.assign(**{kind: good[USED].where(good["curve"] == kind) for kind in PEAKS})
    hauled = good["train"] == LOCOMOTIVE
    return [good[~hauled], good[hauled]]


def table(rows: pd.DataFrame) -> pd.DataFrame:
    """Means over events with 95 % intervals, of the worst slip the greatest; none where a group has no event."""
    lines = []
    for (group, good), name in product(zip(GROUPS, groups(rows), strict=True), ARMS):
        own = good[good["controller"] == name]
        line = {"trains": group, "controller": name, "events": len(own), **means(own, TABLE)}
        worst = f"{own['slip_peak'].max():.2f}" if len(own) else "–"
        lines.append(line | {"worst slip [m/s]": worst})
    return pd.DataFrame(lines)


def figure(rows: pd.DataFrame) -> Figure:
    """What a controller uses, and what it costs: means with intervals."""
    drawn = Figure(figsize=(WIDE, 3.0), layout="constrained")
    shown = ("adhesion used where short [%]", "slip [axle s]", "wheel damage Q [kJ]")
    for axes, label in zip(drawn.subplots(1, 3, sharey=True), shown, strict=True):
        metric, _, scale = TABLE[label]
        found = {
            name: [mean(scale * own.loc[own["controller"] == name, metric]) for own in groups(rows)]
            for name in ARMS
        }
        forest(axes, found, CONTROLLERS)
        axes.set(xlabel=label, xscale="linear" if metric == USED else "log")
    drawn.supxlabel(f"filled: {GROUPS[0]}, hollow: {GROUPS[1]}")
    return drawn


QUESTION = "How do readhesion controllers, ours and others', use adhesion where it is short, and at what cost?"
cells = crossed(event, draw, DRAWN, (RULE,), ARMS)
STUDY = Study("ladder", QUESTION, cells, run, table, figure, statements, events=60, seed=77)
