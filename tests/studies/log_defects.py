"""Defects that loggers put into a log, each as a function of a clean table with columns such as `axle1_speed_kmh`."""

from collections.abc import Callable

import numpy as np
import pandas as pd

PULSES_PER_TURN = 80


def fixes_of(table: pd.DataFrame, late: float, period: float) -> tuple[np.ndarray, np.ndarray]:
    """Instants at which a receiver delivers, and the train's speed that it had `late` seconds before."""
    time = table["time_s"].to_numpy()
    at = np.arange(time[0], time[-1] + 1e-9, period)
    return at, np.interp(at - late, time, table["speed_kmh"])


def speed_held(table: pd.DataFrame, late: float = 0.5, period: float = 1.0) -> pd.DataFrame:
    at, value = fixes_of(table, late, period)
    last = np.searchsorted(at, table["time_s"].to_numpy() + 1e-9, "right") - 1
    return table.assign(speed_kmh=value[last])


def speed_interpolated(table: pd.DataFrame, late: float = 0.5, period: float = 1.0) -> pd.DataFrame:
    at, value = fixes_of(table, late, period)
    return table.assign(speed_kmh=np.interp(table["time_s"], at, value))


def speed_with_gaps(table: pd.DataFrame, late: float = 0.5, period: float = 1.0) -> pd.DataFrame:
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
    changed = {name: table[name].where(told) for name in table if "force" in name}
    if held:
        changed = {name: values.ffill() for name, values in changed.items()}
    return table.assign(**changed)


def interleaved(table: pd.DataFrame) -> pd.DataFrame:
    """Two recorders, whose rows follow each other: speeds in one, forces 3 ms later in the other."""
    forces = [name for name in table if "force" in name]
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


def every_seventh_missing(table: pd.DataFrame, axle: int = 2) -> pd.DataFrame:
    name = f"axle{axle}_speed_kmh"
    return table.assign(**{name: table[name].where(np.arange(len(table)) % 7 != 3)})


def noisy(table: pd.DataFrame, kmh: float = 0.04, seed: int = 0) -> pd.DataFrame:
    rng = np.random.default_rng(seed)
    names = [name for name in table if "speed" in name]
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
        "seventh": every_seventh_missing,
    }


def by_rpm(table: pd.DataFrame, radius: np.ndarray) -> pd.DataFrame:
    """Turning speeds of wheels [1/min]."""
    changed = table.copy()
    for i, r in enumerate(radius, 1):
        name = f"axle{i}_speed_kmh"
        if name in changed:
            changed[name.replace("kmh", "rpm")] = changed.pop(name) / 3.6 / r * 60.0 / (2.0 * np.pi)
    return changed


def stamped(table: pd.DataFrame) -> pd.DataFrame:
    """Time stamps in UTC as texts."""
    start = pd.Timestamp("2026-03-29T00:59:50Z")
    at = start + pd.to_timedelta(table["time_s"], unit="s")
    stamps = at.dt.strftime("%Y-%m-%dT%H:%M:%S.%fZ")
    return table.drop(columns="time_s").assign(timestamp=stamps)


def single_epoch(table: pd.DataFrame) -> pd.DataFrame:
    """Seconds since 1970 in single precision: one value for two minutes."""
    return table.assign(time_s=(table["time_s"] + 1_774_745_990.0).astype(np.float32))


def reversed_signs(table: pd.DataFrame) -> pd.DataFrame:
    """A train whose recorder counts speeds backwards."""
    return table.assign(**{name: -table[name] for name in table if "speed" in name})


def repeated_row(table: pd.DataFrame, row: int = 100) -> pd.DataFrame:
    return pd.concat([table.iloc[: row + 1], table.iloc[row:]]).reset_index(drop=True)


def without_speed(table: pd.DataFrame) -> pd.DataFrame:
    return table.drop(columns="speed_kmh")
