"""What an expression of a compiled function is, once it is C: a number, an array, or something known when C is written."""

import string
from typing import Any, NamedTuple


class TranslationError(NotImplementedError):
    """A compiled function contains a construct without a translation to C; the message names file, line and construct."""


class Number(NamedTuple):
    """A number of the C type `name`."""

    name: str


TRUTH, INTEGER, DOUBLE = Number("bool"), Number("int64_t"), Number("double")
_RANK = {TRUTH: 0, INTEGER: 1, DOUBLE: 2}


class Lanes(NamedTuple):
    """A vector of `alloc.plant.simd`; its text is that of one lane, whose number is `lane`."""

    name: str = "lanes"


class Structure(NamedTuple):
    """A record of numbers that is passed by pointer."""

    name: str
    fields: tuple[tuple[str, Number], ...]


class Array(NamedTuple):
    """An array; a dimension that is not known is None, and stands in a variable beside the pointer."""

    element: Number | Structure
    dims: tuple[int | None, ...]


class Several(NamedTuple):
    """A tuple of numbers."""

    items: tuple[Number, ...]

    @property
    def name(self) -> str:
        """Name of the C structure."""
        return "Tuple_" + "".join(item.name[0] for item in self.items)


class Record(NamedTuple):
    """A record of arrays, which is one place in the controller's memory: nothing is passed."""

    path: str
    value: Any

    def __hash__(self) -> int:
        return hash(self.path)

    def __eq__(self, other: object) -> bool:
        return isinstance(other, Record) and self.path == other.path


class Known(NamedTuple):
    """Something of Python's whose value is known: a module, a function, a number that does not change."""

    value: Any

    def __hash__(self) -> int:
        return hash(
            (
                type(self.value).__name__,
                id(self.value) if callable(self.value) else repr(self.value),
            )
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Known) or type(self.value) is not type(other.value):
            return False
        if callable(self.value):
            return self.value is other.value
        return repr(self.value) == repr(other.value)


class Value(NamedTuple):
    """An expression: its kind, and its text in C; of an array, the text of the pointer and of each dimension."""

    kind: Any
    text: str = ""
    dims: tuple[str, ...] = ()
    offset: str = ""
    """Of an array: where it begins behind the pointer `text`."""
    parts: tuple["Value", ...] = ()
    """Of a tuple that is written out."""

    @property
    def operand(self) -> str:
        """The text as a part of a larger expression."""
        return self.text if _is_whole(self.text) else f"({self.text})"


def _is_whole(text: str) -> bool:
    """Whether an operator beside `text` cannot tear it apart."""
    depth = 0
    for letter in text.replace("->", "."):
        depth += (letter in "([{") - (letter in ")]}")
        if depth == 0 and letter in " -!&":
            return False
    return True


def joined(one: Any, other: Any) -> Any:
    """Kind of a variable that is now `one`, now `other`; None where there is none."""
    if one is None or one == other:
        return other
    if one in _RANK and other in _RANK:
        return max(one, other, key=_RANK.__getitem__)
    if {type(one), type(other)} == {Number, Lanes}:
        return Lanes()
    if isinstance(one, Array) and isinstance(other, Array) and len(one.dims) == len(other.dims):
        dims = tuple(a if a == b else None for a, b in zip(one.dims, other.dims, strict=True))
        return Array(one.element, dims) if one.element == other.element else None
    if (
        isinstance(one, Several)
        and isinstance(other, Several)
        and len(one.items) == len(other.items)
    ):
        return Several(tuple(joined(a, b) for a, b in zip(one.items, other.items, strict=True)))
    return None


def number_text(value: float) -> str:
    """A number of Python's in C."""
    if isinstance(value, bool):
        return "true" if value else "false"
    if value != value:
        return "NAN"
    if value in (float("inf"), float("-inf")):
        return "INFINITY" if value > 0.0 else "-INFINITY"
    return repr(value)


def as_number(value: Value) -> Value:
    """A known number as an expression of C; anything else stays."""
    if isinstance(value.kind, Known) and isinstance(value.kind.value, bool | int | float):
        known = value.kind.value
        kind = TRUTH if isinstance(known, bool) else INTEGER if isinstance(known, int) else DOUBLE
        return Value(kind, value.text or number_text(known))
    return value


_OF_SUMS = {*string.ascii_letters, *string.digits, *"_ +*.[]"}
"""Letters of sums and products, which need no parentheses in a sum."""


def plus(one: str, other: str) -> str:
    """Sum of two texts of whole numbers."""
    if one in ("", "0"):
        return other
    if other in ("", "0"):
        return one
    if one.isdigit() and other.isdigit():
        return str(int(one) + int(other))
    sums = set(one) <= _OF_SUMS
    return f"{one if sums else Value(INTEGER, one).operand} + {Value(INTEGER, other).operand}"


def times(one: str, other: str) -> str:
    """Product of two texts of whole numbers."""
    if "0" in (one, other):
        return "0"
    if "1" in (one, other):
        return other if one == "1" else one
    if one.isdigit() and other.isdigit():
        return str(int(one) * int(other))
    return f"{Value(INTEGER, one).operand} * {Value(INTEGER, other).operand}"
