"""Named parameter sets of trains: one module each, every value with its source.

A value that no source gives is marked "assumed" with the reason why it is plausible.
"""

from collections.abc import Callable
from difflib import get_close_matches

from alloc.errors import PlantError
from alloc.plant.sets import commuter_8car, freight, high_speed_16car, jp4209318_3car, one_axle
from alloc.plant.train import Train

SETS: dict[str, Callable[[], Train]] = {
    "one-axle": one_axle.train,
    "jp4209318-3car": jp4209318_3car.train,
    "commuter-8car": commuter_8car.train,
    "high-speed-16car": high_speed_16car.train,
    "freight-5": freight.train_of_5,
    "freight-17": freight.train_of_17,
}
"""Name of a parameter set and the function that builds its train."""


def find_set(name: str) -> Train:
    """The train of the set `name`; raises `PlantError` with the nearest known name if there is none."""
    if name not in SETS:
        near = get_close_matches(name, SETS, 1, 0.4)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise PlantError(f"train: unknown parameter set {name!r}; {hint}Known: {', '.join(SETS)}")
    return SETS[name]()


__all__ = ["SETS", "find_set"]
