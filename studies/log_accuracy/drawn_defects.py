"""Defects of logs with drawn parameters: what a study of drawn logs takes in turn."""

from collections.abc import Callable
from dataclasses import replace
from functools import partial
from typing import NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from studies.log_accuracy import defects as spoil
from studies.logs.mapping import column_of
from studies.logs.train import MeasuredTrain

Generator = np.random.Generator


class Logged(NamedTuple):
    """A log without a defect, the train that its reader is told, and the run behind it."""

    table: pd.DataFrame
    train: MeasuredTrain
    run: xr.Dataset


class Spoiled(NamedTuple):
    """A log with a defect, the train that its reader is told, and what was drawn, in words."""

    table: pd.DataFrame
    train: MeasuredTrain
    drawn: str


class Defect(NamedTuple):
    """A defect: what it does to a log, and the kinds of remarks that name it (`studies.logs.remarks.KINDS`)."""

    spoil: Callable[[Logged, Generator], Spoiled]
    named_by: frozenset[str]
    refusable: bool = False
    """Whether no Q is a proper answer: a mistaken unit, and worn wheels that never roll freely."""


def _of_table(
    named_by: str, draw: Callable[[pd.DataFrame, Generator], tuple[pd.DataFrame, str]], refusable: bool = False
) -> Defect:  # fmt: skip
    """A defect of the measured values alone, named by remarks of these kinds."""

    def spoil_log(log: Logged, g: Generator) -> Spoiled:
        table, drawn = draw(log.table, g)
        return Spoiled(table, log.train, drawn)

    return Defect(spoil_log, frozenset(named_by.split()), refusable)


Drawn = tuple[pd.DataFrame, str]


def _rare_speed(
    how: Callable[[pd.DataFrame, float, float], pd.DataFrame], table: pd.DataFrame, g: Generator
) -> Drawn:
    late, period = g.uniform(0.0, 1.2), float(g.choice([0.2, 0.5, 1.0]))
    return how(table, late, period), f"every {period:g} s, {late:.2f} s late"


def _late_speed(table: pd.DataFrame, g: Generator) -> Drawn:
    late = g.uniform(0.05, 1.0)
    return spoil.speed_late(table, late), f"{late:.2f} s"


def _rare_forces(table: pd.DataFrame, g: Generator) -> Drawn:
    period, held = g.uniform(0.03, 0.2), bool(g.integers(2))
    words = f"every {1e3 * period:.0f} ms, {'held' if held else 'empty between'}"
    return spoil.forces_at(table, period, held), words


def _counts(log: Logged, g: Generator) -> Spoiled:
    period = float(g.choice([0.005, 0.01, 0.02]))
    table = spoil.counted(log.table, log.train.radius, period)
    return Spoiled(table, log.train, f"over {1e3 * period:.0f} ms")


def _values_missing(table: pd.DataFrame, g: Generator) -> Drawn:
    axle, each = int(g.choice(spoil.axles_of(table))), int(g.integers(3, 12))
    return spoil.values_missing(table, axle, each), f"each {each}th of axle {axle}"


def _noise(table: pd.DataFrame, g: Generator) -> Drawn:
    kmh = float(np.exp(g.uniform(np.log(0.02), np.log(0.3))))
    return spoil.noisy(table, kmh, int(g.integers(2**31))), f"{kmh:.2g} km/h"


def _rounded(table: pd.DataFrame, g: Generator) -> Drawn:
    step = float(g.choice([0.1, 0.25, 0.5]))
    return spoil.rounded_to(table, spoil.speeds_of(table), step), f"to {step:g} km/h"


def _whole_kmh(table: pd.DataFrame, g: Generator) -> Drawn:
    late = g.uniform(0.0, 0.8)
    table = spoil.speed_held(table, late, 0.2)
    return spoil.rounded_to(table, ["speed_kmh"], 1.0), f"{late:.2f} s late, every 0.2 s"


def _stuck_wheel(table: pd.DataFrame, g: Generator) -> Drawn:
    axle, since, span = (
        int(g.choice(spoil.axles_of(table))),
        g.uniform(0.2, 0.8),
        g.uniform(1.0, 5.0),
    )
    at = since * float(table["time_s"].iloc[-1])
    return spoil.stuck(table, axle, at, span), f"axle {axle} at {at:.1f} s for {span:.1f} s"


