"""One run: a train with its computers meets one slip event under one rule and one readhesion controller."""

import hashlib
import math
import time as clock
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple, cast

import numpy as np
import xarray as xr
from numba import boolean, float64, int64, types, void

from alloc.old.balance import check_run
from alloc.old.errors import OnboardError, check_compiling
from alloc.old.event import DriverCommand, Event, SimulationError, canonical
from alloc.old.loop import (
    ALLOCATION,
    CONTROL,
    ClosedLoop,
    Computers,
    Given,
    Part,
    Parts,
    run_with_computers,
    true_limits,
)
from alloc.old.onboard.controllers.base import share_of_target, torque_per_coefficient
from alloc.old.onboard.controllers.collection import BUILT_IN, RESERVE, control
from alloc.old.onboard.distribution import distribute, lead
from alloc.old.onboard.equipment import Equipment, equipment
from alloc.old.onboard.host import (
    CONTROLLERS,
    NOT_A_TORQUE,
    Answers,
    CompiledControllers,
    HostedController,
    TellingController,
    TorqueDecision,
    TrainController,
    UnitSense,
    answers,
    command_compiled,
    failures,
    unit_contexts,
)
from alloc.old.onboard.parameters import Onboard
from alloc.old.onboard.sensing import sense
from alloc.old.onboard.state import Memory, RuleSettings, attachments, memory, settings
from alloc.old.onboard.telegrams import NOTHING_ADDED
from alloc.old.plant.engine import advance
from alloc.old.plant.model import Floats, Layout
from alloc.old.recording import Record, Tally, to_dataset
from alloc.old.records import ByReference, LaidOut, address_of, filled
from alloc.old.rules import AllocationProblem, Rule, find_rule
from alloc.old.rules.problem import fault_of
from alloc.old.rules.rule import LAW, Caps


class _Believed(NamedTuple):
    """What runs of an event share under all rules that bring no settings of their own."""

    onboard: Onboard
    equipment: Equipment
    expected: float  # coefficient that the first command needs
    laid_out: ByReference  # the equipment
    given: ByReference  # a `Given`


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
            cap=m.cap,
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
            plan=float(m.train.expected[0]),
        )
        answer = self.rule(problem)
        if fault := fault_of(answer, problem):
            time = tick * self.onboard.period
            raise SimulationError(f"rule {self.rule.name!r} {fault} (at {time:.2f} s)")
        m.limit_wanted[:] = answer.limit
        m.train.level[0] = answer.level
        m.train.case[0] = {"none": 0.0, "A": 1.0, "B": 2.0}[answer.case]
        self.tally.rule_time += answer.solve_time
        if answer.status != "ok":
            self.tally.rule_failures += 1
            self.tally.note(f"rule: {answer.status}")
        return True


@dataclass(frozen=True)
class ControllerInPython:
    """A hosted controller answers the loop; where it gives up, the reserve's torque command stands.

    What it raises ends the run: a controller that breaks is not one that a solver failed.
    """

    host: TrainController
    computers: Computers
    period: float
    torque: Floats  # of each motor as the inverters know it, (units,)
    tally: Tally

    def __call__(self, tick: int) -> bool:
        self.answer(self.host.decide(self.senses(tick)))
        return True

    def senses(self, tick: int) -> list[UnitSense]:
        """What each unit reads at a tick, foremost first."""
        return [self._sense(j, tick) for j in range(self.torque.size)]

    def answer(self, decisions: Sequence[TorqueDecision | None]) -> None:
        """Write the units' commands; where there is no decision, the reserve commands, which is no failure."""
        unit = self.computers.memory.unit
        for j, decision in enumerate(decisions):
            if decision is not None:
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
    """Run `event` under a rule and a readhesion controller; returns the recorded run (see `alloc.old.recording`).

    `controller`: a name in `CONTROLLERS`, or a hosted controller itself. `on_progress` is called with the share done, 0 to
    1. `until_speed` [m/s]: the run ends early, once the train is no faster. On a train without motors, which brakes with air
    alone, rule and controller have no effect. Raises `SimulationError`, `AllocationError` or `OnboardError` for input that
    cannot be simulated, `UnsoundRun` where the run breaks a law that every run keeps. Several threads may simulate at once,
    also the same event: each run depends on its own call alone. A plug-in's rule and `on_progress` must allow it too.
    """
    run = Simulation(event, rule, controller)
    started = clock.perf_counter()
    run.loop.run(run.go, run.parts, on_progress, until_speed)
    run.tally.wall_time = clock.perf_counter() - started
    return run.recorded()


