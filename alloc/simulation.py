"""One run: a train with its computers meets one slip event under one rule and one readhesion controller."""

import hashlib
import math
import time as clock
from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
import xarray as xr

from alloc.balance import check_run
from alloc.errors import OnboardError, check_compiling
from alloc.event import DriverCommand, Event, SimulationError, canonical
from alloc.loop import ALLOCATION, CONTROL, ClosedLoop, Computers, Given, Part, run_with_computers
from alloc.onboard.controllers.base import share_of_target, torque_per_coefficient
from alloc.onboard.equipment import equipment
from alloc.onboard.host import (
    CONTROLLERS,
    NOT_A_TORQUE,
    CompiledControllers,
    HostedController,
    TellingController,
    TrainController,
    UnitSense,
    answers,
    failures,
    unit_contexts,
)
from alloc.onboard.parameters import Onboard
from alloc.onboard.state import RuleSettings, attachments, memory, settings
from alloc.onboard.telegrams import NOTHING_ADDED
from alloc.plant.model import Floats, Layout
from alloc.recording import Record, Tally, to_dataset
from alloc.records import ByReference, filled
from alloc.rules import Allocation, AllocationProblem, Rule, find_rule
from alloc.rules.dispatch import compiled_index


@dataclass(frozen=True)
class _RuleInPython:
    """An allocation rule that is no compiled one answers the loop."""

    rule: Rule
    computers: Computers
    onboard: Onboard
    tally: Tally

    def __call__(self, tick: int) -> bool:
        eq, m = self.computers.equipment, self.computers.memory
        if m.lead.needed[0] == 0.0:  # as long as nothing is asked for, nothing is to be shared
            return True
        problem = AllocationProblem(
            cap=np.where(np.isfinite(m.cap), m.cap, m.most),
            expected=float(m.lead.needed[0]),
            mass=eq.mass,
            limit_max=m.most.copy(),
            previous=m.limit_wanted.copy(),
            rate=self.onboard.limit_rate,
            delivered=np.maximum(m.delivered, 0.0),
            truth=m.truth.copy(),
            deviation=m.learnt.deviation.copy(),
            mark=m.mark.copy(),
            upper_bound=m.upper_bound.copy(),
        )
        answer: Allocation = self.rule(problem)
        m.limit_wanted[:] = answer.limit
        m.train.level[0] = answer.level
        m.train.case[0] = {"none": 0.0, "A": 1.0, "B": 2.0}[answer.case]
        self.tally.rule_time += answer.solve_time
        if answer.status != "ok":
            self.tally.rule_failures += 1
            self.tally.note(f"rule: {answer.status}")
        return True


@dataclass(frozen=True)
class _ControllerInPython:
    """A hosted controller answers the loop; where it gives up, the reserve's torque command stands.

    What it raises ends the run: a controller that breaks is not one that a solver failed.
    """

    host: TrainController
    computers: Computers
    period: float
    torque: Floats  # of each motor as the inverters know it, (units,)
    tally: Tally

    def __call__(self, tick: int) -> bool:
        senses = [self._sense(j, tick) for j in range(self.torque.size)]
        unit = self.computers.memory.unit
        for j, decision in enumerate(self.host.decide(senses)):
            self.tally.controller_times.append(decision.solve_time)
            usable, status = decision.ok, decision.status
            if usable and not math.isfinite(decision.torque):
                usable, status = False, NOT_A_TORQUE
            if usable:
                unit.torque_command[j] = decision.torque
            if not usable or status != "ok":
                self.tally.controller_failures += 1
                self.tally.note(f"controller: {status}")
            unit.torque_factor[j] = share_of_target(self.computers.memory, j)
        return True

    def _sense(self, j: int, tick: int) -> UnitSense:
        eq, m = self.computers.equipment, self.computers.memory
        driven = eq.axle_unit == j
        return UnitSense(
            time=tick * self.period,
            speed=float(m.reference[eq.unit_body[j]]),
            omega=m.axle_omega[driven] * (eq.axle_radius[driven] / eq.radius[j]),
            torque=float(self.torque[j]),
            target=float(m.unit.torque_target[j]),
            drive_limit=float(m.drive_limit[j]),
            brake_limit=float(m.brake_limit[j]),
            coefficient=float(m.unit.coefficient_estimate[j]),
            slipping=bool(m.unit.slipping[j]),
            in_service=bool(m.in_service[j]),
            planned=float(
                m.train.expected[0] * (1.0 + eq.own_inertia[j]) * torque_per_coefficient(eq, j)
            ),
        )


