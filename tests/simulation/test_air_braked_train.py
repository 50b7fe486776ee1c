"""Trains without motors: they brake with air alone, rules and readhesion controllers have nothing to do."""

import math
from dataclasses import replace

import numpy as np
import pytest

from alloc.balance import mechanical_energy
from alloc.errors import OnboardError
from alloc.metrics import METRICS, evaluate
from alloc.metrics.use import ATMOSPHERE
from alloc.onboard.brakes import Fuzzy, SlideProtection
from alloc.onboard.host import HostedController
from alloc.onboard.parameters import Braking, Onboard
from alloc.plant.adhesion import SlipRatioCurve
from alloc.plant.laws import GRAVITY
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.sets import find_set
from alloc.rules import RULES
from alloc.simulation import DriverCommand, Event, simulate
from studies.slides.jp4209318 import CALIBRATED, slide_train

SPEED = 20.0
CURVE = SlipRatioCurve(peak_slip_ratio=0.03)
FUZZY = SlideProtection(law="fuzzy", period=0.02, fuzzy=Fuzzy())


def stop(level, law="fuzzy", train=None, deceleration=3.0, speed=SPEED, **options):
    """A stop to standstill; more than 1.3 m/s2 is a full application."""
    braking = Braking(slide_protection=replace(FUZZY, law=law), release_speed=0.0)
    return Event(
        "stop",
        build(train or slide_train(2), Rail(level, curve=CURVE)),
        DriverCommand((0.0,), (-deceleration,)),
        Onboard(period=0.02, rise_time=0.02, braking=braking),
        initial_speed=speed,
        target_speed=0.0,
        **({"duration": 32.0} | options),
    )


@pytest.fixture(scope="module")
def sliding_event():
    return stop(0.09)


@pytest.fixture(scope="module")
def sliding(sliding_event):
    return simulate(sliding_event, "greedy")


@pytest.fixture(scope="module")
def unprotected():
    return simulate(stop(0.09, law="none"), "greedy")


def test_rule_and_controller_have_nothing_to_do(sliding):
    for rule, controller in (("oracle", "none"), ("qp", "pi-creep"), ("sharing", "table")):
        other = simulate(stop(0.09), rule, controller)
        np.testing.assert_array_equal(other["speed"].values, sliding["speed"].values)
        assert other.attrs["rule_calls"] == other.attrs["telegrams_sent"] == 0
    assert set(RULES) > {"oracle", "qp", "sharing"}


def test_a_controller_in_python_is_not_asked(sliding):
    def refuse(contexts):
        raise AssertionError("asked for a controller of no units")

    run = simulate(stop(0.09), "alone", HostedController("mine", "refuses", refuse))
    np.testing.assert_array_equal(run["speed"].values, sliding["speed"].values)


def test_metrics_are_numbers_or_nan(sliding):
    found = evaluate(sliding)
    assert set(found) == set(METRICS)
    for name in ("estimate_error", "utilisation_slipping", "utilisation_short", "search_time"):
        assert math.isnan(found[name])
    for name in ("distance", "damage", "air_consumption", "utilisation", "effort_ratio"):
        assert found[name] > 0.0


def test_a_command_to_pull_does_nothing():
    event = replace(stop(0.3), command=DriverCommand((0.0,), (1.0,)), duration=2.0)
    run = simulate(event, "greedy")
    assert run["speed"].values == pytest.approx(SPEED)
    assert run["cylinder_pressure"].values.max() == 0.0


def test_without_slide_the_distance_is_that_of_a_constant_force():
    """v^2 / 2a behind dead time and lag: the brake's impulse starts a dead time and a time constant late."""
    run = simulate(stop(0.3), "greedy")
    train = slide_train(2)
    force = CALIBRATED.shoe_force_share * train.mass * GRAVITY
    a = force / (train.mass + train.rotating_mass)
    dead, lag = 0.05, 1.2
    # v = v0 - a (t - lag (1 - e^(-t/lag))) once the dead time is over; at standstill e^(-t/lag) is next to nothing
    time = SPEED / a + lag
    distance = SPEED * (dead + time) - 0.5 * a * time**2 + a * lag * time - a * lag**2
    assert evaluate(run)["distance"] == pytest.approx(distance, rel=2e-3)