class Simulation:
    """A run under way: `go(stop)` runs to tick `stop`, or returns which of `parts` must answer first, see `alloc.old.loop`.

    `simulate` runs it to its end; who steps it answers as the parts do. `recorded` gives what has been recorded by then.
    """

    def __init__(self, event: Event, rule: str | Rule, controller: str | HostedController) -> None:
        """As `simulate`, at its start."""
        check_compiling()
        _check_kinds(event, rule, controller)
        try:
            found = CONTROLLERS.find(controller) if isinstance(controller, str) else controller
        except OnboardError as error:
            raise SimulationError(str(error)) from None
        chosen = find_rule(rule) if isinstance(rule, str) else rule
        model = event.model

        def believed() -> _Believed:
            onboard = event.onboard.with_settings(chosen.onboard)
            eq = event.equipment if onboard is event.onboard else equipment(model, onboard)
            if (
                chosen.needs_truth and model.layout.units > 0
            ):  # without motors a rule has nothing to do
                onboard = replace(onboard, reference=replace(onboard.reference, source="truth"))
            ticks = round(event.duration / onboard.period)
            commanded = event.command.sampled(onboard.period * np.arange(ticks, dtype=np.float64))
            share = eq.brake_share if eq.blended and commanded[0] < 0.0 else eq.planned_share
            expected = abs(float(commanded[0])) * share
            given = _given(commanded, onboard, model.layout)
            return _Believed(onboard, eq, expected, ByReference(eq), ByReference(given))

        belief = (chosen.needs_truth, canonical(dict(chosen.onboard)))
        onboard, eq, expected, laid_out, given = event.made.once(belief, believed)
        ticks = given.commanded.size
        host: TrainController | CompiledControllers = ()
        law, reserve = found.name, RESERVE
        if chosen.needs_truth:
            law = "none"  # who knows the rail needs no readhesion control
        elif isinstance(found, HostedController):
            if model.layout.units > 0:
                host = found.factory(unit_contexts(model, eq, onboard, found.name))
                reserve = found.reserve
            else:  # a train without motors has no torque to control, whatever controller it is given
                law = "none"
        added = host.added if isinstance(host, TellingController) else NOTHING_ADDED

        def empty() -> LaidOut:
            return LaidOut(memory(eq, event.initial_speed, expected, added))

        by_law = chosen.law is not None and onboard.limit_rate is None
        address = address_of(chosen.law, LAW) if by_law else 0
        of_rule = filled(RuleSettings, chosen, law=address)
        st = ByReference(settings(onboard, of_rule, law))
        m = event.made.once((belief, added), empty).fresh()
        counted = ByReference(answers(host if isinstance(host, tuple) else (), eq, ticks))
        loop = ClosedLoop(
            model, ticks, onboard.period, event.longest_step, event.record_period,
            event.initial_speed, event.initial_position,
        )  # fmt: skip
        plant = ByReference(loop.plant)
        kinds = _kinds_of_parts(laid_out.kind, st.kind, m.kind, counted.kind, plant.kind)
        functions = {
            "sense": sense, "lead": lead, "distribute": distribute, "advance": advance,
            "control": control(law if law in BUILT_IN else reserve),
        }  # fmt: skip
        if chosen.caps in (Caps.TRUE, Caps.PREVIEW):
            functions["true_limits"] = true_limits
        if counted.step.size > 0:
            functions["command_compiled"] = command_compiled
        parts = Parts(**{name: address_of(one, kinds[name]) for name, one in functions.items()})
        computers = Computers(laid_out, st, m, counted, parts)
        self._learnt = None if onboard.learning.kind == "none" else computers.memory.learnt
        self._record = Record.allocate(loop.records, model.layout, self._learnt is not None)
        self.event, self.loop, self.computers, self.given = event, loop, computers, given
        self.tally = Tally()
        self._names, self._host = (chosen.name, found.name), host
        self.parts: dict[int, Part] = {
            ALLOCATION: _RuleInPython(chosen, computers, onboard, self.tally)
        }
        if isinstance(host, TellingController):
            host.connect(*attachments(cast(Memory, computers.memory)))
        if not isinstance(host, tuple):
            torque = loop.plant.state[model.layout.torque]
            self.parts[CONTROL] = ControllerInPython(
                host, computers, onboard.period, torque, self.tally
            )
        before, after = (computers, loop.timing), (loop.progress, self._record)
        self.go: Callable[[int], int] = partial(
            run_with_computers, plant, *map(ByReference, before), given, *map(ByReference, after)
        )

    def recorded(self) -> xr.Dataset:
        """The recorded run; raises `UnsoundRun` where it breaks a law that every run keeps. Once, at the end."""
        host, tally = self._host, self.tally
        if isinstance(host, tuple):
            done = int(self.loop.progress.tick[0])
            tally.controller_times = self.computers.answers.solve_time[:done].ravel().tolist()
            for status, number in failures(host, cast(Answers, self.computers.answers)).items():
                tally.controller_failures += number
                tally.note(f"controller: {status}", number)
        record = self._record.until(self.loop.records)
        run = to_dataset(
            self.event, *self._names, record, self.computers.memory.counter, tally, self._learnt
        )
        check_run(self.event.model, record.plant, run)
        return run


