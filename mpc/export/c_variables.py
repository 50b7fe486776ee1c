"""Variables of a compiled function in C: which names need one, and how they are declared."""

import ast
import re
from collections import Counter
from typing import Any

from alloc.plant.simd import WIDTH
from mpc.export.c_kinds import (
    DOUBLE,
    INTEGER,
    TRUTH,
    Array,
    Known,
    Lanes,
    Number,
    Record,
    Several,
    Structure,
    Value,
)


def bound_names(body: list[ast.stmt]) -> Counter[str]:
    """How often each name is bound."""
    stores = (node for one in body for node in ast.walk(one) if isinstance(node, ast.Name))
    found = Counter(node.id for node in stores if isinstance(node.ctx, ast.Store))
    for one in body:
        for node in ast.walk(one):
            if isinstance(node, ast.AugAssign) and isinstance(node.target, ast.Name):
                found[node.target.id] += 1
    return found


def loop_scoped(tree: ast.FunctionDef) -> set[str]:
    """Targets of loops that are neither bound nor read elsewhere; of others the last value may count."""
    loops = [node for node in ast.walk(tree) if isinstance(node, ast.For)]
    targets = Counter(node.target.id for node in loops if isinstance(node.target, ast.Name))
    for loop in loops:
        if isinstance(
            loop.target, ast.Name
        ):  # of a loop within one of the same name the last value counts
            within = (node for part in loop.body for node in ast.walk(part))
            targets[loop.target.id] += sum(
                isinstance(node, ast.For) and ast.unparse(node.target) == loop.target.id
                for node in within
            )
    inside: set[int] = set()
    for loop in loops:
        if isinstance(loop.target, ast.Name):
            inside |= {
                id(node)
                for part in (loop.target, *loop.body)
                for node in ast.walk(part)
                if isinstance(node, ast.Name) and node.id == loop.target.id
            }
    other = {n.id for n in ast.walk(tree) if isinstance(n, ast.Name) and id(n) not in inside}
    bound = bound_names(tree.body)
    return {name for name, loops_of in targets.items() if bound[name] == loops_of} - other


def pointer(value: Value) -> str:
    """Where an array begins."""
    return f"{value.text} + {value.offset}" if value.offset not in ("", "0") else value.text


def stays(value: Value) -> bool:
    """Whether a name for `value` needs no variable."""
    if value.parts:
        return all(map(stays, value.parts))
    if isinstance(value.kind, Record):
        return True
    if isinstance(value.kind, Known):
        return not isinstance(value.kind.value, float)
    if isinstance(value.kind, Structure):
        return re.fullmatch(r"&memory[\w.]*\[\d+\]", value.text) is not None
    fixed = isinstance(value.kind, Array) and value.text.startswith("memory")
    return fixed and all(text.isdigit() for text in (*value.dims, value.offset or "0"))


def declarations(function: Any) -> list[str]:
    """Lines that declare the variables of a translated function; all begin as zero."""
    lines = []
    for name, kind in function.kinds.items():
        if name in function.parameters or name in function.scoped:
            continue
        text = function.program.local(name)
        if isinstance(kind, Number):
            zero = {DOUBLE: "0.0", INTEGER: "0", TRUTH: "false"}[kind]
            lines.append(f"  {kind.name} {text} = {zero};")
        elif isinstance(kind, Lanes):
            lines.append(f"  double {text}[{WIDTH}] = {{0.0}};")
        elif isinstance(kind, Several):
            lines.append(f"  {kind.name} {text} = {{0}};")
        elif isinstance(kind, Structure):
            lines.append(f"  {kind.name} *{text} = 0;")
        else:
            lines.append(f"  {kind.element.name} *{text} = 0;")
            sizes = [f"{text}_n{axis}" for axis, size in enumerate(kind.dims) if size is None]
            lines += [f"  int64_t {size} = 0;" for size in sizes]
            lines += [f"  (void){size};" for size in sizes]
        if name not in function.read and not isinstance(kind, Lanes):
            lines.append(f"  (void){text};")
    return lines
