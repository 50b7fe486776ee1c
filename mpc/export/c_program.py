"""Compiled functions that call each other as one C program: each for the kinds of its arguments, callees first."""

import ast
import builtins
from typing import Any, NamedTuple

import numpy as np

from alloc.by_reference import ByReference
from mpc.export.c_function import Function
from mpc.export.c_kinds import (
    DOUBLE,
    INTEGER,
    Array,
    Known,
    Lanes,
    Number,
    Record,
    Several,
    Structure,
    TranslationError,
    Value,
    as_number,
    number_text,
)
from mpc.export.c_known import HELPERS, OF_C
from mpc.export.c_source import Source, arguments_of, names_of, source_of, summary_of
from mpc.export.c_variables import declarations, pointer

_WORDS = """auto break case char const continue default do double else enum extern float for goto if inline int long register
restrict return short signed sizeof static struct switch typedef union unsigned void volatile while bool true false
memory lane fill copy"""
_NOT_FREE = {*_WORDS.split(), *HELPERS, *(name for name, _ in OF_C.values())}
"""Names that variables must not have."""


class Instance(NamedTuple):
    """A function of C."""

    name: str
    result: Any
    parameters: dict[str, Any]
    """Kinds of the parameters that are passed."""
    lines: list[str]
    uses: set[tuple[str, Any]]


class Program:
    """The functions that a first one needs, with the constants and helpers that they use."""

    builtins = builtins

    def __init__(self, stands_for: dict[Any, Value]) -> None:
        """`stands_for`: what calls of functions without a source are."""
        self._stands_for = stands_for
        self._instances: dict[Any, Instance] = {}
        self._names: dict[str, int] = {}
        self._uses: list[set[tuple[str, Any]]] = [set()]
        self.constants: dict[str, float] = {}

    def error(self, file: str, line: int, what: str) -> TranslationError:
        """`what` has no translation."""
        return TranslationError(f"{file}, line {line}: no translation to C for {what}")

    def stands_for(self, function: Any) -> Value | None:
        """What a call of `function` is; None: a call."""
        return next((v for one, v in self._stands_for.items() if one is function), None)

    def begin(self) -> None:
        """Restart the function that is being translated."""
        self._uses[-1].clear()

    def use(self, what: str, which: Any) -> None:
        """The function that is being translated needs something."""
        self._uses[-1].add((what, which))

    def helper(self, name: str, *arguments: str) -> str:
        """Text of a call of one of `c_known.HELPERS`."""
        self.use("helper", name)
        return f"{name}({', '.join(arguments)})"

    def constant(self, name: str, value: float) -> str:
        """Name of a constant."""
        if not abs(value) < float("inf"):
            return number_text(value)
        base, number = name.lstrip("_"), 1
        chosen = base
        while number_text(self.constants.setdefault(chosen, value)) != number_text(value):
            number += 1
            chosen = f"{base}_{number}"
        self.use("constant", chosen)
        return chosen

    def local(self, name: str) -> str:
        """Name of a variable in C."""
        if name == "_":
            return "turn_"
        return f"{name}_" if name in _NOT_FREE else name

    def field(self, record: Record, name: str) -> Value:
        """A field of a record."""
        item = getattr(record.value, name)
        item = item._value if isinstance(item, ByReference) else item
        path = f"{record.path}.{name}"
        if isinstance(item, np.ndarray):
            self.use("field", path)
            kind = array_kind(item, type(record.value).__name__ + name.capitalize())
            return Value(
                kind,
                path if item.size else f"(({kind.element.name} *)0)",
                tuple(map(str, item.shape)),
            )
        if hasattr(item, "_fields"):
            return Value(Record(path, item))
        plain = item.item() if isinstance(item, np.generic) else item
        if isinstance(plain, float):
            return Value(
                Known(plain), self.constant(f"{type(record.value).__name__}_{name}", plain)
            )
        return Value(Known(plain))

    def call(self, function: Any, arguments: list[Value], caller: Any, node: ast.AST) -> Value:
        """A call of a compiled function."""
        source = source_of(function)
        given = arguments_of(source, arguments)
        if given is None:
            raise caller.error(node, f"the arguments of {ast.unparse(node)}")
        if any(isinstance(value.kind, Lanes) or value.parts for value in arguments):
            raise caller.error(node, f"lanes or a tuple handed over in {ast.unparse(node)}")
        instance = self._instance(source, given)
        texts: list[str] = []
        for name, kind in instance.parameters.items():
            value = as_number(given[name])
            if isinstance(kind, Array):
                texts.append(pointer(value))
                texts += [value.dims[axis] for axis, size in enumerate(kind.dims) if size is None]
            else:
                texts.append(value.text)
        return Value(instance.result, f"{instance.name}({', '.join(texts)})")

    def first(self, function: Any, arguments: list[Value]) -> Instance:
        """The function that all begins with."""
        source = source_of(function)
        return self._instance(source, dict(zip(names_of(source.tree), arguments, strict=True)))

    def _instance(self, source: Source, given: dict[str, Value]) -> Instance:
        """The function for arguments of these kinds."""
        given = {name: _as_argument(name, value, source) for name, value in given.items()}
        key = (source.module, source.tree.name, tuple(value.kind for value in given.values()))
        if key not in self._instances:
            self._instances[key] = self._translate(source, given)
        self.use("function", key)
        return self._instances[key]

    def _translate(self, source: Source, given: dict[str, Value]) -> Instance:
        module = source.module.rpartition(".")[2]
        module = "model" if module.startswith("readhesion_generated") else module
        name = f"{module}_{source.tree.name.lstrip('_')}"
        self._names[name] = self._names.get(name, 0) + 1
        if self._names[name] > 1:
            name = f"{name}_{self._names[name]}"
        self._uses.append(set())
        made = Function(self, source, given)
        body = made.translate()
        parameters = {one: made.kinds[one] for one in made.parameters}
        unread = [one for one in parameters if one not in made.read]
        head = f"static {result_text(made.result)} {name}({_signature(self, parameters)})"
        lines = [f"/* {source.file}: {summary_of(source.tree)} */", head, "{"]
        lines += [f"  (void){self.local(one)};" for one in unread]
        text = "\n".join(body)
        sizes = (f"{self.local(one)}_n{axis}" for one, axis in _free_sizes(parameters))
        lines += [f"  (void){size};" for size in sizes if size not in text]
        lines += [*declarations(made), *body, "}"]
        if isinstance(made.result, Several):
            self.use("tuple", made.result)
        return Instance(name, made.result, parameters, lines, self._uses.pop())

    def reached(self, first: Instance) -> tuple[list[Instance], dict[str, set[Any]]]:
        """The functions that `first` needs, callees before callers, and all that these use."""
        order: list[Instance] = []
        uses: dict[str, set[Any]] = {}

        def visit(one: Instance) -> None:
            if one in order:
                return
            for what, which in sorted(one.uses, key=repr):
                if what == "function":
                    visit(self._instances[which])
                uses.setdefault(what, set()).add(which)
            order.append(one)

        visit(first)
        return order, uses


