"""The estimated reference speed in runs: how far it is from the truth, what it says of itself, and what reliefs are for.

Its periods one by one are tested in `tests/uncompiled/test_reference_filter.py`.
"""

from dataclasses import fields, replace
from functools import cache

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.estimation.series import spans
from alloc.metrics import evaluate
from alloc.metrics.search import shortage, unit_shares
from alloc.metrics.use import LOCK_SPEED, STANDING_SPEED, locked_time
from alloc.onboard.brakes import SlideProtection
from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import (
    COMPARED,
    Belief,
    Braking,
    Onboard,
    ReferenceSpeed,
    Sensors,
    TorqueRelief,
)
from alloc.plant.adhesion import POLACH_WET, SlipRatioCurve
from alloc.plant.laws import GRAVITY, gradient_force
from alloc.plant.model import build, level_for
from alloc.plant.rail import Line, Patch, Rail
from alloc.plant.sets import find_set
from alloc.plant.train import Coupler, DraftGear
from alloc.simulation import DriverCommand, Event, simulate
from studies import ladder as drawn
from studies.jp4209318 import train as slide_train

SEED = 50
"""Of ladder events."""
SOURCES = {
    "estimate": ReferenceSpeed(),
    "truth": ReferenceSpeed(source="truth"),
    "no reliefs": ReferenceSpeed(relief=TorqueRelief(doubt=1e9, air_doubt=1e9)),
}


def error(run):
    """Reference speed less the speed of the body that it is of, (time,)."""
    return run["reference_speed"].values - run["car_speed"].values[:, 0]


def rms(values):
    return float(np.sqrt((values**2).mean()))


def honest(run):
    """Share of the time in which the error is within three stated deviations and 0.02 m/s."""
    return float((np.abs(error(run)) < 3.0 * run["reference_deviation"].values + 0.02).mean())


@cache
def ladder(k, source="estimate", noise=None):
    event = drawn.event(SEED, k).event(0)
    onboard = replace(event.onboard, reference=SOURCES[source])
    if noise is not None:
        onboard = replace(onboard, sensors=replace(onboard.sensors, speed_noise=noise))
    return simulate(replace(event, onboard=onboard), "alone", "perturb-observe")


SPEED, CYCLE, STANDSTILL = 20.0, 0.02, 0.05
"""Of stops: initial speed [m/s], period of the computers and of the record [s], speed at which a train stands [m/s]."""
CURVES = {"polach": POLACH_WET, "slip-ratio": SlipRatioCurve()}


@cache
def stop(curve, level, source="estimate", grip=1.0, rolling=3.0, grade=0.0):
    """A full application on one car of JP4209318: its run, and the stop in numbers, for level track.

    `level`: adhesion at 15 m/s; `grip`: friction of the brakes over the believed one; `rolling`: time before it [s].
    """
    train = slide_train(1)
    car = train.cars[0]
    car = replace(car, air_brake=replace(car.air_brake, friction_factor=grip))
    train = replace(train, cars=(car,))
    slowing = gradient_force(train.mass, grade) / (train.mass + train.rotating_mass)
    start, way = SPEED + slowing * rolling, (SPEED + 0.5 * slowing * rolling) * rolling
    rail = Rail(level_for(CURVES[curve], level, 15.0, train), curve=CURVES[curve])
    protection = SlideProtection(law="fuzzy", period=CYCLE)
    braking = Braking(slide_protection=protection, release_speed=0.0)
    event = Event(
        "stop", build(train, rail, Line(grades=(grade,)), span=(-way, 4e3)),
        DriverCommand((rolling,), (-3.0,)),
        Onboard(period=CYCLE, rise_time=CYCLE, braking=braking, reference=SOURCES[source]),
        duration=240.0, initial_speed=start, initial_position=-way, record_period=CYCLE, target_speed=0.0,
    )  # fmt: skip
    run = simulate(event, "alone", "none", until_speed=STANDSTILL)
    braked = run.isel(time=slice(int(np.argmax(run["driver_command"].values < 0.0)), None))
    speed, way = braked["speed"].values, np.ptp(braked["position"].values)
    standing = np.abs(braked["rim_speed"].values) < STANDING_SPEED
    locked = standing & (speed > LOCK_SPEED)[:, None]
    return run, {
        "stopped": bool(speed[-1] <= STANDSTILL),
        "adhesion_used": speed[0] ** 2 / (2.0 * way * GRAVITY * level),
        "locked_axle_s": locked_time(braked),
        "longest_lock_s": CYCLE * max(np.ptp(one) for a in locked.T for one in [*spans(a), (0, 0)]),
    }


