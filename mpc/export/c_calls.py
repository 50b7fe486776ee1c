"""Calls in a compiled function: of other compiled functions, and of what C has itself."""

import ast
from types import FunctionType
from typing import Any

from numba.core.dispatcher import Dispatcher

from mpc.export import c_known as known
from mpc.export.c_expressions import Expressions
from mpc.export.c_kinds import DOUBLE, INTEGER, Known, Lanes, Value, joined, plus


class Calls(Expressions):
    """Expressions with calls."""

    def _call(self, node: ast.Call) -> Value:
        if node.keywords or any(isinstance(one, ast.Starred) for one in node.args):
            raise self.error(node, f"arguments by name in {ast.unparse(node)}")
        target = self.value(node.func)
        function = target.kind.value if isinstance(target.kind, Known) else None
        arguments = [self.value(one) for one in node.args]
        found = self._known_call(function, arguments, node)
        if found is not None:
            return found
        if isinstance(function, Dispatcher | FunctionType):
            answer: Value = self.program.call(function, arguments, self, node)
            return answer
        raise self.error(node, f"a call of {ast.unparse(node.func)}")

    def _known_call(self, function: Any, arguments: list[Value], node: ast.Call) -> Value | None:
        if any(function is one for one in known.AS_THEY_ARE) or self.program.stands_for(function):
            return self.program.stands_for(function) or arguments[0]
        if function in (known.LOAD, known.STORE):
            array, first = arguments[0], self.as_number(arguments[1], node)
            place = plus(plus(array.offset, first.text), "lane")
            return Value(Lanes(), f"{array.operand}[{place}]")
        if function is known.SPREAD:
            return Value(Lanes(), self.as_number(arguments[0], node).text)
        if function is known.TOTAL:
            if not isinstance(node.args[0], ast.Name):
                raise self.error(node, f"the sum of an expression: {ast.unparse(node)}")
            name = self.program.local(node.args[0].id)
            return Value(DOUBLE, self.program.helper("total", name))
        if (
            function not in (*known.CASTS, known.WHERE, *known.FOLDED)
            and function not in known.OF_C
        ):
            return None
        numbers = [self.as_number(one, node) for one in arguments]
        if function in known.CASTS:
            kind = known.CASTS[function]
            return Value(kind, f"({kind.name}){numbers[0].operand}")
        if function is known.WHERE:
            return self.chosen(*numbers)
        if function in known.FOLDED:
            return self._folded(function, numbers)
        name, kind = known.OF_C[function]
        if len(numbers) != 1 or (function is abs and numbers[0].kind == INTEGER):
            raise self.error(node, f"the call {ast.unparse(node)}")
        return Value(kind, f"{name}({numbers[0].text})")

    def _folded(self, function: Any, numbers: list[Value]) -> Value:
        result = numbers[0]
        for other in numbers[1:]:
            kind = joined(result.kind, other.kind)
            text = known.FOLDED[function](result.text, other.text)
            name, _, rest = text.partition("(")
            if kind == INTEGER:
                name += "_whole"
            result = Value(kind, self.program.helper(name, rest.removesuffix(")")))
        return result
