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
from functools import cache, partial
from pathlib import Path
from typing import Annotated, Any, ClassVar, TypeVar, get_args

from pydantic import BaseModel, ConfigDict, Field, ValidationError, create_model, field_validator

from alloc.schema import units
from alloc.schema.errors import InputError
from alloc.schema.parameters import ANY, Meaning, meanings
from alloc.schema.units import UNITS, unit_of_key
from studies import StudyError

Schema = dict[str, Any]
Table = TypeVar("Table", bound="Keys")


def _fill_schema(schema: Schema, table: Any) -> None:
    """Complete a table's schema: meanings, units and defaults of its keys; no null, which TOML does not have."""
    record = fields(table.record) if table.record else ()
    defaults = {field.name: field.default for field in record}
    properties = schema.get("properties", {})
    names = {table.field_of(key): key for key in reversed(properties)}
    for key, entry in properties.items():
        unit, default = unit_of_key(key), defaults.get(table.field_of(key))
        if isinstance(default, float) and math.isfinite(default):
            default = float(f"{default / unit.factor:.6g}")
        for value in (entry.pop("default", None), default):
            is_finite = isinstance(value, float) and math.isfinite(value)
            if is_finite or isinstance(value, bool | int | str):
                entry["default"] = value
        choices = [choice for choice in entry.pop("anyOf", ()) if choice != {"type": "null"}]
        entry |= choices[0] if len(choices) == 1 else {"anyOf": choices} if choices else {}
        meaning = table.meaning_of(key).with_names(names)
        sentences = [meaning.text, f"Unit: {unit.symbol}." if unit.ending else ""]
        sentences += [f"Left out: {meaning.left_out}" if meaning.left_out else ""]
        entry["description"] = " ".join(filter(None, sentences))
        entry.pop("title", None)


class Keys(BaseModel):
    """A table of a file: frozen, and without a key that it does not know. JSON's strict mode takes no number in quotes."""

    model_config = ConfigDict(
        frozen=True,
        strict=True,
        defer_build=True,
        extra="forbid",
        allow_inf_nan=False,
        json_schema_extra=_fill_schema,
    )

    record: ClassVar[Any] = None
    """The record that the keys feed, where there is one."""
    renamed: ClassVar[Mapping[str, str]] = {}
    """Fields of the record by their keys without unit, where these have another name."""

    @field_validator("*")
    @classmethod
    def _check_range(cls, value: Any, info: Any) -> Any:
        if fault := find_range_fault(info.field_name, value):
            raise ValueError(fault)
        return value

    @classmethod
    def field_of(cls, key: str) -> str:
        """Field of the record that a key feeds."""
        name = key.removesuffix(unit_of_key(key).ending)
        return cls.renamed.get(name, name)

    @classmethod
    def meaning_of(cls, key: str) -> Meaning:
        """What is said of a key, in its class or in the record."""
        of_field = meanings(cls.record).get(cls.field_of(key)) if cls.record else None
        return meanings(cls).get(key) or of_field or Meaning()

    def si_values(self) -> dict[str, Any]:
        """Values that a file states, in SI units by the fields of the record; tables stay out."""
        values = units.to_si({key: value for key, value in self if not _list_tables(value)})
        return {self.renamed.get(name, name): value for name, value in values.items()}


def find_range_fault(key: str, value: Any) -> str | None:
    """What is wrong with a number, or one of several, whose size no railway knows; None if nothing is."""
    unit = unit_of_key(key)
    for number in value if isinstance(value, tuple) else (value,):
        size = abs(number) if isinstance(number, float | int) else 0.0
        if size and not unit.least <= size <= unit.most:
            low = size < unit.least
            bound = f"0, or at least {unit.least:g}" if low else f"at most {unit.most:g}"
            return f"must be {bound} in size"
    return None


def _list_tables(value: Any) -> tuple[Any, ...]:
    """The tables that a key holds: one, several, or none."""
    entries = value if isinstance(value, tuple) else (value,)
    return entries if all(isinstance(entry, Keys) for entry in entries) else ()


# tables of records


