"""Drives that twist between rotor and wheelset: back ends, energy, the rigid limit, self-excitation beyond the peak."""

from dataclasses import replace

import numpy as np
import pytest

from alloc.balance import energy_balance
from alloc.errors import PlantError
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.laws import swing_torque
from alloc.plant.model import Model, build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Motors, Train
from tests.cases import looped
from tests.plant.conftest import FLAT
from tests.plant.test_engine import assert_back_ends_agree

ROTOR = 1.0
"""Inertia of a rotor [kg m2], at the wheel a third of the wheelset's."""


def _twisting(train: Train, **shaft: object) -> Train:
    """`train` with drives that twist."""
    shaft = {"rotor_inertia": ROTOR} | shaft
    cars = (
        replace(car, motors=replace(car.motors, **shaft)) if car.motors else car for car in train.cars
    )  # fmt: skip
    return replace(train, cars=tuple(cars))


def _model(train: Train, **rail: object) -> Model:
    return build(train, Rail(0.2, curve=PiecewiseCurve(), **rail))


@looped("kind", ["torque", "induction"])
def test_back_ends_agree_and_the_stiffness_bounds_the_jacobian(kind):
    assert_back_ends_agree(_model(_twisting(find_set("commuter-8car"), kind=kind)), (1.0, 20.0))


def test_energy_closes_and_a_stiff_drive_is_a_rigid_one(run, train):
    """Trailers beside driven cars: their axles have no rotor."""
    speeds = {}
    for name, whole in {
        "rigid": train("MT"),
        "soft": _twisting(train("MT"), shaft_stiffness=2e6),
        "stiff": _twisting(train("MT"), shaft_stiffness=2e8),
    }.items():
        model = _model(whole)
        trace = run(model, 2.0, 5.0, step=1e-4, sample=2e-3, command=700.0)
        missing, _ = energy_balance(model, trace.state)
        assert np.abs(missing).max() < 1e-6 * trace.rows("work")[-1, 0], name
        speeds[name] = trace.rows("omega")
    far = {name: np.abs(speeds[name] - speeds["rigid"]).max() for name in ("soft", "stiff")}
    assert far["stiff"] < 0.02 * far["soft"] < 0.1


@looped(("slope", "grows"), [(0.02, False), (0.4, True)])
def test_beyond_the_peak_a_drive_excites_itself_as_fast_as_its_linear_model(
    run, train, slope, grows
):
    """Growth of the oscillation against the eigenvalue of two inertias, a spring, a damper and a contact that falls.

    The body holds still: what it moves meanwhile is the trend that a drive's own frequency does not see.
    """
    curve = PiecewiseCurve(macro_slope=slope, residual_ratio=0.3)
    model = build(_twisting(train("M")), Rail(0.2, curve=curve))
    s, n = model.structure, model.layout
    rotor, stiffness, damping = s.axle_shaft[:, 0]
    wheel = s.inertia[0] - rotor
    falls = s.static_load[0] * s.radius[0] ** 2 * -slope  # of the rail's torque per rad/s
    linear = np.array([
        [-damping / rotor, damping / rotor, -stiffness / rotor],
        [damping / wheel, (-damping - falls) / wheel, stiffness / wheel],
        [1.0, -1.0, 0.0],
    ])  # fmt: skip
    growth = float(
        np.linalg.eigvals(linear).real[np.abs(np.linalg.eigvals(linear).imag) > 1.0].max()
    )
    assert (growth > 0.0) == grows
    # just beyond the end of the parabola the tail falls with this slope
    top = float(curve.limit(0.2)[1])
    slip = top + slope / (2.0 * curve.top_curvature) + 1e-3
    start = model.initial_state(10.0)
    start[n.omega] = start[n.rotor] = (10.0 + slip) / s.radius
    force = float(curve.coefficient(slip, 0.2)) * s.static_load[0]
    # the wheels turn faster as the body does, so slip stays
    turning = n.axles * force / s.body_mass[0] / s.radius[0]
    torque = force * s.radius[0] + s.inertia[0] * turning
    start[n.torque] = torque / s.gear[0]
    start[n.twist] = (torque - rotor * turning) / stiffness + 1e-6
    trace = run(model, 0.1, 10.0, step=2e-5, sample=2e-4, command=torque / s.gear[0], state=start)
    rate = np.abs(trace.rows("rotor")[:, 0] - trace.rows("omega")[:, 0])
    tops = 1 + np.flatnonzero((rate[1:-1] > rate[:-2]) & (rate[1:-1] >= rate[2:]))
    assert tops.size >= 8
    found = np.polyfit(trace.time[tops], np.log(rate[tops]), 1)[0]
    assert found == pytest.approx(growth, rel=0.1)


def test_the_swing_is_what_a_free_oscillation_reaches():
    stiffness, reduced, settled, size = 5e6, 40.0, 3e3, 2e3
    phase = np.linspace(0.0, 2.0 * np.pi, 50)
    torque = settled + size * np.sin(phase)
    rate = size * np.cos(phase) / np.sqrt(stiffness * reduced)  # k d(twist)/dt = dT/dt
    swing = swing_torque(torque, settled, rate, stiffness, reduced)
    np.testing.assert_allclose(swing, settled + size, rtol=1e-12)


@looped(
    ("fault", "word"),
    [({"rotor_inertia": -1.0}, "rotor_inertia"), ({"shaft_stiffness": 0.0}, "shaft_stiffness"),
     ({"shaft_damping": 1.0}, "below 1")],
)  # fmt: skip
def test_what_does_not_fit_is_refused(fault, word):
    with pytest.raises(PlantError, match=word):
        Motors("1C4M", 7.0, FLAT, FLAT, **fault)
    with pytest.raises(PlantError, match="must be less than wheel_inertia"):
        _twisting(find_set("commuter-8car"), rotor_inertia=10.0)