def used_share(run):
    """Adhesion used where a unit is short of it, over what is there."""
    _, used, available = unit_shares(run)
    short = shortage(run)
    assert short.mean() > 0.1
    return float(used[short].sum() / available[short].sum())


@pytest.mark.parametrize("k", [0, 1, 3])
def test_with_free_axles_noise_gives_no_bias(k):
    run = ladder(k, noise=0.04 / 3.6)  # the slowest of 16 noisy wheels is 0.02 m/s slow
    assert (run["axle_unit"].values < 0).sum() == 16
    assert abs(error(run).mean()) < 0.002
    assert np.abs(error(run)).max() < 0.01


@pytest.mark.parametrize("k", [2, 5])
def test_a_locomotive_without_free_axle_uses_nearly_all_adhesion(k):
    run = ladder(k)
    assert used_share(run) >= 0.96
    assert abs(error(run).mean()) < 0.01
    assert rms(error(run)) < 0.03
    assert np.abs(error(run)).max() < 0.08


@pytest.mark.parametrize("k", [2, 5])
def test_without_soundings_a_locomotives_error_grows(k):
    assert rms(error(ladder(k, "no reliefs"))) > 2.0 * rms(error(ladder(k)))


@pytest.mark.parametrize(("curve", "level"), [("polach", 0.03), ("slip-ratio", 0.05)])
def test_air_brakes_lose_little_by_not_knowing_the_speed(curve, level):
    run, found = stop(curve, level)
    assert found["stopped"]
    assert found["locked_axle_s"] == 0.0
    assert found["adhesion_used"] > stop(curve, level, "truth")[1]["adhesion_used"] - 0.025
    assert rms(error(run)) < 0.006 * 20.0


@pytest.mark.parametrize("grip", [0.85, 1.15])
def test_without_soundings_wrong_shoe_friction_locks_wheels_or_wastes_adhesion(grip):
    run, found = stop("slip-ratio", 0.05, "estimate", grip, rolling=0.0)
    blind, lost = stop("slip-ratio", 0.05, "no reliefs", grip, rolling=0.0)
    assert found["locked_axle_s"] == 0.0
    locks = lost["longest_lock_s"] > 1.0
    assert locks or lost["adhesion_used"] < found["adhesion_used"] - 0.04
    assert locks == (grip < 1.0)
    assert rms(error(blind)) > 3.0 * rms(error(run))
    assert rms(error(run)) < 0.01 * 20.0


def test_the_stated_deviation_is_honest():
    told = [honest(ladder(k, noise=0.04 / 3.6)) for k in (0, 1)] + [
        honest(ladder(k)) for k in (2, 5)
    ]
    told += [
        honest(stop(curve, level)[0]) for curve, level in (("polach", 0.03), ("slip-ratio", 0.05))
    ]
    told += [
        honest(stop("slip-ratio", 0.05, "estimate", grip, rolling=0.0)[0]) for grip in (0.85, 1.15)
    ]
    told += [honest(stop("polach", 0.03, grade=grade, rolling=0.0)[0]) for grade in (-0.015, 0.015)]
    assert min(told) > 0.95


def test_it_is_not_honest_because_it_claims_little():
    assert ladder(0, noise=0.04 / 3.6)["reference_deviation"].values.mean() < 0.003
    assert ladder(2)["reference_deviation"].values.mean() < 0.05
    assert stop("polach", 0.03)[0]["reference_deviation"].values.mean() < 0.02 * 20.0


