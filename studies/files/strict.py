"""Checked records read from files: frozen, no unknown keys, and errors of one line that name the key."""

import ast
import re
import tomllib
import warnings
from collections.abc import Iterator, Mapping
from itertools import islice
from typing import Any, ClassVar, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, ValidationError, ValidationInfo, field_validator

from alloc.units import Unit, unit_of
from studies.files.json_schema import describe, meaning_of
from studies.files.limits import DEEPEST, small_text
from studies.files.study_error import FileWarning, StudyError, nearest
from studies.files.units import is_number, range_fault, shown

PART = r"""(?:[\w-]++|"[^"\n]*+"|'[^'\n]*+')"""
DEEP_KEY = re.compile(rf"""(?<![\w"'-])(?:{PART}[ \t]*+\.[ \t]*+){{{DEEPEST}}}""")
"""A key of more parts than tables are nested; sentences and numbers of a text do not look like it."""

MOST_UNKNOWN = 20
"""Unknown keys that are named one by one."""


def _leaves(value: Any) -> Iterator[Any]:
    """What stands in a list, and in lists in it; the value itself if it is no list."""
    for part in value if isinstance(value, list) else ():
        yield from _leaves(part)
    if not isinstance(value, list):
        yield value


class _Plain(BaseModel):
    """A frozen record whose numbers are numbers."""

    model_config = ConfigDict(frozen=True, allow_inf_nan=False)

    @field_validator("*", mode="before")
    @classmethod
    def _no_disguise(cls, value: Any, info: ValidationInfo) -> Any:
        """Refuse a number in quotes, true for a number, and a word or a number for true; the library would convert them."""
        stated = str(cls.model_fields[str(info.field_name)].annotation)
        only_bool = "bool" in stated and not any(kind in stated for kind in ("int", "float", "str"))
        for part in _leaves(value):
            if only_bool and not isinstance(part, bool | None):
                raise ValueError(f"must be true or false, not {shown(part)}")
            if (isinstance(part, bool) and "bool" not in stated) or (
                isinstance(part, str) and "str" not in stated and is_number(part)
            ):
                raise ValueError(f"must be a number without quotes, not {part!r}")
        return value


class Strict(_Plain):
    """A frozen record; a key that it does not know is an error.

    `record`: parameters that the keys feed. A key's name without its unit is that of a field there, which says its meaning.
    """

    model_config = ConfigDict(extra="forbid", str_strip_whitespace=True)

    record: ClassVar[Any] = None
    fields_of_keys: ClassVar[Mapping[str, str]] = {}
    """Fields of the record whose keys have another name, by key, so that errors name the key."""

    @field_validator("*")
    @classmethod
    def _of_a_railway(cls, value: Any, info: ValidationInfo) -> Any:
        fault = range_fault(str(info.field_name), value)
        if fault is not None:
            raise ValueError(fault)
        return value

    @classmethod
    def __get_pydantic_json_schema__(cls, core: Any, handler: Any) -> dict[str, Any]:
        schema: dict[str, Any] = handler(core)
        describe(handler.resolve_ref_schema(schema), cls, cls.record)
        return schema

    @classmethod
    def complete(cls) -> type[BaseModel]:
        """The record with all its keys; one to which parts bring keys of their own has more than its class says."""
        return cls


class Foreign(_Plain):
    """A frozen record of somebody else's format: keys that this project does not use are passed over.

    `unused`: those that the format knows beyond them. `warn_of_unknown` speaks of all others.
    """

    model_config = ConfigDict(extra="ignore")

    unused: ClassVar[frozenset[str]] = frozenset()


def read_toml(path: str, what: str, hint: str) -> dict[str, Any]:
    """Content of a TOML file; raises `StudyError` naming `what` kind of file it is, and `hint` where it does not exist."""
    text = small_text(path, what, hint)
    if DEEP_KEY.search(text):  # the library would take hours
        raise StudyError(f"{what} file {path!r}: tables are nested more than {DEEPEST} deep")
    try:
        return tomllib.loads(text)
    except (ValueError, RecursionError) as error:  # numbers of too many digits, lists too deep
        raise StudyError(f"{what} file {path!r} is not TOML: {error}") from None


Record = TypeVar("Record", bound=BaseModel)


def parse(kind: type[Record], data: Any, source: str) -> Record:
    """Check `data` against `kind`; raises `StudyError` with `source`, the first faulty key and the reason."""
    try:
        return kind.model_validate(data)
    except ValidationError as error:
        hint = _misspelling(kind, data) if issubclass(kind, Foreign) else ""
        raise StudyError(f"{source}: {explain(kind, error)}{hint}") from None


