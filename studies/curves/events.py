"""The events of the claims on rails of several adhesion curves."""

from typing import Any

from studies.claims.events import DURATION, draw, event_name
from studies.claims.events import scenario as claim_event
from studies.curves.statements import CURVES
from studies.ladder.events import polach_level
from studies.scenario.scenario import Scenario

KNOWN = "-known"
"""End of the name of an event whose train knows the rail's curve."""


def name_of(seed: int, k: int, curve: str) -> str:
    """Name of event `k` on a rail of `curve`."""
    return f"{event_name(seed, k)}-{curve.replace(' ', '-')}"


def informed(event: Scenario) -> Scenario:
    """The same event for a train that believes in the rail's own curve."""
    belief = event.belief.model_dump() | {"curve": event.rail.curve.model_dump()}
    return event.changed(name=event.name + KNOWN, belief=belief)


def scenario(seed: int, k: int, curve: str, duration: float = DURATION) -> Scenario:
    """Event `k` of the claims on a rail of `curve`; the train believes in the piecewise curve on all of them."""
    base = claim_event(seed, k, duration)
    rail: dict[str, Any] = base.rail.model_dump() | {"curve": CURVES[curve]}
    if CURVES[curve]["kind"] == "polach":  # its level is the friction coefficient, above the peak
        adhesion = draw(seed, k)["level"]  # "level" may be a factor on a law of speed
        rail["level"] *= polach_level(adhesion) / adhesion
    belief = base.belief.model_dump() | {"curve": {"kind": "piecewise"}}
    return base.changed(name=name_of(seed, k, curve), rail=rail, belief=belief)
