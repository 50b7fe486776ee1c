"""A controller that the loop calls as compiled code does what the same one does in Python, its failures included."""

import json
import math
from dataclasses import replace
from typing import ClassVar, NamedTuple

import numpy as np
import pytest
from numpy.typing import NDArray

from alloc.compilation import compiled
from alloc.event import DriverCommand
from alloc.onboard.host import (
    STEP,
    CompiledController,
    HostedController,
    TorqueDecision,
    each_compiled,
    each_unit,
)
from alloc.onboard.parameters import ReferenceSpeed, Sensors
from alloc.records import ByReference, address_of, stored_at
from alloc.simulation import simulate

PATTERN = ("ok", "infeasible", "odd but usable", "not a number", "ok", "ok")
"""What becomes of the answers, period by period and over again."""
MEASURED = ("rule_time_s", "wall_time_s")


class Python:
    """Takes a share of the target, less for slip of its fastest axle; fails by the pattern."""

    def __init__(self, context):
        self.calls, self.radius = 0, context.radius

    def decide(self, sense):
        what = PATTERN[self.calls % len(PATTERN)]
        self.calls += 1
        slip = np.abs(self.radius * sense.omega - sense.speed).max()
        size = max(0.9 * abs(sense.target) - 2000.0 * slip - 10.0 * sense.slipping, 0.0)
        torque, spent = math.copysign(size, sense.target), 1e-3 * (self.calls % 7)
        if what == "infeasible":
            return TorqueDecision(torque, False, what, spent)
        if what == "not a number":
            return TorqueDecision(math.nan, True, "ok", spent)
        return TorqueDecision(torque, True, what, spent)


class Kept(NamedTuple):
    """What the compiled one keeps."""

    radius: float
    calls: NDArray[np.int64]


_kept_at = stored_at(ByReference(Kept(0.0, np.zeros(1, np.int64))).kind)


def _step(address, reading, omega, answer):
    kept = _kept_at(address)
    k = kept.calls[0] % 6
    kept.calls[0] += 1
    slip = 0.0
    for i in range(omega.size):
        slip = max(slip, abs(kept.radius * omega[i] - reading.speed))
    size = max(0.9 * abs(reading.target) - 2000.0 * slip - 10.0 * reading.slipping, 0.0)
    answer.torque = math.copysign(size, reading.target) if k != 3 else math.nan
    answer.usable = int(k != 1)
    answer.status = k if k in (1, 2) else 0
    answer.solve_time = 1e-3 * (kept.calls[0] % 7)


STEP_OF_IT = compiled(_step, STEP.signature, error_model="numpy", nogil=True, _nrt=False)


def _compiled(context):
    record = ByReference(Kept(context.radius, np.zeros(1, np.int64)))
    address = address_of(STEP_OF_IT, STEP)
    return CompiledController(address, record.address, PATTERN[:3], record)


BOTH = (
    HostedController("mine", "in Python", each_unit(Python)),
    HostedController("mine", "compiled", each_compiled(_compiled)),
)
DEMANDS = {
    "driving": {},
    "to a stop": {"command": DriverCommand((0.2,), (-1.2,)), "initial_speed": 6.0},
}


def _same(runs):
    for name in runs[0].variables:
        np.testing.assert_array_equal(runs[0][name].values, runs[1][name].values, err_msg=str(name))
    attributes = [{k: v for k, v in run.attrs.items() if k not in MEASURED} for run in runs]
    messages = [json.loads(one.pop("messages")) for one in attributes]
    assert messages[0] == messages[1]
    assert attributes[0] == attributes[1]
    return messages[1]


@pytest.mark.parametrize("rule", ["alone", "qp"])
@pytest.mark.parametrize("demand", DEMANDS)
def test_compiled_is_as_in_python(make_event, rule, demand):
    runs = [simulate(make_event(0.11, **DEMANDS[demand]), rule, one) for one in BOTH]
    messages = _same(runs)
    factor = runs[1]["torque_factor"].values
    assert factor.min() < 0.8, "slip and failures show"
    calls = runs[1].attrs["controller_calls"]
    assert calls == runs[1].sizes["unit"] * 800
    statuses = ("infeasible", "odd but usable", "torque not finite")
    counted = [messages[f"controller: {status}"] for status in statuses]
    assert sum(counted) == runs[1].attrs["controller_failures"]
    np.testing.assert_allclose(counted, calls / 6, atol=runs[1].sizes["unit"])


def test_a_run_that_is_watched_and_ended_early_is_the_same(make_event):
    event, shares = make_event(0.11, **DEMANDS["to a stop"]), []
    runs = [simulate(event, "alone", one, shares.append, until_speed=2.0) for one in BOTH]
    _same(runs)
    whole = simulate(event, "alone", BOTH[1])
    assert len(shares) > 20
    assert 0 < runs[1].sizes["time"] < whole.sizes["time"]
    first = whole.isel(time=slice(runs[1].sizes["time"]))
    np.testing.assert_array_equal(runs[1]["torque_command"].values, first["torque_command"].values)


class Listens:
    """Asks for no torque, and notes what it is told of each wheel beside the speed."""

    ahead: ClassVar[list[NDArray[np.float64]]] = []

    def __init__(self, context):
        self.radius = context.radius

    def decide(self, sense):
        self.ahead.append(self.radius * sense.omega - sense.speed)
        return TorqueDecision(0.0, True, "ok", 0.0)


def test_wheels_are_told_as_fast_as_their_rims(make_event):
    """Of wheels whose radii the computers have compared: the ones they believed in at first would make 0.2 m/s of slip."""
    event = make_event(0.3, command=DriverCommand((3.9,), (-0.5,)), initial_speed=20.0)
    onboard = replace(
        event.onboard,
        sensors=Sensors(radius_error=0.01),
        reference=ReferenceSpeed(radii_compared=False),
    )
    Listens.ahead.clear()
    simulate(
        replace(event, onboard=onboard, duration=4.0),
        "alone",
        HostedController("listens", "in Python", each_unit(Listens)),
    )
    units = len(Listens.ahead) // 400
    found = np.abs(np.array(Listens.ahead)).max(axis=1).reshape(400, units).max(axis=1)
    assert found[10] > 0.1
    assert found[100:390].max() < 0.01


def test_a_run_that_was_interrupted_leaves_nothing_behind(make_event):
    event = make_event(0.11)
    whole = simulate(event, "alone", BOTH[1])

    def stop(share):
        if share > 0.3:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        simulate(event, "alone", BOTH[1], stop)
    again = simulate(event, "alone", BOTH[1])
    np.testing.assert_array_equal(again["torque_command"].values, whole["torque_command"].values)