def simulate(
    event: Event,
    rule: str | Rule = "greedy",
    controller: str | HostedController = "cut-and-ramp",
    on_progress: Callable[[float], None] | None = None,
    until_speed: float | None = None,
) -> xr.Dataset:
    """Run `event` under a rule and a readhesion controller; returns the recorded run (see `alloc.recording`).

    `controller`: a name in `CONTROLLERS`, or a hosted controller itself. `on_progress` is called with the share done, 0 to
    1. `until_speed` [m/s]: the run ends early, once the train is no faster. On a train without motors, which brakes with air
    alone, rule and controller have no effect. Raises `SimulationError`, `AllocationError` or `OnboardError` for input that
    cannot be simulated, `UnsoundRun` where the run breaks a law that every run keeps. Several threads may simulate at once,
    also the same event: each run depends on its own call alone. A plug-in's rule and `on_progress` must allow it too.
    """
    check_compiling()
    try:
        found = CONTROLLERS.find(controller) if isinstance(controller, str) else controller
    except OnboardError as error:
        raise SimulationError(str(error)) from None
    chosen = find_rule(rule) if isinstance(rule, str) else rule
    onboard, model = event.onboard.with_settings(chosen.onboard), event.model
    eq = event.equipment if onboard is event.onboard else equipment(model, onboard)
    ticks = round(event.duration / onboard.period)
    commanded = event.command.sampled(onboard.period * np.arange(ticks, dtype=np.float64))
    share = eq.brake_share if eq.blended and commanded[0] < 0.0 else eq.planned_share
    host: TrainController | CompiledControllers = ()
    law = found.name
    if chosen.needs_truth:
        law = "none"  # who knows the rail needs no readhesion control
        if model.layout.units > 0:  # without motors a rule has nothing to do
            onboard = replace(onboard, reference=replace(onboard.reference, source="truth"))
    elif isinstance(found, HostedController):
        if model.layout.units > 0:
            host = found.factory(unit_contexts(model, eq, onboard, found.name))
        else:  # a train without motors has no torque to control, whatever controller it is given
            law = "none"
    added = host.added if isinstance(host, TellingController) else NOTHING_ADDED
    compiled = compiled_index(chosen) if onboard.limit_rate is None else -1
    computers = Computers(
        eq,
        settings(
            onboard,
            filled(RuleSettings, chosen, compiled=compiled),
            law,
        ),
        memory(eq, event.initial_speed, abs(float(commanded[0])) * share, added),
        answers(host if isinstance(host, tuple) else (), eq, ticks),
    )
    loop = ClosedLoop(
        model, ticks, onboard.period, event.longest_step, event.record_period,
        event.initial_speed, event.initial_position,
    )  # fmt: skip
    given = _given(commanded, onboard, model.layout, computers.settings.telegrams.ticks)
    learnt = None if onboard.learning.kind == "none" else computers.memory.learnt
    record = Record.allocate(loop.records, model.layout, learnt is not None)
    tally = Tally()
    parts: dict[int, Part] = {ALLOCATION: _RuleInPython(chosen, computers, onboard, tally)}
    if isinstance(host, TellingController):
        host.connect(*attachments(computers.memory))
    if not isinstance(host, tuple):
        torque = loop.plant.state[model.layout.torque]
        parts[CONTROL] = _ControllerInPython(host, computers, onboard.period, torque, tally)

    parts_of_run = (loop.plant, computers, loop.timing, given, loop.progress, record)
    go = partial(run_with_computers, *map(ByReference, parts_of_run))
    started = clock.perf_counter()
    loop.run(go, parts, on_progress, until_speed)
    tally.wall_time = clock.perf_counter() - started
    if isinstance(host, tuple):
        done = int(loop.progress.tick[0])
        tally.controller_times = computers.answers.solve_time[:done].ravel().tolist()
        for status, number in failures(host, computers.answers).items():
            tally.controller_failures += number
            tally.note(f"controller: {status}", number)
    record = record.until(loop.records)
    run = to_dataset(
        event, chosen.name, found.name, record, computers.memory.counter, tally, learnt
    )
    check_run(model, record.plant, run)
    return run


def _given(commanded: Floats, onboard: Onboard, n: Layout, telegram_ticks: int) -> Given:
    """Commands and common random numbers: sensor noise, draws for jitter and loss."""
    generator = np.random.default_rng([onboard.sensors.seed, 1])
    sigma, ticks = onboard.sensors.speed_noise, commanded.size
    noise = sigma * generator.standard_normal((ticks if sigma > 0.0 else 1, n.axles))
    generator = np.random.default_rng([onboard.sensors.seed, 2])
    down = generator.random((2, ticks // telegram_ticks + 1, n.units))
    generator = np.random.default_rng([onboard.sensors.seed, 4])
    up = generator.random((2, ticks // telegram_ticks + 1, n.units))
    return Given(commanded, noise, *down, *up)


def inputs_hash(event: Event) -> str:
    """Hash of all inputs of a run of `event`: of what was drawn, not of the seeds, which may draw nothing.

    Events that differ in seeds alone have equal hashes if their runs are the same.
    """
    model, onboard = event.model, event.onboard
    eq, telegrams = event.equipment, onboard.telegrams
    ticks = round(event.duration / onboard.period)
    given = _given(
        np.zeros(ticks), onboard, model.layout, max(1, round(telegrams.period / onboard.period))
    )
    # + 0.0: without noise there are zeros of either sign
    parts = (
        model.structure, model.environment, eq, given.noise + 0.0,
        telegrams.jitter * given.delay_draw, given.loss_draw < telegrams.loss,
        telegrams.jitter * given.up_delay_draw, given.up_loss_draw < telegrams.loss,
        event.command, event.initial_speed, event.initial_position,
    )  # fmt: skip
    digest = hashlib.sha256()
    for part in _single(parts):
        if isinstance(part, np.ndarray):
            digest.update(f"{part.dtype} {part.shape} ".encode() + part.tobytes())
        else:
            digest.update(canonical(part).encode())
    return digest.hexdigest()[:16]


def _single(parts: tuple[Any, ...]) -> Iterator[Any]:
    """What records hold, one by one."""
    for part in parts:
        if isinstance(part, tuple):
            yield from _single(part)
        else:
            yield part


__all__ = ["CONTROLLERS", "DriverCommand", "Event", "SimulationError", "inputs_hash", "simulate"]