@cache
def make_table(record: Any, *names: str) -> Any:
    """The table of a frozen dataclass: its fields that state a unit, and records in it as tables below.

    `names`: those that files may set, such as "reference.source"; none: all of them. What has a default in the record may be
    left out of a file.
    """
    keys: dict[str, Any] = {}
    for item in fields(record):
        inner, unit = _find_record(item.type), item.metadata.get("unit", "")
        below = [name for name in names if name.partition(".")[0] == item.name]
        if unit is None or (names and not below) or (inner and not fields(inner)):
            continue
        if inner:
            table: Any = make_table(
                inner, *filter(None, (name.partition(".")[2] for name in below))
            )
            row: Any = Annotated[tuple.__class_getitem__((table, ...)), Field(max_length=1000)]
            if item.type is inner:
                keys[item.name] = (table, table())
            elif item.type == inner | None:
                keys[item.name] = (table | None, None)
            else:
                keys[item.name] = (row, ())
            continue
        kind: Any = item.type
        unit_of_file = next(entry for entry in UNITS if entry.symbol == (unit or "1"))
        limits, bounds = {}, item.metadata.get("bounds", ANY)
        if kind in (float, float | None):
            low = ("gt", bounds.above) if bounds.above > -math.inf else ("ge", bounds.least)
            for name, bound in (low, ("le", bounds.most)):
                if math.isfinite(bound):
                    limits[name] = bound / unit_of_file.factor
        required = item.default is MISSING
        limited = Field(... if required else None, **limits)
        keys[item.name + unit_of_file.ending] = (kind if required else kind | None, limited)
    summary = (record.__doc__ or "").partition("\n")[0]
    table = create_model(f"{record.__name__}Keys", __base__=Keys, __doc__=summary, **keys)
    table.record = record
    return table


def _find_record(kind: Any) -> Any:
    """The dataclass that a field holds, one, several or none of; None if it holds none."""
    held = get_args(kind)[0] if get_args(kind) else kind
    return held if is_dataclass(held) else None


def build_record(table: Any, path: str, **values: Any) -> Any:
    """The record of a table at `path` of the file, with `values` of fields that no file states. Raises `StudyError`."""
    fields_of_file = table.si_values()
    for key, value in table:
        place = join_path(path, key)
        if isinstance(value, tuple):
            rows = enumerate(_list_tables(value), 1)
            records = [build_record(row, f"{place}[{k}]") for k, row in rows if row.record]
            if records:
                fields_of_file[key] = tuple(records)
        elif isinstance(value, Keys) and value.record:
            fields_of_file[key] = build_record(value, place)
    with name_keys(table, path):
        return table.record(**fields_of_file | values)


# faults that records find, worded with the keys and the values of the file


@contextmanager
def name_keys(table: Keys, path: str = "") -> Iterator[None]:
    """Raise `StudyError` for a fault that a record finds, in the keys of the table at `path` from which it is made."""
    try:
        yield
    except StudyError:
        raise
    except InputError as error:
        reason = error.fault.word_reason(partial(_state_key, table)) if error.fault else str(error)
        raise StudyError(f"{path}: {reason}" if path else reason) from None


def _state_key(table: Any, field: str, value: Any) -> str:
    """A field and its value as the key that feeds it, in the file's unit; as they are where the table has no such key."""
    *path, name = field.split(".")
    for part in path:
        table = getattr(table, part, None) or table
    keys = [*type(table).model_fields, *(table.model_extra or ())]
    feeding = [key for key in keys if table.field_of(key) == name]
    for key in sorted(feeding, key=lambda key: getattr(table, key) is None):  # stated keys first
        shown = getattr(table, key)
        if shown is None:  # the record's default
            is_number = isinstance(value, float)
            shown = float(f"{value / unit_of_key(key).factor:.6g}") if is_number else value
        shown = list(shown) if isinstance(shown, tuple) else shown
        return f"{'.'.join((*path, key))} = {shown!r}"
    return f"{field} = {value!r}"


