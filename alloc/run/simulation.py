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
from alloc.onboard.reference_speed import ease_units, turn_round
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
        """Run until the next such step is made, or to the end: `READ`, `PLAN`, `COMMAND` into `world.units.torque_command`,
        `BRAKE`, `ADVANCE`."""
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
        started, last = time.perf_counter(), min(last, self.ticks * STEPS)
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
# of its arrays at every call, which made a run a fifth slower, and even where a piece is inlined costs a twentieth.


@jit_inline
def read_inputs(
    k, command, leader, state, noise, wheelsets, cars, drives, cylinders, plant, axles, units, brakes, onboard, run
):  # fmt: skip
    """The driver's command and the readings of instant k."""
    run.time = k * run.period
    wanted = command[k]
    if wanted < 0.0 and run.reference_speed < onboard.release_speed:
        wanted = 0.0  # the driver releases the brakes, so that a stop ends rolling
    run.driver_command = wanted
    before, run.sign = run.sign, 1.0 if wanted >= 0.0 else -1.0
    if run.sign != before and k > 0:
        turn_round(axles, units, run)
    run.braking = 1 if onboard.blended and wanted < 0.0 else 0
    if units.size > 0:
        run.leader = leader[k]
    disturbed = noise[k % noise.shape[0]]
    wire.read(
        state,
        disturbed,
        wheelsets,
        cars,
        drives,
        cylinders,
        plant,
        axles,
        units,
        brakes,
        onboard,
        run,
    )
    if onboard.true_speed:
        wire.tell_speed(state, wheelsets, cars, drives, cylinders, plant, axles, run)


@jit_inline
def sense_instant(k, axles, units, brakes, rated_effort, rated_retard, onboard, run):
    """What follows from the readings, what each unit would say of itself, and what the plan needs."""
    per_acceleration = onboard.brake_planned if run.braking else onboard.planned
    run.plan = abs(run.driver_command) * per_acceleration
    if k == 0:
        for u in units:
            u.delivered = run.plan
    sense_train(axles, units, brakes, rated_effort, rated_retard, onboard, run)
    report_units(units, run)
    run.needed = run.plan
    if run.braking:
        run.needed += trailers_lack(units, brakes, run)


@jit_inline
def call_rule(belief, share, k, units, reports, report_tick, run):
    """What the leader believes, and where it asks its rule, the limits that it orders."""
    if belief(k, units, reports, report_tick, run):
        run.asked += 1
        run.case = 0
        run.level = share(units, run)
        if run.case == 0:
            run.case = find_case(units, run)


@jit_inline
def set_instant_targets(k, units, order_tick, reports, onboard, run):
    """Limits that have arrived, and what they ask of motors and air."""
    set_limits(k, units, order_tick, reports, onboard, run)
    if run.braking:
        set_brake_targets(units, onboard, run)
    else:
        set_targets(units, onboard, run)


@jit_inline
def command_units(control, axles, units, memory, run):
    """What the readhesion controller of each unit commands."""
    for j in range(units.size):
        control(units[j], axles[units[j].first : units[j].last], memory[j], run)


@jit_inline
def command_brakes(k, axles, units, brakes, onboard, slide, run):
    """What motors are commanded after easing, and what valves and cylinders are."""
    ease_units(units, onboard, run)
    foresee_torques(units, run)
    protect_wheels(k, axles, brakes, slide, run)
    ask_brakes(axles, units, brakes, onboard, run)


@jit_inline
def record_and_advance(
    k, state, stages, wheelsets, cars, drives, cylinders, patches, line, effort, retard, curve, scatter, rail,
    plant, units, brakes, run, recording,
):  # fmt: skip
    """Commands go to the plant; the instant as it is recorded; a control period under these commands."""
    wire.apply(drives, cylinders, plant, units, brakes, run)
    derivative(
        run.time, state, stages[0], wheelsets, cars, drives, cylinders, patches, line, effort, retard, curve, scatter,
        plant,
    )  # fmt: skip
    note_instant(state, stages[0], wheelsets, cars, drives, cylinders, plant)
    # Recorded columns are the first words of a row: one copy of words serves columns of all types, where rows of two types
    # would be copied field by field.
    for live, columns in recording.columns:
        for c in range(columns.shape[0]):
            for i in range(columns.shape[2]):
                columns[c, k, i] = live[i, c]
    for live, memory in recording.rows:
        for i in range(memory.shape[1]):
            for c in range(memory.shape[2]):
                memory[k, i, c] = live[i, c]
    advance_period(
        run.time, state, stages, wheelsets, cars, drives, cylinders, patches, line, effort, retard, curve, scatter,
        rail, plant, recording.cylinders,
    )  # fmt: skip


@jit_threaded
def run_steps(belief, share, control, knows, first, last, world, recording):
    """Steps `first` to `last`, until a part in Python has raised an error."""
    (
        state, stages, wheelsets, cars, drives, cylinders, patches, line, plants, effort, retard, curve, scatter, rail,
        noise, axles, units, brakes, onboards, slides, runs, rated_effort, rated_retard, command, leader, report_tick,
        order_tick, memory,
    ) = world  # fmt: skip
    plant, onboard, slide, run = plants[0], onboards[0], slides[0], runs[0]
    for n in range(first, last):
        k, step = n // STEPS, n % STEPS
        if step == READ:
            read_inputs(
                k, command, leader, state, noise, wheelsets, cars, drives, cylinders, plant, axles, units, brakes,
                onboard, run,
            )  # fmt: skip
            if knows:
                wire.tell_limits(
                    run.time, state, stages, wheelsets, cars, drives, cylinders, patches, line, effort, retard, curve,
                    scatter, plant, units, brakes, run,
                )  # fmt: skip
        elif step == PLAN:
            sense_instant(k, axles, units, brakes, rated_effort, rated_retard, onboard, run)
            call_rule(belief, share, k, units, recording.units, report_tick, run)
            set_instant_targets(k, units, order_tick, recording.units, onboard, run)
        elif step == COMMAND:
            command_units(control, axles, units, memory, run)
        elif step == BRAKE:
            command_brakes(k, axles, units, brakes, onboard, slide, run)
        else:
            record_and_advance(
                k, state, stages, wheelsets, cars, drives, cylinders, patches, line, effort, retard, curve, scatter,
                rail, plant, units, brakes, run, recording,
            )  # fmt: skip
        if run.stopped == 1:
            break
