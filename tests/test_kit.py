"""The conformance kit: every shipped controller and curve passes, and of a faulty one it says which law is broken."""

import math
import re
from dataclasses import dataclass
from linecache import getline

import numpy as np
import pytest

from alloc.conformance import DRY, check_belief, check_controller, check_curve, check_part
from alloc.onboard.beliefs import BELIEFS, Belief
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.onboard.signatures import control, share
from alloc.plant.curves import CURVES, PiecewiseCurve, own_curve
from alloc.rules import RULES, Rule
from alloc.rules.conformance import BrokenLaw, check_rule
from alloc.run.simulation import Simulation, simulate
from alloc.schema.errors import InputError
from tests.cases import looped


@looped("name", [*CONTROLLERS, *BELIEFS, *CURVES])
def test_what_ships_keeps_every_law(name):
    assert max(check_part(name).values()) < 1e-2


def beyond(unit, axles, memory, run):
    unit.torque_command = 1.1 * unit.torque_target


def timid(unit, axles, memory, run):
    unit.torque_command = 0.9 * unit.torque_target


def needs_two_axles(unit, axles, memory, run):
    unit.torque_command = unit.torque_target if axles[1].unit >= 0 else 0.0


@control
def no_number(unit, axles, memory, run):
    unit.torque_command = math.nan if unit.slipping else unit.torque_target


@control
def never_again(unit, axles, memory, run):
    unit.torque_command = (0.5 if unit.detected > 0.0 else 1.0) * unit.torque_target


@looped(("function", "broken", "said"), [
    (beyond, "within target", r"by 0\.1;"), (no_number, "within target", "by nan;"), (timid, "dry rail", r"by 0\.1;"),
    (needs_two_axles, "within target", "IndexError.*axles=1"), (never_again, "recovers", r"drop=0\.25"),
])  # fmt: skip
def test_a_faulty_controller_is_told(function, broken, said):
    with pytest.raises(BrokenLaw, match=rf"^faulty breaks the law '{broken}'.*{said}"):
        check_controller(Controller("faulty", function, ""))


def of_the_delivered(change):
    """The belief "delivered" with a change of the units after it."""

    def function(tick, units, reports, report_tick, run):
        asks = BELIEFS["delivered"].function(tick, units, reports, report_tick, run)
        change(units, run)
        return asks

    return Belief("faulty", function, "")


def negative(units, run):
    units.cap = -0.1


def never_lifted(units, run):
    units.wanted = np.minimum(units.wanted, 0.5)


@looped(("change", "broken"), [(negative, "caps"), (never_lifted, "lifts")])
def test_a_faulty_belief_is_told(change, broken):
    with pytest.raises(BrokenLaw, match=rf"^faulty breaks the law '{broken}'"):
        check_belief(of_the_delivered(change))


def test_a_controller_that_gets_at_the_plant_is_not_blind(monkeypatch):
    runs, start = [], Simulation.__init__

    def watched(self, *arguments):
        start(self, *arguments)
        runs.append(self)

    def cheats(unit, axles, memory, run):
        offered = runs[-1].world.wheelsets.offered.min()
        carried = 0.9 * offered * unit.load * unit.radius / unit.gear
        unit.torque_command = min(unit.torque_target, carried if carried > 0.0 else 0.0)

    monkeypatch.setattr(Simulation, "__init__", watched)
    with pytest.raises(BrokenLaw, match="breaks the law 'blind'"):
        check_controller(Controller("cheat", cheats, ""))


def test_a_row_on_board_has_no_column_of_the_rail():
    def cheats(unit, axles, memory, run):
        unit.torque_command = axles[0].offered * unit.torque_target

    with pytest.raises(InputError, match="offered"):
        check_controller(Controller("cheat", cheats, ""))


@dataclass(frozen=True)
class Faulty(PiecewiseCurve):
    """`change`(coefficients of the piecewise curve, slip); its top is said to be `apart` times as far as it is."""

    values = PiecewiseCurve().values
    change: object = None
    apart: float = 1.0

    def __call__(self, slip, peak, speed=0.0, contact=1.0):
        return self.change(super().__call__(slip, peak, speed, contact), np.asarray(slip))

    def top(self, speed, peak, contact=1.0):
        return super().top(speed, peak, contact) * [1.0, self.apart]


@looped(("change", "apart", "law"), [
    (lambda mu, slip: mu, 1.5, "top"), (lambda mu, slip: np.abs(mu), 1.0, "odd"),
    (lambda mu, slip: mu * np.cos(np.maximum(np.abs(slip), 1.0) - 1.0) ** 2, 1.0, "one maximum"),
    (lambda mu, slip: mu + 1e-3 * (slip == 0.0), 1.0, "zero"), (lambda mu, slip: mu + np.nan * slip, 1.0, "finite"),
])  # fmt: skip
def test_a_faulty_curve_is_told(change, apart, law):
    with pytest.raises(BrokenLaw, match=rf"^Faulty breaks the law '{law}'.*CurvePoint\(peak="):
        check_curve(Faulty(change=change, apart=apart))


@share
def reads(units, run):
    units[0].wanted = units[0].capp
    return math.nan


def writes(units, run):
    units.wantd = run.needed
    return math.nan


@control
def commands(unit, axles, memory, run):
    unit.torque_comand = unit.torque_target


BELIEF = Belief("b", lambda tick, units, reports, report_tick, run: units[0].searchin > 0, "")


@looped(("kept_by", "part", "nearest"), [
    (check_rule, Rule("r", "", reads), "cap"), (check_rule, Rule("r", "", writes), "wanted"),
    (check_rule, Rule("r", "", answer=lambda problem: problem.uper), "upper"),
    (check_controller, Controller("c", commands, ""), "torque_command"),
    (check_controller, Controller("c", commands.py_func, ""), "torque_command"),
    (lambda rule: simulate(DRY[0].event, rule), Rule("r", "", writes, BELIEF), "searching"),
    (lambda shape: own_curve("c", shape), lambda slip: np.exxp(slip), "exp"),
])  # fmt: skip
def test_a_misspelling_is_no_counterexample(kept_by, part, nearest):
    with pytest.raises(InputError, match=rf"; did you mean '{nearest}'\?$") as raised:
        kept_by(part)
    file, line = re.search(r" of (.*): \w+ in line (\d+): ", str(raised.value)).groups()
    assert re.search(r"(capp|wantd|uper|comand|searchin|exxp)\b", getline(file, int(line)))


@looped(("check", "part", "advice"), [
    (check_part, "cut-and-rampe", "'cut-and-ramp'"), (check_controller, "perturb-obserf", "'perturb-observe'"),
    (check_rule, "exakt", "'exact'"), (check_curve, "piecewize", "'piecewise'"),
    (check_rule, 5, "the name of a rule"), (check_controller, 5, "the name of a controller"), (check_curve, 5, "the name"),
])  # fmt: skip
def test_what_is_no_part_is_named_with_what_to_give(check, part, advice):
    with pytest.raises(InputError, match=rf"{part!r}(; did you mean|: give) {advice}"):
        check(part)


def test_a_name_is_checked_as_the_part_itself():
    assert check_rule("greedy", examples=5) == check_rule(RULES["greedy"], examples=5)
    assert check_curve("piecewise") == check_curve(PiecewiseCurve())