def test_without_slide_protection_does_not_act():
    protected, free = (simulate(stop(0.3, law=law), "greedy") for law in ("fuzzy", "none"))
    assert protected["valve"].values.max() == 0
    np.testing.assert_array_equal(protected["speed"].values, free["speed"].values)


def test_energy_closes(sliding, sliding_event):
    """JP4209318 (27): kinetic energy lost is shoe work, work between wheels and rail, and resistance."""
    model = sliding_event.model
    n, s = model.layout, model.structure

    def energy(k):
        now = sliding.isel(time=k)
        state = np.zeros(n.rows)
        state[n.speed] = float(now["speed"])
        state[n.omega] = now["rim_speed"].values / s.radius
        return float(mechanical_energy(model, state))

    lost = energy(0) - energy(-1)
    end = sliding.isel(time=-1)
    spent = float(end["shoe_work"]) + float(end["friction_work"].sum())
    assert float(end["resistance_work"]) == 0.0
    assert spent == pytest.approx(lost, rel=1e-5)


def test_shoe_force_is_what_turns_the_wheels_against_the_rail(sliding_event):
    """Table 1's F_b: J domega/dt = R (F_a - F_b), differences of the record on the left."""
    period = 0.004
    onboard = replace(sliding_event.onboard, period=period)
    event = replace(sliding_event, onboard=onboard, record_period=period, duration=15.0)
    run = simulate(event, "greedy")
    s = event.model.structure
    left = s.inertia * np.diff(run["rim_speed"].values / s.radius, axis=0) / period
    torque = -s.radius * (run["brake_force"].values + run["rail_force"].values)
    right = 0.5 * (torque[1:] + torque[:-1])  # means of two instants
    running = run["speed"].values[1:] > 3.0
    scale = (s.radius * run["brake_force"].values).max()
    assert np.abs(left - right)[running].max() < 0.02 * scale


def test_protection_keeps_wheels_from_locking(sliding, unprotected):
    kept, free = evaluate(sliding), evaluate(unprotected)
    assert kept["locked_time"] == kept["locks"] == 0.0
    assert free["locks"] == 8
    assert free["locked_time"] > 50.0
    assert kept["damage"] < 0.2 * free["damage"]


def test_air_is_what_refills_the_cylinders(sliding, unprotected):
    first_filling = 4 * 4e-3 * 550e3 / ATMOSPHERE * 1e3
    assert evaluate(unprotected)["air_consumption"] == pytest.approx(first_filling, rel=1e-3)
    assert evaluate(sliding)["air_consumption"] > 1.2 * first_filling


def test_a_target_of_standstill_is_reached(sliding):
    found = evaluate(sliding)
    assert found["time_to_speed"] < 31.0
    position = sliding["position"].values
    assert found["distance"] == pytest.approx(position[-1] - position[0], abs=1e-3)


def test_a_train_without_motors_and_air_brakes_is_refused():
    train = slide_train(1)
    bare = replace(train, cars=tuple(replace(car, air_brake=None) for car in train.cars))
    with pytest.raises(OnboardError, match="no traction unit and no air brake") as error:
        simulate(stop(0.1, train=bare), "greedy")
    assert "\n" not in str(error.value)


@pytest.mark.parametrize("law", ["threshold", "fuzzy"])
def test_trailers_of_a_blended_train_are_protected(law):
    train = replace(find_set("commuter-8car"), resistance=(0.0, 0.0, 0.0))

    def slowest(law):
        run = simulate(stop(0.06, law, train, deceleration=0.8, duration=10.0), "greedy")
        running = run["speed"].values > 3.0
        trailers = run["axle_unit"].values < 0
        share = run["rim_speed"].values / run["speed"].values[:, None]
        return share[running][:, trailers].min()

    assert slowest(law) > 0.4
    assert slowest("none") < 0.05
