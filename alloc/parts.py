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

law: Any = jit(LAW)
"""Compiled `law(units, run) -> level` [1], nan for a rule without one. `run.case` becomes 1 (A) or 2 (B)."""
belief: Any = jit(BELIEF)
"""Compiled `belief(tick, units, said, heard, run)`. `said[s, j]`: recorded columns of unit j at tick s; `heard[tick, j]`: tick
of the newest telegram of unit j that has arrived; where that is `tick`, the unit's own row counts, not yet recorded."""
control: Any = jit(CONTROL)
"""Compiled `control(unit, axles, memory, run)`. `axles`: from the unit's foremost to its hindmost, those of `axle.unit` < 0 in
between are not driven; `memory`: the controller's own row of this unit, `memory.view(ROW)[0]`."""

LAW_TYPE, BELIEF_TYPE, CONTROL_TYPE = (types.FunctionType(one) for one in (LAW, BELIEF, CONTROL))


def is_compiled(*functions: Callable[..., Any]) -> bool:
    """Whether all of them are compiled, so that the loop of a run can call them."""
    return all(hasattr(one, "py_func") for one in functions)
