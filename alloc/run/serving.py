"""Parts of a run in plain Python, which its compiled loop calls.

A compiled stand-in goes through Numba's object mode. It hands over numbers alone: to box rows takes twenty times as long as
the call, and Python has the same memory.
"""

import threading
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np
from numba import objmode

from alloc.compilation import jit, signals_afterwards
from alloc.onboard.signatures import BELIEF, CONTROL, SHARE, are_compiled
from alloc.run.recording import Recording
from alloc.run.world import World
from alloc.schema.errors import blamed_on

BELIEVES, SHARES, CONTROLS = range(3)
"""The parts of a run."""
_SERVED = threading.local()
"""Of each thread the `parts` of its run; a part may run an event itself."""


class Parts:
    """Belief, rule and controller of a run, each compiled or in plain Python."""

    def __init__(
        self, belief: Any, rule: Any, controller: Any, world: World, recording: Recording
    ) -> None:
        w, run = world, world.run[0]
        units, reports = w.units, recording.units
        rows = [
            (unit, w.axles[unit.first : unit.last], w.memory[j], run)
            for j, unit in enumerate(units)
        ]
        believe, share, control = belief.function, rule.share, controller.control
        self.run, self.error = run, None
        self.parts = (
            (f"belief {belief.name!r}", believe),
            (f"rule {rule.name!r}", share),
            (f"controller {controller.name!r}", control),
        )
        stand_ins = (BELIEF, served_belief), (SHARE, served_share), (CONTROL, served_control)
        self.functions = []
        for (name, function), (signature, stand_in) in zip(self.parts, stand_ins, strict=True):
            compiled = function if are_compiled(function) else stand_in
            with blamed_on(name, function):
                compiled.compile(signature)
            self.functions.append(compiled)
        self.calls: Any = (
            lambda tick: bool(believe(tick, units, reports, w.report_tick, run)),
            lambda _: float(share(units, run)),
            lambda j: control(*rows[j]),
        )

    @contextmanager
    def serving(self) -> Iterator[None]:
        """While a loop runs; raises what a part in Python raised."""
        before, _SERVED.parts = getattr(_SERVED, "parts", None), self
        try:
            # errors of numbers as compiled code has them
            with signals_afterwards() as self.handle_signals, np.errstate(all="ignore"):
                yield
        finally:
            _SERVED.parts = before
        if self.error is not None:
            part, error = self.error
            with blamed_on(*self.parts[part]):
                raise error


def serve(part: int, number: int) -> Any:
    """Call a part of this thread's run."""
    return call_python(part, _SERVED.parts.calls[part], number)


def call_python(part: int, function: Any, *values: Any) -> Any:
    """What `function` gives for these `values`, for a compiled `part` of this thread's run; 0 where it raises.

    An error that passed through compiled code would keep the run's memory for good, so the loop is stopped; a signal is
    handled before the call. Beside a run, as in a test of a controller, errors are raised.
    """
    parts = getattr(_SERVED, "parts", None)
    if parts is None:
        return function(*values)
    try:
        parts.handle_signals()
        return function(*values)
    except BaseException as error:
        parts.error, parts.run.stopped = (part, error), 1
        return 0.0


@jit
def served_belief(tick, units, reports, report_tick, run):
    """Stands for a `belief` in plain Python."""
    with objmode(asks="float64"):
        asks = serve(BELIEVES, tick)
    return asks != 0.0


@jit
def served_share(units, run):
    """Stands for a `share` in plain Python."""
    with objmode(level="float64"):
        level = serve(SHARES, 0)
    return level  # noqa: RET504 (nothing can be returned from within)


@jit
def served_control(unit, axles, memory, run):
    """Stands for a `control` in plain Python."""
    j = axles[0].unit
    with objmode():
        serve(CONTROLS, j)
