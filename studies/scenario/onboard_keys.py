"""What a scenario file says about the equipment on board, and what the train believes."""

from dataclasses import replace
from typing import Any

from alloc.onboard import Belief, Onboard
from alloc.plant.adhesion import AdhesionCurve
from studies.files.strict import Strict
from studies.files.units import si
from studies.scenario.rail_keys import CurveKeys, IncrementKeys
from studies.scenario.record_keys import built, keys_of


class BeliefKeys(Strict):
    """What the train believes where that differs from the truth: `[belief]`."""

    increments: IncrementKeys | None = None
    unit_increments: tuple[float, ...] | None = None
    unit_deviation: tuple[float, ...] | None = None
    curve: CurveKeys | None = None
    loads_t: tuple[float, ...] | None = None


_Equipment: Any = keys_of(Onboard)


class OnboardKeys(_Equipment):
    """Equipment of the train: `[onboard]`; its tables and keys are the fields of `alloc.onboard.Onboard`."""

    def onboard(
        self,
        belief: BeliefKeys,
        true_increments: IncrementKeys,
        true_curve: AdhesionCurve,
        axles: int,
        seed: int,
    ) -> Onboard:
        """The train's equipment; it believes the truth except for what `belief` says. `seed` draws the sensors' errors."""
        believed = si(belief) | {
            "increments": (belief.increments or true_increments).increments(axles),
            "curve": true_curve if belief.curve is None else belief.curve.curve(),
        }
        equipment = built(self, Onboard, belief=Belief(**believed))
        return replace(equipment, sensors=replace(equipment.sensors, seed=seed))