def warn_of_unknown(kind: type[Foreign], data: Any, source: str) -> None:
    """Warn of each key in `data` that the format of `kind` does not know, once, with its first place and the nearest key."""
    told: dict[tuple[type[Foreign], str], list[str]] = {}
    for record, key, place in _unknown(kind, data, ()):
        told.setdefault((record, key), []).append(_dotted(place))
    if len(told) > MOST_UNKNOWN:
        warnings.warn(
            f"{source}: {len(told)} keys are unknown and passed over; the first {MOST_UNKNOWN} of them follow",
            FileWarning,
            stacklevel=2,
        )
    for (record, key), places in islice(told.items(), MOST_UNKNOWN):
        valid = [*record.model_fields, *sorted(record.unused)]
        near = nearest(key, valid)
        hint = f"did you mean {near!r}?" if near else f"known keys: {', '.join(valid)}"
        more = f" and {len(places) - 1} more like it" if len(places) > 1 else ""
        warnings.warn(
            f"{source}: key {places[0]!r}{more} is unknown and passed over; {hint}",
            FileWarning,
            stacklevel=2,
        )


def _misspelling(kind: type[Foreign], data: Any) -> str:
    """The first key that the format does not know but nearly, which may be why something is missing."""
    for record, key, place in _unknown(kind, data, ()):
        if near := nearest(key, record.model_fields):
            return f" (there is an unknown key {_dotted(place)!r}; did you mean {near!r}?)"
    return ""


def _unknown(
    kind: type[Foreign], data: Any, place: tuple[int | str, ...]
) -> Iterator[tuple[type[Foreign], str, tuple[int | str, ...]]]:
    """Record, key and place of every key below `data` that is neither a field nor known to be unused."""
    for k, item in enumerate(data if isinstance(data, list) else ()):
        yield from _unknown(kind, item, (*place, k))
    for key, value in data.items() if isinstance(data, Mapping) else ():
        name = str(key)
        if name in kind.model_fields:
            inner = _record_in(kind.model_fields[name].annotation)
            if inner is not None and issubclass(inner, Foreign):
                yield from _unknown(inner, value, (*place, name))
        elif name not in kind.unused:
            yield kind, name, (*place, name)


def explain(kind: type[BaseModel], error: ValidationError) -> str:
    """One line for the first fault of `error`: misspelt keys first, with the nearest valid key."""
    faults = error.errors(include_url=False)
    misspelt = [f for f in faults if f["type"] == "extra_forbidden"]
    fault = (misspelt or faults)[0]
    place = tuple(fault["loc"])
    key = _dotted(place)
    if fault["type"] == "extra_forbidden":
        valid = list(_model_at(kind, place[:-1]).model_fields)
        near = nearest(str(place[-1]), valid)
        return f"unknown key {key!r}; " + (
            f"did you mean {near!r}?" if near else f"valid keys: {', '.join(valid)}"
        )
    missing = [_dotted(tuple(one["loc"])) for one in faults if one["type"] == "missing"]
    if fault["type"] == "missing" and len(missing) > 1:
        return f"keys {', '.join(map(repr, missing))} are missing"
    if fault["type"] == "missing":
        inside = _model_at(kind, place[:-1])
        told = meaning_of(str(place[-1]), inside, getattr(inside, "record", None))
        return f"key {key!r} is missing" + (f": {told.text}" if told else "")
    reason = fault["msg"].removeprefix("Value error, ")
    reason = reason[0].lower() + reason[1:]
    if not place:
        return reason
    given = fault.get("input")
    if fault["type"] == "tuple_type" and isinstance(given, Mapping):
        return f"key {key!r}: there may be several such tables; write [[{key}]], not [{key}]"
    if fault["type"] == "tuple_type":
        return f"key {key!r} = {shown(given)}: must be a list, in brackets"
    value = "" if isinstance(given, Mapping | list | BaseModel) else f" = {shown(given)}"
    return f"key {key!r}{value}: {reason}"


def _dotted(place: tuple[int | str, ...]) -> str:
    text = ""
    for part in place:
        if isinstance(part, int):
            text += f"[{part + 1}]"
        else:
            text += f".{part}" if text else part
    return text


def _model_at(kind: type[BaseModel], place: tuple[int | str, ...]) -> type[BaseModel]:
    """The record type found by following field names (and list positions) from `kind`."""
    for part in place:
        if isinstance(part, str) and part in kind.model_fields:
            kind = _record_in(kind.model_fields[part].annotation) or kind
            kind = kind.complete() if issubclass(kind, Strict) else kind
    return kind


def _record_in(annotation: Any) -> type[BaseModel] | None:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        return annotation
    for argument in getattr(annotation, "__args__", ()):
        found = _record_in(argument)
        if found is not None:
            return found
    return None


# Messages about parameter records in the words of a file: its keys, and its units, in place of fields and SI values.

STATED = re.compile(r"((?:\w+\.)*\w+)(\[\d+\])? = (\([^)]*\)|-?[\w.+-]+)")
"""A field and its value, as errors of records state them; `part.field` for a field of a record inside."""
NEAR = 1e-9
"""Share of a value by which conversion to SI may move it."""


