"""Air brakes, blended brakes and sand in the closed loop."""

import math
from dataclasses import replace

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.event import DriverCommand, Event
from alloc.metrics import METRICS, evaluate
from alloc.metrics.use import ATMOSPHERE
from alloc.onboard.brakes import Fuzzy, Sanding, SlideProtection
from alloc.onboard.host import HostedController
from alloc.onboard.parameters import Belief, Braking, Onboard, ReferenceSpeed
from alloc.plant.adhesion import SlipRatioCurve
from alloc.plant.laws import GRAVITY
from alloc.plant.model import build
from alloc.plant.rail import Patch, Rail, Receptivity, logarithmic_increments
from alloc.plant.sets import find_set
from alloc.plant.train import Sander
from alloc.rules import RULES
from alloc.simulation import simulate
from studies.jp4209318 import CALIBRATED
from studies.jp4209318 import train as slide_train
from studies.scenario import load as load_scenario
from tests.cases import looped

SPEED = 20.0


CURVE = SlipRatioCurve(peak_slip_ratio=0.03)


FUZZY = SlideProtection(law="fuzzy", period=0.02, fuzzy=Fuzzy())


def air_stop(level, law="fuzzy", train=None, deceleration=3.0, speed=SPEED, **options):
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
    return air_stop(0.09)


@pytest.fixture(scope="module")
def sliding(sliding_event):
    return simulate(sliding_event, "greedy")


@pytest.fixture(scope="module")
def unprotected():
    return simulate(air_stop(0.09, law="none"), "greedy")


def test_rule_and_controller_have_nothing_to_do(sliding):
    for rule, controller in (("oracle", "none"), ("qp", "pi-creep"), ("sharing", "table")):
        other = simulate(air_stop(0.09), rule, controller)
        np.testing.assert_array_equal(other["speed"].values, sliding["speed"].values)
        assert other.attrs["rule_calls"] == other.attrs["telegrams_sent"] == 0
    assert set(RULES) > {"oracle", "qp", "sharing"}


def test_a_controller_in_python_is_not_asked(sliding):
    def refuse(contexts):
        raise AssertionError("asked for a controller of no units")

    run = simulate(air_stop(0.09), "alone", HostedController("mine", "refuses", refuse))
    np.testing.assert_array_equal(run["speed"].values, sliding["speed"].values)


def test_metrics_are_numbers_or_nan(sliding):
    found = evaluate(sliding)
    assert set(found) == set(METRICS)
    for name in ("estimate_error", "utilisation_slipping", "utilisation_short", "search_time"):
        assert math.isnan(found[name])
    for name in ("distance", "damage", "air_consumption", "utilisation", "effort_ratio"):
        assert found[name] > 0.0


def test_without_slide_the_distance_is_that_of_a_constant_force():
    """v^2 / 2a behind dead time and lag: the brake's impulse starts a dead time and a time constant late."""
    run = simulate(air_stop(0.3), "greedy")
    train = slide_train(2)
    force = CALIBRATED.shoe_force_share * train.mass * GRAVITY
    a = force / (train.mass + train.rotating_mass)
    dead, lag = 0.05, 1.2
    # v = v0 - a (t - lag (1 - e^(-t/lag))) once the dead time is over; at standstill e^(-t/lag) is next to nothing
    time = SPEED / a + lag
    distance = SPEED * (dead + time) - 0.5 * a * time**2 + a * lag * time - a * lag**2
    assert evaluate(run)["distance"] == pytest.approx(distance, rel=2e-3)


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


@looped("law", ["threshold", "fuzzy"])
def test_trailers_of_a_blended_train_are_protected(law):
    train = replace(find_set("commuter-8car"), resistance=(0.0, 0.0, 0.0))

    def slowest(law):
        run = simulate(air_stop(0.06, law, train, deceleration=0.8, duration=10.0), "greedy")
        running = run["speed"].values > 3.0
        trailers = run["axle_unit"].values < 0
        share = run["rim_speed"].values / run["speed"].values[:, None]
        return share[running][:, trailers].min()

    assert slowest(law) > 0.4
    assert slowest("none") < 0.05


TRAIN = replace(find_set("commuter-8car"), resistance=(0.0, 0.0, 0.0))


GROWTH = tuple(logarithmic_increments(TRAIN.axle_count))


DECELERATION = 0.8


