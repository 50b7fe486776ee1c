"""Expressions of a compiled function in C."""

import ast
from types import ModuleType
from typing import Any

from mpc.export import c_known as known
from mpc.export.c_kinds import (
    DOUBLE,
    INTEGER,
    TRUTH,
    Array,
    Known,
    Lanes,
    Number,
    Record,
    Structure,
    Value,
    as_number,
    joined,
    plus,
    times,
)

_ARITHMETIC = {ast.Add: "+", ast.Sub: "-", ast.Mult: "*"}
_COMPARISONS = {
    ast.Lt: "<", ast.LtE: "<=", ast.Gt: ">", ast.GtE: ">=", ast.Eq: "==", ast.NotEq: "!=",
}  # fmt: skip
_FOLDS: dict[type, Any] = {
    ast.Add: lambda a, b: a + b, ast.Sub: lambda a, b: a - b, ast.Mult: lambda a, b: a * b,
    ast.FloorDiv: lambda a, b: a // b, ast.Mod: lambda a, b: a % b,
    ast.Lt: lambda a, b: a < b, ast.LtE: lambda a, b: a <= b, ast.Gt: lambda a, b: a > b,
    ast.GtE: lambda a, b: a >= b, ast.Eq: lambda a, b: a == b, ast.NotEq: lambda a, b: a != b,
    ast.In: lambda a, b: a in b, ast.NotIn: lambda a, b: a not in b,
}  # fmt: skip


def is_known(value: Value, *kinds: type) -> bool:
    """Whether a value is known, and of one of the types `kinds`."""
    return isinstance(value.kind, Known) and isinstance(value.kind.value, kinds or object)


def has_call(node: ast.AST) -> bool:
    """Whether something is called in an expression."""
    return any(isinstance(one, ast.Call) for one in ast.walk(node))


