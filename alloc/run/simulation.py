"""One slip event under a rule and a readhesion controller.

In: an `Event`, a rule, a controller, by name or as objects. Out: the recorded run, an `xarray.Dataset` (see
`alloc.run.recording`). The loop is compiled where rule and controller are; else the same pieces are called from Python once
a control period.
"""

import time
from dataclasses import replace
from functools import cache
from typing import Any

import numpy as np
import xarray as xr
from numba import boolean, int64, typeof, void
from numba.extending import register_jitable

from alloc.compilation import jit, part
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.onboard.reference_speed import ease
from alloc.onboard.sensing import report, sense
from alloc.onboard.signatures import (
    BELIEF,
    BELIEF_TYPE,
    CONTROL,
    CONTROL_TYPE,
    SHARE,
    SHARE_TYPE,
    are_compiled,
)
from alloc.onboard.slide_protection import protect
from alloc.onboard.targets import ask_brakes, foresee, set_brake_targets, set_targets, trailers_lack
from alloc.onboard.telegrams import set_limits
from alloc.plant.dynamics import advance, derivative, note, true_limits
from alloc.rules import RULES, Rule
from alloc.rules.baselines import case_of
from alloc.rules.problem import ROUNDING
from alloc.run.event import Event
from alloc.run.recording import dataset, room
from alloc.schema.errors import SimulationError, blamed_on
from alloc.schema.registry import Registry


def simulate(
    event: Event, rule: str | Rule = "cooperative", controller: str | Controller = "perturb-observe"
) -> xr.Dataset:
    """Run an event; returns the recorded run.

    Raises `InputError` for a part that does not exist or cannot be compiled, `UnsoundRun` for a run whose state is no
    number.
    """
    run = Simulation(event, rule, controller)
    run.go_on()
    return run.recorded()


class Simulation:
    """A run that can be stopped between control instants: `go_on` to the end, or `aim`, commands of one's own, and `go`."""

    def __init__(self, event: Event, rule: str | Rule, controller: str | Controller) -> None:
        if not isinstance(event, Event):
            hint = "readhesion.simulate takes names too"
            if hasattr(event, "event"):  # a scenario
                hint = "its method event(seed) gives one"
            raise SimulationError(f"{event!r:.60} is no Event: {hint}")
        self.rule: Rule = _part(RULES, Rule, rule)
        self.controller: Controller = _part(CONTROLLERS, Controller, controller)
        if self.rule.settings:
            onboard = event.onboard.with_settings(self.rule.settings)
            event = replace(event, onboard=onboard)
        self.event, world = event, event.world()
        self.knows = self.rule.belief.knows
        if self.knows:  # what no train can know: the true speed, orders that take no time, and no need of readhesion
            self.controller = CONTROLLERS["none"]
            world.onboard.true_speed[:] = 1
            world.order_tick[:] = np.arange(world.command.size)[:, None]
        self.world = world._replace(memory=self.controller.rows(world.units.size))
        self.record = room(self.world)
        self.tick, self.wall_time = 0, 0.0

    @property
    def ticks(self) -> int:
        """Number of control instants."""
        return int(self.world.command.size)

    def go_on(self) -> None:
        """Run to the end, from where the run is."""
        started = time.perf_counter()
        parts: Any = (
            (f"belief {self.rule.belief.name!r}", self.rule.belief.function, BELIEF),
            (f"rule {self.rule.name!r}", self.rule.share, SHARE),
            (f"controller {self.controller.name!r}", self.controller.control, CONTROL),
        )
        served = [one if are_compiled(one) else blamed_on(name, one)(one) for name, one, _ in parts]
        if are_compiled(*served):
            for name, one, signature in parts:
                with blamed_on(name, one):
                    one.compile(signature)
            loop = compiled_steps(typeof(self.world), typeof(self.record))
            loop(*served, self.knows, self.tick, self.world, self.record)
        else:
            in_python: Any = steps
            # as compiled code has it
            with np.errstate(all="ignore"), blamed_on(f"{parts[1][0]} or {parts[2][0]}"):
                in_python(*served, self.knows, self.tick, self.world, self.record)
        limits, period = self.record.units.wanted, self.event.onboard.period
        with blamed_on(f"rule {self.rule.name!r}", self.rule.share):
            for k, j in np.argwhere(~(limits >= -ROUNDING))[:1]:
                raise SimulationError(f"limit[{j}] is {limits[k, j]:.6g} at {k * period:g} s")
        self.tick = self.ticks
        self.wall_time += time.perf_counter() - started

    def aim(self) -> None:
        """Go to the next instant's targets: readings, belief, rule, limits."""
        belief, share = self.rule.belief.function, self.rule.share
        aim(belief, share, self.knows, self.tick, self.world, self.record)

    def command(self) -> None:
        """Have the controller command torques for these targets, in `world.units.torque_command`."""
        command(self.controller.control, self.world)

    def go(self) -> None:
        """Go to the next instant with the torques that `world.units.torque_command` has."""
        go(self.tick, self.world, self.record)
        self.tick += 1

    def recorded(self) -> xr.Dataset:
        """The run up to here; raises `UnsoundRun` where its state is no number."""
        names = self.rule.name, self.controller.name
        return dataset(self.event, *names, self.world, self.record, self.tick, self.wall_time)


