"""What rules and controllers are made of: functions on rows of the tables, with one signature each.

    law(units, run) -> level               how a rule shares: from `cap`, `mass`, `most`, `run.needed`; writes `wanted`
    belief(tick, units, said, heard, run)  what the leader believes: fills `cap`; whether the law is asked now
    control(unit, axles, memory, run)      readhesion control of a unit: turns `torque_target` into `torque_command`

Decorated, each is compiled by itself, and the loop of a run, compiled once, calls it as a first-class function. Undecorated,
the same function is served by Python: `unit.limit` reads in both.
"""

from collections.abc import Callable
from typing import Any

from numba import boolean, float64, int64, types, void

from alloc.columns import AXLE, RUN, UNIT
from alloc.compilation import jit

LAW = float64(UNIT.type, RUN.row)
BELIEF = boolean(int64, UNIT.type, UNIT.said[:, ::1], int64[:, ::1], RUN.row)
CONTROL = void(UNIT.row, AXLE.type, float64[::1], RUN.row)
LAW_TYPE, BELIEF_TYPE, CONTROL_TYPE = (types.FunctionType(one) for one in (LAW, BELIEF, CONTROL))

law: Any = jit
"""Decorator of a compiled `law(units, run) -> level` [1]; nan for a rule without one. It may set `run.case`."""
belief: Any = jit
"""Decorator of a compiled `belief(tick, units, said, heard, run) -> bool`.

`said[s, j]`: recorded columns of unit j at tick s. `heard[tick, j]`: tick of the newest telegram of unit j that has arrived;
where that is `tick` the unit's own row counts, which is not recorded yet.
"""
control: Any = jit
"""Decorator of a compiled `control(unit, axles, memory, run)`.

`axles`: from the unit's foremost to its hindmost; those in between whose `unit` is negative are not driven. `memory`: the
controller's own row of this unit, read as `memory.view(ROW)[0]`.
"""


def are_compiled(*functions: Callable[..., Any]) -> bool:
    """Whether all of them are compiled, so that the loop of a run can call them."""
    return all(hasattr(one, "py_func") for one in functions)
