"""Records: parameters that are declared once, and arrays that compiled code gets as one address.

In: dataclasses and named tuples of numbers and arrays. Out: for compiled code their addresses and types; for files and
pages the unit, meaning and source of each field.
"""

import hashlib
import re
from collections import namedtuple
from collections.abc import Mapping
from dataclasses import dataclass, field, is_dataclass, replace
from functools import cache, lru_cache
from inspect import get_annotations
from typing import Any, ClassVar, NamedTuple, TypeVar, get_args, get_origin

import numpy as np
from docstring_parser.attrdoc import AttributeDocstrings
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.typing.templates import (
    AbstractTemplate,
    AttributeTemplate,
    infer,
    infer_getattr,
    signature,
)
from numba.extending import (
    NativeValue,
    intrinsic,
    lower_builtin,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
    unbox,
)
from numba.np.numpy_support import from_dtype

# Nested records of arrays for compiled code, passed as one address.
#
# Numba passes a `NamedTuple` by value, field by field, seven numbers per array. With the hundreds of arrays of a run
# this took most of the compile time, and more time than the work of a short step. Here compiled code gets the address
# of a block with the numbers and the addresses of the arrays; it reads fields as those of the `NamedTuple`.


_WORD = ir.IntType(64)


class Field(NamedTuple):
    """A field of a record: its type, and its first word in the block."""

    kind: types.Type
    word: int


class Record(types.Type):
    """Numba's type of a record by its address; records of equal fields are of one type."""

    def __init__(self, name: str, fields: tuple[tuple[str, Field], ...]) -> None:
        self.fields = dict(fields)
        digest = hashlib.sha256(repr((name, fields)).encode()).hexdigest()[:12]
        super().__init__(name=f"{name}_{digest}")


class ByReference:
    """A `NamedTuple` of numbers, arrays and further ones, to be handed to compiled code; in Python it has their fields.

    Arrays must be contiguous; they are shared, numbers are copied. Raises `TypeError` for what is neither.
    """

    def __init__(self, value: Any) -> None:
        self._value = value
        words: list[int] = []
        self.kind = _record(_lay_out(value, words))
        self._block = np.array(words, dtype=np.uint64)
        self.address = self._block.ctypes.data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._value, name)


Kind = tuple[str, tuple[tuple[str, Any, int], ...]]
"""A record in plain values: its class, and of every field its name, what it is, and its first word."""

_NUMBERS = {
    float: (np.float64, types.float64),
    bool: (np.int64, types.boolean),
    int: (np.int64, types.int64),
}


def _lay_out(value: Any, words: list[int]) -> Kind:
    """Append the words of `value`; an array takes its address and shape, a number one word."""
    fields, start = [], len(words)
    for name, item in zip(value._fields, value, strict=True):
        word = len(words) - start
        if isinstance(item, np.ndarray):
            if not item.flags.c_contiguous:
                raise TypeError(f"{type(value).__name__}.{name}: the array is not contiguous")
            words += [item.__array_interface__["data"][0], *item.shape]
            what: Any = (item.dtype, item.ndim)
        elif hasattr(item, "_fields"):
            what = _lay_out(item._value if isinstance(item, ByReference) else item, words)
        elif item is None:
            what = None
        else:
            what = _number(f"{type(value).__name__}.{name}", item, words)
        fields.append((name, what, word))
    return type(value).__name__, tuple(fields)


def _number(name: str, item: Any, words: list[int]) -> type:
    """Append the word of a number; returns which of `_NUMBERS` it is."""
    plain = item.item() if isinstance(item, np.generic) else item
    if type(plain) not in _NUMBERS:
        raise TypeError(f"{name}: {type(item).__name__} is neither number, array nor record")
    words.append(int(_NUMBERS[type(plain)][0](plain).view(np.uint64)))
    return type(plain)


@lru_cache(maxsize=256)
def _record(kind: Kind) -> Record:
    """Numba's type of a record."""
    name, fields = kind
    return Record(name, tuple((field, Field(_type(what), word)) for field, what, word in fields))


def _type(what: Any) -> types.Type:
    if what is None:
        return types.none
    if isinstance(what, type):
        return _NUMBERS[what][1]
    if isinstance(what[0], str):
        return _record(what)
    return types.Array(from_dtype(what[0]), what[1], "C")


@register_model(Record)
class _RecordModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, _WORD.as_pointer())


@typeof_impl.register(ByReference)
def _typeof(value: ByReference, context: Any) -> Record:
    return value.kind


@unbox(Record)
def _unbox(kind: Record, value: Any, context: Any) -> NativeValue:
    address = context.pyapi.object_getattr_string(value, "address")
    number = context.pyapi.long_as_ulonglong(address)
    context.pyapi.decref(address)
    return NativeValue(context.builder.inttoptr(number, _WORD.as_pointer()))


