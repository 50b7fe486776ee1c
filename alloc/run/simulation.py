"""One slip event under a rule and a readhesion controller.

In: an `Event`, a rule, a controller, by name or as objects. Out: the recorded run, an `xarray.Dataset` (see
`alloc.run.recording`). The loop is compiled, and compiled once: it calls belief, rule and controller as first-class
functions, and those in plain Python through `alloc.run.serving`.
"""

import time
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import xarray as xr
from numba import boolean, int64, typeof, void

from alloc.compilation import compile_once, jit_inline, jit_threaded
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.onboard.reference_speed import ease_units
from alloc.onboard.sensing import report_units, sense_train
from alloc.onboard.signatures import BELIEF_TYPE, CONTROL_TYPE, SHARE_TYPE
from alloc.onboard.slide_protection import protect_wheels
from alloc.onboard.targets import (
    ask_brakes,
    foresee_torques,
    set_brake_targets,
    set_targets,
    trailers_lack,
)
from alloc.onboard.telegrams import set_limits
from alloc.plant.dynamics import advance_period, derivative, note_instant
from alloc.rules import RULES, Rule
from alloc.rules.baselines import find_case
from alloc.rules.problem import ROUNDING
from alloc.run import wire
from alloc.run.event import Event
from alloc.run.recording import Recording, make_dataset, make_room
from alloc.run.serving import Parts
from alloc.run.world import TRUE, World
from alloc.schema.errors import SimulationError, blamed_on
from alloc.schema.registry import find_part


def simulate(
    event: Event, rule: str | Rule = "cooperative", controller: str | Controller = "perturb-observe"
) -> xr.Dataset:
    """Run an event; returns the recorded run.

    Raises `InputError` for a part that does not exist or cannot be compiled, `UnsoundRun` for a run whose state is no
    number.
    """
    run = Simulation(event, rule, controller)
    run.run_to_end()
    return run.recorded()


READ, PLAN, COMMAND, BRAKE, ADVANCE = range(5)
"""Steps of a control instant: readings; belief, rule and targets; the controllers' torques; brakes; the plant's period."""
STEPS = 5


class Simulation:
    """A run that can be stopped between the steps of its control instants.

    `run_to_end`, or step by step: `run_to(PLAN)`, `run_to(COMMAND)` or torques of another, `run_to(ADVANCE)`.
    """

    def __init__(self, event: Event, rule: str | Rule, controller: str | Controller) -> None:
        if not isinstance(event, Event):
            hint = "readhesion.simulate takes names too"
            if hasattr(event, "event"):  # a scenario
                hint = "its method event(seed) gives one"
            raise SimulationError(f"{event!r:.60} is no Event: {hint}")
        self.rule: Rule = find_part(RULES, rule, isinstance(rule, Rule))
        self.controller: Controller = find_part(
            CONTROLLERS, controller, isinstance(controller, Controller)
        )
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
        self.recording = make_room(self.world)
        self._parts = Parts(
            self.rule.belief, self.rule, self.controller, self.world, self.recording
        )
        self._step, self.wall_time = 0, 0.0

    @property
    def ticks(self) -> int:
        """Number of control instants."""
        return int(self.world.command.size)

    @property
    def tick(self) -> int:
        """Number of control instants that have ended."""
        return self._step // STEPS

    def run_to_end(self) -> None:
        """Run to the end, from where the run is."""
        self._run_until(self.ticks * STEPS)
        limits, period = self.recording.units.wanted, self.event.onboard.period
        with blamed_on(f"rule {self.rule.name!r}", self.rule.share):
            for k, j in np.argwhere(~(limits >= -ROUNDING))[:1]:
                raise SimulationError(f"limit[{j}] is {limits[k, j]:.6g} at {k * period:g} s")

    def run_to(self, step: int) -> None:
        """Run until the next such step is made: `READ`, `PLAN`, `COMMAND` into `world.units.torque_command`, `BRAKE`,
        `ADVANCE`."""
        self._run_until(self._step + (step - self._step) % STEPS + 1)

    def run_blind(self) -> None:
        """Run to the end with all that is true nan between `wire.read` and `wire.apply`.

        The law of the house: what computers on board command must be the same. Slow, for tests and `check_controller`.
        """
        truth = [getattr(self.world, name) for name in TRUE]
        while self.tick < self.ticks:
            self.run_to(READ)
            hidden = [table.copy() for table in truth]
            for table in truth:
                for column in table.dtype.names or (...,):
                    table[column] = np.nan if table[column].dtype.kind == "f" else 0
            self.run_to(BRAKE)
            for table, values in zip(truth, hidden, strict=True):
                table[...] = values
            self.run_to(ADVANCE)

    def _run_until(self, last: int) -> None:
        started = time.perf_counter()
        with self._parts.serving():
            run_loop(
                self._parts.functions, self.knows, self._step, last, self.world, self.recording
            )
        self._step = last
        self.wall_time += time.perf_counter() - started

    def recorded(self) -> xr.Dataset:
        """The run up to here; raises `UnsoundRun` where its state is no number."""
        names = self.rule.name, self.controller.name
        return make_dataset(
            self.event, *names, self.world, self.recording, self.tick, self.wall_time
        )


def run_loop(
    functions: Sequence[Any], knows: bool, first: int, last: int, w: World, recording: Recording
) -> None:
    """Steps `first` to `last` of a run, `STEPS` an instant, with compiled belief, rule and controller.

    The loop calls them by their addresses, so it is compiled once for all of them; a world has the types of any other.
    """
    kinds = BELIEF_TYPE, SHARE_TYPE, CONTROL_TYPE, boolean, int64, int64
    compile_once(run_steps, lambda: void(*kinds, typeof(w), typeof(recording)))
    run_steps(*functions, knows, first, last, w, recording)


