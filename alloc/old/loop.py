"""The closed loop: a plant that runs control period by control period, with calls to parts in Python on the way.

In: plant, computers on board and what is given (commands, noise, losses). Out: a filled record of instants. The loop itself
is compiled (`run_with_computers`); `ClosedLoop.run` is plain Python and answers what the compiled loop returns for.
"""

import math
from collections.abc import Callable, Mapping
from typing import NamedTuple

import numpy as np
from numba import types
from numpy.typing import NDArray

from alloc.old.compilation import inlined_jit, jit
from alloc.old.onboard.brakes import (
    brake_receiver,
    command_sand,
    foresee_torque,
    restrain_blind_units,
    set_brake_targets,
    set_targets,
)
from alloc.old.plant import engine as compiled
from alloc.old.plant.engine import copy_row, find_limits, peak_field
from alloc.old.plant.model import Floats, Inputs, Layout, Model
from alloc.old.records import ByReference, called_at
from alloc.old.rules.problem import CASE_A, CASE_B
from alloc.old.rules.rule import Caps, Units, law_at

# What the loop writes down of an instant, compiled.


@inlined_jit
def _copy(values, k, record):
    # element by element: an assignment of arrays compiles its check of shapes too, for seconds
    for f in range(values.shape[0]):
        for j in range(values.shape[1]):
            record[k, f, j] = values[f, j]


@inlined_jit
def record_computers(plant, eq, st, m, commanded, k, record):
    """Write to row `k` what the computers know and decide, `commanded` [m/s2] included."""
    m.train.driver_command[0] = commanded
    body = eq.unit_body[m.lead.unit[0]] if eq.axles.size > 0 else 0
    m.train.reference_speed[0] = m.reference[body]
    _copy(m.unit_block, k, record.unit)
    _copy(m.train_block, k, record.train)
    if record.learning.shape[0] > 0:
        _copy(m.learning.block, k, record.learning)
    for g in range(plant.rows.groups):
        record.valve[k, g] = plant.inputs.valve[g]
    for s in range(plant.rows.sanders):
        record.sand_rate[k, s] = plant.inputs.sand_rate[s]
    for c in range(record.slide_reference.shape[1]):
        record.slide_reference[k, c] = m.reference[min(c, m.reference.size - 1)]


@inlined_jit
def record_plant(plant, time, k, record):
    """Write the state at `time` [s] to row `k`."""
    record.time[k] = time
    copy_row(plant.state, 0, record.state[k])


@inlined_jit
def record_noted(noted, k, record):
    """Write to row `k` what the plant noted in the step that began there."""
    copy_row(noted.peak, 0, record.peak[k])
    copy_row(noted.coefficient, 0, record.coefficient[k])
    copy_row(noted.load, 0, record.load[k])
    copy_row(noted.force, 0, record.force[k])
    copy_row(noted.brake, 0, record.brake[k])
    copy_row(noted.motor, 0, record.motor[k])
    copy_row(noted.shaft, 0, record.shaft[k])
    copy_row(noted.acceleration, 0, record.acceleration[k])
    copy_row(noted.tension, 0, record.tension[k])


# What the rail truly carries: the oracle's knowledge, which nobody on board has.


USED = 0.995
"""Share of the true adhesion that the oracle's units use. At the very peak a torque is not held."""

LAGS_AHEAD = 2.0
"""Lags of the motors' torque by which the oracle looks ahead, beyond the control period for which it keeps its torque."""

PREVIEW = 0.2
"""How far ahead `Caps.PREVIEW` looks [s]: two periods of telegrams, in which a limit arrives and the torque falls to it."""


@inlined_jit
def _least_adhesion(w, eq, time, truth, trailing):
    """Lower `truth` (units,) and `trailing` (groups,) to the force per axle [N] that each can carry.

    It is that of the weakest axle. Motors in parallel could carry more, but only while that axle slips beyond its peak. The
    state is that in the workspace's scratch.
    """
    c, axle, rail = w.scratch, w.axle, w.rail
    peak_field(w, time, c.state)
    speed, limit, slip = c.limit[0], c.limit[1], c.limit[2]
    for i in range(w.size.axles):
        speed[i] = c.state[axle.speed_row[i]]
    find_limits(rail.curve_kind, rail.curve, c.peak, speed, axle.contact, limit, slip)
    for i in range(w.size.axles):
        j, g = eq.axle_unit[i], eq.axle_group[i]
        if j >= 0:
            truth[j] = min(truth[j], USED * limit[i] * c.normal[i])
        elif g >= 0:
            trailing[g] = min(trailing[g], USED * limit[i] * c.normal[i])


