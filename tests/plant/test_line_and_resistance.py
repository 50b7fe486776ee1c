"""Line and running resistance: gradients and tunnels by position, A + B v + C v^2."""

import numpy as np
import pytest

from alloc.errors import PlantError
from alloc.plant.laws import GRAVITY, gradient_force, running_resistance
from alloc.plant.model import build
from alloc.plant.rail import Line, Rail
from alloc.plant.train import Coupler
from tests.plant.numpy_plant import environment_at

LINE = Line((0.0, 500.0, 900.0), (0.0, 0.02, -0.01), tunnels=((600.0, 700.0),), tunnel_factor=1.8)


def test_gradient_and_tunnel_by_position(train):
    """Cars of 20 m: their middles stand 10, 30 and 50 m behind the train's front."""
    model = build(train("TMT"), Rail(0.2), LINE)
    for front, grades, air in [
        (400.0, [0.0, 0.0, 0.0], [1.0, 1.0, 1.0]),
        (540.0, [0.02, 0.02, 0.0], [1.0, 1.0, 1.0]),
        (640.0, [0.02, 0.02, 0.02], [1.8, 1.8, 1.0]),
        (915.0, [-0.01, 0.02, 0.02], [1.0, 1.0, 1.0]),
        (1500.0, [-0.01, -0.01, -0.01], [1.0, 1.0, 1.0]),
    ]:
        state = model.initial_state(20.0, front + 1.0)
        local = environment_at(model, 0.0, state)
        np.testing.assert_allclose(local.grade, grades, atol=1e-12)
        np.testing.assert_allclose(local.air_factor, air)


def test_train_rolls_back_on_a_slope(run, train):
    """Acceleration g sin(angle) m / (m + J / r^2): without resistance and brakes, wheels roll."""
    t = train("TT", brake=False)
    trace = run(build(t, Rail(0.3), Line((0.0,), (0.03,))), 3.0, 0.0, position=100.0, sample=0.1)
    expected = -GRAVITY * np.sin(np.arctan(0.03)) * t.mass / (t.mass + t.rotating_mass)
    assert trace.rows("speed")[-1, 0] == pytest.approx(3.0 * expected, rel=1e-3)


def test_resistance_opposes_motion_and_is_the_parabola(train):
    speed = np.array([-30.0, -3.0, 3.0, 30.0])
    force = running_resistance(speed, 3e3, 60.0, 8.0, 1.0)
    parabola = np.sign(speed) * (3e3 + 60.0 * np.abs(speed) + 8.0 * speed**2)
    np.testing.assert_allclose(force, parabola, rtol=2e-4)
    assert running_resistance(0.0, 3e3, 60.0, 8.0, 1.0) == 0.0
    assert gradient_force(1e3, 0.0) == 0.0


def test_cars_share_the_resistance_of_the_train(train):
    for couplers in (None, (Coupler(), Coupler())):
        s = build(train("TMT", resistance=(3e3, 60.0, 8.0), couplers=couplers), Rail(0.2)).structure
        np.testing.assert_allclose(s.car_resistance.sum(axis=0), [3e3, 60.0, 8.0])


def test_coasting_slows_down_by_the_resistance(run, train):
    t = train("TMT", resistance=(5e3, 100.0, 10.0))
    trace = run(build(t, Rail(0.3)), 1.0, 30.0, sample=0.1)
    speed = trace.rows("speed")[:, 0]
    force = 5e3 + 100.0 * speed.mean() + 10.0 * speed.mean() ** 2
    assert speed[0] - speed[-1] == pytest.approx(force / (t.mass + t.rotating_mass), rel=1e-3)


def test_tunnel_raises_the_air_part_only(run, train):
    lost = []
    for factor in (1.0, 2.0):
        line = Line(tunnels=((-1e3, 1e4),), tunnel_factor=factor)
        model = build(train("TMT", resistance=(5e3, 0.0, 10.0)), Rail(0.3), line)
        work = run(model, 0.1, 30.0, position=100.0).rows("work")[-1, 2]
        lost.append(work / (30.0 * 0.1))
    assert lost[0] == pytest.approx(5e3 + 9e3, rel=5e-3)
    assert lost[1] == pytest.approx(5e3 + 18e3, rel=5e-3)


def test_curve_holds_back_each_car_where_it_is(train):
    """600/R kgf/t; Roeckl: 650 / (R - 55) from 300 m on, 500 / (R - 30) below. Middles 10, 30 and 50 m behind the front."""
    for law, expected in (
        ("600/R", 600.0 / 250.0),
        ("800/R", 800.0 / 250.0),
        ("roeckl", 500.0 / 220.0),
    ):
        line = Line(curves=((100.0, 145.0, 250.0), (300.0, 400.0, 1e3)), curve_law=law)
        model = build(train("TMT"), Rail(0.2), line)
        for front, inside in (
            (90.0, (0, 0, 0)),
            (135.0, (1, 1, 0)),
            (165.0, (0, 1, 1)),
            (250.0, (0, 0, 0)),
        ):
            local = environment_at(model, 0.0, model.initial_state(20.0, front + 1.0))
            np.testing.assert_allclose(
                local.curving, 1e-3 * expected * np.array(inside), atol=1e-15
            )
    assert Line(curve_law="roeckl").curving(300.0) == pytest.approx(650e-3 / 245.0)


def test_train_loses_its_weights_share_in_a_curve(run, train):
    """Work over a curve: specific resistance x weight x length, whatever the speed; none before it and behind."""
    t = train("TMT", brake=False)
    lost = []
    for radius in (300.0, 600.0):
        line = Line(curves=((100.0, 200.0, radius),))
        trace = run(build(t, Rail(0.3), line), 15.0, 20.0, position=50.0, sample=0.1)
        lost.append(trace.rows("work")[-1, 2])
        assert lost[-1] == pytest.approx(0.6 / radius * t.mass * GRAVITY * 100.0, rel=2e-3)
        speed = trace.rows("speed")[:, 0]
        kinetic = 0.5 * (t.mass + t.rotating_mass) * (speed[0] ** 2 - speed[-1] ** 2)
        assert kinetic == pytest.approx(lost[-1], rel=5e-3)
    assert lost[0] == pytest.approx(2.0 * lost[1], rel=1e-6)


def test_curves_are_checked():
    for curves, law, message in (
        (((0.0, 0.0, 300.0),), "600/R", "end beyond its start"),
        (((0.0, 9.0, 0.0),), "600/R", "radius"),
        (((0.0, 9.0, 30.0),), "roeckl", "radius"),
        (((0.0, 9.0, np.nan),), "600/R", "radius"),
        ((), "700/R", "curve_law"),
    ):
        with pytest.raises(PlantError, match=message):
            Line(curves=curves, curve_law=law)


def test_train_at_rest_on_level_track_stays(run, train):
    model = build(train("TMT", resistance=(5e3, 100.0, 10.0), couplers=(Coupler(),) * 2), Rail(0.2))
    trace = run(model, 1.0, 0.0, position=10.0, sample=0.1)
    np.testing.assert_array_equal(trace.state[-1], trace.state[0])
