"""Drawn runs, the logs of them that recorders would write, with defects, and what the analysis makes of each."""

import re
import tempfile
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pandas as pd
import xarray as xr

from alloc.metrics import METRICS
from alloc.plant.sets import find_set
from alloc.plant.train import Train
from alloc.simulation import simulate
from studies.core.cell import Row
from studies.core.job import Job, simulate_job
from studies.files.study_error import StudyError
from studies.ladder.events import scenario as drawn_start
from studies.logs import defects as spoil
from studies.logs.defects import by_rpm, names_of, reversed_signs, stamped
from studies.logs.mapping import column_of
from studies.logs.measured_log import MeasuredLog, read_log
from studies.logs.measured_run import Findings, analyse_run
from studies.logs.report import fit_remarks, withheld
from studies.logs.simulated import log_table, rounded
from studies.logs.train import MeasuredTrain
from studies.scenario.scenario import shipped_scenario
from studies.stops.blended_events import scenario as drawn_stop
from studies.stops.wsp_acceptance_study import CURVES, stop_of

# Defects of logs with drawn parameters: what a study of drawn logs takes in turn.

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


# How recorders write a log down: names in several languages, units, separators, encodings, clocks and formats.

Write = Callable[[pd.DataFrame, np.ndarray, Path], Path]
"""Writes a table with the columns of `studies.logs.mapping` to a path without an ending; the wheels' radii [m] are second.
Returns the file's path."""

GERMAN = {
    r"time_s": "Zeit [s]", r"speed_kmh": "Zuggeschwindigkeit [km/h]",
    r"axle(\d+)_speed_kmh": r"Radsatz \1 Geschwindigkeit [km/h]",
    r"axle(\d+)_force_kn": r"Radsatz \1 Zugkraft [kN]",
}  # fmt: skip
FRENCH = {
    r"time_s": "Temps (s)", r"speed_kmh": "Vitesse train (km/h)", r"axle(\d+)_speed_kmh": r"Vitesse essieu \1 (km/h)",
    r"axle(\d+)_force_kn": r"Effort essieu \1 (kN)",
}  # fmt: skip
JAPANESE = {
    r"time_s": "時刻[s]", r"speed_kmh": "列車速度[km/h]", r"axle(\d+)_speed_kmh": r"第\1軸周速[km/h]",
    r"axle(\d+)_force_kn": r"第\1軸力[kN]",
}  # fmt: skip
SHORT = {
    r"time_s": "t",
    r"speed_kmh": "v_train",
    r"axle(\d+)_speed_kmh": r"v\1",
    r"axle(\d+)_force_kn": r"F\1",
}
IN_SI = {"kmh": ("ms", 1.0 / 3.6), "kn": ("n", 1e3)}
"""Unit of a column's name -> the unit and factor in its place."""


def named(table: pd.DataFrame, words: Mapping[str, str]) -> pd.DataFrame:
    """The table with other names; columns that no pattern fits keep theirs."""
    names = {}
    for name in names_of(table):
        for pattern, text in words.items():
            if re.fullmatch(pattern, name):
                names[name] = re.sub(pattern, text, name)
    return table.rename(columns=names)


def in_si(table: pd.DataFrame) -> pd.DataFrame:
    """Speeds in m/s and forces in N, and the names say it."""
    changed = {}
    for name in names_of(table):
        stem, _, unit = name.rpartition("_")
        other, factor = IN_SI.get(unit, (unit, 1.0))
        changed[f"{stem}_{other}" if stem else name] = table[name] * factor
    return pd.DataFrame(changed)


def _csv(
    change: Callable[[pd.DataFrame, np.ndarray], pd.DataFrame], options: Mapping[str, Any],
    table: pd.DataFrame, radius: np.ndarray, path: Path,
) -> Path:  # fmt: skip
    file = path.with_suffix(options.get("ending", ".csv"))
    given = {name: value for name, value in options.items() if name != "ending"}
    change(table, radius).to_csv(file, index=False, **given)
    return file


def _text(change: Callable[[pd.DataFrame], pd.DataFrame], **options: Any) -> Write:
    return partial(_csv, lambda table, _: change(table), options)


def _same(table: pd.DataFrame) -> pd.DataFrame:
    return table


def _parquet(table: pd.DataFrame, radius: np.ndarray, path: Path) -> Path:
    file = path.with_suffix(".parquet")
    table.astype(np.float32).assign(time_s=table["time_s"]).to_parquet(file, index=False)
    return file