def test_the_truth_is_given_where_it_is_asked_for():
    assert np.abs(error(ladder(2, "truth"))).max() < 1e-9
    assert np.abs(error(stop("polach", 0.03, "truth")[0])).max() < 1e-9


def test_unequal_wheels_reach_the_computers_and_not_the_plant():
    model = build(find_set("commuter-8car"), Rail(0.3))
    runs = []
    for wear in (0.0, 0.01):
        onboard = Onboard(
            sensors=Sensors(radius_error=wear, seed=4), belief=Belief(curve=model.rail.curve)
        )
        ratio = equipment(model, onboard).axle_radius / model.structure.radius - 1.0
        assert np.abs(ratio).max() <= wear
        assert np.unique(ratio).size == (ratio.size if wear else 1)
        np.testing.assert_array_equal(
            equipment(model, onboard).axle_radius, (1.0 + ratio) * model.structure.radius
        )
        event = Event(
            "coasts", model, DriverCommand((0.0,), (0.0,)), onboard, 3.0, initial_speed=20.0
        )
        runs.append(simulate(event, "alone", "none"))
    np.testing.assert_array_equal(runs[1]["rim_speed"], runs[0]["rim_speed"])
    np.testing.assert_array_equal(runs[1]["speed"], runs[0]["speed"])
    assert 1e-3 < np.abs(error(runs[1])).max() < 0.01 * 20.0
    assert np.abs(error(runs[0])).max() < 1e-3


NUMBERS = [
    (kind, item.name)
    for kind in (ReferenceSpeed, TorqueRelief)
    for item in fields(kind)
    if isinstance(item.default, float)
]


@pytest.mark.parametrize("value", [-0.1, np.nan])
@pytest.mark.parametrize(("kind", "name"), NUMBERS)
def test_impossible_settings_are_refused_by_name(kind, name, value):
    with pytest.raises(OnboardError, match=rf"\b{name} = {value}") as refused:
        kind(**{name: value})
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (
            lambda: ReferenceSpeed(source="forces"),
            "source = 'forces' must be one of estimate, truth",
        ),
        (lambda: ReferenceSpeed(sensor=0.0), "sensor = 0.0"),
        (lambda: TorqueRelief(time=0.0), "time = 0.0"),
        (
            lambda: TorqueRelief(time=0.1, longest=0.05),
            "time = 0.1 must not exceed longest = 0.05",
        ),
        (
            lambda: TorqueRelief(air_doubt=0.03),
            "air_known = 0.03 must be below air_doubt",
        ),
        (lambda: Sensors(radius_error=-0.01), "radius_error = -0.01"),
        (lambda: Belief(mass_factor=0.0), "mass_factor = 0.0"),
        (lambda: Belief(coupler_factor=-1.0), "coupler_factor = -1.0"),
        (lambda: Belief(resistance_factor=-0.1), "resistance_factor = -0.1"),
    ],
)
def test_impossible_beliefs_are_refused(make, words):
    with pytest.raises(OnboardError, match=words):
        make()


@pytest.mark.parametrize("ratio", [0.04, 0.05])
@pytest.mark.parametrize("controller", ["mpc", "mpc-train"])
def test_motors_that_share_a_slide_with_air_brakes_learn_the_speed(ratio, controller):
    """A blended stop on a flat peak. When wheels that air brakes held in their slide passed for rolling, 0.91 was used."""
    train = find_set("commuter-8car")
    rail = Rail(
        0.08, patches=(Patch(0.6, begin=3.0, until=9.0, fade=0.3),), curve=SlipRatioCurve(ratio)
    )
    event = Event(
        "blended", build(train, rail), DriverCommand((0.2,), (-0.9,)), Onboard(), duration=12.0, initial_speed=22.0
    )  # fmt: skip
    run = simulate(event, "alone", controller)
    assert np.abs(error(run)).max() < 0.1 * run["speed"].values[-1]
    assert evaluate(run)["bound_use"] > 0.94