def stop(
    level,
    *,
    receptivity=None,
    failures=None,
    braking=None,
    duration=14.0,
    speed=20.0,
    increments=GROWTH,
):
    """A stop from `speed` [m/s] on rail of coefficient `level`."""
    rail = Rail(level, increments=increments)
    model = build(TRAIN, rail, receptivity=receptivity or Receptivity(), failures=failures)
    onboard = Onboard(belief=Belief(increments=increments), braking=braking or Braking())
    return Event(
        "stop",
        model,
        DriverCommand((0.5,), (-DECELERATION,)),
        onboard,
        duration=duration,
        initial_speed=speed,
    )


def electric_force(run):
    """Force at the rim per axle of each unit [N], (time, unit)."""
    return -run["motor_torque"].values * run["unit_gear"].values / run["unit_radius"].values


def trailer_groups(run):
    """Whether each brake group (two per car) belongs to a car without motors."""
    powered = set(run["axle_car"].values[run["axle_unit"].values >= 0])
    return np.array([car not in powered for car in range(len(TRAIN.cars)) for _ in range(2)])


@pytest.fixture(scope="module")
def dry():
    return simulate(stop(0.30), "greedy")


@pytest.fixture(scope="module")
def fluctuating():
    return simulate(stop(0.30, receptivity=Receptivity(0.6, 0.4, 5.0)), "greedy")


@pytest.fixture(scope="module")
def blended_sliding():
    return simulate(stop(0.075), "greedy")


def test_every_car_brakes_as_planned(dry):
    steady = dry.sel(time=slice(4.0, 12.0))
    assert steady["acceleration"].values.mean() == pytest.approx(-DECELERATION, rel=0.03)
    # every car bears its own weight: the coefficients of motor cars and trailers agree
    per_axle = steady["coefficient"].values.mean(axis=0)
    assert np.ptp(per_axle) < 0.06 * abs(per_axle.mean())


def test_electric_brake_serves_first(dry):
    steady = dry.sel(time=slice(4.0, 12.0))
    pressure = steady["cylinder_pressure"].values
    trailer = trailer_groups(dry)
    assert pressure[:, trailer].min() > 1e4
    assert pressure[:, ~trailer].max() < 0.1 * pressure[:, trailer].max()


def test_air_fills_what_the_electric_brake_lacks(fluctuating):
    steady = fluctuating.sel(time=slice(3.0, 12.0))
    electric, air = electric_force(steady), steady["air_brake_force"].values
    assert np.ptp(electric[:, 0]) > 0.3 * electric[:, 0].max()
    assert air[:, 0].max() > 0.2 * electric[:, 0].max()
    # the command follows at once, so the pattern of JP5484215 par. 0071 is held: F_elec + F_air_c
    total = electric + air
    assert np.ptp(total) < 0.02 * total.mean()


def mean_of_units(run, values):
    """Mean of `values` (time, axle) over the axles of each unit, (time, unit)."""
    unit = run["axle_unit"].values
    return np.stack([values[:, unit == j].mean(axis=1) for j in range(run.sizes["unit"])], axis=1)


def test_estimate_18_is_what_the_rail_carries_later_by_the_observers_lag(blended_sliding):
    run = blended_sliding.sel(time=slice(2.0, 10.0))
    carried = mean_of_units(run, -run["coefficient"].values)
    lagged = carried.copy()
    for k in range(1, len(carried)):
        lagged[k] = lagged[k - 1] - np.expm1(-25.0 * 0.01) * (carried[k] - lagged[k - 1])
    # the air brake's force is not filtered, and moves slowly
    assert np.abs(run["coefficient_estimate"].values - lagged)[50:].mean() < 3e-4


def test_estimate_by_command_finds_force_that_the_cylinders_do_not_give_yet(fluctuating):
    by_command = simulate(
        stop(0.30, receptivity=Receptivity(0.6, 0.4, 5.0), braking=Braking(air_force="command")),
        "greedy",
    )

    def error(run):
        steady = run.sel(time=slice(3.0, 12.0))
        carried = mean_of_units(steady, -steady["coefficient"].values)
        return np.abs(steady["coefficient_estimate"].values - carried).mean()

    assert error(fluctuating) < 0.3 * error(by_command)


