"""What the page keeps of a recorded run, so that it can be replayed: states of train, units and axles at 20 Hz."""

import base64
import json
import math
import zlib
from collections.abc import Hashable, Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pandas as pd
import xarray as xr
from numpy.typing import ArrayLike, NDArray

from alloc.plant.model import Model
from studies.core.cell import Shared, Yield
from studies.core.job import Job, run_status, simulate_job
from studies.patent.headroom_study import measure

# Recorded series as short text: whole steps of a stated resolution, differences in time, deflated, base64.
#
# A browser takes it apart without any library (`unpack.js`). A replay of 32 axles and 20 s takes some 10 kB; its
# numbers in single precision would take 300 kB.

MOST_STEPS = 32_000
"""Steps of the resolution up to which a number is kept; where a series goes beyond, its steps are longer."""
NOTHING = -32_768
"""Represents a missing number, such as a limit that is not set."""


@dataclass(frozen=True)
class Packed:
    """Series by name, each (instants,) or (instants, n), in one text."""

    text: str
    columns: dict[str, int | None]
    """Columns of each series, in their order; None for a series of one number per instant."""
    steps: dict[str, float]
    """What one step of each series is worth, in its unit: no number is off by more than half of it."""
    instants: int

    def content(self) -> dict[str, Any]:
        """The same as plain values, as the page keeps them."""
        return {
            "text": self.text,
            "instants": self.instants,
            "series": [[name, self.columns[name], self.steps[name]] for name in self.columns],
        }


def pack(series: Mapping[str, tuple[ArrayLike, float]]) -> Packed:
    """Pack series of equal length, each with the resolution that is wanted of it."""
    columns: dict[str, int | None] = {}
    steps, parts, instants = {}, [], 0
    for name, (given, resolution) in series.items():
        values = np.asarray(given, dtype=float)
        columns[name] = None if values.ndim == 1 else values.shape[1]
        instants = len(values)
        known = np.isfinite(values)
        largest = float(np.abs(values[known]).max(initial=0.0))
        step = steps[name] = max(resolution, largest / MOST_STEPS)
        whole = np.full(values.shape, NOTHING, np.int64)
        whole[known] = np.rint(values[known] / step)
        table = whole if values.ndim > 1 else whole[:, None]
        change = np.diff(table, axis=0, prepend=0).astype(
            "<i2"
        )  # what wraps round comes back round
        parts.append(np.ascontiguousarray(change.T).ravel())
    numbers = np.concatenate(parts) if parts else np.empty(0, "<i2")
    planes = numbers.view(np.uint8).reshape(-1, 2).T.tobytes()  # low bytes, then high bytes
    text = base64.b64encode(zlib.compress(planes, 9)).decode()
    return Packed(text, columns, steps, instants)


def unpack(packed: Packed) -> dict[str, NDArray[np.float64]]:
    """The series again, as a browser makes them of the text."""
    planes = np.frombuffer(zlib.decompress(base64.b64decode(packed.text)), np.uint8)
    numbers = planes.reshape(2, -1).T.copy().view("<i2").ravel()
    found: dict[str, NDArray[np.float64]] = {}
    start = 0
    for name, columns in packed.columns.items():
        width = 1 if columns is None else columns
        size = packed.instants * width
        change = numbers[start : start + size].reshape(width, packed.instants)
        start += size
        whole = np.cumsum(change, axis=1, dtype=np.int16).T
        values = np.where(whole == NOTHING, np.nan, whole * packed.steps[name])
        found[name] = values[:, 0] if columns is None else values
    return found


def deflated(text: str) -> str:
    """A text, such as a program, deflated, as base64."""
    return base64.b64encode(zlib.compress(text.encode(), 9)).decode()


PERIOD = 0.05
"""Time between two instants that are kept [s]."""
MOST_INSTANTS = 2000
"""Of a longer run every second, third, ... of them is kept."""

KEPT: dict[str, float] = {
    "position": 0.05,
    "speed": 0.005,
    "driver_command": 0.001,
    "expected": 1e-4,
    "limit": 1e-4,
    "slipping": 1.0,
    "slip_velocity": 1e-3,
    "peak_slip": 1e-3,
    "rail_force": 10.0,
    "adhesion_limit": 1e-4,
    "axle_load": 10.0,
}
"""Recorded variables that are kept, each with its resolution, in the unit of the recording."""


@dataclass(frozen=True)
class ReplayCell:
    """A job's run, kept for its replay; its row has the replay as JSON."""

    job: Job

    @property
    def label(self) -> str:
        """That of the job."""
        return self.job.label

    @property
    def identity(self) -> Mapping[str, Any]:
        """That of the job."""
        return self.job.identity

    @property
    def sources(self) -> tuple[str, ...]:
        """Those of the job, and what is kept of its run."""
        return (*self.job.sources, __name__)

    @property
    def group(self) -> Hashable:
        """That of the job."""
        return self.job.group

    def work(self, shared: Shared) -> Yield:
        """Simulate, and keep what is shown."""
        run = simulate_job(self.job)
        with np.errstate(invalid="ignore"):  # nan where nothing is asked for
            row = dict(self.identity) | measure(run)
        return Yield([row | {"content": json.dumps(kept(run))} | run_status(run)])


@dataclass(frozen=True)
class Replay:
    """A run as the page keeps it."""

    label: str
    """Scenario/rule/controller/seed."""
    status: str
    reason: str
    plan_use: float
    """Effort, the plan at most, over the plan (`studies.patent.headroom_study`); nan where the run failed."""
    run: Mapping[str, Any]
    """Replay of the run in `kept`; nothing where the run failed."""

    def content(self) -> dict[str, Any]:
        """The same as plain values, as the page keeps them."""
        return {"status": self.status, "reason": self.reason, **self.run}


def kept(run: xr.Dataset) -> dict[str, Any]:
    """What is kept of a recorded run: first instant and period [s], and the series of `KEPT`."""
    time = run["time"].values
    recorded = float(time[1] - time[0]) if time.size > 1 else PERIOD
    every = max(1, round(PERIOD / recorded), -(-time.size // MOST_INSTANTS))
    series = {name: (run[name].values[::every], step) for name, step in KEPT.items() if name in run}
    return {"start": float(time[0]), "period": every * recorded, **pack(series).content()}


def replays_of(cells: Sequence[ReplayCell], table: pd.DataFrame) -> list[Replay]:
    """The replays in the rows of `cells`, in their order."""
    found = []
    for cell, row in zip(cells, table.to_dict("records"), strict=True):
        failed = row["status"] == "failed"
        run = {} if failed else json.loads(row["content"])
        use = math.nan if failed else float(row["plan_use"])
        found.append(Replay(cell.label, row["status"], row["reason"], use, run))
    return found


def drawing(model: Model) -> dict[str, Any]:
    """What the page draws a train from: places [m] behind the train's front, and which unit each axle belongs to."""
    structure = model.structure
    ends = np.cumsum([car.length for car in model.train.cars])
    return {
        "train": model.train.name,
        "cars": [[float(end - car.length), float(end)] for end, car in zip(ends, model.train.cars, strict=True)],
        "axles": (-structure.axle_offset).tolist(),
        "axle_unit": structure.axle_unit.tolist(),
        "axle_load": structure.static_load.tolist(),
    }  # fmt: skip