@jit
def true_limits(plant, eq, time, period, preview, sign, braking, truth, trailing):
    """Coefficient of each unit whose torque the rail just carries, now and as far ahead as its torque cannot be changed.

    Or `preview` [s] ahead, if that is more. Part of the torque turns the wheelsets as the train goes, not as the plan has
    it.
    """
    w = plant.workspace
    for j in range(truth.size):
        truth[j] = np.inf
    for g in range(trailing.size):
        trailing[g] = np.inf
    compiled.pack(w, plant.state, w.scratch.state)
    _least_adhesion(w, eq, time, truth, trailing)
    ahead = max(period, preview)
    for j in range(truth.size):
        ahead = max(ahead, period + LAGS_AHEAD / w.unit.inverse_lag[j])
    for b in range(w.size.bodies):
        w.scratch.state[w.row.position + b] += ahead * w.scratch.state[w.row.speed + b]
    _least_adhesion(w, eq, time + ahead, truth, trailing)
    for j in range(truth.size):
        turning = eq.inertia[j] / eq.radius[j] ** 2 * sign * w.noted.acceleration[eq.unit_body[j]]
        share = 1.0 + (eq.brake_inertia[j] if braking else eq.own_inertia[j])
        truth[j] = max(truth[j] + turning, 0.0) / (share * eq.axle_load[j])


# The loop is compiled. It returns to Python only where a part lives there (a driver, a rule with a QP solver, an MPC).
# It states what it needs, and continues with the answer. So compiled and hosted parts work in exactly the same run.


REPORT_DELAY = 0.1
"""Time [s] after which the train knows that a unit has failed."""

NOTHING, ALLOCATION, CONTROL, DRIVER = range(4)
"""What the loop needs of Python."""

SENSE, DISTRIBUTE, ADVANCE = range(3)
"""Phases of a control period."""

CHUNKS = 100
"""Parts of a run after each of which it can be watched, or ended."""

Part = Callable[[int], bool]
"""Something in Python that answers the loop at a tick; False ends the run with this tick."""


class Plant(NamedTuple):
    """The plant of a run."""

    rows: Layout
    state: Floats
    inputs: Inputs
    workspace: ByReference  # a `Workspace`


class Parts(NamedTuple):
    """Addresses of the parts of a control period that are compiled by themselves; 0 where a run does not need one.

    The loop does not import them, so an edit of one compiles that one alone. All of them in one function, optimised
    together, took LLVM and Numba twice as long to compile, and were no faster.
    """

    sense: int
    lead: int
    distribute: int
    control: int  # of the built-in controller, or of the reserve
    advance: int
    true_limits: int = 0
    command_compiled: int = 0


_call, _asks, _goes = map(called_at, (types.void, types.boolean, types.float64))


class Computers(NamedTuple):
    """The train's computers in a run."""

    equipment: ByReference  # an `Equipment`
    settings: ByReference  # `Settings`
    memory: ByReference  # a `Memory`
    answers: ByReference  # `Answers`
    parts: Parts


class Timing(NamedTuple):
    """Control period and integration step [s], steps per period, periods between two records."""

    period: float
    step: float
    steps: int
    record_ticks: int


class Progress(NamedTuple):
    """Control periods done, the phase of the present one, and the acceleration commanded in it [m/s2]; (1,) each."""

    tick: NDArray[np.int64]
    phase: NDArray[np.int64]
    commanded: Floats