def test_estimate_as_printed_finds_adhesion_that_is_not_there(blended_sliding):
    printed = simulate(stop(0.075, braking=Braking(inertia_in_estimate=False)), "greedy")
    error, error_printed = (evaluate(run)["estimate_error"] for run in (blended_sliding, printed))
    assert error_printed > 0.005
    assert abs(error) < error_printed
    assert printed.attrs["detections"] > blended_sliding.attrs["detections"]


@looped("mean", [1.0, 0.6, 0.0])
def test_brakes_fill_up_to_the_limit_whatever_the_line_takes(mean):
    receptivity = Receptivity(mean, min(mean, 1.0 - mean), 5.0)
    run = simulate(stop(0.075, receptivity=receptivity), "oracle").sel(time=slice(5.0, 10.0))
    limit, weight = run["limit"].values, run["unit_static_load"].values / 4.0
    shoes = mean_of_units(run, run["brake_force"].values)
    assert np.all(limit != run["expected"].values[:, None])
    # at the rim a limit is what the rail gives and what decelerates the wheelset, 10 % of it
    wanted = limit * weight * (1.0 + 0.1 * DECELERATION / 9.80665 / run["expected"].values[:, None])
    delivered = (electric_force(run) + shoes) / wanted
    assert delivered.mean() == pytest.approx(1.0, abs=0.02)
    # the motors make up for the cylinders' lag as far as the line takes their power
    target = -run["torque_target"].values * run["unit_gear"].values / run["unit_radius"].values
    np.testing.assert_allclose(target + shoes, wanted, rtol=0.02)


def test_allocation_brakes_better_than_each_unit_alone():
    """It did not while limits froze the air brake."""
    scenario = load_scenario("wet-stop")
    found = {}
    for rule in ("alone", "greedy-literal", "oracle"):
        found[rule] = evaluate(simulate(scenario.event(1), rule))
    alone, greedy = found["alone"], found["greedy-literal"]
    assert greedy["utilisation"] > alone["utilisation"]
    for worse in ("distance", "slip_time", "damage"):
        assert greedy[worse] < alone[worse]
    assert found["oracle"]["effort_ratio"] > 0.94


def test_driver_releases_when_the_train_has_stopped(dry):
    end = simulate(stop(0.30, duration=30.0), "alone").isel(time=-1)
    assert float(end["driver_command"]) == 0.0
    assert 0.0 < float(end["speed"]) < 0.6


def test_a_train_without_air_brakes_brakes_with_its_motors():
    cars = tuple(replace(car, air_brake=None) for car in TRAIN.cars)
    model = build(replace(TRAIN, cars=cars), Rail(0.30))
    event = Event("stop", model, DriverCommand((0.5,), (-0.5,)), duration=8.0, initial_speed=15.0)
    run = simulate(event, "alone").sel(time=slice(3.0, 7.0))
    assert run["acceleration"].values.mean() == pytest.approx(-0.5, rel=0.05)
    assert run["air_brake_force"].values.max() == 0.0


def test_fuzzy_slide_protection_of_trailers_saves_damage_and_air_at_the_same_distance():
    """The threshold releases trailers that slide a little and lets those slide on that slide less than it."""
    found = {}
    for law in ("threshold", "fuzzy"):
        protection = SlideProtection(law=law, period=0.02)
        event = stop(0.07, braking=Braking(slide_protection=protection), duration=20.0)
        found[law] = evaluate(simulate(event, "greedy-literal"))
    plain, fuzzy = found["threshold"], found["fuzzy"]
    assert fuzzy["damage"] < 0.85 * plain["damage"]
    assert fuzzy["air_consumption"] < plain["air_consumption"]
    assert fuzzy["distance"] == pytest.approx(plain["distance"], rel=0.01)
    assert fuzzy["locked_time"] == 0.0


def share_of_air(run):
    """Air brake force commanded to each unit over what is asked of it, (unit,), from the third second."""
    braking = run.sel(time=slice(3.0, None))
    asked = braking["limit"].values * braking["unit_static_load"].values / 4.0
    return braking["air_brake_force"].values.mean(axis=0) / asked.mean(axis=0)


@looped("controller", ["cut-and-ramp", "perturb-observe"])
@looped("level", [0.30, 0.03])
def test_a_line_that_takes_everything_needs_no_air(level, controller):
    """Neither the motors' lag, nor reliefs, nor what readhesion control takes away may count as lacking."""
    run = simulate(stop(level), "alone", controller)
    slides = run["slip_velocity"].values[:, run["axle_unit"].values >= 0].min() < -0.1
    assert slides == (level == 0.03)
    assert share_of_air(run).max() < 0.01


