"""Sensitivities of a Runge-Kutta step of a model, written out from where its Jacobian has nonzeros.

Few of a model's numbers depend on each other. A loop over lists of its nonzeros takes most of its time to read the lists.
Here every product stands in the source, and a block of sensitivities stays in registers through the four stages.
"""

from typing import Any

from alloc.plant.structure import Ints
from mpc.generated import compile_source

_BEGIN = """
from alloc.plant.simd import WIDTH, load, spread, store
from mpc.arrays import TANGENT


@sweep(TANGENT.signature)
def tangent(jacobians, step, moved, torques):
    half, third, sixth = 0.5 * step, step / 3.0, step / 6.0
    for m in range(0, moved.shape[1], WIDTH):
"""


def tangent_source(row: Ints, column: Ints, states: int, units: int) -> str:
    """Source of a function (jacobians, step, moved, torques) of the kind `mpc.arrays.TANGENT`.

    `jacobians` (4, nonzeros) are those of the slopes by (state, torques) at the step's four evaluations, with nonzeros at
    `row`, `column`; where a place comes twice, values add up. `moved` (states, width) is the sensitivity of the state before
    the step, and of that after it in the end; `torques` (units, width) that of the torques.
    """
    terms: list[list[str]] = [[] for _ in range(states)]
    for number, (i, j) in enumerate(zip(row.tolist(), column.tolist(), strict=True)):
        terms[i].append(f"j[{number}] * {{x}}{j}" if j < states else f"j[{number}] * t{j - states}")
    lines = [f"t{k} = load(torques[{k}], m)" for k in range(units)]
    lines += [f"a{i} = load(moved[{i}], m)" for i in range(states)]
    point = "a"
    for stage, (onward, following) in enumerate(
        (("half", "b"), ("half", "d"), ("step", "e"), ("", ""))
    ):
        lines.append(f"j = jacobians[{stage}]")
        share = "sixth" if stage in (0, 3) else "third"
        for i in range(states):
            rate = " + ".join(terms[i]).format(x=point) or "spread(0.0)"
            lines += [f"r = {rate}", f"c{i} = {'a' if stage == 0 else 'c'}{i} + {share} * r"]
            if following:
                lines.append(f"{following}{i} = a{i} + {onward} * r")
        point = following
    lines += [f"store(moved[{i}], m, c{i})" for i in range(states)]
    return _BEGIN + "".join(f"        {line}\n" for line in lines)


def compile_tangent(row: Ints, column: Ints, states: int, units: int) -> Any:
    """The function of `tangent_source`, compiled once per machine and pattern."""
    return compile_source(tangent_source(row, column, states, units))["tangent"]