def _row_of_units(table: pd.DataFrame, radius: np.ndarray, path: Path) -> Path:
    """Names in one row, units in the next, and lines about the recorder above."""
    spelt = {"s": "s", "kmh": "km/h", "kn": "kN", "ms2": "m/s²"}
    units = [spelt[name.rpartition("_")[2]] for name in names_of(table)]
    names = [name.rpartition("_")[0] for name in names_of(table)]
    file = path.with_suffix(".txt")
    with file.open("w", encoding="utf-8") as out:
        out.write("Recorder 7, firmware 2.1\nTrain: set 12\n")
        out.write("\t".join(names) + "\n" + "\t".join(units) + "\n")
        table.to_csv(out, sep="\t", index=False, header=False)
    return file


def _words_for_nothing(table: pd.DataFrame) -> pd.DataFrame:
    """A value in 200 is a word or a number that stands for no value."""
    rng = np.random.default_rng(len(table))
    changed = table.astype(object)
    for name in names_of(table):
        if name != "time_s":
            changed.loc[rng.random(len(table)) < 0.005, name] = rng.choice(["---", "n/a", "-9999"])
    return changed


def _milliseconds(table: pd.DataFrame) -> pd.DataFrame:
    rest = table.drop(columns="time_s")
    rest.insert(0, "time_ms", np.round(1e3 * table["time_s"]))
    return rest


def _in_any_order(table: pd.DataFrame) -> pd.DataFrame:
    names: list[str] = sorted(names_of(table), key=lambda name: name[::-1])
    return table[names]


def _since_1970(table: pd.DataFrame) -> pd.DataFrame:
    return table.assign(time_s=1_774_745_990.0 + table["time_s"]).rename(
        columns={"time_s": "epoch"}
    )


FORMS: dict[str, Write] = {
    "own names": _text(_same),
    "German, semicolons": _text(partial(named, words=GERMAN), sep=";", decimal=",", encoding="cp1252"),
    "French, tabs": _text(partial(named, words=FRENCH), sep="\t", decimal=",", encoding="utf-16", ending=".txt"),
    "Japanese": _text(partial(named, words=JAPANESE), encoding="shift_jis"),
    "short names": _text(partial(named, words=SHORT)),
    "m/s and N": _text(in_si, compression="gzip", ending=".csv.gz"),
    "turning speeds": partial(_csv, by_rpm, {}),
    "row of units": _row_of_units,
    "parquet": _parquet,
    "time stamps": _text(stamped, encoding="utf-8-sig"),
    "milliseconds": _text(_milliseconds),
    "since 1970": _text(_since_1970),
    "words for nothing": _text(_words_for_nothing),
    "speeds below 0": _text(reversed_signs),
    "columns in any order": _text(_in_any_order),
}  # fmt: skip
"""Every form by name."""


STREAM = 41
"""Number that distinguishes the draws from those of other studies."""
LOGS = 8
"""Spoiled logs of a run."""
RULES = ("alone", "cooperative", "exact")
CONTROLLERS = ("cut-and-ramp", "perturb-observe", "mpc")
TRAINS = ("commuter-8car", "gb-unit-8car", "jp4209318-3car")
"""Sets that stop by air brakes and slide protection."""
SHIPPED_STARTS = "long-train", "gradient-start", "freight-start", "uneven-load"
"""Scenarios of starts from rest: sixteen cars, a hill, a locomotive and wagons behind slack couplers, full cars."""
PERIOD = 0.01
"""Of the recorder of the clean log [s]."""
CLEAN, PLAIN = "none", "own names"
TOLERANCE = 0.02
"""Error of Q, as a share, up to which a log is right ..."""
LITTLE = 0.5
"""... or that much [kJ] where Q is little."""
FAULTS, LOCKED = ("delay", "radius", "balance", "sign", "stuck", "faulty"), "a locked wheel"
"""Kinds of remarks that say that figures may be wrong, and what no fault of the log is."""
SLIPS, SHARE_OF_SLIPS = 2, 2.0 / 24.0
"""Slips too many or too few up to which it is right: two, or two of 24."""


def drawn_run(seed: int, k: int) -> tuple[str, xr.Dataset, Train]:
    """Run `k`, its name and its train.

    In turn: a start on a drawn rail, a stop with motors and air, a stop by air and slide protection, and a shipped start
    with a drawn seed. Trains take turns within each: multiple units, sixteen cars, locomotives with wagons or coaches.
    """
    g = np.random.default_rng([seed, k, STREAM])
    kind, number, own_seed = k % 4, k // 4, 0
    if kind == 2:
        train, curve = find_set(str(g.choice(TRAINS))), str(g.choice(list(CURVES)))
        level, speed = float(g.uniform(0.03, 0.09)), float(g.uniform(40.0, 90.0)) / 3.6
        stop = stop_of(train, curve, level, speed).event
        return f"air stop, {curve}, {level:.3f}", simulate(stop, "alone", "none"), stop.model.train
    if kind == 3:
        scenario = shipped_scenario(SHIPPED_STARTS[number % len(SHIPPED_STARTS)])
        own_seed = int(g.integers(1, 1000))
    else:
        scenario = drawn_start(seed, number) if kind == 0 else drawn_stop(seed, number)
    job = Job(scenario, str(g.choice(RULES)), str(g.choice(CONTROLLERS)), own_seed)
    return scenario.name, simulate_job(job), scenario.event(own_seed).model.train