@looped("taken", [0.3, 0.1])
def test_air_supplies_what_the_line_refuses(taken):
    run = simulate(stop(0.30, receptivity=Receptivity(taken, 0.0, 1.0)), "alone")
    force = mean_of_units(run, run["brake_force"].values) + electric_force(run)
    weight = run["unit_static_load"].values / 4.0
    braking = run["time"].values > 3.0
    wanted = (run["limit"].values * weight)[braking]
    assert share_of_air(run).min() > 0.25
    # what decelerates the wheelsets comes on top
    turning = 0.1 * DECELERATION / 9.80665 / run["expected"].values[-1]
    found = force[braking].mean(axis=0) / wanted.mean(axis=0)
    np.testing.assert_allclose(found, 1.0 + turning, atol=0.02)


def test_air_stands_in_for_failed_motors():
    run = simulate(stop(0.30, failures={1: 3.0}), "alone")
    share = share_of_air(run.sel(time=slice(4.0, None)))
    assert share[1] > 0.95
    assert np.delete(share, 1).max() < 0.01


@looped("rule", ["alone", "exact", "cooperative"])
@looped("controller", ["cut-and-ramp", "mpc"])
def test_air_stands_in_for_motors_that_failed_before_the_brakes(rule, controller):
    """On rail that limits every unit: a limit at what the failed one delivered when the brakes came would be none at all."""
    run = simulate(stop(0.06, failures={1: 0.2}), rule, controller).sel(time=slice(5.0, None))
    used = mean_of_units(run, -run["coefficient"].values).mean(axis=0)
    assert used[1] > 0.7 * np.delete(used, 1).mean()


@looped("taken", [1.0, 0.4, 0.1])
@looped("controller", ["cut-and-ramp", "perturb-observe"])
def test_air_holds_no_wheel_in_a_slide_that_no_cut_of_torque_ends(controller, taken):
    """Without valves of slide protection: where the line takes little, the air brake alone asks more than the rail gives."""
    event = stop(
        0.03,
        receptivity=Receptivity(taken, 0.0, 1.0),
        braking=Braking(slide_protection=SlideProtection(law="none")),
    )
    run = simulate(event, "alone", controller).sel(time=slice(8.0, None))
    driven = run["axle_unit"].values >= 0
    assert (np.abs(run["slip_velocity"].values[:, driven]) > 1.0).mean() < 0.01


RECORD = 0.01


FIXED_RATE, GREATEST_RATE, VARIABLE_AMOUNT = 2.0 / 60.0, 6.0 / 60.0, 4.5e-3


"""Of sanders, per rail: fixed and greatest rate [kg/s], and the amount that a variable one keeps to [kg/m]."""


SLIPPERY = Patch(0.2, begin=2.0, until=5.0, fade=0.1)


"""Three seconds on which wheels slide; before and after all is carried."""


def one_unit():
    """Half of the British train, with a sander of fixed rate at its third axle."""
    both = find_set("gb-unit-8car")
    a, b, c = both.resistance
    return replace(both, cars=both.cars[:4], resistance=(0.5 * a, 0.5 * b, 0.5 * c))


def sanded(train, sanders):
    """The train with these sanders alone, by the number of their axle in the train (0 = foremost)."""
    cars, first = [], 0
    for car in train.cars:
        axles = range(first, first + len(car.axle_positions))
        own = tuple(replace(sanders[i], axle=i - first) for i in axles if i in sanders)
        cars.append(replace(car, sanders=own))
        first = axles.stop
    return replace(train, cars=tuple(cars))


def run(sanding=None, *, sanders=None, speed=20.0, patches=(SLIPPERY,), duration=12.0, shares=None):
    """One unit brakes from `speed` [m/s] on dry rail with slippery spells."""
    train = one_unit() if sanders is None else sanded(one_unit(), sanders)
    onboard = Onboard(
        sanding=sanding or Sanding(),
        braking=Braking(car_shares=shares),
        reference=ReferenceSpeed(source="truth"),
    )
    model = build(train, Rail(0.15, patches=tuple(patches)), span=(0.0, 1000.0))
    event = Event(
        "sanding", model, DriverCommand((0.5,), (-0.9,)), onboard,
        duration=duration, initial_speed=speed, record_period=RECORD,
    )  # fmt: skip
    return simulate(event, "alone", "none")