class Expressions:
    """Translates the expressions of one function; `program` knows the other functions and the constants."""

    def __init__(self, program: Any, space: dict[str, Any], file: str) -> None:
        self.program, self.space, self.file = program, space, file
        self.kinds: dict[str, Any] = {}
        """Kind of each variable."""
        self.aliases: dict[str, Value] = {}
        """Names that stand for something of which C needs no variable."""
        self.read: set[str] = set()

    def error(self, node: ast.AST, what: str) -> Exception:
        """`what` of a source has no translation."""
        error: Exception = self.program.error(self.file, getattr(node, "lineno", 0), what)
        return error

    def value(self, node: ast.expr) -> Value:
        """An expression."""
        method = getattr(self, f"_{type(node).__name__.lower()}", None)
        if method is None:
            raise self.error(node, f"{type(node).__name__} ({ast.unparse(node)})")
        found: Value = method(node)
        return found

    def number(self, node: ast.expr) -> Value:
        """An expression that must be a number, or lanes of them."""
        return self.as_number(self.value(node), node)

    def as_number(self, value: Value, node: ast.AST) -> Value:
        """`value` as a number in C."""
        value = as_number(value)
        if not isinstance(value.kind, Number | Lanes):
            raise self.error(node, f"no number: {ast.unparse(node)}")
        return value

    def _constant(self, node: ast.Constant) -> Value:
        if not isinstance(node.value, bool | int | float):
            raise self.error(node, f"the constant {node.value!r}")
        return Value(Known(node.value))

    def _name(self, node: ast.Name) -> Value:
        name = node.id
        if name in self.aliases:
            return self.aliases[name]
        if name in self.kinds:
            self.read.add(name)
            return self.variable(name)
        if name in self.space:
            found = self.space[name]
        elif hasattr(self.program.builtins, name):
            found = getattr(self.program.builtins, name)
        else:
            raise self.error(node, f"the name {name} without a value")
        if isinstance(found, float):
            return Value(Known(found), self.program.constant(name, found))
        return Value(Known(found))

    def variable(self, name: str) -> Value:
        """A variable or an argument."""
        kind, text = self.kinds[name], self.program.local(name)
        if isinstance(kind, Array):
            dims = (str(n) if n is not None else f"{text}_n{k}" for k, n in enumerate(kind.dims))
            return Value(kind, text, tuple(dims))
        return Value(kind, f"{text}[lane]" if isinstance(kind, Lanes) else text)

    def _attribute(self, node: ast.Attribute) -> Value:
        owner, name = self.value(node.value), node.attr
        if isinstance(owner.kind, Record):
            field: Value = self.program.field(owner.kind, name)
            return field
        if isinstance(owner.kind, Structure) and name in dict(owner.kind.fields):
            at = owner.text
            text = f"{at[1:]}.{name}" if at.startswith("&") else f"{at}->{name}"
            return Value(dict(owner.kind.fields)[name], text)
        if isinstance(owner.kind, Array) and name in ("size", "shape"):
            dims = tuple(map(_dimension, owner.dims))
            if name == "shape":
                return Value(None, parts=dims)
            size = "1"
            for dim in owner.dims:
                size = times(size, dim)
            return _dimension(size)
        if is_known(owner, ModuleType) and hasattr(owner.kind.value, name):
            return Value(Known(getattr(owner.kind.value, name)))
        raise self.error(node, f"the attribute {ast.unparse(node)}")

    def _tuple(self, node: ast.Tuple) -> Value:
        return Value(None, parts=tuple(map(self.value, node.elts)))

    def _subscript(self, node: ast.Subscript) -> Value:
        owner = self.value(node.value)
        places = node.slice.elts if isinstance(node.slice, ast.Tuple) else [node.slice]
        if owner.parts or is_known(owner, tuple):
            index = self.value(node.slice)
            if is_known(index, int):
                if owner.parts:
                    return owner.parts[index.kind.value]
                return Value(Known(owner.kind.value[index.kind.value]))
        if not isinstance(owner.kind, Array) or len(places) > len(owner.dims):
            raise self.error(node, f"the subscript {ast.unparse(node)}")
        offset, dims = owner.offset, list(owner.dims)
        kept: list[str] = []
        for axis, place in enumerate(places):
            inner = "1"
            for dim in dims[axis + 1 :]:
                inner = times(inner, dim)
            if isinstance(place, ast.Slice):
                if kept or any(isinstance(p, ast.Slice) for p in places[axis + 1 :]):
                    raise self.error(node, f"several slices in {ast.unparse(node)}")
                begin, length = self._slice(place, dims[axis])
                kept.append(length)
                offset = plus(offset, times(begin, inner))
            else:
                offset = plus(offset, times(self._index(place), inner))
                if kept:
                    raise self.error(node, f"an index behind a slice in {ast.unparse(node)}")
        rest = (*kept, *dims[len(places) :])
        if rest:
            shape = tuple(int(n) if n.isdigit() else None for n in rest)
            return Value(Array(owner.kind.element, shape), owner.text, rest, offset)
        text = f"{owner.operand}[{offset or '0'}]"
        element = owner.kind.element
        return Value(element, f"&{text}" if isinstance(element, Structure) else text)

    def _index(self, node: ast.expr) -> str:
        index = self.number(node)
        if index.kind != INTEGER or index.text.startswith("-"):
            raise self.error(node, f"the index {ast.unparse(node)}")
        return index.text

    def _slice(self, node: ast.Slice, size: str) -> tuple[str, str]:
        """Begin and length of a slice, whose bounds lie within the array."""
        if node.step is not None:
            raise self.error(node, f"the slice {ast.unparse(node)}")
        begin = self._index(node.lower) if node.lower else "0"
        end = self._index(node.upper) if node.upper else size
        if begin == "0":
            return begin, end
        if begin.isdigit() and end.isdigit():
            return begin, str(int(end) - int(begin))
        before, _, more = end.rpartition(" + ")
        if before == Value(INTEGER, begin).operand and more.isdigit():
            return begin, more
        return begin, f"{end} - {Value(INTEGER, begin).operand}"

    def _binop(self, node: ast.BinOp) -> Value:
        return self.operation(node, node.op, self.value(node.left), self.value(node.right))

    def operation(self, node: ast.AST, op: ast.operator, left: Value, right: Value) -> Value:
        """An operation of arithmetic."""
        kind = type(op)
        if is_known(left, int) and is_known(right, int) and kind in _FOLDS:
            return Value(Known(_FOLDS[kind](left.kind.value, right.kind.value)))
        if kind is ast.Pow:
            if not (is_known(right, int) and right.kind.value == 2):
                raise self.error(node, f"the power {ast.unparse(node)}")
            return Value(DOUBLE, self.program.helper(known.SQUARE, self.as_number(left, node).text))
        a, b = self.as_number(left, node), self.as_number(right, node)
        both = joined(a.kind, b.kind)
        whole = both in (TRUTH, INTEGER)
        if kind in _ARITHMETIC:
            if whole and kind is ast.Mult:
                return Value(INTEGER, times(a.text, b.text))
            if whole and kind is ast.Add:
                return Value(INTEGER, plus(a.text, b.text))
            return Value(INTEGER if whole else both, f"{a.operand} {_ARITHMETIC[kind]} {b.operand}")
        if kind is ast.Div:
            top = f"(double){a.operand}" if whole else a.operand
            return Value(DOUBLE if whole else both, f"{top} / {b.operand}")
        if kind is ast.Mod and not isinstance(both, Lanes):
            name = known.WHOLE_MODULO if whole else known.MODULO
            return Value(both, self.program.helper(name, a.text, b.text))
        if kind is ast.FloorDiv and whole:
            return Value(INTEGER, self.program.helper(known.WHOLE_QUOTIENT, a.text, b.text))
        raise self.error(node, f"the operator {kind.__name__} ({ast.unparse(node)})")

    def _unaryop(self, node: ast.UnaryOp) -> Value:
        value = self.value(node.operand)
        if isinstance(node.op, ast.Not):
            if is_known(value, bool):
                return Value(Known(not value.kind.value))
            return Value(TRUTH, f"!{self.as_number(value, node).operand}")
        if isinstance(node.op, ast.USub):
            if is_known(value, int, float):
                return Value(Known(-value.kind.value), f"-{value.text}" if value.text else "")
            value = self.as_number(value, node)
            return Value(value.kind, f"-{value.operand}")
        raise self.error(node, f"the operator {type(node.op).__name__} ({ast.unparse(node)})")

    def _compare(self, node: ast.Compare) -> Value:
        values, parts = [self.value(one) for one in (node.left, *node.comparators)], []
        if any(has_call(one) for one in node.comparators[:-1]):  # it would be called twice
            raise self.error(node, f"a call within {ast.unparse(node)}")
        for op, left, right in zip(node.ops, values, values[1:], strict=False):
            if right.parts and all(is_known(part, int) for part in right.parts):
                right = Value(Known(tuple(part.kind.value for part in right.parts)))
            if is_known(left, int) and is_known(right, int, tuple) and len(node.ops) == 1:
                return Value(Known(_FOLDS[type(op)](left.kind.value, right.kind.value)))
            if type(op) not in _COMPARISONS:
                raise self.error(node, f"the comparison {ast.unparse(node)}")
            a, b = self.as_number(left, node), self.as_number(right, node)
            if isinstance(joined(a.kind, b.kind), Lanes):
                raise self.error(node, f"a comparison of lanes: {ast.unparse(node)}")
            parts.append(f"{a.operand} {_COMPARISONS[type(op)]} {b.operand}")
        return Value(TRUTH, parts[0] if len(parts) == 1 else " && ".join(f"({p})" for p in parts))

    def _boolop(self, node: ast.BoolOp) -> Value:
        ends = isinstance(node.op, ast.Or)  # the operand that decides
        texts: list[str] = []
        for operand in node.values:
            value = self.value(operand)
            if is_known(value, bool):
                if value.kind.value is not ends:
                    continue
                if not texts:
                    return Value(Known(ends))
            number = self.as_number(value, operand)
            if number.kind != TRUTH:  # Python's `and` gives an operand back
                raise self.error(node, f"no truth value: {ast.unparse(operand)}")
            texts.append(number.operand)
        if len(texts) < 2:
            return Value(TRUTH, texts[0]) if texts else Value(Known(not ends))
        return Value(TRUTH, (" || " if ends else " && ").join(texts))

    def _ifexp(self, node: ast.IfExp) -> Value:
        test = self.value(node.test)
        if is_known(test, bool, int):
            return self.value(node.body if test.kind.value else node.orelse)
        return self.chosen(
            self.as_number(test, node), self.number(node.body), self.number(node.orelse)
        )

    def chosen(self, test: Value, body: Value, other: Value) -> Value:
        """One of two numbers."""
        text = f"{test.operand} ? {body.operand} : {other.operand}"
        return Value(joined(body.kind, other.kind), text)


def _dimension(text: str) -> Value:
    """A dimension of an array."""
    return Value(Known(int(text))) if text.isdigit() else Value(INTEGER, text)
