"""From the units' torque targets to their torque commands, by the readhesion controller of the run."""

from typing import Any

from alloc.compilation import equation, inlined_jit
from alloc.onboard.controllers.collection import BUILT_IN


def _case(index: int, law: Any) -> Any:
    """Law of a unit under the controller of this index."""

    @equation
    def follow(eq, st, m, j, commanded):
        return law(eq, st, m, st.law[index], m.law[index], j, commanded)

    return follow


def _either(first: Any, below: int, second: Any) -> Any:
    """`first` for controllers of an index below this, else `second`."""

    @equation
    def choose(eq, st, m, j, commanded):
        if st.controller < below:
            return first(eq, st, m, j, commanded)
        else:
            return second(eq, st, m, j, commanded)

    return choose


def _tree(cases: list[Any], start: int) -> Any:
    """Choice among `cases`, the first of index `start`; halved, for the compiler goes through all at every level."""
    if len(cases) == 1:
        return cases[0]
    half = len(cases) // 2
    return _either(_tree(cases[:half], start), start + half, _tree(cases[half:], start + half))


_command: Any = _tree([_case(k, one.law) for k, one in enumerate(BUILT_IN.values())], 0)


@inlined_jit
def control(eq, st, m, commanded):
    """Torque commands of all units, and the share of its target that each is.

    Under a hosted controller these are its reserve; the share is then that of the host, which is not known yet.
    """
    for j in range(eq.axles.size):
        share = _command(eq, st, m, j, commanded)
        if not st.hosted:
            m.unit.torque_factor[j] = share