def _part(registry: Registry[Any], kind: type, given: Any) -> Any:
    """The part that is given, by its name or as itself."""
    if isinstance(given, str):
        return registry.find(given)
    if not isinstance(given, kind):
        hint = f"give its name, or {kind.__name__}(...)"
        if isinstance(given, list | tuple):
            hint = "a run has one; `readhesion.compare` takes several"
        raise SimulationError(f"{registry.kind} = {given!r:.60}: {hint}")
    return given


# An instant, in its order. Each piece is inlined in the loop, and compiled by itself where Python calls it.


@part
def listen(k, w):
    """Command and readings of instant k, and what each unit would say of itself."""
    run, onboard, plant = w.run[0], w.onboard[0], w.plant[0]
    run.time = k * run.period
    asked = w.command[k]
    if asked < 0.0 and run.reference_speed < onboard.release_speed:
        asked = 0.0  # the driver releases the brakes, so that a stop ends rolling
    run.driver_command = asked
    run.sign = 1.0 if asked >= 0.0 else -1.0
    run.braking = 1 if onboard.blended and asked < 0.0 else 0
    size = abs(asked)
    run.plan = size * (onboard.brake_planned if run.braking else onboard.planned)
    run.planned_coefficient = size * (plant.brake_planned if run.braking else plant.planned)
    if w.units.size > 0:
        run.leader = w.leader[k]
    if k == 0:
        for u in w.units:
            u.delivered = run.plan
    sense(
        w.state, w.noise[k % w.noise.shape[0]], w.axles, w.cars, w.units, w.brakes, w.effort, w.retard, plant, onboard, run
    )  # fmt: skip
    report(w.units, run)
    run.needed = run.plan
    if run.braking:
        run.needed += trailers_lack(w.units, w.brakes, run)


@part
def set_aims(k, w, record):
    """Limits that have arrived, and what they ask of motors and air."""
    run, onboard = w.run[0], w.onboard[0]
    set_limits(k, w.units, w.order_tick, record.units, onboard, run)
    if run.braking:
        set_brake_targets(w.units, onboard, run)
    else:
        set_targets(w.units, onboard, run)


@part
def go(k, w, record):
    """Command motors and valves, write the instant down, and go to the next."""
    run = w.run[0]
    ease(w.units, w.onboard[0], run)
    foresee(w.units, run)
    protect(k, w.axles, w.brakes, w.slide[0], run)
    ask_brakes(w.axles, w.units, w.brakes, w.onboard[0], run)
    write_down_and_advance(k, w, record)


@part
def write_down_and_advance(k, w, record):
    """The plant at instant k as it is recorded, and a control period under what motors and valves are commanded."""
    plant, run = w.plant[0], w.run[0]
    derivative(
        run.time, w.state, w.stages[0], w.axles, w.cars, w.units, w.brakes, w.patches, w.line, w.effort, w.retard,
        w.curve, w.scatter, plant,
    )  # fmt: skip
    note(w.state, w.stages[0], w.axles, w.cars, w.units, w.brakes, plant, run)
    for n in range(len(record.kept)):  # recorded columns are the first words of a row
        live, kept = record.live[n], record.kept[n]
        for i in range(kept.shape[1]):
            for c in range(kept.shape[2]):
                kept[k, i, c] = live[i, c]
    advance(
        run.time, w.state, w.stages, w.axles, w.cars, w.units, w.brakes, w.patches, w.line, w.effort, w.retard, w.curve,
        w.scatter, w.rail, plant, record.brakes,
    )  # fmt: skip


# Both may be called from Python, with parts in Python, and from the compiled loop.


@register_jitable(inline="always")
def aim(belief, share, knows, k, w, record):
    """Up to the targets of instant k."""
    run = w.run[0]
    listen(k, w)
    if knows:
        true_limits(
            run.time, w.state, w.stages, w.axles, w.cars, w.units, w.brakes, w.patches, w.line, w.effort, w.retard,
            w.curve, w.scatter, w.plant[0], run,
        )  # fmt: skip
    if belief(k, w.units, record.units, w.report_tick, run):
        run.asked += 1
        run.case = 0
        run.level = share(w.units, run)
        if run.case == 0:
            run.case = case_of(w.units, run)
    set_aims(k, w, record)


@register_jitable(inline="always")
def command(control, w):
    """What the readhesion controller of each unit commands."""
    axles, units, memory, run = w.axles, w.units, w.memory, w.run[0]
    for j in range(units.size):
        control(units[j], axles[units[j].first : units[j].last], memory[j], run)


def steps(belief, share, control, knows, first, w, record):
    """All instants from `first` on."""
    for k in range(first, w.command.size):
        aim(belief, share, knows, k, w, record)
        command(control, w)
        go(k, w, record)


@cache
def compiled_steps(*kinds: Any) -> Any:
    """`steps` for compiled parts, which it calls by their addresses, so it is compiled once for all of them.

    `kinds`: Numba's types of a world and a record, which are those of any other.
    """
    return jit(void(BELIEF_TYPE, SHARE_TYPE, CONTROL_TYPE, boolean, int64, *kinds))(steps)