def rows_of(seed: int, k: int, logs: int = LOGS) -> list[Row]:
    """Rows of run `k`: its clean log, and `logs` that are spoiled and written as recorders do.

    Defects take turns over the runs; of two logs one has a drawn form.
    """
    name, run, train = drawn_run(seed, k)
    every = max(1, round(PERIOD / float(np.median(np.diff(run["time"].values)))))
    clean = Logged(rounded(log_table(run, train, every)), MeasuredTrain.of(train), run)
    damage = METRICS.find("damage").function(run)
    own = {
        "run": name,
        "number": k,
        "coupled": clean.train.coupler is not None,
        "damage_simulated": damage,
    }
    rows: list[Row] = []
    slips = np.nan
    for i in range(logs + 1):
        turn = (k * logs + i - 1) % len(DEFECTS)
        defect = CLEAN if i == 0 else list(DEFECTS)[turn]
        g = np.random.default_rng([seed, k, i, STREAM])
        form = str(g.choice(list(FORMS))) if i > 0 and g.random() < 0.5 else PLAIN
        row = own | {"log": i, "defect": defect, "form": form}
        found = _judged(clean, DEFECTS.get(defect), form, g, damage, slips)
        slips = float(found["slips"]) if i == 0 else slips
        rows.append(row | found)
    return rows


def _judged(
    clean: Logged, defect: Defect | None, form: str, g: np.random.Generator, damage: float, slips: float
) -> dict[str, Any]:  # fmt: skip
    """What the analysis says of a log with this defect in this form; `damage` and `slips`: what would be right."""
    table, train, drawn = clean.table, clean.train, ""
    if defect is not None:
        table, train, drawn = defect.spoil(clean, g)
    with tempfile.TemporaryDirectory() as folder:
        path = FORMS[form](table, train.radius, Path(folder) / "log")
        try:
            log = read_log(path, train)
            found = analyse_run(log.run, log.train)
        except StudyError as error:
            return _refused(drawn, defect, str(error).replace(folder, ""))
    if reason := withheld(log, found):
        return _refused(drawn, defect, f"no Q: {reason}")
    return {"drawn": drawn, "refused": False, "proper": 0.0} | _figures(
        log, found, defect, damage, slips
    )


def _refused(drawn: str, defect: Defect | None, said: str) -> dict[str, Any]:
    """Of a log that is refused, or whose Q is withheld: neither right nor silent, proper where the defect is such."""
    proper = float(defect is not None and defect.refusable)
    found = {"drawn": drawn, "refused": True, "proper": proper, "said": said}
    return (
        found
        | dict.fromkeys(("right", "slips_right", "silent"), 0.0)
        | dict.fromkeys(_NUMBERS, np.nan)
    )


_NUMBERS = ("damage", "error", "stated", "slips", "covered", "named", "remarked")


def _figures(
    log: MeasuredLog, found: Findings, defect: Defect | None, damage: float, slips: float
) -> dict[str, Any]:
    remarks = [*log.remarks, *fit_remarks(log, found)]
    kinds = {remark.kind for remark in remarks}
    q = 1e-3 * found.total_damage
    stated = np.nan if found.errors is None else 1e-3 * found.errors.total
    apart, many = abs(q - damage), len(found.events)
    right = apart <= max(TOLERANCE * damage, LITTLE)
    counted = np.isnan(slips) or abs(many - slips) <= max(SLIPS, SHARE_OF_SLIPS * slips)
    covered = bool(apart <= 2.0 * stated)
    named = defect is not None and bool(kinds & defect.named_by)
    remarked = any(remark.kind in FAULTS and LOCKED not in remark.text for remark in remarks)
    return {
        "damage": q,
        "error": apart / max(damage, LITTLE),
        "stated": stated,
        "slips": float(many),
        "right": float(right),
        "slips_right": float(counted),
        "covered": float(covered),
        "named": float(named),
        "remarked": float(remarked),
        "silent": float(not right and not covered and not named and not remarked),
        "said": "; ".join(f"{remark.kind}: {remark.text}" for remark in remarks)[:600],
    }
