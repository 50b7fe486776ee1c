"""Adhesion that the energy of slip recovers: back ends, energy, the law's limits, what is left for those behind."""

import numpy as np
import pytest

from alloc.balance import energy_balance
from alloc.errors import PlantError
from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve
from alloc.plant.laws import cleaned_degree, recovered_peak, recovery_rate
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from tests.cases import looped
from tests.plant.test_engine import assert_back_ends_agree

RECOVERING = {"recovered_coefficient": 0.28, "recovery_energy": 1000.0}


@looped(("name", "curve"), [("commuter-8car", PiecewiseCurve()), ("freight-5", POLACH_WET)])
def test_back_ends_agree_and_the_stiffness_bounds_the_jacobian(name, curve):
    model = build(find_set(name), Rail(0.06, curve=curve, **RECOVERING))
    assert_back_ends_agree(model, (20.0,), ("cleaning",))


def test_the_degree_follows_the_energy_on_a_metre_of_rail():
    degree, energy = np.linspace(0.0, 1.0, 11), 1000.0
    # at rest it fades; W = the energy holds tanh(1); a wheel that dissipates much is clean at last
    assert (recovery_rate(degree, 0.0, 10.0, energy, 0.1) <= 0.0).all()
    held = np.tanh(1.0)
    for speed, power in ((10.0, 10e3), (10.0, -10e3), (40.0, 40e3), (0.0, 1e3)):
        assert recovery_rate(held, power, speed, energy, 0.1) == pytest.approx(0.0, abs=1e-12)
        assert recovery_rate(0.0, power, speed, energy, 0.1) == pytest.approx(held / 0.1)
    assert recovery_rate(1.0, 1e9, 10.0, energy, 0.1) == pytest.approx(0.0, abs=1e-12)
    for own in degree:
        both = cleaned_degree(own, degree)
        assert (both >= np.maximum(own, degree) - 1e-12).all()
        assert both[-1] == pytest.approx(1.0)
    # rail that carries more than clean rail stays as it is
    np.testing.assert_array_equal(recovered_peak(0.3, degree, 0.28), np.full(11, 0.3))
    np.testing.assert_allclose(recovered_peak(0.06, degree, 0.28)[[0, -1]], [0.06, 0.28])


def test_a_wheel_that_slips_recovers_and_leaves_a_share_to_those_behind(run, train):
    """Energy closes, and adhesion rises by energy; without a share on the rail each axle is on its own."""
    found = {}
    for name, change in {
        "none": {}, "own": RECOVERING | {"recovery_left": 0.0}, "shared": RECOVERING | {"recovery_left": 1.0},
    }.items():  # fmt: skip
        model = build(train("M"), Rail(0.06, curve=PiecewiseCurve(), **change))
        trace = run(model, 4.0, 8.0, step=2e-4, sample=2e-3, command=700.0)
        missing, turned = energy_balance(model, trace.state)
        assert np.abs(missing).max() < 1e-6 * turned[-1], name
        found[name] = trace
    speed = {name: trace.rows("speed")[-1, 0] for name, trace in found.items()}
    assert speed["none"] < speed["own"] < speed["shared"]
    assert not found["own"].cleaning.any()
    degree = found["shared"].rows("recovery")
    assert degree.min() >= 0.0
    assert degree.max() <= 1.0
    # the last axle runs on what the others cleaned, and needs less slip of its own
    assert found["shared"].cleaning[-1, -1] > found["shared"].cleaning[-1, 1] > 0.0
    assert found["shared"].cleaning[-1, 0] == 0.0


def test_what_does_not_fit_is_refused():
    with pytest.raises(PlantError, match="two laws"):
        Rail(0.06, conditioning=0.1, recovered_coefficient=0.28)
    faults = {
        "recovery_energy": 0.0,
        "recovery_time": -1.0,
        "recovery_left": 1.5,
        "recovered_coefficient": -0.1,
    }
    for name, value in faults.items():
        with pytest.raises(PlantError, match=name):
            Rail(0.06, **{name: value})
