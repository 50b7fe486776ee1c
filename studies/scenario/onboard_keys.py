"""Keys of a scenario file on the equipment on board, and on what the train believes."""

from contextlib import suppress
from dataclasses import replace
from typing import Any

from pydantic import BaseModel, ConfigDict, Field, create_model, model_validator

from alloc.errors import InputError
from alloc.onboard.host import CONTROLLERS, HostedController
from alloc.onboard.parameters import Belief, Onboard
from alloc.plant.adhesion import AdhesionCurve
from studies.files.strict import Strict, in_file_words
from studies.files.units import si
from studies.scenario.rail_keys import CurveKeys, Increment, IncrementKeys
from studies.scenario.record_keys import built, keys_of


class BeliefKeys(Strict):
    """What the train believes where that differs from the truth: `[belief]`. Source: this project."""

    record = Belief

    increments: IncrementKeys | None = None
    """Growth of the coefficient along the train. Left out: that of the rail. Source: JP5484215 (15), Shinkansen."""
    unit_increments: tuple[Increment, ...] | None = None
    unit_deviation: tuple[Increment, ...] | None = None
    curve: CurveKeys | None = None
    """Adhesion curve. Left out: that of the rail."""
    loads_t: tuple[float, ...] | None = None
    mass_factor: float | None = Field(default=None, le=100.0)
    resistance_factor: float | None = Field(default=None, le=100.0)
    coupler_factor: float | None = Field(default=None, le=100.0)


_Equipment: Any = keys_of(Onboard)


def _hosted_controllers() -> dict[str, Any]:
    """Hosted controllers that have settings, by the name of their table."""
    found = {}
    for name in CONTROLLERS:
        with suppress(ImportError, AttributeError):  # one that needs what is not installed
            controller = CONTROLLERS[name]
            if isinstance(controller, HostedController) and controller.settings is not None:
                found[name.replace("-", "_")] = controller
    return found


def _about(controller: HostedController) -> str:
    return f"Controller {controller.name}: {controller.meaning}. Source: see its keys."


class OnboardKeys(_Equipment):
    """Equipment of the train: `[onboard]`; its tables and keys are the fields of `alloc.onboard.Onboard`.

    A hosted controller that has settings has a table too, `[onboard.mpc_car]` for "mpc-car": the fields of their record.
    """

    model_config = ConfigDict(extra="allow")

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> dict[str, Any]:
        complete = cls.complete()
        made: dict[str, Any] = handler(complete.__pydantic_core_schema__)
        return made

    @classmethod
    def complete(cls) -> type[BaseModel]:
        """All keys, those of hosted controllers included, which may come with plug-ins."""
        tables: Any = {
            name: (
                keys_of(controller.settings),
                Field(default=None, description=_about(controller)),
            )
            for name, controller in _hosted_controllers().items()
        }
        return create_model("Equipment", __base__=_Equipment, __doc__=cls.__doc__, **tables)

    @model_validator(mode="after")
    def _fits(self) -> "OnboardKeys":
        self.hosted()
        return self

    def hosted(self) -> dict[str, Any]:
        """Settings of hosted controllers, by the controller's name."""
        if not self.model_extra:
            return {}
        keys = self.complete().model_validate(self.model_extra)
        try:
            return {
                controller.name: built(getattr(keys, table), controller.settings)
                for table, controller in _hosted_controllers().items()
                if table in self.model_extra
            }
        except InputError as error:
            raise ValueError(in_file_words(str(error), keys)) from None

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
        equipment = built(self, Onboard, belief=Belief(**believed), hosted=self.hosted())
        return replace(equipment, sensors=replace(equipment.sensors, seed=seed))
