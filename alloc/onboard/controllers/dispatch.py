"""From the units' torque targets to their torque commands, by the readhesion controller of the run."""

from typing import Any

from alloc.compilation import equation, inlined_jit
from alloc.onboard.controllers.collection import BUILT_IN


def _case(index: int, law: Any, otherwise: Any) -> Any:
    """Law of a unit: `law` where the run's controller has this index, else `otherwise`."""

    @equation
    def choose(eq, st, m, j, commanded):
        if st.controller == index:
            return law(eq, st, m, st.law[index], m.law[index], j, commanded)
        else:
            return otherwise(eq, st, m, j, commanded)

    return choose


@equation
def _keep_command(eq, st, m, j, commanded):
    return 1.0


_command: Any = _keep_command
for _index, _controller in reversed(list(enumerate(BUILT_IN.values()))):
    _command = _case(_index, _controller.law, _command)


@inlined_jit
def control(eq, st, m, commanded):
    """Torque commands of all units, and the share of its target that each is.

    Under a hosted controller these are its reserve; the share is then that of the host, which is not known yet.
    """
    for j in range(eq.axles.size):
        share = _command(eq, st, m, j, commanded)
        if not st.hosted:
            m.unit.torque_factor[j] = share