def _one_radius(log: Logged, g: Generator) -> Spoiled:
    axle, error = (
        int(g.choice(spoil.axles_of(log.table))),
        float(g.uniform(0.005, 0.03) * g.choice([-1, 1])),
    )
    return Spoiled(
        spoil.by_radius(log.table, {axle: 1.0 + error}), log.train, f"axle {axle} by {100.0 * error:+.1f} %"
    )  # fmt: skip


def _worn(log: Logged, g: Generator) -> Spoiled:
    wear = g.uniform(0.0, 0.04, log.train.radius.size)
    factors = {axle: 1.0 / (1.0 - wear[axle - 1]) for axle in spoil.axles_of(log.table)}
    return Spoiled(spoil.by_radius(log.table, factors), log.train, "by 0 to 4 %")


def _late_forces(table: pd.DataFrame, g: Generator) -> Drawn:
    late = float(g.uniform(0.03, 0.3) * g.choice([-1, 1]))
    return spoil.shifted(table, spoil.forces_of(table), late), f"{late:+.2f} s"


def _wrong_forces(table: pd.DataFrame, g: Generator) -> Drawn:
    names = spoil.forces_of(table)
    factors = 1.0 + 0.05 * g.standard_normal(len(names))
    return table.assign(
        **{name: table[name] * f for name, f in zip(names, factors, strict=True)}
    ), "by 5 %"


def _late_axles(table: pd.DataFrame, g: Generator) -> Drawn:
    late = g.uniform(0.05, 0.4)
    return spoil.rear_late(table, late), f"{late:.2f} s"


def _one_sign(table: pd.DataFrame, g: Generator) -> Drawn:
    name = str(g.choice(spoil.forces_of(table)))
    return table.assign(**{name: -table[name]}), name


def _all_signs(table: pd.DataFrame, g: Generator) -> Drawn:
    return table.assign(**{name: -table[name] for name in spoil.forces_of(table)}), "all"


def _outliers(table: pd.DataFrame, g: Generator) -> Drawn:
    number = int(g.integers(3, 30))
    return spoil.outliers(table, number, int(g.integers(2**31))), f"{number} values"


def _rows_lost(table: pd.DataFrame, g: Generator) -> Drawn:
    gaps = [(g.uniform(0.1, 0.9), g.uniform(0.2, 1.5)) for _ in range(int(g.integers(1, 4)))]
    words = ", ".join(f"{length:.1f} s" for _, length in gaps)
    return spoil.rows_lost(table, gaps), words


def _rows_twice(table: pd.DataFrame, g: Generator) -> Drawn:
    rows = sorted(int(one) for one in g.integers(0, len(table), int(g.integers(1, 20))))
    for row in reversed(rows):
        table = spoil.repeated_row(table, row)
    return table, f"{len(rows)} rows"


def _clock_rounded(table: pd.DataFrame, g: Generator) -> Drawn:
    step = float(g.choice([0.1, 1.0]))
    return spoil.rounded_to(table, ["time_s"], step, np.floor), f"to {step:g} s"


def _clock_jitters(table: pd.DataFrame, g: Generator) -> Drawn:
    share = g.uniform(0.1, 0.45)
    period = float(np.median(np.diff(table["time_s"])))
    moved = table["time_s"] + g.uniform(-share, share, len(table)) * period
    return table.assign(time_s=moved), f"by {share:.0%} of a period"


def _clock_fast(table: pd.DataFrame, g: Generator) -> Drawn:
    share = float(g.uniform(-0.02, 0.02))
    return table.assign(time_s=table["time_s"] * (1.0 + share)), f"{100.0 * share:+.1f} %"


def _clock_set_back(table: pd.DataFrame, g: Generator) -> Drawn:
    by, when = g.uniform(0.1, 0.5), g.uniform(0.3, 0.8) * float(table["time_s"].iloc[-1])
    time = table["time_s"]
    return table.assign(time_s=time.where(time < when, time - by)), f"by {by:.2f} s at {when:.1f} s"


def _zero_when_slow(table: pd.DataFrame, g: Generator) -> Drawn:
    below = g.uniform(1.0, 5.0)
    return spoil.zero_below(table, below), f"below {below:.1f} km/h"


