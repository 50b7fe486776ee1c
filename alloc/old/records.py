"""Records: parameters that are declared once, and arrays that compiled code gets as one address.

In: dataclasses and named tuples of numbers and arrays. Out: for compiled code their addresses and types; for files and
pages the unit, meaning and source of each field.
"""

import ast
import hashlib
import re
from collections import namedtuple
from collections.abc import Callable, Hashable, Iterator, Mapping
from dataclasses import field, is_dataclass
from functools import cache, cached_property, lru_cache
from inspect import get_annotations, getsource
from itertools import pairwise
from textwrap import dedent
from typing import Any, ClassVar, NamedTuple, TypeVar, cast, get_args, get_origin

import numpy as np
from llvmlite import ir
from numba import types
from numba.core import cgutils
from numba.core.types.npytypes import _RecordField
from numba.extending import (
    intrinsic,
    lower_getattr_generic,
    models,
    register_model,
    typeof_impl,
)
from numba.np.numpy_support import from_dtype
from numpy.typing import NDArray

# Nested records of arrays for compiled code, passed as one address.
#
# Numba passes a `NamedTuple` by value, field by field, seven numbers per array. With the hundreds of arrays of a run
# this took most of the compile time, and more time than the work of a short step. Here compiled code gets the address
# of a block in which every field lies as Numba keeps it in memory, and reads fields as those of the `NamedTuple`.

Filled = TypeVar("Filled")

_WORD = ir.IntType(64)
_NUMBERS = {
    float: (np.float64, types.float64),
    bool: (np.int64, types.boolean),
    int: (np.int64, types.int64),
}


class RecordType(types.Record):
    """Numba's type of a record of NumPy, whose fields may be arrays; records of equal fields are of one type."""

    __repr__ = types.Type.__repr__

    def __init__(self, name: str, fields: dict[str, _RecordField]) -> None:
        self.fields = fields  # an offset is the first word in the block
        digest = hashlib.sha256(repr((name, fields)).encode()).hexdigest()[:12]
        types.Type.__init__(self, f"{name}_{digest}")  # Numba's name would be as long as all fields


class ByReference:
    """A `NamedTuple` of numbers, arrays and further ones, to be handed to compiled code; in Python it has their fields.

    Arrays must be contiguous; they are shared, numbers are copied. Raises `TypeError` for what is neither.
    """

    def __init__(self, value: Any) -> None:
        self._value = value
        words: list[int] = []
        self.kind = _type(_lay_out(value, words))
        self.data = np.array(words, dtype=np.uint64)
        self.address = self.data.ctypes.data

    def __getattr__(self, name: str) -> Any:
        return getattr(self._value, name)


class Made(dict[Any, Any]):
    """What an object makes once for all that use it, none of which may change it; a copy or a pickle begins anew."""

    def once(self, key: Hashable, make: Callable[[], Filled]) -> Filled:
        """What `make` gives, made once for `key`."""
        if key not in self:
            self[key] = make()
        return cast(Filled, self[key])

    def __reduce__(self) -> Any:
        return Made, ()


LINE = 64
"""Bytes of a cache line."""


