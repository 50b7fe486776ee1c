"""One run: a train with its computers meets one slip event under one rule and one readhesion controller.

The loop is compiled. It returns to Python only where a rule or a controller lives there (QP solvers, MPC), says what it
needs, and goes on with the answer; so compiled and hosted parts see exactly the same run.
"""

import math
import time as clock
from collections.abc import Callable, Mapping

import numpy as np
import xarray as xr
from numpy.typing import NDArray

from alloc.compilation import inlined_jit, jit
from alloc.errors import OnboardError
from alloc.event import DriverCommand, Event, SimulationError
from alloc.onboard import memory as om
from alloc.onboard.brakes import brake_receiver, set_brake_targets
from alloc.onboard.control import control, cut_and_ramp_unit
from alloc.onboard.distribution import distribute, prepare_allocation
from alloc.onboard.equipment import Equipment, equipment
from alloc.onboard.host import TrainController, TrainControllerFactory, UnitSense, unit_contexts
from alloc.onboard.parameters import Onboard
from alloc.onboard.readhesion import CONTROLLERS, HOST
from alloc.onboard.sensing import sense
from alloc.onboard.torque import restrain_blind_units, set_targets
from alloc.plant import compiled
from alloc.plant.adhesion import adhesion_limit
from alloc.plant.model import Floats
from alloc.recording import Record, Tally, to_dataset
from alloc.rules import Allocation, AllocationProblem, Rule, find_rule
from alloc.rules.kernels import allocate_compiled

REPORT_DELAY = 0.1
"""Time [s] after which the train knows that a unit has failed."""

STABLE_SHARE = 0.97
"""Share of the true adhesion that the oracle's units may use. At the very peak a torque is not held: any change of the
rail between two telegrams carries the slip over it."""

NEEDS_NOTHING, NEEDS_ALLOCATION, NEEDS_CONTROL = 0, 1, 2
PHASE_SENSE, PHASE_DISTRIBUTE, PHASE_ADVANCE = 0, 1, 2


@inlined_jit
def _true_limits(s, e, layout, eq, time, state, cleaning, w, truth):
    """Usable adhesion coefficient of each unit: that of its weakest axle, whose wheels slip first, less a margin."""
    compiled.peak_field(s, e, layout, time, state, cleaning, w, w.peak)
    for j in range(truth.size):
        truth[j] = np.inf
    for i in range(layout.axles):
        j = eq.axle_unit[i]
        if j >= 0:
            v = state[layout.bodies + s.axle_body[i], 0]
            limit, _ = adhesion_limit(e.curve_kind, e.curve, w.peak[i, 0], v)
            truth[j] = min(truth[j], STABLE_SHARE * limit)


@jit
def _write_record(s, e, layout, eq, time, state, inputs, w, m, commanded, k, r):
    compiled.note(s, e, layout, time, state, inputs, w, k, r.state, r.peak, r.body_acceleration)
    r.time[k] = time
    for j in range(layout.units):
        r.command[k, j] = m.command[j]
        r.target[k, j] = m.target[j]
        r.limit[k, j] = m.limit[j]
        r.estimate[k, j] = m.estimate[j]
        r.slipping[k, j] = m.slipping[j]
        r.fallen_back[k, j] = m.fallen_back[j]
        r.factor[k, j] = m.factor[j]
        r.seen[k, j] = m.seen[j]
        r.acceleration[k, j] = m.acceleration[j]
        r.air[k, j] = m.air[j]
    for g in range(layout.groups):
        r.valve[k, g] = inputs.valve[g, 0]
    for c in range(layout.cars):
        r.car_reference[k, c] = m.slide.reference[c]
    r.train[k, 0] = m.held[om.HELD_CASE]
    r.train[k, 1] = m.held[om.HELD_LEVEL]
    r.train[k, 2] = commanded
    body = eq.unit_body[int(m.held[om.HELD_FIRST])] if layout.units > 0 else 0
    r.train[k, 3] = m.reference[body]
    r.train[k, 4] = m.held[om.HELD_EXPECTED]