def test_friction_draft_gears_hold_the_believed_train_together():
    """Without them the locomotive of 70 vehicles ran away from its train in the computers' belief, by 3 m/s."""
    model = build(find_set("heavy-70"), Rail(0.12, scatter=0.02))
    event = Event(
        "heavy", model, DriverCommand((0.2,), (0.08,)), Onboard(), duration=8.0, initial_speed=2.8
    )
    run = simulate(event, "alone", "perturb-observe")
    assert np.abs(error(run)).max() < 0.3
    assert rms(error(run)) < 0.05
    assert evaluate(run)["utilisation_short"] > 0.9


def test_a_friction_draft_gear_is_believed_as_the_spring_that_it_is_at_first():
    gear = DraftGear(in_series=2, damping=1e3)
    train = find_set("heavy-70")
    model = build(replace(train, couplers=(gear, Coupler(), *train.couplers[2:])), Rail(0.3))
    chain = equipment(model, Onboard(belief=Belief(coupler_factor=0.5))).chain
    stiffness, stiffening, damping, slack = chain.coupler.T
    assert stiffness[0] == 0.5 * gear.structure / 2
    assert (stiffening[0], slack[0]) == (0.0, gear.slack)
    assert damping[0] == gear.damping / 2
    assert stiffness[1] == 0.5 * Coupler().stiffness
    # a damping that steps of the filter could not follow is bounded
    assert damping[2] < DraftGear().damping / 2


def after_rolling(radius_error, deviation, controller, rolls=3.0, compared=False):
    """Adhesion used where short, and mean error [m/s], in a stop whose train rolls for the first seconds."""
    model = build(find_set("commuter-8car"), Rail(0.06))
    onboard = Onboard(
        sensors=Sensors(radius_error=radius_error, speed_noise=0.01, seed=4),
        reference=ReferenceSpeed(radius_deviation=deviation, radii_compared=compared),
        belief=Belief(curve=model.rail.curve),
    )
    command = DriverCommand((rolls,), (-0.8,))
    event = Event("stop", model, command, onboard, duration=12.0, initial_speed=28.0)
    run = simulate(event, "alone", controller)
    return evaluate(run)["utilisation_short"], np.abs(error(run)[run["time"].values > rolls]).mean()


@pytest.mark.parametrize("controller", ["cut-and-ramp", "perturb-observe"])
def test_unequal_wheels_cost_little_once_the_train_has_rolled(controller):
    equal, _ = after_rolling(0.0, 0.01, controller)
    learnt, wrong = after_rolling(0.01, 0.01, controller)
    believed, worse = after_rolling(0.01, 0.0, controller)
    assert learnt > equal - 0.03
    assert learnt > believed
    # the mean of all radii stays unknown
    assert wrong < 0.5 * worse


@pytest.mark.parametrize("controller", ["cut-and-ramp", "perturb-observe", "mpc"])
@pytest.mark.parametrize("wear", [0.003, 0.01])
def test_unequal_wheels_that_were_compared_before_cost_little(wear, controller):
    """A train that brakes at once: without the comparison all of the adhesion may be lost."""
    equal, _ = after_rolling(0.0, 0.01, controller, 0.0, compared=True)
    compared, _ = after_rolling(wear, 0.01, controller, 0.0, compared=True)
    unknown, _ = after_rolling(wear, 0.01, controller, 0.0)
    assert compared > equal - 0.05
    assert compared > unknown


def test_compared_wheels_share_their_error():
    model = build(find_set("commuter-8car"), Rail(0.1))
    sensors = Sensors(radius_error=0.01, seed=4)

    def errors(**reference):
        eq = equipment(model, Onboard(sensors=sensors, reference=ReferenceSpeed(**reference)))
        return eq.axle_radius / model.structure.radius - 1.0

    drawn, left = errors(radii_compared=False), errors()
    assert np.ptp(drawn) > 0.01
    assert np.ptp(left) < 6.0 * COMPARED
    assert left.mean() == pytest.approx(drawn.mean(), abs=COMPARED)
    np.testing.assert_array_equal(errors(radius_deviation=0.0), drawn)
