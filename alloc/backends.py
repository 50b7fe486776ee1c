"""The laws of `alloc.laws` for compiled code and for CasADi: the same text, with other elementary operations in its
scope.

`compiled.gradient_force(...)` and `symbolic.gradient_force(...)` are `laws.gradient_force` for Numba and for CasADi. In
compiled code `where(c, a, b)` becomes `a if c else b`, so that of two expensive sides one is computed.
"""

import ast
import inspect
import math
from types import FunctionType, ModuleType
from typing import Any

from numba import njit

from alloc import laws


class _Lazy(ast.NodeTransformer):
    def visit_Call(self, node: ast.Call) -> ast.expr:
        self.generic_visit(node)
        if isinstance(node.func, ast.Name) and node.func.id == "where":
            return ast.copy_location(ast.IfExp(*node.args), node)
        return node


def _make_laws(name: str, tree: ast.Module, finish: Any = None, **operations: Any) -> Any:
    """A module of the laws as `tree` has them, with these operations; each law is passed through `finish`."""
    module = ModuleType(f"{laws.__name__}_{name}")
    scope = vars(module)
    scope["__name__"] = laws.__name__
    exec(compile(ast.fix_missing_locations(tree), str(laws.__file__), "exec"), scope)
    scope.update(operations)
    for key, law in list(scope.items()):
        if finish and isinstance(law, FunctionType) and law.__module__ == laws.__name__:
            scope[key] = finish(law)
    return module  # Numba reads attributes of modules


@njit(inline="always")
def _maximum(a, b):
    return a if a > b else b


@njit(inline="always")
def _minimum(a, b):
    return a if a < b else b


_TEXT = inspect.getsource(laws)
compiled: Any = _make_laws(
    "compiled", _Lazy().visit(ast.parse(_TEXT)), njit(error_model="numpy", inline="always"),
    maximum=_maximum, minimum=_minimum, absolute=abs, exp=math.exp, sqrt=math.sqrt, copysign=math.copysign,
    atan=math.atan, sine=math.sin,
)  # fmt: skip


def __getattr__(name: str) -> Any:
    """`symbolic`, made when it is asked for: CasADi takes longer to import than a run takes."""
    if name != "symbolic":
        raise AttributeError(f"module {__name__!r} has no attribute {name!r}")
    import casadi

    globals()[name] = _make_laws(
        name, ast.parse(_TEXT),
        where=casadi.if_else, maximum=casadi.fmax, minimum=casadi.fmin, absolute=casadi.fabs, exp=casadi.exp,
        sqrt=casadi.sqrt, copysign=lambda a, b: a * casadi.sign(b), atan=casadi.atan, sine=casadi.sin,
    )  # fmt: skip
    return globals()[name]
