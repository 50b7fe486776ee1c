"""Named parameter sets of trains: one module each, which registers its trains; every value has its source.

A value without a source is marked "assumed" with the reason why it is plausible.
"""

from collections.abc import Callable

from alloc.errors import PlantError
from alloc.plant.train import Train
from alloc.registry import Registry

SETS: Registry[Callable[[], Train]] = Registry(
    "train", "readhesion.trains", PlantError, "alloc.plant.sets",
    (
        "one-axle", "jp4209318-3car", "commuter-8car", "gb-unit-8car", "high-speed-16car", "freight-5",
        "freight-17", "heavy-70",
    ),
)  # fmt: skip
"""Name of a parameter set and the function that builds its train; from short trains to long ones."""


def find_set(name: str) -> Train:
    """The train of the set `name`; raises `PlantError` with the nearest known name if there is none."""
    return SETS.find(name)()
