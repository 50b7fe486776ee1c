"""Tables of TOML files as checked keys: a key is a name and its unit, and a fault is one line that names the key.

In: a file, and records of `alloc`, which state units, meanings and defaults once. Out: frozen tables (pydantic), the records
that they describe in SI units, and a JSON schema for editors.
"""

import json
import math
import re
import tomllib
from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import MISSING, fields, is_dataclass
from difflib import get_close_matches
from functools import cache
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, field_validator

from alloc.schema import units
from alloc.schema.errors import InputError
from alloc.schema.parameters import ANY, Meaning, meanings
from alloc.schema.units import UNITS, unit_of
from studies import StudyError

Schema = dict[str, Any]
Table = TypeVar("Table", bound="Keys")


def _describe(schema: Schema, kind: Any) -> None:
    """Complete a table's schema: meanings, units and defaults of its keys; no null, which TOML does not have."""
    stated = {one.name: one.default for one in fields(kind.record)} if kind.record else {}
    table = schema.get("properties", {})
    names = {kind.field_of(key): key for key in reversed(table)}
    for key, said in table.items():
        unit, default, own = unit_of(key), stated.get(kind.field_of(key)), said.pop("default", None)
        if isinstance(default, float) and math.isfinite(default):
            default = float(f"{default / unit.factor:.6g}")
        for one in (own, default):
            if isinstance(one, bool | int | str) or (isinstance(one, float) and math.isfinite(one)):
                said["default"] = one
        choices = [one for one in said.pop("anyOf", ()) if one != {"type": "null"}]
        said |= choices[0] if len(choices) == 1 else {"anyOf": choices} if choices else {}
        meaning = kind.meaning_of(key).with_names(names)
        words = [meaning.text, f"Unit: {unit.symbol}." if unit.ending else ""]
        words += [f"Left out: {meaning.left_out}" if meaning.left_out else ""]
        said["description"] = " ".join(filter(None, words))
        said.pop("title", None)


class Keys(BaseModel):
    """A table of a file: frozen, and without a key that it does not know. JSON's strict mode takes no number in quotes."""

    model_config = ConfigDict(
        frozen=True, strict=True, extra="forbid", allow_inf_nan=False, json_schema_extra=_describe
    )

    record: ClassVar[Any] = None
    """The record that the keys feed, where there is one."""
    renamed: ClassVar[Mapping[str, str]] = {}
    """Fields of the record by their keys without unit, where these have another name."""

    @field_validator("*")
    @classmethod
    def _of_a_railway(cls, value: Any, info: Any) -> Any:
        if fault := range_fault(info.field_name, value):
            raise ValueError(fault)
        return value

    @classmethod
    def field_of(cls, key: str) -> str:
        """Field of the record that a key feeds."""
        name = key.removesuffix(unit_of(key).ending)
        return cls.renamed.get(name, name)

    @classmethod
    def meaning_of(cls, key: str) -> Meaning:
        """What is said of a key, in its class or in the record."""
        stated = meanings(cls.record).get(cls.field_of(key)) if cls.record else None
        return meanings(cls).get(key) or stated or Meaning()

    def si(self) -> dict[str, Any]:
        """Values that were given, in SI units by the fields of the record; tables stay out."""
        given = units.si({key: one for key, one in self if not _tables(one)})
        return {self.renamed.get(name, name): one for name, one in given.items()}


def range_fault(key: str, value: Any) -> str | None:
    """What is wrong with a number, or one of several, whose size no railway knows; None if nothing is."""
    unit = unit_of(key)
    for number in value if isinstance(value, tuple) else (value,):
        size = abs(number) if isinstance(number, float | int) else 0.0
        if size and not unit.least <= size <= unit.most:
            low = size < unit.least
            bound = f"0, or at least {unit.least:g}" if low else f"at most {unit.most:g}"
            return f"must be {bound} in size"
    return None


def _tables(value: Any) -> tuple[Any, ...]:
    """The tables that a key holds: one, several, or none."""
    several = value if isinstance(value, tuple) else (value,)
    return several if all(isinstance(one, Keys) for one in several) else ()


