"""Some lanes of a model with many."""

from dataclasses import replace
from typing import Any

from alloc.errors import PlantError
from alloc.plant.model import Model

LANES_LAST = ("law", "increment", "patch", "conditioning", "receptivity", "failure_time")
LANES_FIRST = ("noise", "noise_length")
"""Fields of `Environment` by where the lane is among their dimensions; the others are common to all lanes."""


def select_lanes(model: Model, lanes: slice) -> Model:
    """The same model with these of its lanes only; raises `PlantError` if none is left."""
    rails = model.rails[lanes]
    if not rails:
        raise PlantError(f"lanes: {lanes} selects none of {model.lanes} lanes")
    e = model.environment
    own: dict[str, Any] = {name: getattr(e, name)[..., lanes].copy() for name in LANES_LAST}
    own |= {name: getattr(e, name)[lanes].copy() for name in LANES_FIRST}
    return replace(model, rails=rails, environment=e._replace(**own))