@infer_getattr
class _Fields(AttributeTemplate):
    key = Record

    def generic_resolve(self, kind: Any, name: Any) -> Any:  # type: ignore[override]
        return kind.fields[name].kind if name in kind.fields else None


@infer
class _Items(AbstractTemplate):
    key = "static_getitem"

    def generic(self, args: Any, kws: Any) -> Any:
        kind, index = args
        if isinstance(kind, Record) and isinstance(index, int):
            return signature(list(kind.fields.values())[index].kind, *args)
        return None


@lower_builtin("static_getitem", Record, types.IntegerLiteral)
def _read_item(context: Any, builder: Any, sig: Any, args: Any) -> Any:
    block, index = args
    return _read(context, builder, sig.args[0], block, list(sig.args[0].fields)[index])


@lower_getattr_generic(Record)
def _read(context: Any, builder: Any, kind: Record, block: Any, name: str) -> Any:
    field = kind.fields[name]

    def word(k: int, of: ir.Type = _WORD) -> Any:
        place = builder.gep(block, [ir.Constant(_WORD, k)])
        value = builder.load(builder.bitcast(place, of.as_pointer()), align=8)
        # nothing writes to the block while compiled code runs
        value.set_metadata("invariant.load", builder.module.add_metadata([]))
        return value

    if isinstance(field.kind, Record):
        return builder.gep(block, [ir.Constant(_WORD, field.word)])
    if field.kind == types.none:
        return context.get_dummy_value()
    if isinstance(field.kind, types.Array):
        return _array(context, builder, field, word)
    if field.kind == types.float64:
        return word(field.word, ir.DoubleType())
    number = word(field.word)
    return builder.trunc(number, ir.IntType(1)) if field.kind == types.boolean else number


def _array(context: Any, builder: Any, field: Field, word: Any) -> Any:
    """Numba's description of an array, of its address and shape; nobody owns it."""
    kind: Any = field.kind
    array = context.make_array(kind)(context, builder)
    size = context.get_abi_sizeof(context.get_data_type(kind.dtype))
    shape = [word(field.word + 1 + k) for k in range(kind.ndim)]
    strides = [ir.Constant(_WORD, size)]
    for count in reversed(shape[1:]):
        strides.insert(0, builder.mul(strides[0], count))
    items = shape[0] if shape else ir.Constant(_WORD, 1)
    for count in shape[1:]:
        items = builder.mul(items, count)
    data = builder.inttoptr(word(field.word), context.get_data_type(kind.dtype).as_pointer())
    context.populate_array(
        array,
        data=data,
        shape=cgutils.pack_array(builder, shape),
        strides=cgutils.pack_array(builder, strides),
        itemsize=size,
        meminfo=None,
    )
    return array._getvalue()


# Compiled functions and records that are handed to compiled code as numbers: their addresses.
#
# So code that is compiled first can call what is made later, without knowing of which package it comes. Numba's own way
# to hand over a function asks Python for its address at every call, which takes as long as a simulation over the MPC's
# horizon.


def address_of(function: Any, kind: types.FunctionType) -> int:
    """Address of a compiled function, which must be kept while the address is in use."""
    made = function.get_compile_result(kind.signature)
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


def function_at(kind: types.FunctionType) -> Any:
    """Compiled function that takes an address (int64) and returns the function of `kind` stored there."""

    def at(typingctx, address):
        def generate(context, builder, signature, args):
            made = cgutils.create_struct_proxy(kind)(context, builder)
            pointer = builder.inttoptr(args[0], ir.IntType(8).as_pointer())
            made.c_addr = made.py_addr = ir.Constant(pointer.type, None)
            made.jit_addr = pointer
            return made._getvalue()

        return kind(types.int64), generate

    return intrinsic(at)


def record_at(kind: Record) -> Any:
    """Compiled function of an address (int64) that returns the record of `kind` there, see `alloc.records`."""

    def at(typingctx, address):
        def generate(context, builder, signature, args):
            return builder.inttoptr(args[0], context.get_data_type(kind))

        return kind(types.int64), generate

    return intrinsic(at)


# Records of single numbers whose fields are attributes, in Python as in compiled code.


def named_record(*names: str, **others: type) -> np.dtype[np.void]:
    """Type of records of floats called `names`, then of what is said of `others`; for arrays of such records."""
    return np.dtype((np.record, [(name, float) for name in names] + list(others.items())))