def _without_speed(table: pd.DataFrame, g: Generator) -> Drawn:
    return spoil.without_speed(table), ""


def _at_the_rail(log: Logged, g: Generator) -> Spoiled:
    contact = {
        column_of("axleN_force", i, "kn"): 1e-3 * values
        for i, values in enumerate(log.run["rail_force"].values.T, 1)
    }
    return Spoiled(log.table.assign(**contact), log.train, "")


def _rare_rows(table: pd.DataFrame, g: Generator) -> Drawn:
    every = int(g.choice([2, 5, 10]))
    return table.iloc[::every].reset_index(drop=True), f"every {every}th row"


def _wrong_unit(
    factor: float, names: Callable[[pd.DataFrame], list[str]], table: pd.DataFrame, g: Generator
) -> Drawn:
    return table.assign(
        **{name: table[name] * factor for name in names(table)}
    ), f"{factor:.3g} times"


def _load_not_told(log: Logged, g: Generator) -> Spoiled:
    share = g.uniform(0.05, 0.25)
    told = replace(
        log.train,
        car_mass=log.train.car_mass * (1.0 - share),
        axle_load=log.train.axle_load * (1.0 - share),
    )
    return Spoiled(log.table, told, f"{100.0 * share:.0f} % of the mass")


def _scale_of_speed(table: pd.DataFrame, g: Generator) -> Drawn:
    error = float(g.uniform(0.002, 0.01) * g.choice([-1, 1]))
    return table.assign(speed_kmh=table["speed_kmh"] * (1.0 + error)), f"{100.0 * error:+.1f} %"


DEFECTS: dict[str, Defect] = {
    "speed rare, held": _of_table("delay sampling", partial(_rare_speed, spoil.speed_held)),
    "speed rare, interpolated": _of_table("delay sampling", partial(_rare_speed, spoil.speed_interpolated)),
    "speed rare, gaps between": _of_table("delay sampling", partial(_rare_speed, spoil.speed_with_gaps)),
    "speed late": _of_table("delay", _late_speed),
    "speed in whole km/h": _of_table("delay sampling", _whole_kmh),
    "speed's scale wrong": _of_table("radius", _scale_of_speed),
    "no train speed": _of_table("estimate", _without_speed),
    "speeds noisy": _of_table("sampling", _noise),
    "speeds rounded": _of_table("sampling", _rounded),
    "speeds in mile/h called km/h": _of_table("balance", partial(_wrong_unit, 1.0 / 1.609344, spoil.speeds_of), True),
    "pulses counted": Defect(_counts, frozenset({"sampling"})),
    "values of an axle missing": _of_table("gap sampling missing", _values_missing),
    "a wheel's sensor stuck": _of_table("stuck", _stuck_wheel),
    "wheels 0 at low speed": _of_table("stuck", _zero_when_slow),
    "one radius wrong": Defect(_one_radius, frozenset({"radius"})),
    "wheels worn": Defect(_worn, frozenset({"radius", "balance"}), refusable=True),
    "half of the axles late": _of_table("delay", _late_axles),
    "forces rare": _of_table("sampling", _rare_forces),
    "forces late or early": _of_table("delay", _late_forces),
    "forces at the rail": Defect(_at_the_rail, frozenset({"guess"})),
    "forces in lbf called kN": _of_table("balance", partial(_wrong_unit, 224.809, spoil.forces_of), True),
    "forces wrong, each by its own": _of_table("balance", _wrong_forces),
    "one force reversed": _of_table("sign balance", _one_sign),
    "all forces reversed": _of_table("sign balance", _all_signs),
    "outliers": _of_table("faulty", _outliers),
    "rows rare": _of_table("sampling", _rare_rows),
    "rows of two recorders": _of_table("sampling", lambda t, g: (spoil.interleaved(t), "")),
    "rows lost": _of_table("gap", _rows_lost),
    "rows twice": _of_table("time", _rows_twice),
    "clock rounded": _of_table("time", _clock_rounded),
    "clock jitters": _of_table("time", _clock_jitters),
    "clock fast or slow": _of_table("time balance", _clock_fast),
    "clock set back": _of_table("time", _clock_set_back),
    "load not told": Defect(_load_not_told, frozenset({"balance"})),
}  # fmt: skip
"""Every defect by name, in the order in which logs take them."""
