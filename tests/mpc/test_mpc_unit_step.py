"""The compiled period of a unit's MPC is the one in Python: for readings of all kinds, and in the closed loop."""

from dataclasses import replace

import numpy as np
import pytest
from numba.core.runtime import _nrt_python

import mpc.unit_controller
from alloc.onboard.compiled_controller import ANSWER, READING
from alloc.onboard.host import HostedController, each_unit
from alloc.plant.adhesion import PiecewiseCurve
from alloc.simulation import simulate
from mpc.hosted import MPC
from mpc.real_time import RealTimeIteration
from mpc.settings import CurveBelief, MpcSettings
from mpc.unit_controller import MpcController
from mpc.unit_model import substeps
from mpc.unit_step import STATUSES, compiled_unit, unit_step
from studies.scenario.loading import load_scenario
from tests.benchmarks.daqp_peer import DaqpIteration
from tests.mpc.drop import drop_event, run_mpc

IN_PYTHON = HostedController(
    "mpc", "in Python", each_unit(lambda context: MpcController(context, context.settings))
)


class Compiled:
    """The compiled controller, asked from Python."""

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


@pytest.mark.parametrize(
    "settings",
    [
        MpcSettings(),
        MpcSettings(exact_hessian=True, horizon=8),
        MpcSettings(step=0.02, horizon=10),
        MpcSettings(step_time=3e-3, headroom=0.3, slip_limit=0.8),
        MpcSettings(step_time=0.02),
    ],
    ids=["default", "exact", "longer steps", "few steps", "late"],
)
def test_every_answer_is_that_in_python(context, make_sense, settings):
    one, other = Compiled(context, settings), MpcController(context, settings)
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


@pytest.mark.parametrize(
    ("name", "rule", "duration"), [("wet-patch", "alone", 9.0), ("wet-stop", "cooperative", 5.0)]
)
def test_the_closed_loop_is_the_references(monkeypatch, name, rule, duration):
    event = replace(load_scenario(name).event(), duration=duration)
    own = simulate(event, rule, MPC)
    assert own.attrs["controller_failures"] == 0
    slip = np.abs(own["slip_velocity"].values)
    assert (slip > own["peak_slip"].values).any(), "without slip there is little to solve"
    command = own["torque_command"].values
    for kind in (RealTimeIteration, DaqpIteration):
        monkeypatch.setattr(mpc.unit_controller, "RealTimeIteration", kind)
        other = simulate(event, rule, IN_PYTHON)
        for key in ("controller_calls", "controller_failures", "controller_time_s", "messages"):
            assert own.attrs[key] == other.attrs[key]
        np.testing.assert_allclose(
            command, other["torque_command"].values, atol=1e-8 * np.abs(command).max()
        )


def test_a_curve_that_gets_steeper_is_predicted_in_more_steps():
    # believed is a slope half as steep as the rail's: the stretch falls to 0.5
    event = drop_event(curve=PiecewiseCurve(micro_slope=0.5 * PiecewiseCurve().micro_slope))
    run, made = run_mpc(event)
    other = simulate(event, "alone", MPC)
    np.testing.assert_array_equal(run["torque_command"], other["torque_command"])
    for controller in made:
        q, now = controller.belief.q, controller._solver.period.now
        assert controller.belief.stretch < 0.7
        steeper = replace(controller._context, curve=controller._context.curve.with_parameters(q))
        assert substeps(steeper, 0.01) <= now.substeps[0] <= 2 * substeps(steeper, 0.01)
        assert now.substeps[0] > substeps(controller._context, 0.01)


def test_room_is_made_for_the_steepest_curve(context):
    settings = MpcSettings(curve=CurveBelief(smallest=0.5), exact_hessian=True)
    rules = MpcController(context, settings)._solver.period.rules
    assert rules.most_substeps == substeps(context, settings.step, 1.0 / (0.8 * 0.5))
    off = replace(settings, curve=CurveBelief(estimate=False))
    assert MpcController(context, off)._solver.period.rules.most_substeps == substeps(context, 0.01)


def test_a_period_allocates_nothing(context, make_sense):
    one = Compiled(context)
    senses = list(_readings(make_sense, 5))
    one.decide(senses[0])
    _nrt_python.memsys_enable_stats()
    before = _nrt_python.memsys_get_stats_alloc()
    for sense in senses[1:]:
        one.decide(sense)
    assert _nrt_python.memsys_get_stats_alloc() == before
    _nrt_python.memsys_disable_stats()
