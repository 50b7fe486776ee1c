"""How recorders write a log down: names in several languages, units, separators, encodings, clocks and formats."""

import re
from collections.abc import Callable, Mapping
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd

from studies.log_accuracy.defects import by_rpm, names_of, reversed_signs, stamped

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