# An instant, in its order. Each piece is inlined in the loop.
#
# Arrays are handed on one by one. A world handed down would be shorter to write, but compiled code counts references to each
# of its arrays at every call, which made a run a fifth slower.


@jit_inline
def read_inputs(k, w):
    """The driver's command and the readings of instant k."""
    run, onboard, plant = w.run[0], w.onboard[0], w.plant[0]
    run.time = k * run.period
    command = w.command[k]
    if command < 0.0 and run.reference_speed < onboard.release_speed:
        command = 0.0  # the driver releases the brakes, so that a stop ends rolling
    run.driver_command = command
    run.sign = 1.0 if command >= 0.0 else -1.0
    run.braking = 1 if onboard.blended and command < 0.0 else 0
    if w.units.size > 0:
        run.leader = w.leader[k]
    noise = w.noise[k % w.noise.shape[0]]
    wire.read(
        w.state, noise, w.wheelsets, w.cars, w.drives, w.cylinders, plant, w.axles, w.units, w.brakes, onboard, run
    )  # fmt: skip
    if onboard.true_speed:
        wire.tell_speed(w.state, w.wheelsets, w.cars, w.drives, w.cylinders, plant, w.axles, run)


@jit_inline
def tell_oracle(w):
    """What each unit and each trailer's brake can truly carry."""
    wire.tell_limits(
        w.run[0].time, w.state, w.stages, w.wheelsets, w.cars, w.drives, w.cylinders, w.patches, w.line, w.effort,
        w.retard, w.curve, w.scatter, w.plant[0], w.units, w.brakes, w.run[0],
    )  # fmt: skip


@jit_inline
def sense_instant(k, w):
    """What follows from the readings, what each unit would say of itself, and what the plan needs."""
    run, onboard = w.run[0], w.onboard[0]
    per_acceleration = onboard.brake_planned if run.braking else onboard.planned
    run.plan = abs(run.driver_command) * per_acceleration
    if k == 0:
        for u in w.units:
            u.delivered = run.plan
    sense_train(w.axles, w.units, w.brakes, w.rated_effort, w.rated_retard, onboard, run)
    report_units(w.units, run)
    run.needed = run.plan
    if run.braking:
        run.needed += trailers_lack(w.units, w.brakes, run)


@jit_inline
def set_instant_targets(k, w, recording):
    """Limits that have arrived, and what they ask of motors and air."""
    run, onboard = w.run[0], w.onboard[0]
    set_limits(k, w.units, w.order_tick, recording.units, onboard, run)
    if run.braking:
        set_brake_targets(w.units, onboard, run)
    else:
        set_targets(w.units, onboard, run)


@jit_inline
def command_brakes(k, w):
    """What motors are commanded after easing, and what valves and cylinders are."""
    run = w.run[0]
    ease_units(w.units, w.onboard[0], run)
    foresee_torques(w.units, run)
    protect_wheels(k, w.axles, w.brakes, w.slide[0], run)
    ask_brakes(w.axles, w.units, w.brakes, w.onboard[0], run)


@jit_inline
def record_and_advance(k, w, recording):
    """Commands go to the plant; the instant as it is recorded; a control period under these commands."""
    plant, run = w.plant[0], w.run[0]
    wire.apply(w.drives, w.cylinders, plant, w.units, w.brakes, run)
    derivative(
        run.time, w.state, w.stages[0], w.wheelsets, w.cars, w.drives, w.cylinders, w.patches, w.line, w.effort,
        w.retard, w.curve, w.scatter, plant,
    )  # fmt: skip
    note_instant(w.state, w.stages[0], w.wheelsets, w.cars, w.drives, w.cylinders, plant)
    # Recorded columns are the first words of a row: one copy of words serves columns of all types, where rows of two types
    # would be copied field by field.
    for n in range(len(recording.memory)):
        live, memory = recording.live[n], recording.memory[n]
        for i in range(memory.shape[1]):
            for c in range(memory.shape[2]):
                memory[k, i, c] = live[i, c]
    advance_period(
        run.time, w.state, w.stages, w.wheelsets, w.cars, w.drives, w.cylinders, w.patches, w.line, w.effort, w.retard,
        w.curve, w.scatter, w.rail, plant, recording.cylinders,
    )  # fmt: skip


@jit_inline
def call_rule(belief, share, k, w, recording):
    """What the leader believes, and where it asks its rule, the limits that it orders."""
    run = w.run[0]
    if belief(k, w.units, recording.units, w.report_tick, run):
        run.asked += 1
        run.case = 0
        run.level = share(w.units, run)
        if run.case == 0:
            run.case = find_case(w.units, run)


@jit_inline
def command_units(control, w):
    """What the readhesion controller of each unit commands."""
    axles, units, memory, run = w.axles, w.units, w.memory, w.run[0]
    for j in range(units.size):
        control(units[j], axles[units[j].first : units[j].last], memory[j], run)


@jit_threaded
def run_steps(belief, share, control, knows, first, last, w, recording):
    """Steps `first` to `last`, until a part in Python has raised an error."""
    run = w.run[0]
    for n in range(first, last):
        k, step = n // STEPS, n % STEPS
        if step == READ:
            read_inputs(k, w)
            if knows:
                tell_oracle(w)
        elif step == PLAN:
            sense_instant(k, w)
            call_rule(belief, share, k, w, recording)
            set_instant_targets(k, w, recording)
        elif step == COMMAND:
            command_units(control, w)
        elif step == BRAKE:
            command_brakes(k, w)
        else:
            record_and_advance(k, w, recording)
        if run.stopped == 1:
            break
