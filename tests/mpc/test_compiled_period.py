"""The compiled control period of a unit's MPC is the one in Python."""

from dataclasses import replace
from functools import partial

import numpy as np
import pytest
from numba.core.runtime import _nrt_python

from alloc.onboard.host import ANSWER, READING, HostedController, each_unit
from alloc.simulation import simulate
from mpc.belief import with_predicted_curve
from mpc.hosted import MPC
from mpc.model import unit_model
from mpc.period import RealTimeIteration
from mpc.settings import MpcSettings, PeakBelief
from mpc.unit import STATUSES, MpcController, compiled_unit, unit_step
from studies.scenario import load as load_scenario
from tests.cases import looped
from tests.mpc.peers import DaqpIteration, step_function


class InNumba:
    """The controller compiled by Numba, as the simulation has it."""

    def __init__(self, context, settings=None):
        self.controller = compiled_unit(context, settings)
        self.reading, self.answer = np.zeros(1, READING)[0], np.zeros(1, ANSWER)[0]

    def decide(self, sense):
        for name in READING.names:
            self.reading[name] = getattr(sense, name)
        unit_step(self.controller.state, self.reading, sense.omega, self.answer)
        return self.answer


def _readings(make_sense, seed):
    """Readings as they come, with slips, changes of direction, no demand, and some that are no numbers."""
    rng, torque, sign = np.random.default_rng(seed), 0.0, 1.0
    for tick in range(120):
        sign = -sign if tick in (50, 70) else sign
        target = 0.0 if tick in (30, 31, 90) else sign * rng.uniform(300.0, 1100.0)
        slip = sign * rng.choice([0.003, 0.02, 0.3]) * rng.uniform(0.5, 1.5)
        torque = 0.7 * torque + 0.3 * sign * rng.uniform(100.0, 700.0)
        bad = {12: "torque", 75: "omega", 76: "drive_limit"}.get(tick)
        sense = make_sense(
            10.0 + 0.01 * tick, slip, torque, target, coefficient=rng.uniform(0.0, 0.15)
        )
        if bad:
            sense = sense._replace(**{bad: np.full(4, np.inf) if bad == "omega" else np.nan})
        yield sense


@looped(
    "settings",
    [
        MpcSettings(),
        MpcSettings(step=0.02, horizon=10),
        MpcSettings(step_time=3e-3, headroom=0.3),
        MpcSettings(step_time=0.02),
        MpcSettings(computing_delay=1),
        MpcSettings(computing_delay=1, compensated=False),
        MpcSettings(computing_delay=1, step_time=0.02),
        MpcSettings(computing_delay=1, step=0.025, horizon=10),
    ],
)
def test_every_answer_is_that_in_python(context, make_sense, settings):
    one, other = InNumba(context, settings), MpcController(context, settings)
    statuses = set()
    for sense in _readings(make_sense, 3):
        found, wanted = one.decide(sense), other.decide(sense)
        assert (bool(found.usable), STATUSES[found.status]) == (wanted.ok, wanted.status)
        assert found.torque == pytest.approx(wanted.torque, rel=1e-9, abs=1e-9)
        assert found.solve_time == pytest.approx(wanted.solve_time, rel=1e-12)
        assert found.residual == pytest.approx(wanted.residual, rel=1e-6, abs=1e-9, nan_ok=True)
        statuses.add(wanted.status)
    assert statuses == {
        "reading not finite",
        "ok",
        *(["late"] if settings.step_time > 0.01 else []),
    }


@looped(
    ("name", "rule", "duration"), [("wet-patch", "alone", 9.0), ("wet-stop", "cooperative", 5.0)]
)
def test_the_closed_loop_is_the_references(name, rule, duration):
    event = replace(load_scenario(name).event(), duration=duration)
    own = simulate(event, rule, MPC)
    assert own.attrs["controller_failures"] == 0
    slip = np.abs(own["slip_velocity"].values)
    assert (slip > own["peak_slip"].values).any(), "without slip there is little to solve"
    command = own["torque_command"].values
    for kind in (RealTimeIteration, DaqpIteration):
        in_python = HostedController("mpc", "", each_unit(partial(MpcController, iteration=kind)))
        other = simulate(event, rule, in_python)
        for key in ("controller_calls", "controller_failures", "controller_time_s", "messages"):
            assert own.attrs[key] == other.attrs[key]
        np.testing.assert_allclose(
            command, other["torque_command"].values, atol=1e-8 * np.abs(command).max()
        )


FIXED = MpcSettings(belief=PeakBelief(initial=0.12, floor=0.12 - 1e-12, ceiling=0.12))


"""A belief about the peaks that stays as it is."""


@looped("code", ["unit_step", "python"])
def test_with_a_perfect_model_a_delayed_command_is_found_from_the_state_it_acts_on(
    context, make_sense, code
):
    settings = replace(FIXED, computing_delay=1)
    if code == "python":
        controller = MpcController(context, settings)
        now = controller._solver.period.now
    else:
        controller = InNumba(context, settings)
        now = controller.controller.kept[1].period.now
    model = unit_model(with_predicted_curve(context))
    state, commands = np.array([10.0, *[10.1 / 0.43] * 4, 500.0]), []
    for _ in range(60):
        sense = make_sense(speed=state[0], torque=state[5])._replace(omega=state[1:5].copy())
        commands.append(float(controller.decide(sense).torque))
        step = step_function(model, context.period, int(now.substeps[0]))
        state = np.asarray(step(state, commands[-1], now.parameters)).ravel()
        np.testing.assert_allclose(now.state, state, rtol=1e-9)
    assert np.ptp(commands) > 100.0


def test_without_compensation_a_delayed_command_is_that_of_the_period_before(context, make_sense):
    at_once = InNumba(context, FIXED)
    delayed = InNumba(context, replace(FIXED, computing_delay=1, compensated=False))
    rng, found = np.random.default_rng(2), []
    for _ in range(40):
        sense = make_sense(slip=rng.uniform(0.0, 0.1), torque=rng.uniform(300.0, 600.0))
        found.append([float(one.decide(sense).torque) for one in (at_once, delayed)])
    own, late = np.array(found).T
    np.testing.assert_allclose(late[1:], own[:-1], rtol=1e-9)
    # what was commanded before stands until then; of what the driver no longer wants nothing does
    assert delayed.decide(make_sense(target=50.0)).torque == pytest.approx(50.0)
    assert delayed.decide(make_sense(target=0.0)).torque == 0.0


def test_a_delayed_failure_fails_when_its_command_would_act(context, make_sense):
    one = InNumba(context, replace(FIXED, computing_delay=1))
    senses = [make_sense(torque=300.0)] * 5
    senses[2] = senses[2]._replace(speed=np.nan)
    statuses = [STATUSES[one.decide(sense).status] for sense in senses]
    assert statuses == ["ok", "ok", "ok", "reading not finite", "ok"]


def test_a_period_allocates_nothing(context, make_sense):
    one = InNumba(context)
    senses = list(_readings(make_sense, 5))
    one.decide(senses[0])
    _nrt_python.memsys_enable_stats()
    before = _nrt_python.memsys_get_stats_alloc()
    for sense in senses[1:]:
        one.decide(sense)
    assert _nrt_python.memsys_get_stats_alloc() == before
    _nrt_python.memsys_disable_stats()