@lru_cache(maxsize=64)
def _kinds_of_parts(
    eq: Any, st: Any, m: Any, answered: Any, plant: Any
) -> dict[str, types.FunctionType]:
    """Type of each of `Parts`, for records of these kinds."""
    numbers, of = float64[::1], {name: one.type for name, one in plant.fields.items()}
    kinds = {
        "sense": void(eq, st, m, float64, float64, numbers, numbers, numbers, numbers),
        "lead": boolean(eq, st, m, float64, int64, float64, boolean, numbers, numbers),
        "distribute": void(eq, st, m, float64, int64, numbers, numbers),
        "control": void(eq, st, m, float64),
        "advance": float64(of["workspace"], float64, float64, int64, numbers, of["inputs"]),
        "true_limits": void(plant, eq, *(float64,) * 4, boolean, numbers, numbers),
        "command_compiled": void(eq, m, answered, numbers, float64, int64),
    }
    return {name: types.FunctionType(kind) for name, kind in kinds.items()}


def _check_kinds(event: Any, rule: Any, controller: Any) -> None:
    """Raise `SimulationError` for what is natural to give and is no event, rule or controller."""
    if not isinstance(event, Event):
        wanted = (
            "its method event(seed) gives one"
            if hasattr(event, "event")
            else "`readhesion.simulate` takes names too"
        )
        raise SimulationError(f"event = {event!r:.80} is no Event: {wanted}")
    for name, part, has, wanted in (
        ("rule", rule, "caps", "Rule(name, description, function)"),
        ("controller", controller, "name", "HostedController(name, meaning, each_unit(class), colour, marker)"),
    ):  # fmt: skip
        if isinstance(part, list | tuple):
            raise SimulationError(
                f"{name} = {part!r:.80}: a run has one; `readhesion.compare` runs several"
            )
        if not (isinstance(part, str) or hasattr(part, has)):
            raise SimulationError(f"{name} = {part!r:.80} is none: give its name, or {wanted}")


def _given(commanded: Floats, onboard: Onboard, n: Layout) -> Given:
    """Commands and common random numbers: sensor noise, draws for jitter and loss."""
    telegram_ticks = max(1, round(onboard.telegrams.period / onboard.period))
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
    given = _given(np.zeros(ticks), onboard, model.layout)
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
