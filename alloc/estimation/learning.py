"""Increments that a train has learnt, from run to run: read from a recorded run, and stored in a file of the train."""

import json
from dataclasses import asdict
from pathlib import Path

import xarray as xr

from alloc.errors import EstimationError, OnboardError
from alloc.onboard.increment_learning import Increments, LearntIncrements
from alloc.whole_file import write_whole

DIRECTIONS = ("forward", "backward")
"""Running directions; each has its own increments, because another car leads."""


def learnt_in(run: xr.Dataset) -> LearntIncrements:
    """What the train has learnt by the end of a recorded run; raises `EstimationError` for a run without learning."""
    if "learnt_increment" not in run:
        raise EstimationError(
            'learning: nothing is learnt in this run; give [onboard.learning] kind = "running-mean" or "gaussian"'
        )
    return LearntIncrements(
        *(tuple(run[f"learnt_{name}"].values.tolist()) for name in Increments._fields)
    )


def save_learning(path: str | Path, train: str, learnt: dict[str, LearntIncrements]) -> None:
    """Save what a train has learnt, by running direction, in a JSON file; replaces the whole file."""
    path = Path(path)
    directions = {name: asdict(item) for name, item in learnt.items()}
    text = json.dumps({"train": train, "directions": directions}, indent=1)
    try:
        write_whole(path, lambda aside: aside.write_text(text, encoding="utf-8"))
    except OSError as error:
        raise EstimationError(
            f"learning file {str(path)!r} cannot be written: {error.strerror}"
        ) from None


def load_learning(path: str | Path, train: str) -> dict[str, LearntIncrements]:
    """What `train` has learnt, by running direction; empty if there is no file yet.

    Raises `EstimationError` for a file that belongs to another train or is not from `save_learning`.
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
            name: LearntIncrements(**{key: tuple(values) for key, values in state.items()})
            for name, state in directions.items()
        }
    except (KeyError, TypeError, ValueError, AttributeError, OnboardError) as error:
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