@jit
def _run(
    s, e, layout, eq, st, m, state, inputs, w, progress, ticks, period, step, steps,
    commanded, noise, noisy, draws, loss, record_ticks, r,
):  # fmt: skip
    """Run until the end, or until something in Python must answer; return what is needed."""
    units = eq.axles.size
    while progress[0] < ticks:
        tick = progress[0]
        time = tick * period
        a = commanded[tick]
        if a < 0.0 and m.reference[0] < st.release_speed:
            a = 0.0
        if progress[1] == PHASE_SENSE:
            for j in range(units):
                m.in_service[j] = time < e.failure_time[j, 0] + REPORT_DELAY
            first = 2 * layout.bodies
            torque = first + layout.axles
            sense(
                eq, st, m, time, a,
                state[first : first + layout.axles, 0], state[torque : torque + units, 0],
                noise[tick if noisy else 0],
            )  # fmt: skip
            needed = prepare_allocation(eq, st, m, time, tick, a)
            if needed and st.needs_truth:
                _true_limits(s, e, layout, eq, time, state, inputs.cleaning, w, m.truth)
            progress[1] = PHASE_DISTRIBUTE
            if needed:
                m.counter[om.RULE_CALLS] += 1
                if st.rule < 0:
                    return NEEDS_ALLOCATION
                m.held[om.HELD_LEVEL], m.held[om.HELD_CASE] = allocate_compiled(
                    st.rule, m.cap, m.held[om.HELD_EXPECTED], eq.mass, m.limit_max, m.limit_wanted,
                    m.delivered, m.truth, st.rule_parameters, m.limit_wanted,
                )  # fmt: skip
        if progress[1] == PHASE_DISTRIBUTE:
            row = (tick // st.telegram_ticks) % draws.shape[1]
            distribute(eq, st, m, time, tick, draws[0, row], draws[1, row], loss)
            if eq.blended and a < 0.0:
                set_brake_targets(eq, st, m)
            else:
                set_targets(eq, st, m, a)
            restrain_blind_units(st, m)
            progress[1] = PHASE_ADVANCE
            if st.controller == HOST:
                return NEEDS_CONTROL
            control(eq, st, m, a)
        for j in range(units):
            inputs.torque_command[j, 0] = m.command[j]
        braking = eq.blended and a < 0.0
        brake_receiver(eq, st, m, tick, braking, inputs.pressure_target, inputs.valve)
        if tick % record_ticks == 0:
            _write_record(s, e, layout, eq, time, state, inputs, w, m, a, tick // record_ticks, r)
        compiled.advance(s, e, layout, time, step, steps, state, inputs, w)
        progress[0] += 1
        progress[1] = PHASE_SENSE
    return NEEDS_NOTHING


def _allocate_in_python(
    rule: Rule, eq: Equipment, m: om.Memory, onboard: Onboard, tally: Tally
) -> None:
    problem = AllocationProblem(
        cap=m.cap.copy(),
        expected=float(m.held[om.HELD_EXPECTED]),
        mass=eq.mass,
        limit_max=m.limit_max.copy(),
        previous=m.limit_wanted.copy(),
        rate=onboard.limit_rate,
        delivered=np.maximum(m.delivered, 0.0),
        truth=m.truth.copy(),
        deviation=eq.deviation,
    )
    answer: Allocation = rule(problem)
    m.limit_wanted[:] = answer.limit
    m.held[om.HELD_LEVEL] = answer.level
    m.held[om.HELD_CASE] = {"none": 0.0, "A": 1.0, "B": 2.0}[answer.case]
    tally.rule_time += answer.solve_time
    if answer.status != "ok":
        tally.rule_failures += 1
        tally.note(f"rule: {answer.status}")


def _control_in_python(
    host: TrainController, eq: Equipment, st: om.Settings, m: om.Memory,
    time: float, commanded: float, torque: Floats, tally: Tally,
) -> None:  # fmt: skip
    readings = [
        UnitSense(
            time=time,
            speed=float(m.reference[eq.unit_body[j]]),
            omega=m.axle_omega[eq.axle_unit == j],
            torque=float(torque[j]),
            target=float(m.target[j]),
            drive_limit=float(m.drive_limit[j]),
            brake_limit=float(m.brake_limit[j]),
            coefficient=float(m.estimate[j]),
            slipping=bool(m.slipping[j]),
        )
        for j in range(eq.axles.size)
    ]
    for j, decision in enumerate(host.decide(readings)):
        # the built-in controller runs along, so that it is in step wherever a host controller gives up
        cut_and_ramp_unit(eq, st, m, j, commanded)
        fallback = m.command[j]
        tally.controller_times.append(decision.solve_time)
        if decision.ok and math.isfinite(decision.torque):
            m.command[j] = decision.torque
        else:
            tally.controller_failures += 1
            tally.note(f"controller: {decision.status}")
            m.command[j] = fallback


def simulate(
    event: Event,
    rule: str | Rule = "greedy",
    controller: str = "cut-and-ramp",
    host_factories: Mapping[str, TrainControllerFactory] | None = None,
    on_progress: Callable[[float], None] | None = None,
) -> xr.Dataset:
    """Run `event` under a rule and a readhesion controller; returns the recorded run (see `alloc.recording`).

    `controller` is a name in `CONTROLLERS` or in `host_factories`. `on_progress` is told the share done, 0 to 1. On a train
    without motors, which brakes with air alone, rule and controller have nothing to do.
    Raises `SimulationError`, `AllocationError` or `OnboardError` for what cannot be run.
    """
    host_factories = host_factories or {}
    known = [*CONTROLLERS, *host_factories]
    if controller not in known:
        from difflib import get_close_matches

        near = get_close_matches(controller, known, 1)
        hint = f"; did you mean {near[0]!r}?" if near else ""
        raise SimulationError(f"unknown controller {controller!r}{hint} Known: {', '.join(known)}")
    chosen = find_rule(rule) if isinstance(rule, str) else rule
    onboard, model = event.onboard, event.model
    s, e, layout = model.structure, model.environment, compiled.rows(model.layout)
    eq = equipment(model, onboard)
    # a train without motors has no torque to control, whatever controller it is given
    hosted = controller not in CONTROLLERS and model.layout.units > 0
    known_controller = CONTROLLERS.get(controller, CONTROLLERS["none"])
    compiled_rule = chosen.compiled_id if onboard.limit_rate is None else None
    st = om.settings(
        onboard,
        -1 if compiled_rule is None else compiled_rule,
        om.ALLOCATE_PERIODICALLY if chosen.periodic else om.ALLOCATE_ON_SLIP,
        chosen.needs_truth,
        HOST if hosted else known_controller,
        np.asarray(chosen.parameters, dtype=float),
    )
    period = onboard.period
    ticks = round(event.duration / period)
    steps = round(period / event.step)
    steps *= model.substeps(period / steps)
    step = period / steps
    record_ticks = max(1, round(event.record_period / period))
    commanded = event.command.sampled(period * np.arange(ticks, dtype=np.float64))
    share = eq.brake_share if eq.blended and commanded[0] < 0.0 else eq.planned_share
    m = om.memory(eq, event.initial_speed, abs(float(commanded[0])) * share)
    state = model.initial_state(event.initial_speed, event.initial_position)
    inputs, w = model.zero_inputs(), compiled.workspace(model, step)
    noise, draws = _draws(onboard, ticks, model.layout.axles, model.layout.units, st.telegram_ticks)
    records = (ticks + record_ticks - 1) // record_ticks
    record = Record.allocate(records, model.layout)
    tally = Tally()
    host = host_factories[controller](unit_contexts(model, eq, onboard)) if hosted else None
    progress = np.zeros(2, dtype=np.int64)
    n = model.layout
    started = clock.perf_counter()
    chunk = ticks if on_progress is None else max(1, ticks // 50)
    stop = 0
    while stop < ticks:
        stop = min(ticks, stop + chunk)
        while True:
            need = _run(
                s, e, layout, eq, st, m, state, inputs, w, progress, stop, period, step, steps,
                commanded, noise, onboard.sensors.speed_noise > 0.0, draws, onboard.telegrams.loss,
                record_ticks, record,
            )  # fmt: skip
            if need == NEEDS_NOTHING:
                break
            time = progress[0] * period
            if need == NEEDS_ALLOCATION:
                _allocate_in_python(chosen, eq, m, onboard, tally)
            else:
                assert host is not None
                _control_in_python(
                    host, eq, st, m, time, float(commanded[progress[0]]),
                    state[n.torque, 0], tally,
                )  # fmt: skip
        if on_progress is not None:
            on_progress(stop / ticks)
    tally.wall_time = clock.perf_counter() - started
    return to_dataset(event, chosen.name, controller, record, m.counter, tally)


def _draws(
    onboard: Onboard, ticks: int, axles: int, units: int, telegram_ticks: int
) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
    """Common random numbers: sensor noise (ticks or 1, axles), draws for jitter and loss (2, telegrams, units)."""
    generator = np.random.default_rng([onboard.sensors.seed, 1])
    sigma = onboard.sensors.speed_noise
    noise = sigma * generator.standard_normal((ticks if sigma > 0.0 else 1, axles))
    generator = np.random.default_rng([onboard.sensors.seed, 2])
    return noise, generator.random((2, ticks // telegram_ticks + 1, units))


__all__ = [
    "CONTROLLERS",
    "DriverCommand",
    "Event",
    "OnboardError",
    "SimulationError",
    "simulate",
]
