"""Increments learnt from the units' own slips: the running mean of JP5484215 (16) and (17), and a Bayesian one.

A datum is the difference of two estimates at a slip of unit j: its own coefficient minus that of the foremost unit.
"""

import json
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from alloc.errors import EstimationError

Floats = NDArray[np.float64]


def _datum(units: int, unit: int, increment: float) -> None:
    if not 0 <= unit < units:
        raise EstimationError(f"learning: no unit {unit}; the train has {units} (counted from 0)")
    EstimationError.check(
        f"learning of unit {unit}", {"increment": increment}, finite=("increment",)
    )


@dataclass(eq=False)
class RunningMean:
    """Learning of JP5484215, embodiment 2.

    `increment` (units,) as stored in B1, `count` (units,) N_z, the number of data behind each. New data of a unit
    are kept until there are `first` of them (N_min) for the first time, then every `further` (N_arg).
    """

    increment: Floats
    count: Floats
    first: int = 10
    further: int = 5
    pending_sum: Floats = field(init=False)
    pending: NDArray[np.int64] = field(init=False)
    updates: NDArray[np.int64] = field(init=False)
    kind: ClassVar[str] = "running-mean"

    def __post_init__(self) -> None:
        self.increment = np.array(self.increment, dtype=float)
        self.count = np.array(self.count, dtype=float)
        if self.increment.ndim != 1 or self.increment.shape != self.count.shape:
            raise EstimationError(
                f"learning: increment {self.increment.shape} and count {self.count.shape} must be (units,)"
            )
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
        _datum(self.increment.size, unit, increment)
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

    def state(self) -> dict[str, Any]:
        """What a file keeps."""
        names = ("increment", "count", "pending_sum", "pending", "updates")
        settings = {"first": self.first, "further": self.further}
        return settings | {name: getattr(self, name).tolist() for name in names}

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> "RunningMean":
        """The learning that `state` describes."""
        made = cls(state["increment"], state["count"], state["first"], state["further"])
        made.pending_sum = np.array(state["pending_sum"], dtype=float)
        made.pending = np.array(state["pending"], dtype=np.int64)
        made.updates = np.array(state["updates"], dtype=np.int64)
        return made


@dataclass(eq=False)
class GaussianPosterior:
    """Bayesian learning: a Gaussian prior per unit, data that scatter by `noise` about the true increment.

    `increment` (units,) posterior means, `variance` (units,). `drift`: variance that each datum's passing adds, so that
    old data fade and the train can follow the seasons; 0 keeps all data for ever.
    """

    increment: Floats
    variance: Floats
    noise: float
    drift: float = 0.0
    kind: ClassVar[str] = "gaussian"

    def __post_init__(self) -> None:
        self.increment = np.array(self.increment, dtype=float)
        self.variance = np.array(self.variance, dtype=float)
        if self.increment.ndim != 1 or self.increment.shape != self.variance.shape:
            raise EstimationError(
                f"learning: increment {self.increment.shape} and variance {self.variance.shape} must be (units,)"
            )
        bounded = ("variance[]", "drift")
        EstimationError.check(
            "learning", self, ("noise",), bounded, ("increment[]",), infinite=("noise", *bounded)
        )

    def add(self, unit: int, increment: float) -> bool:
        """Take a datum of `unit`; the increment changes at once."""
        _datum(self.increment.size, unit, increment)
        prior = self.variance[unit] + self.drift
        gain = prior / (prior + self.noise**2)
        self.increment[unit] += gain * (increment - self.increment[unit])
        self.variance[unit] = (1.0 - gain) * prior
        return True

    def deviation(self) -> Floats:
        """Posterior standard deviation of each increment."""
        return np.sqrt(self.variance)

    def state(self) -> dict[str, Any]:
        """What a file keeps."""
        return {
            "noise": self.noise,
            "drift": self.drift,
            "increment": self.increment.tolist(),
            "variance": self.variance.tolist(),
        }

    @classmethod
    def from_state(cls, state: dict[str, Any]) -> "GaussianPosterior":
        """The learning that `state` describes."""
        return cls(state["increment"], state["variance"], state["noise"], state["drift"])


Learning = RunningMean | GaussianPosterior
KINDS: dict[str, type[RunningMean] | type[GaussianPosterior]] = {
    kind.kind: kind for kind in (RunningMean, GaussianPosterior)
}
"""Kinds of learning by name."""

DIRECTIONS = ("forward", "backward")
"""Running directions; each has its own increments, for another car leads."""


def save_learning(path: str | Path, train: str, learnt: dict[str, Learning]) -> None:
    """Keep what a train has learnt, by running direction, in a JSON file; replaces the file as a whole."""
    path = Path(path)
    content = {
        "train": train,
        "directions": {name: {"kind": item.kind} | item.state() for name, item in learnt.items()},
    }
    aside = path.with_name(path.name + ".new")
    try:
        aside.write_text(json.dumps(content, indent=1), encoding="utf-8")
        aside.replace(path)
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
    try:
        content = json.loads(path.read_text(encoding="utf-8"))
        owner, directions = content["train"], content["directions"]
        learnt: dict[str, Learning] = {}
        for name, state in directions.items():
            if name not in DIRECTIONS:
                raise KeyError(name)
            learnt[name] = KINDS[state["kind"]].from_state(state)
    except (KeyError, TypeError, ValueError) as error:
        if isinstance(error, EstimationError):
            raise
        raise EstimationError(
            f"learning file {str(path)!r} is damaged ({type(error).__name__}: {error}); remove it to start anew"
        ) from None
    except OSError as error:
        raise EstimationError(
            f"learning file {str(path)!r} cannot be read: {error.strerror}"
        ) from None
    if owner != train:
        raise EstimationError(
            f"learning file {str(path)!r} belongs to train {owner!r}, not {train!r}; give another file"
        )
    return learnt