class Given(NamedTuple):
    """What comes from outside, drawn or commanded before the run."""

    commanded: Floats  # (ticks,) acceleration
    noise: Floats  # (ticks, or 1 without noise, axles) of the speed sensors [m/s at the rim]
    delay_draw: Floats  # (telegrams, units) uniform draws: of the jitter of a telegram's delay
    loss_draw: Floats  # (telegrams, units) of its loss
    up_delay_draw: Floats  # the same of the telegrams to the leader
    up_loss_draw: Floats


@jit
def run_with_computers(plant, computers, timing, given, progress, record, stop):
    """Run to tick `stop`, or until something in Python must answer; returns what is needed."""
    eq, st, m = computers.equipment, computers.settings, computers.memory
    units, rows = eq.axles.size, plant.rows
    while progress.tick[0] < stop:
        tick = progress.tick[0]
        time = tick * timing.period
        if progress.phase[0] == SENSE:
            # once a period: after the way through Python the reference speed is a new one
            released = m.reference[0] < st.brakes.release_speed
            a = given.commanded[tick]
            progress.commanded[0] = 0.0 if a < 0.0 and released else a
        a = progress.commanded[0]
        braking = eq.blended and a < 0.0
        if progress.phase[0] == SENSE:
            failed = False
            for j in range(units):
                works = time < plant.workspace.unit.failure_time[j] + REPORT_DELAY
                failed = failed or works != m.in_service[j]
                m.in_service[j] = works
            if st.reference.given:
                for b in range(rows.bodies):
                    m.reference[b] = plant.state[rows.bodies + b]
            first = 2 * rows.bodies
            torque = first + rows.axles
            pressure = torque + units
            _call(
                computers.parts.sense, eq, st, m, time, a,
                plant.state[first : first + rows.axles], plant.state[torque:pressure],
                plant.state[pressure : pressure + rows.groups],
                given.noise[tick if st.sensors.noisy else 0],
            )  # fmt: skip
            row = (tick // st.telegrams.ticks) % given.delay_draw.shape[0]
            needed = _asks(
                computers.parts.lead, eq, st, m, time, tick, a, failed,
                given.up_delay_draw[row], given.up_loss_draw[row],
            )  # fmt: skip
            if needed and (st.rule.caps == Caps.TRUE or st.rule.caps == Caps.PREVIEW):
                sign = 1.0 if a >= 0.0 else -1.0
                ahead = PREVIEW if st.rule.caps == Caps.PREVIEW else 0.0
                _call(
                    computers.parts.true_limits, plant, eq, time, timing.period, ahead, sign, braking,
                    m.truth, m.air_most,
                )  # fmt: skip
            if needed and st.rule.caps == Caps.PREVIEW:
                # no unit has been ahead of the leader, and trailers' brakes are told nothing
                m.truth[m.lead.unit[0]] = np.inf
                for g in range(m.air_most.size):
                    m.air_most[g] = np.inf
            progress.phase[0] = DISTRIBUTE
            if needed:
                m.counter.rule_calls[0] += 1
                if st.rule.law == 0:
                    return ALLOCATION
                asked = Units(
                    m.cap,
                    eq.mass,
                    m.most,
                    m.limit_wanted,
                    m.delivered,
                    m.truth,
                    m.upper_bound,
                    m.mark,
                    m.train.expected[0],
                )
                level, reached = law_at(st.rule.law)(asked, m.lead.needed[0], m.limit_wanted)
                m.train.level[0], m.train.case[0] = level, CASE_B if reached else CASE_A
        if progress.phase[0] == DISTRIBUTE:
            row = (tick // st.telegrams.ticks) % given.delay_draw.shape[0]
            _call(
                computers.parts.distribute, eq, st, m, time, tick, given.delay_draw[row], given.loss_draw[row]
            )  # fmt: skip
            if braking:
                set_brake_targets(eq, st, m)
            else:
                set_targets(eq, st, m, a)
            if st.rule.caps != Caps.TRUE:
                restrain_blind_units(st, m)
            _call(computers.parts.control, eq, st, m, a)
            progress.phase[0] = ADVANCE
            first = 2 * rows.bodies + rows.axles
            if computers.answers.step.size > 0:
                torque = plant.state[first : first + units]
                _call(
                    computers.parts.command_compiled, eq, m, computers.answers, torque, time, tick
                )
            elif st.hosted:
                return CONTROL
        for j in range(units):
            applied = m.estimate.relief.share[j] * m.unit.torque_command[j]
            foresee_torque(eq, m, j, applied)
            plant.inputs.torque_command[j] = applied
        brake_receiver(eq, st, m, tick, braking, plant.inputs.pressure_target, plant.inputs.valve)
        if rows.sanders > 0:
            command_sand(eq, st, m, time, plant.inputs.sand_rate)
        k = tick // timing.record_ticks
        recorded = tick % timing.record_ticks == 0
        if recorded:
            record_plant(plant, time, k, record.plant)
            record_computers(plant, eq, st, m, a, k, record)
        _goes(
            computers.parts.advance,
            plant.workspace, time, timing.step, timing.steps, plant.state, plant.inputs,
        )  # fmt: skip
        if recorded:
            record_noted(plant.workspace.noted, k, record.plant.noted)
        progress.tick[0] += 1
        progress.phase[0] = SENSE
    return NOTHING


def run_with_driver(plant, timing, progress, record, stop):
    """As `run_with_computers`, for a train whose inputs a driver sets in every period; compiled are the steps alone."""
    while progress.tick[0] < stop:
        tick = int(progress.tick[0])
        time = tick * timing.period
        if progress.phase[0] == SENSE:
            progress.phase[0] = ADVANCE
            return DRIVER
        k = tick // timing.record_ticks
        recorded = tick % timing.record_ticks == 0
        if recorded:
            record.time[k], record.state[k] = time, plant.state[: record.state.shape[1]]
        compiled.advance(
            plant.workspace, time, timing.step, timing.steps, plant.state, plant.inputs
        )
        if recorded:
            for values, noted in zip(record.noted, plant.workspace.noted, strict=True):
                values[k] = noted
        progress.tick[0] += 1
        progress.phase[0] = SENSE
    return NOTHING


class ClosedLoop:
    """A plant on its way through `ticks` control periods: its stepping, and what is recorded of it."""

    def __init__(
        self,
        model: Model,
        ticks: int,
        period: float,
        step: float,
        record_period: float,
        speed: float,
        position: float,
    ) -> None:
        """Start at `speed` [m/s] and `position` [m]; `step` [s] is the longest, less where the plant needs it."""
        steps = math.ceil(period / step * (1.0 - 1e-9))
        steps *= model.substeps(period / steps)
        record_ticks = max(1, round(record_period / period))
        self.ticks = ticks
        self.timing = Timing(float(period), period / steps, steps, record_ticks)
        self.plant = Plant(
            model.layout,
            model.initial_state(speed, position),
            model.zero_inputs(),
            compiled.workspace(model, period / steps),
        )
        self.progress = Progress(
            np.zeros(1, dtype=np.int64), np.zeros(1, dtype=np.int64), np.zeros(1)
        )
        self._end = ticks

    @property
    def records(self) -> int:
        """Instants recorded from the start to the end of the run."""
        return -(-self._end // self.timing.record_ticks)

    def run(
        self,
        go: Callable[[int], int],
        parts: Mapping[int, Part],
        on_progress: Callable[[float], None] | None = None,
        until_speed: float | None = None,
    ) -> None:
        """Run to the end: `go(stop)` runs to tick `stop`, or returns what one of `parts` must answer.

        `on_progress` is called with the share done, 0 to 1. `until_speed` [m/s]: the run ends once no body is faster, at the
        latest soon after.
        """
        watched = on_progress is not None or until_speed is not None
        chunk = max(1, self.ticks // CHUNKS) if watched else self.ticks
        tick, stop = self.progress.tick, 0
        while stop < self._end:
            stop = min(self._end, stop + chunk)
            while (need := go(stop)) != NOTHING:
                if not parts[need](int(tick[0])):
                    stop = self._end = int(tick[0]) + 1
            if on_progress is not None:
                on_progress(stop / self.ticks)
            speed = self.plant.state[self.plant.rows.speed]
            if until_speed is not None and speed.max() <= until_speed:
                # so far that this speed is recorded
                self._end = min(self._end, stop + self.timing.record_ticks)
                until_speed = None
