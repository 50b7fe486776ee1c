"""Curves of one's own: any shape over the slip velocity becomes a curve like the others."""

import math
import pkgutil
from dataclasses import dataclass
from importlib import import_module

import numba
import numpy as np
import pytest

import studies
from alloc.errors import PlantError
from alloc.metrics import METRICS
from alloc.onboard.host import CONTROLLERS
from alloc.plant.adhesion import CURVES, ExponentialDifference, ShapedCurve
from alloc.plant.laws import TABULATED, adhesion_limit, tangential_coefficient
from alloc.plant.sets import SETS
from alloc.rules import RULES
from alloc.testing import check_curve


@dataclass(frozen=True)
class DoubleExponential(ShapedCurve):
    a: float = 0.54
    b: float = 1.2

    def shape(self, slip):
        return np.exp(-self.a * slip) - np.exp(-self.b * slip)

    @property
    def top(self):
        return np.log(self.b / self.a) / (self.b - self.a)


@dataclass(frozen=True)
class Faulty(ShapedCurve):
    values: str = "nan"

    def shape(self, slip):
        return {
            "nan": np.full_like(slip, np.nan),
            "negative": -slip,
            "no maximum": slip,
            "not from 0": np.exp(-slip),
            "one value": np.array(1.0),
        }[self.values]


SLIP = np.linspace(0.0, 25.0, 4001)


@pytest.mark.parametrize("curve", [DoubleExponential(), DoubleExponential(0.1, 50.0)])
def test_the_shape_is_met_at_every_slip_and_scaled_to_the_peak(curve):
    shape = curve.shape(SLIP) / curve.shape(np.array(curve.top))
    np.testing.assert_allclose(curve.coefficient(SLIP, 0.2), 0.2 * shape, atol=2e-5 * 0.2)
    np.testing.assert_allclose(curve.coefficient(-SLIP, 0.2), -0.2 * shape, atol=2e-5 * 0.2)


def test_the_peak_is_the_shapes():
    curve = DoubleExponential()
    coefficient, slip = curve.limit(0.2, 10.0)
    assert coefficient == 0.2
    assert slip == pytest.approx(curve.top, rel=1e-3)


def test_a_steep_shape_keeps_the_laws_of_curves():
    check_curve(DoubleExponential(1.0, 60.0), 60)


def test_compiled_code_agrees():
    curve = DoubleExponential()

    @numba.njit
    def compiled(q, slip, peak):
        return tangential_coefficient(TABULATED, q, slip, 10.0, 10.0 + slip, peak), adhesion_limit(
            TABULATED, q, peak, 10.0
        )

    for slip in (-3.0, -0.01, 0.0, 0.7, 1e6):
        value, limit = compiled(curve.q, slip, 0.17)
        assert value == pytest.approx(float(curve.coefficient(slip, 0.17)), rel=1e-12, abs=1e-15)
        assert limit == (0.17, curve.q[0])


@pytest.mark.parametrize("values", ["nan", "negative", "no maximum", "not from 0", "one value"])
def test_what_is_no_curve_is_refused_by_name(values):
    with pytest.raises(PlantError, match="adhesion curve Faulty: shape must"):
        Faulty(values).coefficient(0.1, 0.2)


def test_the_shipped_curves_are_known_by_name():
    assert list(CURVES)[:3] == ["piecewise", "polach", "slip-ratio"]
    with pytest.raises(PlantError, match="did you mean 'polach'"):
        CURVES.find("pollach")


@pytest.mark.parametrize(
    "registry", [CURVES, RULES, CONTROLLERS, SETS, METRICS], ids=lambda one: one.kind
)
def test_no_part_is_there_only_where_a_study_was_imported(registry):
    for module in pkgutil.walk_packages(studies.__path__, "studies."):
        import_module(module.name)
    assert [name for name in registry if registry.origin(name).startswith("studies.")] == []


def test_the_exponential_difference_peaks_where_its_derivative_says():
    curve = ExponentialDifference()
    slip = math.log(curve.b * curve.d / (curve.a * curve.c)) / (curve.b - curve.a)
    assert curve.limit(0.2, 15.0)[1] == pytest.approx(slip, rel=1e-3)
    assert slip == pytest.approx(1.21, abs=0.01)
    assert type(curve) is CURVES["exponential-difference"]
    with pytest.raises(PlantError, match="shape must"):
        ExponentialDifference(a=1.2).coefficient(0.1, 0.2)


def test_the_mpc_cannot_believe_in_it():
    casadi = pytest.importorskip("casadi")
    slip = casadi.SX.sym("slip")
    with pytest.raises(PlantError, match="name another"):
        tangential_coefficient(TABULATED, DoubleExponential().q, slip, 10.0, 10.0, 0.2)
