"""What rules and controllers are made of: functions on rows of the tables, with one signature each.

    share(units, run) -> level                       a rule: from `cap`, `mass_share`, `most`, `run.needed` to `wanted`
    belief(tick, units, reports, report_tick, run)   the leader: fills `cap`; whether the rule is asked now
    control(unit, axles, memory, run)                a controller: turns `torque_target` into `torque_command`

Decorated, each is compiled by itself, and the loop of a run, compiled once, calls it as a first-class function. Undecorated,
the loop calls the same function in Python (`alloc.run.serving`): `unit.limit` reads in both.
"""

from collections.abc import Callable
from typing import Any

from numba import boolean, float64, int64, types, void

from alloc.compilation import jit
from alloc.onboard.columns import AXLE, RUN, UNIT

SHARE = float64(UNIT.type, RUN.row)
BELIEF = boolean(int64, UNIT.type, UNIT.recorded_row[:, ::1], int64[:, ::1], RUN.row)
CONTROL = void(UNIT.row, AXLE.type, float64[::1], RUN.row)
SHARE_TYPE, BELIEF_TYPE, CONTROL_TYPE = (
    types.FunctionType(signature) for signature in (SHARE, BELIEF, CONTROL)
)

share: Any = jit
"""Decorator of a compiled `share(units, run) -> level` [1]; nan for a rule without one. It may set `run.case`."""
belief: Any = jit
"""Decorator of a compiled `belief(tick, units, reports, report_tick, run) -> bool`.

`reports[s, j]`: recorded columns of unit j at tick s. `report_tick[tick, j]`: tick of the newest telegram of unit j that has
arrived; where that is `tick` the unit's own row counts, which is not recorded yet.
"""
control: Any = jit
"""Decorator of a compiled `control(unit, axles, memory, run)`.

`axles`: from the unit's foremost to its hindmost; those in between whose `unit` is negative are not driven. `memory`: the
controller's own row of this unit, read as `memory.view(ROW)[0]`.
"""


def are_compiled(*functions: Callable[..., Any]) -> bool:
    """Whether all of them are compiled, so that the loop of a run can call them."""
    return all(hasattr(function, "py_func") for function in functions)