# The meaning of a field or a key, from one place: the docstring below it, in a record or in a class of keys.
#
# Such a docstring states the meaning. Where useful, "Left out:" says what applies without the key, and "Source:" gives
# the source of meaning and value; both come at the end. A unit in brackets is that of the field; a key may use another
# unit.


UNIT = re.compile(r"(?:^| )\[((?:[A-Za-z(]|1/)[^\]]*)\]")
NAME = re.compile(r"`(\w+)`")
PARTS = re.compile(r"(?:^|(?<=\s))(Left out|Source): ")


@dataclass(frozen=True)
class Meaning:
    """What is said of a key; empty where nothing is."""

    text: str = ""
    unit: str = ""
    """That of the field; the key's own where its name has no ending."""
    left_out: str = ""
    """What applies where the key is left out, if that is no plain number."""
    source: str = ""

    def with_names(self, names: Mapping[str, str]) -> "Meaning":
        """The same with other names for what stands in backticks."""

        def renamed(text: str) -> str:
            return NAME.sub(lambda found: f"`{names.get(found[1], found[1])}`", text)

        return replace(self, text=renamed(self.text), left_out=renamed(self.left_out))


@cache
def meanings(kind: type) -> dict[str, Meaning]:
    """Meaning of every field of a class, its bases' included. The source is the field's own, else that of its class."""
    found: dict[str, Meaning] = {}
    for base in reversed(kind.__mro__):
        if base.__module__ in ("builtins", "pydantic.main"):
            continue
        of_class = meant(base.__dict__.get("__doc__") or "").source
        own = {name: meant(text) for name, (text, *_) in _docstrings(base).items()}
        found |= {name: replace(one, source=one.source or of_class) for name, one in own.items()}
    return found


def meant(docstring: str) -> Meaning:
    """Content of a docstring: its text, and the marked parts."""
    text, *parts = PARTS.split(" ".join(docstring.split()))
    said = {mark: part.strip() for mark, part in zip(parts[::2], parts[1::2], strict=True)}
    unit = UNIT.search(text)
    return Meaning(
        UNIT.sub("", text).strip(),
        unit.group(1) if unit else "",
        said.get("Left out", ""),
        said.get("Source", ""),
    )


def _docstrings(kind: type) -> dict[str, tuple[str, str | None, str | None]]:
    try:
        return AttributeDocstrings().get_attr_docs(kind)
    except TypeError:  # made at run time: it has no source
        return {}


# Fields of parameter records: the unit in which a file gives them, and what compiled code takes of them.
#
# A number is declared once, as a field of a frozen dataclass. One that is the same for every train is a `ClassVar`: no file
# sets it. `numbers_of` makes the record that compiled code reads.


Filled = TypeVar("Filled")

NOT_IN_FILES = {"unit": None}
"""Metadata of a field that no scenario file sets."""


def quantity(
    default: Any, unit: str, names: Mapping[str, float] | None = None, most: float | None = None
) -> Any:
    """A number of a parameter record, kept in SI units; MISSING: no default.

    `unit`: that of the key in scenario files, "1" for a pure number, see `studies.files.units`. `names`: values that
    have a name there. `most`: the greatest value that a file may give.
    """
    return field(default=default, metadata={"unit": unit, "names": names or {}, "most": most})


@cache
def _numeric(kind: type) -> dict[str, type]:
    """Fields and constants (`ClassVar`) of a dataclass that are numbers or further dataclasses, and the type of each."""
    found = {}
    for base in reversed(kind.__mro__):
        for name, stated in get_annotations(base).items():
            stated = get_args(stated)[0] if get_origin(stated) is ClassVar else stated
            if stated in _NUMBERS or is_dataclass(stated):
                found[name] = stated
    return found


@cache
def _numbers_kind(name: str, fields: tuple[str, ...]) -> Any:
    return namedtuple(name, fields)


def numbers_of(record: Any, **others: Any) -> Any:
    """Named tuple of the numbers of a dataclass, its constants and those of further dataclasses in it, and of `others`.

    Every number gets the type that its field states: another type would make Numba compile everything again.
    """
    kind: Any = type(record)
    values = {
        name: numbers_of(getattr(record, name)) if is_dataclass(stated) else stated(getattr(record, name))
        for name, stated in _numeric(kind).items()
        if name not in others
    }  # fmt: skip
    values |= others
    return _numbers_kind(kind.__name__, tuple(values))(**values)


def filled(kind: type[Filled], source: Any, **others: Any) -> Filled:
    """Named tuple `kind` of the fields of `source` that have the same names, and of `others`; types as by `numbers_of`."""
    values = {}
    for name, stated in kind.__annotations__.items():
        value = others[name] if name in others else getattr(source, name)
        values[name] = stated(value) if stated in (float, int, bool) else value
    return kind(**values)