# tables of records


@cache
def keys_of(record: Any, *names: str) -> Any:
    """The table of a frozen dataclass: its fields that state a unit, and records in it as tables of their own.

    `names`: those that files may set, such as "reference.source"; none: all of them. What has a default in the record may be
    left out of a file.
    """
    found: dict[str, Any] = {}
    for item in fields(record):
        inner, unit = _record_in(item.type), item.metadata.get("unit", "")
        own = [one for one in names if one.partition(".")[0] == item.name]
        if unit is None or (names and not own) or (inner and not fields(inner)):
            continue
        if inner:
            table: Any = keys_of(inner, *filter(None, (one.partition(".")[2] for one in own)))
            several: Any = Annotated[tuple.__class_getitem__((table, ...)), Field(max_length=1000)]
            if item.type is inner:
                found[item.name] = (table, table())
            elif item.type == inner | None:
                found[item.name] = (table | None, None)
            else:
                found[item.name] = (several, ())
            continue
        stated: Any = item.type
        of_file = next(one for one in UNITS if one.symbol == (unit or "1"))
        limits, bounds = {}, item.metadata.get("bounds", ANY)
        if stated in (float, float | None):
            low = ("gt", bounds.above) if bounds.above > -math.inf else ("ge", bounds.least)
            limits = {name: one / of_file.factor for name, one in (low, ("le", bounds.most))
                      if math.isfinite(one)}  # fmt: skip
        required = item.default is MISSING
        bound = Field(... if required else None, **limits)
        found[item.name + of_file.ending] = (stated if required else stated | None, bound)
    about = (record.__doc__ or "").partition("\n")[0]
    made: Any = create_model(f"{record.__name__}Keys", __base__=Keys, __doc__=about, **found)
    made.record = record
    return made


def _record_in(kind: Any) -> Any:
    """The dataclass that a field holds, one, several or none of; None if it holds none."""
    found = get_args(kind)[0] if get_args(kind) else kind
    return found if is_dataclass(found) else None


def built(keys: Any, path: str, **given: Any) -> Any:
    """The record of a table at `path` of the file; fields that no file says are `given`. Raises `StudyError`."""
    values = keys.si()
    for key, value in keys:
        made = [built(one, f"{joined(path, key)}[{k}]" if isinstance(value, tuple) else joined(path, key))
                for k, one in enumerate(_tables(value), 1) if one.record]  # fmt: skip
        if made:
            values[key] = tuple(made) if isinstance(value, tuple) else made[0]
    with in_words_of(keys, path):
        return keys.record(**values | given)


# faults that records find, told with the keys and the values of the file

STATED = re.compile(r"(?<![\w.])((?:\w+\.)*\w+) = (\([^)]*\)|'[^']*'|[^\s,;]+)")
"""A field, perhaps of a record within, and its value, as messages of records state them."""


@contextmanager
def in_words_of(keys: Keys, path: str = "") -> Iterator[None]:
    """Raise `StudyError` for a fault that a record finds, in the words of the table at `path` from which it is made."""
    try:
        yield
    except StudyError:
        raise
    except InputError as error:
        said = error.fault or str(error)
        told = STATED.sub(lambda found: _in_words_of(keys, *found.groups()), said)
        raise StudyError(f"{path}: {told}" if path else told) from None


def _in_words_of(keys: Any, field: str, value: str) -> str:
    """A statement about a field as one about its key; as it is where the table has no such key."""
    *tables, name = field.split(".")
    for one in tables:
        keys = getattr(keys, one, None) or keys
    own = {key: getattr(keys, key) for key in (*type(keys).model_fields, *(keys.model_extra or ()))
           if keys.field_of(key) == name}  # fmt: skip
    for key, given in sorted(own.items(), key=lambda one: one[1] is None):  # what a file says first
        if given is None and value[0].isdigit():  # the record's default
            given = float(f"{float(value) / unit_of(key).factor:.6g}")
        shown = value if given is None else repr(list(given) if isinstance(given, tuple) else given)
        return f"{'.'.join((*tables, key))} = {shown}"
    return f"{field} = {value}"


