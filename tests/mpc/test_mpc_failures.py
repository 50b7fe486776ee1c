"""Failures of the MPC in the closed loop: cut-and-ramp takes over for the periods that failed, and the run recovers."""

import numpy as np
import pytest

from alloc.metrics import evaluate
from alloc.simulation import simulate
from mpc.solver import NO_SOLUTION
from mpc.unit import MpcController
from tests.mpc.drop import BACK, DROP, adhesion_used, between, driven, drop_event, run_mpc

UNITS, PERIOD = 4, 0.01


def failing(when, fails=None):
    """Class of controllers whose solver finds nothing at the periods that `when` (number, time) picks."""

    class Failing(MpcController):
        def __init__(self, context, settings=None):
            super().__init__(context, settings)
            self.calls = 0

        def decide(self, sense):
            bad = when(self.calls, sense.time)
            self.calls += 1
            solver = self._solver
            sound = solver._iterate
            if bad:
                solver._iterate = lambda *_: (1.0, 1.0, 1, NO_SOLUTION)
            decision = super().decide(sense)
            solver._iterate = sound
            # without demand nothing is solved
            assert decision.ok != (bad and sense.target != 0.0)
            if fails is not None and not decision.ok:
                fails.append(sense.time)
            return decision

    return Failing


PATTERNS = {
    "every third": lambda number, time: number % 3 == 0,
    "every tenth": lambda number, time: number % 10 == 0,
    "from the drop on for half a second": lambda number, time: DROP <= time < DROP + 0.5 - 1e-9,
}


@pytest.mark.parametrize("pattern", PATTERNS)
def test_a_solver_that_fails_is_counted_and_survived(pattern):
    fails = []
    run, _ = run_mpc(drop_event(), None, failing(PATTERNS[pattern], fails))
    assert run.attrs["controller_failures"] == len(fails) > 0
    assert "QP not solved" in run.attrs["messages"]
    assert adhesion_used(run, DROP + 1.2) > 0.85
    command, target = run["torque_command"].values, run["torque_target"].values
    assert np.isfinite(command).all()
    assert np.all((command >= 0.0) & (command <= target * (1 + 1e-12)))
    # whoever answered, the MPC or its reserve
    factor = run["torque_factor"].values
    assert factor.min() < 0.8
    np.testing.assert_array_equal(
        factor[target != 0.0], (command[target != 0.0] / target[target != 0.0])
    )
    assert np.all(factor[target == 0.0] == 1.0)
    assert (
        evaluate(run)["slip_time"] < evaluate(simulate(drop_event(), "alone", "none"))["slip_time"]
    )


@pytest.mark.parametrize(
    "pattern",
    ["every third", "every tenth", "from the drop on for half a second"],
)
def test_slip_stays_near_the_peak_although_the_solver_fails(pattern):
    run, _ = run_mpc(drop_event(), None, failing(PATTERNS[pattern]))
    settled = between(run, DROP + 1.2, BACK)
    slip, top = (
        run[name].values[settled][:, driven(run)] for name in ("slip_velocity", "peak_slip")
    )
    assert np.all(slip < 4.0 * top)


def test_a_solver_that_never_answers_leaves_the_run_to_cut_and_ramp():
    event = drop_event(duration=5.5)
    run, _ = run_mpc(event, None, failing(lambda number, time: True))
    classic = simulate(event, "alone", "cut-and-ramp")
    for name in ("torque_command", "slip_velocity", "speed"):
        np.testing.assert_array_equal(run[name], classic[name])


def test_after_an_interval_of_failures_it_is_as_if_they_had_not_been():
    sound, _ = run_mpc(drop_event())
    run, _ = run_mpc(drop_event(), None, failing(PATTERNS["from the drop on for half a second"]))
    assert run.attrs["controller_failures"] == UNITS * 50
    assert adhesion_used(run, BACK - 0.5) > 0.97 * adhesion_used(sound, BACK - 0.5)


@pytest.mark.parametrize("every", [5, 50])
def test_a_solver_that_is_late_now_and_then_is_counted_and_survived(every):
    class Late(MpcController):
        calls = 0

        def decide(self, sense):
            self._late = self.calls % every == 0
            self.calls += 1
            decision = super().decide(sense)
            assert decision.status == ("late" if self._late and sense.target else "ok")
            late.append(decision.status == "late")
            return decision

    event, late = drop_event(), []
    run, _ = run_mpc(event, None, Late)
    assert run.attrs["controller_failures"] == sum(late)
    assert sum(late) > 0.9 * UNITS * event.duration / PERIOD / every
    assert adhesion_used(run) > 0.85


def test_a_fault_of_the_program_ends_the_run():
    class Broken(MpcController):
        calls = 0

        def _problem(self, *readings):
            self.calls += 1
            if self.calls == 5:
                raise ZeroDivisionError("no axles")
            return super()._problem(*readings)

    with pytest.raises(ZeroDivisionError, match="no axles"):
        run_mpc(drop_event(duration=1.0), None, Broken)
