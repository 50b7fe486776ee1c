"""Defects that loggers put into a log, each as a function of a clean table with columns such as `axle1_speed_kmh`."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np
import pandas as pd

PULSES_PER_TURN = 80


def names_of(table: pd.DataFrame, part: str = "") -> list[str]:
    """Columns with this in their name, all without."""
    return [name for name in map(str, table) if part in name]


def speeds_of(table: pd.DataFrame) -> list[str]:
    """Columns of all speeds."""
    return names_of(table, "speed")


def forces_of(table: pd.DataFrame) -> list[str]:
    """Columns of the axles' forces."""
    return [name for name in names_of(table, "force") if name.startswith("axle")]


def wheels_of(table: pd.DataFrame) -> list[str]:
    """Columns of the axles' speeds."""
    return [name for name in speeds_of(table) if name.startswith("axle")]


def axles_of(table: pd.DataFrame) -> list[int]:
    """Numbers of the axles that have a speed."""
    return [int(name.removeprefix("axle").partition("_")[0]) for name in wheels_of(table)]


def fixes_of(table: pd.DataFrame, late: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Instants at which a receiver delivers, and the train's speed that it had `late` seconds before."""
    time = table["time_s"].to_numpy()
    at = np.arange(time[0], time[-1] + 1e-9, period)
    return at, np.interp(at - late, time, table["speed_kmh"])


def speed_held(table: pd.DataFrame, late: float = 0.5, period: float = 1.0) -> pd.DataFrame:
    """A train's speed that is rare, late and held in between."""
    at, value = fixes_of(table, late, period)
    last = np.searchsorted(at, table["time_s"].to_numpy() + 1e-9, "right") - 1
    return table.assign(speed_kmh=value[last])


def speed_interpolated(table: pd.DataFrame, late: float = 0.5, period: float = 1.0) -> pd.DataFrame:
    """The same on straight lines in between."""
    at, value = fixes_of(table, late, period)
    return table.assign(speed_kmh=np.interp(table["time_s"], at, value))


def speed_with_gaps(table: pd.DataFrame, late: float = 0.5, period: float = 1.0) -> pd.DataFrame:
    """The same with nothing in between."""
    held = speed_held(table, late, period)["speed_kmh"]
    time = table["time_s"].to_numpy()
    tick = np.floor((time - time[0] + 1e-9) / period)
    return table.assign(speed_kmh=held.where(np.diff(tick, prepend=-1.0) > 0.0))


def speed_late(table: pd.DataFrame, late: float = 0.5) -> pd.DataFrame:
    """At the logger's full rate, only late."""
    time = table["time_s"]
    return table.assign(speed_kmh=np.interp(time - late, time, table["speed_kmh"]))


def forces_at(table: pd.DataFrame, period: float = 0.05, held: bool = False) -> pd.DataFrame:
    """Forces sampled less often than the wheels: empty in between, or held."""
    time = table["time_s"].to_numpy()
    tick = np.floor((time - time[0] + 1e-9) / period)
    told = np.diff(tick, prepend=-1.0) > 0.0
    changed = {name: table[name].where(told) for name in names_of(table, "force")}
    if held:
        changed = {name: values.ffill() for name, values in changed.items()}
    return table.assign(**changed)


def interleaved(table: pd.DataFrame) -> pd.DataFrame:
    """Two recorders, whose rows follow each other: speeds in one, forces 3 ms later in the other."""
    forces = names_of(table, "force")
    time = table["time_s"].to_numpy()
    later = table[["time_s", *forces]].copy()
    for name in forces:
        later[name] = np.interp(time + 0.003, time, table[name])
    later["time_s"] += 0.003
    both = pd.concat([table.drop(columns=forces), later])
    return both.sort_values("time_s", kind="stable").reset_index(drop=True)


def counted(table: pd.DataFrame, radius: np.ndarray, period: float = 0.01) -> pd.DataFrame:
    """Wheel speeds from whole pulses counted in the time before each row."""
    time = table["time_s"].to_numpy()
    at = np.arange(time[0], time[-1] + 1e-9, period)
    rows = {name: np.interp(at, time, table[name]) for name in table if name != "time_s"}
    fine = pd.DataFrame({"time_s": np.round(at, 6), **rows})
    for i, r in enumerate(radius, 1):
        name = f"axle{i}_speed_kmh"
        if name in table:
            rim = table[name].to_numpy() / 3.6
            way = np.concatenate([[0.0], np.cumsum(0.5 * (rim[1:] + rim[:-1]) * np.diff(time))])
            pulse = 2.0 * np.pi * r / PULSES_PER_TURN
            count = np.floor(np.interp(at, time, way) / pulse + 0.37 * i)
            counts = np.diff(count)
            counts = np.concatenate([counts[:1], counts])
            fine[name] = 3.6 * counts * pulse / period
    return fine


def values_missing(table: pd.DataFrame, axle: int = 2, each: int = 7) -> pd.DataFrame:
    """An axle's speed without each so manieth value."""
    name = f"axle{axle}_speed_kmh"
    return table.assign(**{name: table[name].where(np.arange(len(table)) % each != each // 2)})


def noisy(table: pd.DataFrame, kmh: float = 0.04, seed: int = 0) -> pd.DataFrame:
    """All speeds with white noise of this standard deviation [km/h]."""
    rng = np.random.default_rng(seed)
    names = speeds_of(table)
    return table.assign(**{n: table[n] + rng.normal(0.0, kmh, len(table)) for n in names})


def defects(radius: np.ndarray) -> dict[str, Callable[[pd.DataFrame], pd.DataFrame]]:
    """Every defect of the measured values by name."""
    return {
        "clean": lambda t: t,
        "held": speed_held,
        "interpolated": speed_interpolated,
        "gaps": speed_with_gaps,
        "late": speed_late,
        "slow forces": forces_at,
        "slow forces, held": lambda t: forces_at(t, held=True),
        "interleaved": interleaved,
        "counts 5 ms": lambda t: counted(t, radius, 0.005),
        "counts 10 ms": lambda t: counted(t, radius, 0.01),
        "counts 20 ms": lambda t: counted(t, radius, 0.02),
        "seventh": values_missing,
    }


def by_rpm(table: pd.DataFrame, radius: np.ndarray) -> pd.DataFrame:
    """Turning speeds of wheels [1/min]."""
    per_kmh = {
        f"axle{i}_speed_kmh": 60.0 / (3.6 * 2.0 * np.pi * r) for i, r in enumerate(radius, 1)
    }
    wheels = {name: table[name] * per_kmh[name] for name in wheels_of(table)}
    return table.assign(**wheels).rename(
        columns={name: name.replace("kmh", "rpm") for name in wheels}
    )


def stamped(table: pd.DataFrame) -> pd.DataFrame:
    """Time stamps in UTC as texts."""
    start = pd.Timestamp("2026-03-29T00:59:50Z")
    at = start + pd.to_timedelta(table["time_s"], unit="s")
    stamps = at.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    return table.drop(columns="time_s").assign(timestamp=stamps)


def reversed_signs(table: pd.DataFrame) -> pd.DataFrame:
    """A train whose recorder counts speeds backwards."""
    return table.assign(**{name: -table[name] for name in speeds_of(table)})


def repeated_row(table: pd.DataFrame, row: int = 100) -> pd.DataFrame:
    """One row twice."""
    return pd.concat([table.iloc[: row + 1], table.iloc[row:]]).reset_index(drop=True)


def without_speed(table: pd.DataFrame) -> pd.DataFrame:
    """Without the train's speed."""
    return table.drop(columns="speed_kmh")


def shifted(table: pd.DataFrame, names: Sequence[str], late: float) -> pd.DataFrame:
    """These columns recorded `late` [s], earlier where it is negative."""
    time = table["time_s"].to_numpy()
    return table.assign(**{name: np.interp(time - late, time, table[name]) for name in names})


def zero_below(table: pd.DataFrame, kmh: float) -> pd.DataFrame:
    """Wheels whose sensors say 0 at low speed."""
    return table.assign(**{n: table[n].where(table[n] >= kmh, 0.0) for n in wheels_of(table)})


def rear_late(table: pd.DataFrame, late: float) -> pd.DataFrame:
    """The rear half of the axles has a recorder of its own, which is `late` [s]."""
    axles = axles_of(table)
    rear = {f"axle{axle}" for axle in axles[len(axles) // 2 :]}
    names = [n for n in wheels_of(table) + forces_of(table) if n.partition("_")[0] in rear]
    return shifted(table, names, late)


def rounded_to(
    table: pd.DataFrame,
    names: Sequence[str],
    step: float,
    how: Callable[[Any], Any] = np.round,
) -> pd.DataFrame:
    """These columns in multiples of a step."""
    return table.assign(**{name: how(table[name] / step + 1e-9) * step for name in names})


def stuck(table: pd.DataFrame, axle: int, since: float, span: float) -> pd.DataFrame:
    """An axle's speed that stays at its value for a `span` [s]."""
    name, time = f"axle{axle}_speed_kmh", table["time_s"].to_numpy()
    inside = (time >= since) & (time < since + span)
    return table.assign(**{name: table[name].mask(inside, np.interp(since, time, table[name]))})


def by_radius(table: pd.DataFrame, factors: Mapping[int, float]) -> pd.DataFrame:
    """Rim speeds by radii that are wrong by these factors, by number of the axle."""
    names = {axle: f"axle{axle}_speed_kmh" for axle in factors}
    return table.assign(**{name: table[name] * factors[axle] for axle, name in names.items()})


def outliers(table: pd.DataFrame, number: int, seed: int) -> pd.DataFrame:
    """Single speeds that are 5 to 50 km/h too high or too low, but not below 0."""
    rng, changed = np.random.default_rng(seed), table.copy()
    for _ in range(number):
        name = str(rng.choice(speeds_of(table)))
        row = int(rng.integers(len(table)))
        by = rng.uniform(5.0, 50.0) * rng.choice([-1.0, 1.0])
        changed.loc[row, name] = max(float(table[name].iloc[row]) + by, 0.0)
    return changed


def rows_lost(table: pd.DataFrame, gaps: Sequence[tuple[float, float]]) -> pd.DataFrame:
    """Without the rows of gaps, each by its begin as a share of the log and its length [s]."""
    time = table["time_s"]
    lost = time < time.iloc[0]
    for begin, length in gaps:
        start = time.iloc[0] + begin * (time.iloc[-1] - time.iloc[0])
        lost |= (time >= start) & (time < start + length)
    return table[~lost].reset_index(drop=True)