class LaidOut:
    """A `NamedTuple` as of `ByReference` whose arrays lie in one block, laid out once; `fresh` gives it with a copy of them.

    So a run need not look for hundreds of addresses, which takes longer than many a run's steps. Each array has cache lines
    of its own; where they happened to lie otherwise made the plant's right side up to 1.5 times slower. Arrays that overlap,
    such as a block and its rows, overlap in the copy too.
    """

    def __init__(self, value: Any) -> None:
        self.value = value
        arrays = list(_arrays_of(value))
        spans = [(_address(one), one.nbytes) for one in arrays]
        self._places, first, end, place = {}, 0, 0, 0
        for k in sorted(range(len(arrays)), key=spans.__getitem__):
            start, length = spans[k]
            if start >= end:
                place += -(-(end - first) // LINE) * LINE
                first = start
            self._places[id(arrays[k])] = place + start - first
            end = max(end, start + length)
        self._content = np.zeros(place + end - first, dtype=np.uint8)
        for array in arrays:
            self.placed(array, self._content)[...] = array
        # numbers are the same wherever the block lies, addresses move with it
        blocks = self._copy(), self._copy()
        one, other = (ByReference(self.placed(value, block)) for block in blocks)
        self.kind = one.kind
        self._moves = (one.data != other.data).astype(np.uint64)
        self._words = one.data - self._moves * np.uint64(_address(blocks[0]))

    def _copy(self) -> NDArray[np.uint8]:
        room = np.empty(self._content.size + LINE, dtype=np.uint8)
        start = -_address(room) % LINE
        block = room[start : start + self._content.size]
        block[:] = self._content
        return block

    def placed(self, part: Any, block: NDArray[np.uint8]) -> Any:
        """`part` of the value with its arrays in `block`."""
        if isinstance(part, np.ndarray):
            return np.ndarray(part.shape, part.dtype, cast(Any, block), self._places[id(part)])
        if hasattr(part, "_fields"):
            return type(part)(*(self.placed(one, block) for one in part))
        return part

    def words_at(self, block: NDArray[np.uint8]) -> NDArray[np.uint64]:
        """What compiled code reads where the arrays are those in `block`."""
        return self._words + self._moves * np.uint64(_address(block))

    def fresh(self) -> ByReference:
        """The record with arrays of its own, as they were when it was laid out."""
        return _Fresh(self)


class _Fresh(ByReference):
    """Fields become arrays of Python where they are asked for."""

    def __init__(self, made: LaidOut) -> None:
        self._made, self._block = made, made._copy()
        self.kind, self.data = made.kind, made.words_at(self._block)
        self.address = self.data.ctypes.data

    @cached_property
    def _value(self) -> Any:
        return self._made.placed(self._made.value, self._block)

    def __getattr__(self, name: str) -> Any:
        found = self._made.placed(getattr(self._made.value, name), self._block)
        setattr(self, name, found)
        return found


def _address(array: NDArray[Any]) -> int:
    return int(array.__array_interface__["data"][0])


def _arrays_of(value: Any) -> Iterator[NDArray[Any]]:
    for item in value:
        if isinstance(item, np.ndarray):
            yield item
        elif hasattr(item, "_fields"):
            yield from _arrays_of(item)


def _lay_out(value: Any, words: list[int]) -> tuple[str, tuple[tuple[str, Any, int], ...]]:
    """Append the words of `value`; returns its class, and of each field its name, what it is, and its first word."""
    fields, start = [], len(words)
    for name, item in zip(value._fields, value, strict=True):
        word = len(words) - start
        what: Any = None
        if isinstance(item, np.ndarray):
            if not item.flags.c_contiguous:
                raise TypeError(f"{type(value).__name__}.{name}: the array is not contiguous")
            words += [0, 0, item.size, item.itemsize, _address(item), *item.shape, *item.strides]
            what = item.dtype, item.ndim
        elif isinstance(item, ByReference):
            what = item.kind
            words += item.data.tolist()
        elif hasattr(item, "_fields"):
            what = _lay_out(item, words)
        elif item is not None:
            plain = item.item() if isinstance(item, np.generic) else item
            what = type(plain)
            if what not in _NUMBERS:
                raise TypeError(
                    f"{type(value).__name__}.{name}: {type(item).__name__} is neither number, array nor record"
                )
            words.append(int(_NUMBERS[what][0](plain).view(np.uint64)))
        fields.append((name, what, word))
    return type(value).__name__, tuple(fields)


@lru_cache(maxsize=1024)
def _type(what: Any) -> types.Type:
    """Numba's type of a field, or of a record, that is `what` says `_lay_out`."""
    if what is None:
        return types.none
    if isinstance(what, types.Type):
        return what
    if isinstance(what, type):
        return _NUMBERS[what][1]
    if isinstance(what[0], str):
        return RecordType(
            what[0],
            {name: _RecordField(_type(one), word, None, None) for name, one, word in what[1]},
        )
    return types.Array(from_dtype(what[0]), what[1], "C")


@register_model(RecordType)
class _RecordModel(models.PrimitiveModel):
    def __init__(self, manager: Any, kind: types.Type) -> None:
        super().__init__(manager, kind, _WORD.as_pointer())


@typeof_impl.register(ByReference)
def _typeof(value: ByReference, context: Any) -> types.Type:
    return value.kind


@lower_getattr_generic(RecordType)
def _read(context: Any, builder: Any, kind: RecordType, block: Any, name: str) -> Any:
    of, word = kind.fields[name][:2]
    place = builder.gep(block, [ir.Constant(_WORD, word)])
    if isinstance(of, RecordType):
        return place
    if of == types.none:
        return context.get_dummy_value()
    as_number = types.int64 if of == types.boolean else of
    model = context.data_model_manager[as_number]
    before = len(builder.block.instructions)
    place = builder.bitcast(place, model.get_data_type().as_pointer())
    value = model.load_from_data_pointer(builder, place, align=8)
    for one in builder.block.instructions[before:]:
        if isinstance(one, ir.LoadInstr):  # nothing writes to the block while compiled code runs
            one.set_metadata("invariant.load", builder.module.add_metadata([]))
    return builder.trunc(value, ir.IntType(1)) if of == types.boolean else value


# Compiled functions and records that are handed to compiled code as numbers: their addresses.
#
# So code that is compiled first can call what is made later, without knowing of which package it comes. Numba's own way
# to hand over a function asks Python for its address at every call, which takes as long as a simulation over the MPC's
# horizon.


def address_of(function: Any, kind: types.FunctionType) -> int:
    """Address of a compiled function, which must be kept while the address is in use."""
    made = function.get_compile_result(kind.signature)
    return int(made.library.get_pointer_to_function(made.fndesc.llvm_func_name))


def called_at(returns: types.Type) -> Any:
    """Compiled function that takes an address (int64) and arguments, and calls the function stored there.

    That must take the very types of these arguments, and return `returns`. For one whose types are known at import,
    `stored_at`.
    """

    def at(typingctx, address, *given):
        def generate(context, builder, signature, args):
            convention = context.call_conv
            kind = convention.get_function_type(returns, given)
            function = builder.inttoptr(args[0], kind.as_pointer())
            values = cgutils.unpack_tuple(builder, args[1])
            status, value = convention.call_function(builder, function, returns, given, values)
            with cgutils.if_unlikely(builder, status.is_error):
                convention.return_status_propagate(builder, status)
            return value

        return returns(address, types.StarArgTuple(given)), generate

    return intrinsic(at)


def stored_at(kind: types.FunctionType | RecordType) -> Any:
    """Compiled function that takes an address (int64) and returns the function or the record of `kind` stored there."""

    def at(typingctx, address):
        def generate(context, builder, signature, args):
            pointer = builder.inttoptr(args[0], context.get_data_type(types.voidptr))
            if isinstance(kind, RecordType):
                return builder.bitcast(pointer, context.get_data_type(kind))
            made = cgutils.create_struct_proxy(kind)(context, builder)
            made.c_addr = made.py_addr = ir.Constant(pointer.type, None)
            made.jit_addr = pointer
            return made._getvalue()

        return kind(types.int64), generate

    return intrinsic(at)


def named_record(*names: str, **others: type) -> np.dtype[np.void]:
    """Type of records of floats `names`, then of `others`; for arrays whose records have them as attributes everywhere."""
    return np.dtype((np.record, [(name, float) for name in names] + list(others.items())))


# The meaning of a field or a key, from one place: the docstring below it, in a record or in a class of keys.
#
# Such a docstring states the meaning. Where useful, "Left out:" says what applies without the key, and "Source:" gives
# the source of meaning and value; both come at the end. A unit in brackets is that of the field; a key may use another
# unit.

UNIT = re.compile(r"(?:^| )\[((?:[A-Za-z(]|1/)[^\]]*)\]")
PARTS = re.compile(r"(?:^|(?<=\s))(Left out|Source): ")


class Meaning(NamedTuple):
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
            return re.sub(r"`(\w+)`", lambda found: f"`{names.get(found[1], found[1])}`", text)

        return self._replace(text=renamed(self.text), left_out=renamed(self.left_out))


@cache
def meanings(kind: type) -> dict[str, Meaning]:
    """Meaning of every field of a class, its bases' included. The source is the field's own, else that of its class."""
    found: dict[str, Meaning] = {}
    for base in reversed(kind.__mro__):
        if base.__module__ in ("builtins", "pydantic.main"):
            continue
        of_class = meant(base.__dict__.get("__doc__") or "").source
        try:
            body = ast.parse(dedent(getsource(base))).body[0].body  # type: ignore[attr-defined]
        except (TypeError, OSError):  # made at run time: it has no source
            continue
        # a field, and the string that follows it
        stated = {
            field.target.id: str(said.value.value)
            for field, said in pairwise(body)
            if isinstance(field, ast.AnnAssign)
            and isinstance(field.target, ast.Name)
            and isinstance(said, ast.Expr)
            and isinstance(said.value, ast.Constant)
        }
        for name, text in stated.items():
            meaning = meant(text)
            found[name] = meaning._replace(source=meaning.source or of_class)
    return found


def meant(docstring: str) -> Meaning:
    """Content of a docstring: its text, and the marked parts."""
    text, *parts = PARTS.split(" ".join(docstring.split()))
    said = {mark: part.strip() for mark, part in zip(parts[::2], parts[1::2], strict=True)}
    unit = UNIT.search(text)
    own = UNIT.sub("", text).strip()
    return Meaning(own, unit[1] if unit else "", said.get("Left out", ""), said.get("Source", ""))


# Fields of parameter records: the unit in which a file gives them, and what compiled code takes of them.
#
# A number is declared once, as a field of a frozen dataclass. One that is the same for every train is a `ClassVar`: no file
# sets it. `numbers_of` makes the record that compiled code reads.

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
    stated = {
        name: one for base in reversed(kind.__mro__) for name, one in get_annotations(base).items()
    }
    plain = {
        name: get_args(one)[0] if get_origin(one) is ClassVar else one
        for name, one in stated.items()
    }
    return {name: one for name, one in plain.items() if one in _NUMBERS or is_dataclass(one)}


@cache
def _named_tuple(kind: Any, fields: tuple[str, ...]) -> Any:
    name = f"Numbers_{'_'.join(fields)}"
    made = namedtuple(kind.__name__, fields, module=kind.__module__)  # type: ignore[misc]
    made.__qualname__ = f"{kind.__qualname__}.{name}"  # where Numba's cache looks for it
    setattr(kind, name, made)
    return made


def numbers_of(record: Any, **others: Any) -> Any:
    """Named tuple of the numbers of a dataclass, its constants and those of further dataclasses in it, and of `others`.

    Every number gets the type that its field states: another type would make Numba compile everything again.
    """
    kind: Any = type(record)
    values = {
        name: numbers_of(getattr(record, name)) if is_dataclass(stated) else stated(getattr(record, name))
        for name, stated in _numeric(kind).items()
        if name not in others
    } | others  # fmt: skip
    return _named_tuple(kind, tuple(values))(**values)


def filled(kind: type[Filled], source: Any, **others: Any) -> Filled:
    """Named tuple `kind` of the fields of `source` that have the same names, and of `others`; types as by `numbers_of`."""
    values = {}
    for name, stated in kind.__annotations__.items():
        value = others[name] if name in others else getattr(source, name)
        values[name] = stated(value) if stated in _NUMBERS else value
    return kind(**values)