def array_kind(item: np.ndarray, name: str) -> Array:
    """Kind of an array; truth values are kept as whole numbers."""
    element: Number | Structure = DOUBLE if item.dtype.kind == "f" else INTEGER
    if item.dtype.names:
        element = structure(name, item.dtype)
    return Array(element, tuple(map(int, item.shape)))


def structure(name: str, kind: np.dtype) -> Structure:
    """Kind of a record of numbers."""
    fields = ((one, DOUBLE if kind[one].kind == "f" else INTEGER) for one in kind.names or ())
    return Structure(name, tuple(fields))


def result_text(kind: Any) -> str:
    """Type of a C function's result."""
    return "void" if kind is None else kind.name


def _as_argument(name: str, value: Value, source: Source) -> Value:
    """An argument as its function is translated for; sizes that it does not ask for make no difference."""
    if isinstance(value.kind, Known) and isinstance(value.kind.value, float):
        return as_number(value)
    if not isinstance(value.kind, Array) or len(value.kind.dims) > 1:
        return value
    if name not in source.unsized:
        return value
    return value._replace(kind=Array(value.kind.element, (0,)))


def _signature(program: Program, parameters: dict[str, Any]) -> str:
    texts: list[str] = []
    for name, kind in parameters.items():
        text = program.local(name)
        if isinstance(kind, Array):
            texts.append(f"{kind.element.name} *{text}")
            texts += [
                f"int64_t {text}_n{axis}" for axis, size in enumerate(kind.dims) if size is None
            ]
        else:
            texts.append(f"{kind.name} {'*' * isinstance(kind, Structure)}{text}")
    return ", ".join(texts) or "void"


def _free_sizes(parameters: dict[str, Any]) -> list[tuple[str, int]]:
    """Parameter and axis of the sizes that are passed."""
    return [
        (name, axis)
        for name, kind in parameters.items()
        if isinstance(kind, Array)
        for axis, size in enumerate(kind.dims)
        if size is None
    ]
