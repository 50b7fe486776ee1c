"""Increments learnt from the units' own slips: the running mean of JP5484215 (16) and (17), and a Bayesian one.

A datum is the difference of two estimates at a slip of unit j: its own coefficient minus that of the foremost unit.
"""

import json
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import Any, ClassVar, Self

import numpy as np
from numpy.typing import NDArray

from alloc.errors import EstimationError
from alloc.whole_file import write_whole

Floats = NDArray[np.float64]


@dataclass(eq=False)
class Learning:
    """What all ways of learning have: the increment of each unit, checks, and a state that a file keeps."""

    increment: Floats
    """(units,), as stored in the foremost unit."""
    kind: ClassVar[str]

    def _to_arrays(self, *names: str) -> None:
        """Turn these fields into arrays of their own, (units,) each."""
        for name in names:
            setattr(self, name, np.array(getattr(self, name), dtype=float))
        shapes = [getattr(self, name).shape for name in names]
        if self.increment.ndim != 1 or len(set(shapes)) > 1:
            raise EstimationError(f"learning: {' and '.join(names)} {shapes} must be (units,)")

    def _check(self, unit: int, increment: float) -> None:
        units = self.increment.size
        if not 0 <= unit < units:
            raise EstimationError(
                f"learning: no unit {unit}; the train has {units} (counted from 0)"
            )
        given = {"increment": increment}
        EstimationError.check(f"learning of unit {unit}", given, finite=given)

    def add(self, unit: int, increment: float) -> bool:
        """Take a datum of `unit`; returns whether the stored increment changed."""
        raise NotImplementedError

    def state(self) -> dict[str, Any]:
        """What a file keeps."""
        values = {one.name: getattr(self, one.name) for one in fields(self)}
        return {
            name: value.tolist() if isinstance(value, np.ndarray) else value
            for name, value in values.items()
        }

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> Self:
        """The learning that `state` describes."""
        made = cls(**{one.name: state[one.name] for one in fields(cls) if one.init})
        for one in fields(cls):
            if not one.init:
                getattr(made, one.name)[:] = state[one.name]
        return made


@dataclass(eq=False)
class RunningMean(Learning):
    """Learning of JP5484215, embodiment 2.

    `count` (units,) N_z, the number of data behind each increment. New data of a unit are kept until there are `first` of
    them (N_min) for the first time, then every `further` (N_arg).
    """

    count: Floats
    first: int = 10
    further: int = 5
    pending_sum: Floats = field(init=False)
    pending: NDArray[np.int64] = field(init=False)
    updates: NDArray[np.int64] = field(init=False)
    kind: ClassVar[str] = "running-mean"

    def __post_init__(self) -> None:
        self._to_arrays("increment", "count")
        EstimationError.check(
            "learning", self, (), ("count[]",), ("increment[]",), infinite=("count[]",)
        )
        if self.first < 1 or self.further < 1:
            raise EstimationError(
                f"learning: first = {self.first}, further = {self.further} must be 1 or greater"
            )
        self.pending_sum = np.zeros_like(self.increment)
        self.pending = np.zeros(self.increment.size, dtype=np.int64)
        self.updates = np.zeros(self.increment.size, dtype=np.int64)

    def add(self, unit: int, increment: float) -> bool:
        """Take a datum of `unit`; returns whether the stored increment changed."""
        self._check(unit, increment)
        self.pending_sum[unit] += increment
        self.pending[unit] += 1
        if self.pending[unit] < (self.further if self.updates[unit] else self.first):
            return False
        n, n_stored = self.pending[unit], self.count[unit]
        mean = self.pending_sum[unit] / n  # (16)
        self.increment[unit] = (self.increment[unit] * n_stored + mean * n) / (n_stored + n)  # (17)
        self.count[unit] = n_stored + n
        self.pending_sum[unit], self.pending[unit] = 0.0, 0
        self.updates[unit] += 1
        return True

    def deviation(self, noise: float) -> Floats:
        """Standard error of each increment if every datum scatters by `noise`, inf where there are none."""
        with np.errstate(divide="ignore"):
            return noise / np.sqrt(self.count)


@dataclass(eq=False)
class GaussianPosterior(Learning):
    """Bayesian learning: a Gaussian prior per unit, data that scatter by `noise` about the true increment.

    `increment` (units,) posterior means, `variance` (units,). `drift`: variance that each datum's passing adds, so that
    old data fade and the train can follow the seasons; 0 keeps all data for ever.
    """

    variance: Floats
    noise: float
    drift: float = 0.0
    kind: ClassVar[str] = "gaussian"

    def __post_init__(self) -> None:
        self._to_arrays("increment", "variance")
        bounded = ("variance[]", "drift")
        EstimationError.check(
            "learning", self, ("noise",), bounded, ("increment[]",), infinite=("noise", *bounded)
        )

    def add(self, unit: int, increment: float) -> bool:
        """Take a datum of `unit`; the increment changes at once."""
        self._check(unit, increment)
        prior = self.variance[unit] + self.drift
        gain = prior / (prior + self.noise**2)
        self.increment[unit] += gain * (increment - self.increment[unit])
        self.variance[unit] = (1.0 - gain) * prior
        return True

    def deviation(self) -> Floats:
        """Posterior standard deviation of each increment."""
        return np.sqrt(self.variance)


KINDS: dict[str, type[Learning]] = {kind.kind: kind for kind in (RunningMean, GaussianPosterior)}

DIRECTIONS = ("forward", "backward")
"""Running directions; each has its own increments, for another car leads."""


def save_learning(path: str | Path, train: str, learnt: dict[str, Learning]) -> None:
    """Keep what a train has learnt, by running direction, in a JSON file; replaces the file as a whole."""
    path = Path(path)
    content = {
        "train": train,
        "directions": {name: {"kind": item.kind} | item.state() for name, item in learnt.items()},
    }
    text = json.dumps(content, indent=1)
    try:
        write_whole(path, lambda aside: aside.write_text(text, encoding="utf-8"))
    except OSError as error:
        raise EstimationError(
            f"learning file {str(path)!r} cannot be written: {error.strerror}"
        ) from None


def load_learning(path: str | Path, train: str) -> dict[str, Learning]:
    """What `train` has learnt, by running direction; empty if there is no file yet.

    Raises `EstimationError` for a file that is another train's, or none of `save_learning`.
    """
    path = Path(path)
    if not path.exists():
        return {}
    named = f"learning file {str(path)!r}"
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        owner, directions = content["train"], content["directions"]
        unknown = set(directions) - set(DIRECTIONS)
        if unknown:
            raise KeyError(*unknown)
        learnt = {
            name: KINDS[state["kind"]].from_state(state) for name, state in directions.items()
        }
    except EstimationError:
        raise
    except (KeyError, TypeError, ValueError) as error:
        raise EstimationError(
            f"{named} is damaged ({type(error).__name__}: {error}); remove it to start anew"
        ) from None
    except OSError as error:
        raise EstimationError(f"{named} cannot be read: {error.strerror}") from None
    if owner != train:
        raise EstimationError(
            f"{named} belongs to train {owner!r}, not {train!r}; give another file"
        )
    return learnt
