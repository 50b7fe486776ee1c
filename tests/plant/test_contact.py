"""Creep stiffness from load and radius, and Polach's curves against Open Rails' formula."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.errors import PlantError
from alloc.plant.adhesion import (
    POLACH_DRY,
    POLACH_WET,
    PolachByFrictionCurve,
    PolachCurve,
    creep_stiffness,
)
from alloc.plant.laws import polach_set
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.train import Train

once = settings(max_examples=40, deadline=None, derandomize=True)
SLIP = np.concatenate([np.geomspace(1e-4, 0.1, 100), np.linspace(0.1, 20.0, 2000)])


def open_rails(slip, friction, speed, load, radius, faults=False):
    """Open Rails' coefficient on straight track, with spin; `load` of a wheel.

    With its `faults` an area in mm2 meets a modulus in Pa, and kA is not squared with the gradient.
    """
    b = 6.0  # mm
    a = 1.52 * np.sqrt(load / 1e3 * radius * 1e3 * 1e3 / (2.0 * b * 207000.0))
    c11 = np.polyval([0.32955, 0.48538, 3.4992], a / b)
    area = a * b * (1.0 if faults else 1e-6)
    fall = max(1.6 * friction - 0.28, 0.2)
    k_adhesion, k_slip = max(2.8 * friction - 0.54, 0.3), max(1.2 * friction - 0.26, 0.1)
    mu = friction * (0.4 + 0.6 * np.exp(-fall * slip))
    longitudinal, spin = slip / speed, np.sin(np.deg2rad(3.0)) / radius * a * 1e-3
    creepage = np.hypot(longitudinal, spin)
    eps = 8.4e10 * np.pi * area * c11 / (4.0 * load * mu) * creepage
    below = 1.0 + (k_adhesion * eps**2 if faults else (k_adhesion * eps) ** 2)
    total = 2.0 * mu / np.pi * (k_adhesion * eps / below + np.arctan(k_slip * eps))
    return total * longitudinal / creepage


@pytest.mark.parametrize("curve", [POLACH_WET, PolachByFrictionCurve()])
def test_the_corrected_formula_of_open_rails(curve):
    """At 0.30, 20 m/s, 100 kN and 0.5 m, braking from micro slip to a lock: within 1 % of the peak."""
    expected = open_rails(SLIP, 0.30, 20.0, 1e5, 0.5)
    value = -curve.coefficient(-SLIP, 0.30, 20.0, curve.contact(1e5, 0.5))
    assert expected.max() == pytest.approx(0.2244, abs=1e-4)
    assert np.abs(value - expected).max() < 0.01 * expected.max()


@pytest.mark.parametrize("friction", [0.1, 0.3, 0.42, 0.55])
@pytest.mark.parametrize(("load", "radius"), [(60e3, 0.43), (100e3, 0.5), (180e3, 0.53)])
def test_open_rails_family_next_door(friction, load, radius):
    """There C11 follows a / b of each load, here the ratio is given: 2 % of the peak's height, 8 % of its slip."""
    curve, speed = PolachByFrictionCurve(), 10.0
    slip = SLIP[speed > SLIP]
    expected = open_rails(slip, friction, speed, load, radius)
    value = -curve.coefficient(-slip, friction, speed, curve.contact(load, radius))
    assert value.max() == pytest.approx(expected.max(), rel=0.02)
    assert slip[value.argmax()] == pytest.approx(slip[expected.argmax()], rel=0.08)


def test_open_rails_as_coded_gives_another_curve():
    """Its peak is 31 % higher and lies at a twelfth of the slip."""
    fine = np.geomspace(1e-3, 20.0, 4000)
    right, coded = (open_rails(fine, 0.30, 20.0, 1e5, 0.5, faults) for faults in (False, True))
    assert (right.max(), fine[right.argmax()]) == pytest.approx((0.2244, 1.405), rel=5e-3)
    assert (coded.max(), fine[coded.argmax()]) == pytest.approx((0.294, 0.12), rel=0.05)


@once
@given(load=st.floats(20e3, 200e3), radius=st.floats(0.3, 0.65), factor=st.floats(0.2, 5.0))
def test_stiffness_falls_with_the_root_of_the_load(load, radius, factor):
    curve = PolachCurve()
    one, other = curve.on(load, radius), curve.on(factor * load, radius)
    assert other.creep_stiffness == pytest.approx(one.creep_stiffness / np.sqrt(factor), rel=1e-12)
    wider = curve.on(load, factor * radius)
    assert wider.creep_stiffness == pytest.approx(one.creep_stiffness * np.sqrt(factor), rel=1e-12)


def test_stiffness_of_the_reference_contact():
    assert creep_stiffness() == pytest.approx(120.8, abs=0.1)
    assert PolachCurve().on(1e5, 0.5).creep_stiffness == pytest.approx(creep_stiffness())
    # Kalker, Poisson's ratio 0.25: C11 grows from 3.6 at a / b = 0.5 to 4.1 at 1, 14 %
    assert creep_stiffness(1.0) / creep_stiffness(0.5) == pytest.approx(1.14, abs=0.02)


def test_a_given_stiffness_counts_for_every_axle():
    curve = PolachCurve(creep_stiffness=186.0)
    np.testing.assert_array_equal(curve.contact([5e4, 1e5], 0.43), 1.0)
    assert curve.on(5e4, 0.43) == curve


def test_each_axle_has_the_stiffness_of_its_load(car):
    """A light car before a heavy one."""
    cars = (car(True, mass=20e3), car(True, mass=80e3))
    model = build(Train("two", cars), Rail(0.3, curve=POLACH_WET))
    wheel_load = 0.5 * model.structure.static_load
    expected = np.sqrt(1e5 / wheel_load * 0.43 / 0.5)
    np.testing.assert_allclose(model.environment.contact, expected, rtol=1e-12)


def test_polach_sets_lie_on_the_family():
    """Dry at 0.55, wet at 0.30 and below."""
    family = PolachByFrictionCurve()
    for friction, curve in ((0.55, POLACH_DRY), (0.30, POLACH_WET), (0.05, POLACH_WET)):
        named = polach_set(family.kind, family.q, np.array(friction))
        own = polach_set(curve.kind, curve.q, np.array(friction))
        np.testing.assert_allclose(named, own, rtol=1e-12)


@pytest.mark.parametrize("values", [{"creep_stiffness": 0.0}, {"half_axes_ratio": 3.0}])
def test_impossible_contacts_are_refused(values):
    for curve in (PolachCurve, PolachByFrictionCurve):
        with pytest.raises(PlantError, match=next(iter(values))):
            curve(**values)
