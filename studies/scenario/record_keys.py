"""Keys of a file from a record of parameters: the record says names, units and defaults, and nothing is said twice."""

from collections.abc import Mapping
from dataclasses import MISSING, fields, is_dataclass
from dataclasses import Field as RecordField
from functools import cache, partial
from typing import Annotated, Any, Literal, TypeVar, get_args, get_origin

from pydantic import BaseModel, BeforeValidator, Field, create_model

from studies.files.strict import Strict
from studies.files.units import si, unit_called

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
