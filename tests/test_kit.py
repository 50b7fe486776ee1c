"""The conformance kit: every shipped controller and curve passes, and of a faulty one it says which law is broken."""

import math
from dataclasses import dataclass

import numpy as np
import pytest

import mpc.unit  # noqa: F401  (registers "mpc")
from alloc.curves import CURVES, PiecewiseCurve
from alloc.errors import InputError
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.parts import control
from alloc.rules.testing import BrokenLaw
from alloc.testing import check_controller, check_curve, check_part
from tests.cases import looped


@looped("name", [*CONTROLLERS, *CURVES])
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


@looped(("function", "law", "said"), [
    (beyond, "within target", r"by 0\.1;"), (no_number, "within target", "by nan;"), (timid, "dry rail", r"by 0\.1;"),
    (needs_two_axles, "within target", "IndexError.*axles=1"), (never_again, "recovers", r"drop=0\.25"),
])  # fmt: skip
def test_a_faulty_controller_is_told(function, law, said):
    with pytest.raises(BrokenLaw, match=rf"^faulty breaks the law '{law}'.*{said}"):
        check_controller(Controller("faulty", function, ""))


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
    with pytest.raises(BrokenLaw, match=rf"^Faulty breaks the law '{law}'.*Rolling\(peak="):
        check_curve(Faulty(change=change, apart=apart))


def test_an_unknown_name_is_told_with_the_nearest():
    with pytest.raises(InputError, match="'cut-and-rampe'; did you mean 'cut-and-ramp'"):
        check_part("cut-and-rampe")
