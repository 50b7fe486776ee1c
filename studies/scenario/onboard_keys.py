"""Keys of a scenario file on the equipment on board, and on what the train believes."""

from collections.abc import Mapping
from contextlib import suppress
from dataclasses import MISSING, fields, is_dataclass, replace
from dataclasses import Field as RecordField
from functools import cache, partial
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, ConfigDict, Field, create_model, model_validator

from alloc.errors import InputError
from alloc.onboard.host import CONTROLLERS, HostedController
from alloc.onboard.parameters import Belief, Onboard
from alloc.plant.adhesion import AdhesionCurve
from studies.files.strict import Strict, in_file_words
from studies.files.units import si, unit_called
from studies.scenario.rail_keys import CurveKeys, Increment, IncrementKeys

# Keys of a file from a record of parameters: the record says names, units and defaults, and nothing is said twice.

Parameters = TypeVar("Parameters")


class _Keys(Strict):
    """Keys of a record. They travel to other processes by it, for their class has no name in a module."""

    def __reduce__(self) -> Any:
        kind: Any = type(self)
        return _blank, (self.record if keys_of(self.record) is kind else kind,), self.__getstate__()


def _blank(kind: Any) -> Any:
    model = kind if issubclass(kind, _Keys) else keys_of(kind)
    return model.__new__(model)


@cache
def keys_of(record: type) -> Any:
    """Model of the keys that give a frozen dataclass; a key is the field's name and its unit's ending.

    Everything may be left out that has a default in `record`. Records in fields become tables. Raises `TypeError` for a
    number whose field states no unit, see `alloc.records`.
    """
    keys: Any = dict(_key(item) for item in fields(record) if _in_files(item))
    summary = (record.__doc__ or "").strip().splitlines()[0]
    model = create_model(f"{record.__name__}Keys", __base__=_Keys, __doc__=summary, **keys)
    model.record = record
    return model


def built(keys: BaseModel, record: type[Parameters], **given: Any) -> Parameters:
    """The record that `keys` describe in SI units; fields that no file says are `given`."""
    values = si(keys)
    for item in fields(record):  # type: ignore[arg-type]
        inner, value = _record_in(item.type), getattr(keys, item.name, None)
        if inner is None or value is None:
            continue
        several = isinstance(value, tuple)
        parts = [built(part, inner) for part in (value if several else (value,))]
        values[item.name] = tuple(parts) if several else parts[0]
    return record(**values | given)


def _in_files(item: RecordField[Any]) -> bool:
    inner = _record_in(item.type)
    return item.metadata.get("unit", "") is not None and (inner is None or bool(fields(inner)))


def _record_in(kind: Any) -> Any:
    """The dataclass that a field holds, one or several of; None if it holds none."""
    found = get_args(kind)[0] if get_origin(kind) is tuple else kind
    return found if is_dataclass(found) else None


def _key(item: RecordField[Any]) -> tuple[str, tuple[Any, Any]]:
    """Name of a field's key; its type and default."""
    inner = _record_in(item.type)
    if inner is not None:
        table = keys_of(inner)
        several: Any = Annotated[tuple.__class_getitem__((table, ...)), Field(max_length=1000)]
        return item.name, (table, table()) if inner is item.type else (several, ())
    stated: Any = item.type
    unit = item.metadata.get("unit")
    if unit is None and float in (stated, *get_args(stated)):
        raise TypeError(f"{item.name}: a number that a file gives needs a unit")
    kind: Any = stated if item.default is MISSING else stated | None
    if (most := item.metadata.get("most")) is not None:
        kind = Annotated[kind, Field(le=most)]
    if names := item.metadata.get("names"):
        given: Any = Literal.__getitem__(tuple(names)) | kind
        kind = Annotated[
            kind, BeforeValidator(partial(_named, names), json_schema_input_type=given)
        ]
    return item.name + unit_called(unit or "1").ending, (
        kind,
        ... if item.default is MISSING else None,
    )


def _named(names: Mapping[str, float], value: object) -> object:
    """The number that `value` names, or `value` itself."""
    if not isinstance(value, str):
        return value
    if value not in names:
        raise ValueError(f"must be {', '.join(map(repr, names))} or a number")
    return names[value]


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