def spells(run):
    """Begin and end [s] of every span in which sand is laid."""
    on = np.concatenate([[False], run["sand_rate"].values[:, 0] > 0.0, [False]])
    edges = np.flatnonzero(np.diff(on.astype(int)))
    return (RECORD * edges).reshape(-1, 2)


def slides(run):
    """Instants [s] at which a valve does not supply."""
    return run["time"].values[(run["valve"].values > 0).any(axis=1)]


@looped(("delay", "hold"), [(1.0, 2.0), (0.3, 4.0)])
def test_sand_begins_a_delay_after_the_first_slide_and_holds_on(delay, hold):
    found = run(Sanding(delay=delay, hold=hold))
    seen = slides(found)
    (begin, end), = spells(found)  # fmt: skip
    assert begin == pytest.approx(seen[0] + delay, abs=0.021)
    assert end == pytest.approx(seen[-1] + hold, abs=0.021)
    assert found["speed"].values[-1] > Sanding().least_speed


def test_a_fixed_rate_is_that_of_the_sander():
    rates = np.unique(run()["sand_rate"].values)
    assert rates.tolist() == [0.0, FIXED_RATE]


def test_no_slide_no_sand():
    found = run(patches=())
    assert slides(found).size == 0
    assert spells(found).size == 0


def test_sand_by_command():
    found = run(Sanding(on_slide=False, delay=0.5, begin=1.0, until=4.0))
    assert slides(found).size > 0
    np.testing.assert_allclose(spells(found), [[1.5, 4.5]], atol=1e-9)


def test_slow_trains_lay_none():
    found = run(Sanding(on_slide=False, delay=0.0, begin=0.0, least_speed=15.0))
    speed = found["speed"].values
    (_, end), = spells(found)  # fmt: skip
    assert speed[round(end / RECORD)] == pytest.approx(15.0, abs=0.02)


def test_a_variable_rate_keeps_to_the_amount_as_far_as_it_goes():
    found = run(
        Sanding(on_slide=False, delay=0.0, begin=0.0, least_speed=0.0),
        sanders={2: Sander(0, GREATEST_RATE, VARIABLE_AMOUNT)},
        speed=28.0,
    )  # fmt: skip
    amount = found["sand_rate"].values[:, 0] / found["speed"].values
    most = GREATEST_RATE / found["speed"].values
    np.testing.assert_allclose(amount, np.minimum(VARIABLE_AMOUNT, most), rtol=1e-3)
    assert most[0] < 0.9 * VARIABLE_AMOUNT < most[-1]


def test_a_train_without_sanders_has_none_in_its_record():
    assert "sand_rate" not in run(sanders={})
    found = run(duration=1.0)
    assert found["sand_rate"].dims == ("time", "sander")
    assert found["sand_rate"].attrs["units"] == "kg s-1"


def test_cars_brake_by_their_shares():
    shares = (0.5, 0.9, 1.2, 1.0)
    equal, shared = (run(patches=(), duration=4.0, shares=one) for one in (None, shares))
    ratio = shared["cylinder_pressure"].values[-1] / equal["cylinder_pressure"].values[-1]
    np.testing.assert_allclose(ratio, np.repeat(shares, 2), rtol=1e-3)


@looped(
    ("make", "named"),
    [
        (lambda: Sanding(delay=-1.0), "delay"),
        (lambda: Sanding(hold=float("nan")), "hold"),
        (lambda: Sanding(begin=3.0, until=2.0), "begin = 3.0 must not exceed until"),
        (lambda: Braking(car_shares=(1.0, -0.1)), r"car_shares\[1\]"),
        (lambda: run(shares=(1.0, 1.0)), "2 car_shares for 4 cars"),
    ],
)
def test_impossible_parameter_is_named(make, named):
    with pytest.raises(OnboardError, match=named):
        make()


def test_slip_in_traction_calls_for_sand_too(make_event, train):
    one = sanded(train, {4: Sander(0, 0.03)})
    event = make_event(0.06, train=one, onboard=Onboard(sanding=Sanding(least_speed=0.0)))
    found = simulate(event, "alone", "cut-and-ramp")
    first = found["time"].values[(found["slipping"].values > 0).any(axis=1)][0]
    begin, _ = spells(found)[0]
    assert begin == pytest.approx(first + Sanding().delay, abs=0.021)
    assert found["rail_force"].values[-1].sum() > 0.0
