"""Statements of a compiled function in C, and with them the function."""

import ast
from typing import Any

from alloc.plant.simd import WIDTH
from mpc.export import c_known as known
from mpc.export.c_calls import Calls
from mpc.export.c_expressions import has_call, is_known
from mpc.export.c_kinds import (
    DOUBLE,
    INTEGER,
    Array,
    Known,
    Lanes,
    Number,
    Record,
    Several,
    Value,
    as_number,
    joined,
)
from mpc.export.c_variables import bound_names, loop_scoped, pointer, stays

_EVERY_LANE = f"for (int64_t lane = 0; lane < {WIDTH}; lane++)"
_IN_PLACE = {ast.Add: "+=", ast.Sub: "-=", ast.Mult: "*=", ast.Div: "/="}


class Function(Calls):
    """A compiled function with arguments of given kinds, as C."""

    def __init__(self, program: Any, source: Any, arguments: dict[str, Value]) -> None:
        super().__init__(program, source.space, source.file)
        self.tree: ast.FunctionDef = source.tree
        self.bindings = bound_names(self.tree.body)
        self.scoped = loop_scoped(self.tree)
        self.result: Any = None
        self.parameters: list[str] = []
        for name, given in arguments.items():
            if isinstance(given.kind, Record) or (is_known(given) and name not in self.bindings):
                self.aliases[name] = given
            else:
                self.parameters.append(name)
                self.kinds[name] = as_number(given).kind
        self._given = dict(self.aliases)

    def translate(self) -> list[str]:
        """Lines of the body; kinds of variables are found by going through it until none changes."""
        while True:
            before = dict(self.kinds), self.result
            self.aliases, self.read, self._number = dict(self._given), set(), 0
            self.program.begin()
            lines = self.block(self.tree.body)
            if (dict(self.kinds), self.result) == before:
                return lines

    def block(self, body: list[ast.stmt]) -> list[str]:
        """Statements one after the other, indented."""
        lines = []
        for node in body:
            method = getattr(self, f"_do_{type(node).__name__.lower()}", None)
            if method is None:
                raise self.error(node, f"the statement {ast.unparse(node).splitlines()[0]}")
            lines += method(node)
            if isinstance(node, ast.Return | ast.Break | ast.Continue):
                break
        return ["  " + line for line in lines]

    def _do_pass(self, node: ast.Pass) -> list[str]:
        return []

    def _do_break(self, node: ast.Break) -> list[str]:
        return ["break;"]

    def _do_continue(self, node: ast.Continue) -> list[str]:
        return ["continue;"]

    def _do_expr(self, node: ast.Expr) -> list[str]:
        call = node.value
        if isinstance(call, ast.Constant):  # docstring
            return []
        if not isinstance(call, ast.Call):
            raise self.error(node, f"the statement {ast.unparse(node)}")
        target = self.value(call.func)
        if is_known(target) and target.kind.value is known.STORE:
            stored = call.args[2]
            # what is stored must not be read from where other lanes are being written
            if not isinstance(stored, ast.Name) and ast.unparse(stored) != "spread(0.0)":
                raise self.error(node, f"storing an expression: {ast.unparse(node)}")
            place = self.value(ast.Call(call.func, call.args[:2], []))
            return [f"{_EVERY_LANE} {place.text} = {self.number(stored).text};"]
        return [f"{self.value(call).text};"]

    def _do_return(self, node: ast.Return) -> list[str]:
        if node.value is None:
            return ["return;"]
        value = self._held(self.value(node.value), node)
        self.result = joined(self.result, value.kind)
        if self.result is None or isinstance(self.result, Lanes | Array):
            raise self.error(node, f"returning {ast.unparse(node.value)}")
        return [f"return {value.text};"]

    def _held(self, value: Value, node: ast.AST) -> Value:
        """A value as a variable holds it; a tuple that is written out becomes one of C."""
        if not value.parts:
            return as_number(value)
        numbers = [self.as_number(part, node) for part in value.parts]
        kind = Several(tuple(number.kind for number in numbers))
        self.program.use("tuple", kind)
        return Value(kind, f"({kind.name}){{{', '.join(number.text for number in numbers)}}}")

    def _do_if(self, node: ast.If) -> list[str]:
        test = self.value(node.test)
        if is_known(test, bool, int):
            live = node.body if test.kind.value else node.orelse
            return [line[2:] for line in self.block(live)]
        lines = [f"if ({self.as_number(test, node).text}) {{", *self.block(node.body)]
        other = self.block(node.orelse)
        if (
            len(node.orelse) == 1
            and other
            and other[0].startswith("  if (")
            and isinstance(node.orelse[0], ast.If)
        ):
            return [*lines, "} else " + other[0].strip(), *(line[2:] for line in other[1:])]
        return [*lines, "} else {", *other, "}"] if other else [*lines, "}"]

    def _do_while(self, node: ast.While) -> list[str]:
        if node.orelse:
            raise self.error(node, "else of a loop")
        test = as_number(self.value(node.test)).text
        return [f"while ({test}) {{", *self.block(node.body), "}"]

    def _do_for(self, node: ast.For) -> list[str]:
        call = node.iter
        ranges = isinstance(call, ast.Call) and self.value(call.func).kind == Known(range)
        if not ranges or node.orelse or not isinstance(node.target, ast.Name):
            raise self.error(node, f"the loop over {ast.unparse(call)}")
        bounds = [self.number(one) for one in call.args]  # type: ignore[attr-defined]
        steps = self.value(call.args[2]) if len(bounds) == 3 else Value(Known(1))  # type: ignore[attr-defined]
        if (
            any(bound.kind != INTEGER for bound in bounds)
            or not is_known(steps, int)
            or not steps.kind.value
        ):
            raise self.error(node, f"the loop over {ast.unparse(call)}")
        begin, end = ("0", bounds[0].text) if len(bounds) == 1 else (bounds[0].text, bounds[1].text)
        name, step = self.program.local(node.target.id), steps.kind.value
        self.kinds[node.target.id] = joined(self.kinds.get(node.target.id), INTEGER)
        counter, first = name, []
        if node.target.id not in self.scoped:
            counter = f"{name}_next"
            first = [f"  {name} = {counter};"]
        declared, limit = f"int64_t {counter} = {begin}", end
        if not end.lstrip("-").isdigit():
            declared, limit = f"{declared}, {counter}_end = {end}", f"{counter}_end"
        onward = {1: f"{counter}++", -1: f"{counter}--"}.get(step, f"{counter} += {step}")
        test = f"{counter} {'<' if step > 0 else '>'} {limit}"
        return [f"for ({declared}; {test}; {onward}) {{", *first, *self.block(node.body), "}"]

    def _do_augassign(self, node: ast.AugAssign) -> list[str]:
        if has_call(node.target):  # Python evaluates the place once
            raise self.error(node, f"a call within {ast.unparse(node.target)}")
        target = ast.parse(ast.unparse(node.target), mode="eval").body
        for one in ast.walk(target):
            ast.copy_location(one, node)
        old, new = self.value(target), self.value(node.value)
        value = self.operation(node, node.op, old, new)
        if value.kind == old.kind == DOUBLE and type(node.op) in _IN_PLACE:
            return [f"{old.text} {_IN_PLACE[type(node.op)]} {as_number(new).text};"]
        if value.kind == old.kind == INTEGER and isinstance(node.op, ast.Add | ast.Sub):
            return [f"{old.text} {_IN_PLACE[type(node.op)]} {as_number(new).text};"]
        return self._put(node.target, value, node)

    def _do_assign(self, node: ast.Assign) -> list[str]:
        value, first = self.value(node.value), node.targets[0]
        if isinstance(first, ast.Tuple):
            if len(node.targets) > 1:
                raise self.error(node, f"the assignment {ast.unparse(node)}")
            return self._unpack(first, value, node)
        lines = self._put(first, value, node)
        for target in node.targets[1:]:
            lines += self._put(
                target, self.value(ast.parse(ast.unparse(first), mode="eval").body), node
            )
        return lines

    def _unpack(self, targets: ast.Tuple, value: Value, node: ast.Assign) -> list[str]:
        lines, parts = [], list(value.parts)
        if isinstance(value.kind, Several):
            self._number += 1
            name = f"found_{self._number}"
            lines.append(f"const {value.kind.name} {name} = {value.text};")
            parts = [Value(kind, f"{name}.item{k}") for k, kind in enumerate(value.kind.items)]
        elif self._reads_what_it_writes(targets, node.value):
            parts, made = self._kept(parts, node)
            lines += made
        if len(parts) != len(targets.elts):
            raise self.error(node, f"the assignment {ast.unparse(node)}")
        for target, part in zip(targets.elts, parts, strict=True):
            lines += self._put(target, part, node)
        return lines

    def _reads_what_it_writes(self, targets: ast.Tuple, value: ast.expr) -> bool:
        """Whether a later value may read what an earlier target has got."""
        if not isinstance(value, ast.Tuple):
            return False
        named = {one.id for one in targets.elts if isinstance(one, ast.Name)}
        if len(named) < len(targets.elts):
            return any(not isinstance(one, ast.Constant) for one in value.elts[1:])
        later = {n.id for one in value.elts[1:] for n in ast.walk(one) if isinstance(n, ast.Name)}
        return bool(named & later)

    def _kept(self, parts: list[Value], node: ast.AST) -> tuple[list[Value], list[str]]:
        """Values in variables of their own."""
        kept, lines = [], []
        for part in map(as_number, parts):
            if not isinstance(part.kind, Number):
                raise self.error(node, f"the assignment {ast.unparse(node)}")
            self._number += 1
            name = f"new_{self._number}"
            lines.append(f"const {part.kind.name} {name} = {part.text};")
            kept.append(Value(part.kind, name))
        return kept, lines

    def _put(self, target: ast.expr, value: Value, node: ast.AST) -> list[str]:
        """Assign to one target."""
        if isinstance(target, ast.Name):
            return self._put_name(target.id, value, node)
        place = self.value(target)
        if not isinstance(target, ast.Subscript | ast.Attribute) or not isinstance(
            place.kind, Number
        ):
            raise self.error(node, f"assigning to {ast.unparse(target)}")
        return [f"{place.text} = {self.as_number(value, node).text};"]

    def _put_name(self, name: str, value: Value, node: ast.AST) -> list[str]:
        if name == "_":
            return []
        if self.bindings[name] == 1 and name not in self.parameters and stays(value):
            self.aliases[name] = value
            return []
        value = self._held(value, node)
        kind = joined(self.kinds.get(name), value.kind)
        if kind is None or isinstance(kind, Record | Known):
            raise self.error(node, f"{name}, which stands for things of two kinds")
        self.kinds[name] = kind
        text = self.program.local(name)
        if isinstance(kind, Lanes):
            return [f"{_EVERY_LANE} {text}[lane] = {value.text};"]
        if not isinstance(kind, Array):
            return [f"{text} = {value.text};"]
        lines = [f"{text} = {pointer(value)};"]
        for axis, size in enumerate(kind.dims):
            if size is None:
                lines.append(f"{text}_n{axis} = {value.dims[axis]};")
        return lines