def joined(path: str, key: str) -> str:
    """Path of a key in the table at `path`."""
    return f"{path}.{key}" if path else key


@contextmanager
def told_of(source: object) -> Iterator[None]:
    """Raise each `StudyError` with its `source` before it."""
    try:
        yield
    except StudyError as error:
        raise StudyError(f"{source}: {error}") from None


# files


def read_toml(path: str | Path) -> dict[str, Any]:
    """Unchecked keys of a file; raises `StudyError` with the reason why there are none."""
    if not Path(path).is_file():  # a pipe or a device might never end
        there = Path(path).exists()
        raise StudyError("this is no regular file" if there else "there is no such file")
    try:
        return tomllib.loads(Path(path).read_text("utf-8-sig"))
    except OSError as error:
        raise StudyError(f"cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise StudyError(f"this is not TOML: {error}") from None


def checked(kind: type[Table], data: Mapping[str, Any], path: str = "") -> Table:
    """`data` as a table at `path` of its file; raises `StudyError` with the first fault."""
    try:
        return kind.model_validate_json(json.dumps(data, default=_plain))
    except ValidationError as error:
        raise StudyError(_explain(error, kind, data, path)) from None


def _plain(value: Any) -> Any:
    """What JSON does not know: a table, a number of NumPy; a date, which no key is, as its text."""
    if isinstance(value, BaseModel):
        return value.model_dump(exclude_unset=True)
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _explain(error: ValidationError, kind: Any, given: Any, path: str) -> str:
    """The first fault in a line, misspelt keys before others."""
    faults = error.errors(include_url=False)
    fault = next((one for one in faults if one["type"] == "extra_forbidden"), faults[0])
    if isinstance(told := fault.get("ctx", {}).get("error"), StudyError):
        return str(told)
    if fault["type"] == "json_invalid":  # what TOML gave was JSON, but for this
        return "tables are nested too deeply"
    table, name, last = kind, "", len(fault["loc"]) - 1
    for k, part in enumerate(fault["loc"]):
        known = (
            given
            if isinstance(given, Mapping)
            else range(len(given))
            if isinstance(given, list | tuple)
            else ()
        )
        if part not in known and (k < last or fault["type"] != "missing"):
            continue  # it names one of several types
        path = f"{path}[{part + 1}]" if isinstance(part, int) else joined(path, part)
        given = given[part] if part in known else None
        if isinstance(part, str):
            stated = kind.model_fields.get(part)
            table, name, kind = kind, part, (stated and _table_in(stated.annotation)) or kind
    meaning = table.meaning_of(name).text
    if fault["type"] == "missing":
        return f"key {path!r} is missing: {meaning}".removesuffix(": ")
    if fault["type"] == "extra_forbidden":
        return f"unknown key {path!r}{near(name, table.model_fields)}"
    own = {
        "tuple_type": f"must be a list; of tables, [[{path}]] each",
        "string_pattern_mismatch": f"must be: {meaning}",
        "bool_type": "must be true or false",
        "model_type": "must be a table",
    }
    said = re.sub("^(Input|Tuple) should", "must", fault["msg"].removeprefix("Value error, "))
    reason = own.get(fault["type"], said.replace(" after validation", ""))
    shown = "" if isinstance(given, Mapping | list | tuple) else f" = {given!r:.60}"
    return f"key {path!r}{shown}: {reason[0].lower()}{reason[1:]}" if path else reason


def _table_in(kind: Any) -> type[Keys] | None:
    """The table that a type names, or that stands in it; None if there is none."""
    if isinstance(kind, type) and issubclass(kind, Keys):
        return kind
    return next((found for one in get_args(kind) if (found := _table_in(one))), None)


def near(name: str, known: Iterable[str]) -> str:
    """The end of a message about an unknown name: the nearest known one, or all of them."""
    lowered = {one.lower(): one for one in known}
    if found := get_close_matches(name.lower(), lowered, 1):
        return f"; did you mean {lowered[found[0]]!r}?"
    return f"; known: {', '.join(lowered.values())}"