def join_path(path: str, key: str) -> str:
    """Path of a key in the table at `path`."""
    return f"{path}.{key}" if path else key


@contextmanager
def name_source(source: object) -> Iterator[None]:
    """Raise each `StudyError` with its `source` before it."""
    try:
        yield
    except StudyError as error:
        raise StudyError(f"{source}: {error}") from None


# files


def read_toml(path: str | Path) -> dict[str, Any]:
    """Unchecked keys of a file; raises `StudyError` with the reason why there are none."""
    if not Path(path).is_file():  # a pipe or a device might never end
        exists = Path(path).exists()
        raise StudyError("this is no regular file" if exists else "there is no such file")
    try:
        return tomllib.loads(Path(path).read_text("utf-8-sig"))
    except OSError as error:
        raise StudyError(f"cannot be read: {error.strerror}") from None
    except (ValueError, RecursionError) as error:
        raise StudyError(f"this is not TOML: {error}") from None


def check_keys(kind: type[Table], data: Mapping[str, Any]) -> Table:
    """`data` as a table; raises `StudyError` with the first fault."""
    try:
        return kind.model_validate_json(json.dumps(data, default=_plain_value))
    except ValidationError as error:
        raise StudyError(_explain_fault(error, kind, data)) from None


def _plain_value(value: Any) -> Any:
    """What JSON does not know: a table, a number of NumPy; a date, which no key is, as its text."""
    if isinstance(value, BaseModel):
        return value.model_dump(exclude_unset=True)
    return value.tolist() if hasattr(value, "tolist") else str(value)


def _explain_fault(error: ValidationError, table: Any, value: Any) -> str:
    """The first fault in a line, misspelt keys before others."""
    faults = error.errors(include_url=False)
    fault = next((fault for fault in faults if fault["type"] == "extra_forbidden"), faults[0])
    if isinstance(cause := fault.get("ctx", {}).get("error"), StudyError):
        return str(cause)
    if fault["type"] == "json_invalid":  # what TOML gave was JSON, but for this
        return "tables are nested too deeply"
    path, name, inner, missing = "", "", table, fault["type"] == "missing"
    for k, part in enumerate(fault["loc"]):
        try:
            value = value[part]
        except (LookupError, TypeError):
            if not missing or k < len(fault["loc"]) - 1:
                continue  # it names one of several types
        path = f"{path}[{part + 1}]" if isinstance(part, int) else join_path(path, part)
        if isinstance(part, str):
            field = inner.model_fields.get(part)
            table, name, inner = inner, part, (field and _find_table(field.annotation)) or inner
    meaning = table.meaning_of(name).text
    if missing:
        return f"key {path!r} is missing: {meaning}".removesuffix(": ")
    if fault["type"] == "extra_forbidden":
        return f"unknown key {path!r}{suggest_name(name, table.model_fields)}"
    message = re.sub("^(Input|Tuple) should", "must", fault["msg"].removeprefix("Value error, "))
    reasons = {
        "tuple_type": f"must be a list; of tables, [[{path}]] each",
        "string_pattern_mismatch": f"must be: {meaning}",
        "bool_type": "must be true or false",
        "model_type": "must be a table",
    }
    reason = reasons.get(fault["type"], message.replace(" after validation", ""))
    shown = "" if isinstance(value, Mapping | list | tuple) else f" = {value!r:.60}"
    return f"key {path!r}{shown}: {reason[0].lower()}{reason[1:]}" if path else reason


def _find_table(kind: Any) -> type[Keys] | None:
    """The table that a type names, or that stands in it; None if there is none."""
    if isinstance(kind, type) and issubclass(kind, Keys):
        return kind
    return next(filter(None, map(_find_table, get_args(kind))), None)


def suggest_name(name: str, names: Iterable[str]) -> str:
    """The end of a message about an unknown name: the nearest of `names`, or all of them."""
    lowered = {candidate.lower(): candidate for candidate in names}
    if nearest := get_close_matches(name.lower(), lowered, 1):
        return f"; did you mean {lowered[nearest[0]]!r}?"
    return f"; known: {', '.join(lowered.values())}"