def in_file_words(message: str, keys: BaseModel) -> str:
    """`message` with the keys of a file, and the values as they stand there, for fields of the records made of `keys`.

    A field is found by its name without the unit and by its value. Where several keys fit, or none does, the words stay;
    a field beside one that was found is one of the same table, also where the file leaves it out.
    """
    table: list[tuple[str, BaseModel]] = []

    def replaced(found: re.Match[str]) -> str:
        field, _, text = found.groups()
        value = _value(text)
        if value is None:
            return found.group()
        places = [*_places(keys, "", field, value)]
        if len(places) == 1:
            (path, key, k, given, record) = places[0]
            table.append((path, record))
            number = f"[{k + 1}]" if k is not None else ""
            shown = given if k is None else given[k]
            return f"{_joined(path, key)}{number} = {_plain(shown)!r}"
        if isinstance(value, float | int):
            for path, record in table:
                for key, unit in _keys_of(type(record), field):
                    return f"{_joined(path, key)} = {value / unit.factor:.6g}"
        return found.group()

    STATED.sub(replaced, message)  # the field that was given may stand behind one that was not
    told = STATED.sub(replaced, message)
    _, parted, rest = told.partition(": ")
    # the path of the key says whose it is
    return rest if parted and table and rest.startswith(_joined(table[0][0], "")) else told


def _places(
    keys: BaseModel, path: str, field: str, value: Any
) -> Iterator[tuple[str, str, int | None, Any, BaseModel]]:
    """Every key below `keys` that stands for `field` and has this SI value.

    Yields the table's path, the key within it, the place in a list, the value in the file, and the table's record.
    """
    for key, unit in _keys_of(type(keys), field):
        given = _at(keys, key)
        if _same(given, value, unit):
            yield path, key, None, given, keys
        elif isinstance(given, tuple):
            places = [k for k, one in enumerate(given) if _same(one, value, unit)]
            yield from ((path, key, k, given, keys) for k in places[:1])
    for key in type(keys).model_fields:
        given = getattr(keys, key)
        inside = _joined(path, key)
        if isinstance(given, BaseModel):
            yield from _places(given, inside, field, value)
        elif isinstance(given, tuple):
            for k, one in enumerate(given):
                if isinstance(one, BaseModel):
                    yield from _places(one, f"{inside}[{k + 1}]", field, value)
        elif isinstance(given, dict):
            for name, one in given.items():
                if isinstance(one, BaseModel):
                    yield from _places(one, _joined(inside, name), field, value)


def _keys_of(table: type[BaseModel], field: str) -> Iterator[tuple[str, Unit]]:
    """Keys of a table that stand for `field`, which may name tables inside it, each with its unit.

    A key stands for the field of its name without the unit, and for that which its table says.
    """
    part, dotted, name = field.partition(".")
    if dotted:
        inner = _table_in(table, part)
        yield from (
            (_joined(part, key), unit) for key, unit in (_keys_of(inner, name) if inner else ())
        )
        return
    others = getattr(table, "fields_of_keys", {})
    for key in table.model_fields:
        unit = unit_of(key)
        bare = key.removesuffix(unit.ending) if unit.ending else key
        if field in (bare, others.get(key, key)):
            yield key, unit


def _table_in(table: type[BaseModel], key: str) -> type[BaseModel] | None:
    """The table that a key holds, also one that may be left out; None for any other key."""
    stated = table.model_fields[key].annotation if key in table.model_fields else None
    for kind in (stated, *get_args(stated)):
        if isinstance(kind, type) and issubclass(kind, BaseModel):
            return kind
    return None


def _at(keys: BaseModel, key: str) -> Any:
    """What a file gives for a key, or for one of a table inside; None where the table is left out."""
    found: Any = keys
    for part in key.split("."):
        found = getattr(found, part, None)
    return found


def _same(given: Any, value: Any, unit: Unit) -> bool:
    """Whether a value of a file is this SI value."""
    if isinstance(given, tuple) and isinstance(value, tuple):
        return len(given) == len(value) and all(
            _same(a, b, unit) for a, b in zip(given, value, strict=True)
        )
    if isinstance(given, bool) or not isinstance(given, float | int):
        return False
    if isinstance(value, bool) or not isinstance(value, float | int):
        return False
    return abs(given * unit.factor - value) <= NEAR * abs(value)


def _value(text: str) -> Any:
    """The number, or the numbers, that a message states; None for anything else."""
    try:
        return ast.literal_eval(text.rstrip("."))
    except (ValueError, SyntaxError):
        return None


def _plain(value: Any) -> Any:
    """A value as a file states it: several in a list."""
    return list(value) if isinstance(value, tuple) else value


def _joined(path: str, key: str) -> str:
    return f"{path}.{key}" if path else key
