"""Room for sharing, on runs made by hand: what bounds a unit, what a trailer adds, and which instants count."""

import numpy as np
import pytest
import xarray as xr

from alloc.metrics import METRICS
from alloc.metrics.use import SETTLING, settled, train_bounds

LOAD = 1e5
EXPECTED = 0.10
PERIOD = 0.5
COUNT = 13
"""The driver asks from 0 s on for 6 s; what is later than 2 s counts: 9 instants."""
LAST = 9


def made(
    adhesion=0.2,
    force=EXPECTED,
    braking=False,
    blended=True,
    motor=1.0,
    turning=0.0,
    command=None,
    factor=1.0,
    parallel=(0, 0),
):
    """Two units of two axles and a trailer of two, of which all that is given is a coefficient of the load, per axle.

    Gear and radius are 1, so `motor`, of each unit's motors, is a coefficient too. The train gains 1 m/s2.
    """
    sign = -1.0 if braking else 1.0
    over_time = np.ones((COUNT, 1))
    command = np.full(COUNT, sign) if command is None else np.asarray(command, dtype=float)
    force = force * np.ones(6)
    if not (braking and blended):
        force[4:] = 0.0
    limits = LOAD * motor * over_time * np.ones(2)
    variables = {
        "driver_command": ("time", command),
        "acceleration": ("time", sign * np.ones(COUNT)),
        "planned_coefficient": ("time", np.full(COUNT, EXPECTED)),
        "adhesion_limit": (("time", "axle"), adhesion * over_time * np.ones(6)),
        "axle_load": (("time", "axle"), LOAD * over_time * np.ones(6)),
        "rail_force": (("time", "axle"), sign * LOAD * force * over_time),
        "torque_factor": (("time", "unit"), factor * over_time * np.ones(2)),
        "drive_limit": (("time", "unit"), 0.0 * limits if braking else limits),
        "brake_limit": (("time", "unit"), limits if braking else 0.0 * limits),
        "axle_unit": ("axle", [0, 0, 1, 1, -1, -1]),
        "axle_group": ("axle", [0, 0, 1, 1, 2, 2]),
        "axle_static_load": ("axle", np.full(6, LOAD)),
        "axle_turning_mass": ("axle", np.full(6, turning * LOAD)),
        "unit_static_load": ("unit", np.full(2, 2.0 * LOAD)),
        "unit_gear": ("unit", np.ones(2)),
        "unit_radius": ("unit", np.ones(2)),
        "unit_parallel": ("unit", np.array(parallel)),
    }
    return xr.Dataset(
        variables, {"time": PERIOD * np.arange(COUNT)}, {"blended_brakes": int(blended)}
    )


def found(run):
    """Room in loads of an axle at the last instant, plan first, and the three metrics."""
    forces = [float(values[-1]) / LOAD for values in train_bounds(run)[:4]]
    return forces, [
        METRICS[name].function(run) for name in ("bound_use", "headroom", "over_delivery")
    ]


def agree(run, forces, metrics):
    now = found(run)
    assert now[0] == pytest.approx(forces, rel=1e-12)
    assert now[1] == pytest.approx(metrics, rel=1e-12, abs=1e-15)


AXLES = np.array([0.20, 0.20, 0.20, 0.20, 0.20, 0.20])


def weak(*coefficients):
    """Adhesion of the axles, 0.2 where nothing is said."""
    return np.append(coefficients, AXLES[len(coefficients) :])


@pytest.mark.parametrize("braking", [False, True])
def test_a_train_that_delivers_its_plan_uses_its_bound_and_has_no_room(braking):
    agree(made(braking=braking, blended=False), [0.4] * 4, [1.0, 0.0, 0.0])


def test_the_weakest_axle_bounds_its_unit():
    # unit 0 can deliver 2 x 0.06, unit 1 what lacks: 0.28 of its 0.4
    agree(made(weak(0.06, 0.2), 0.05), [0.4, 0.4, 0.32, 0.2], [0.5, 0.2, 0.0])
    # and nothing more where unit 1 has no more than 2 x 0.12
    run = made(weak(0.06, 0.2, 0.12, 0.13), 0.05)
    agree(run, [0.4, 0.36, 0.32, 0.2], [0.2 / 0.36, 0.1, 0.0])
    # both short: sharing cannot help
    run = made(weak(0.06, 0.2, 0.09, 0.13), 0.05)
    agree(run, [0.4, 0.3, 0.3, 0.2], [0.2 / 0.3, 0.0, 0.0])


def test_motors_in_parallel_are_bounded_by_the_sum_of_their_axles():
    rail = weak(0.06, 0.2, 0.12, 0.13)
    agree(made(rail, 0.05, parallel=(0, 1)), [0.4, 0.37, 0.32, 0.2], [0.2 / 0.37, 0.05 / 0.4, 0.0])
    agree(made(rail, 0.05, parallel=(1, 1)), [0.4, 0.4, 0.4, 0.2], [0.5, 0.0, 0.0])
    # beside it stands the bound of equal torques: 2 x 0.06 and 2 x 0.12
    for parallel in ((0, 0), (1, 1)):
        used = METRICS["equal_torque_use"].function(made(rail, 0.05, parallel=parallel))
        assert used == pytest.approx(0.2 / 0.36, rel=1e-12)
    # motors bound such a unit too
    run = made(rail, 0.05, motor=np.array([0.06, 0.2]), parallel=(1, 0))
    agree(run, [0.4, 0.36, 0.32, 0.2], [0.2 / 0.36, 0.1, 0.0])


@pytest.mark.parametrize("braking", [False, True])
def test_motors_bound_a_unit_where_air_does_not_help(braking):
    run = made(motor=np.array([0.06, 0.14]), force=0.05, braking=braking, blended=False)
    agree(run, [0.4, 0.4, 0.32, 0.2], [0.5, 0.2, 0.0])
    # of both the wheelsets take 0.02 per axle
    motor, turning = np.array([0.06, 0.14]), 0.02
    run = made(motor=motor, force=0.05, turning=turning, braking=braking, blended=False)
    agree(run, [0.4, 0.32, 0.28, 0.2], [0.2 / 0.32, 0.1, 0.0])


def test_air_makes_up_for_motors_under_blended_brakes_and_not_beyond_the_rail():
    agree(made(motor=0.0, braking=True), [0.6] * 4, [1.0, 0.0, 0.0])
    run = made(weak(0.06, 0.2), 0.05, motor=0.0, braking=True)
    agree(run, [0.6, 0.6, 0.52, 0.3], [0.5, 0.08 / 0.6, 0.0])


def test_a_trailer_brakes_its_own_part_at_most_and_what_it_lacks_the_units_make_up_for():
    rail = weak(0.2, 0.2, 0.2, 0.2, 0.04, 0.2)
    agree(made(rail, 0.04, braking=True), [0.6, 0.6, 0.48, 0.24], [0.4, 0.2, 0.0])
    # adhesion that it has beyond its part serves nobody else
    rail = np.array([0.08, 0.08, 0.08, 0.08, 0.5, 0.5])
    agree(made(rail, 0.06, braking=True), [0.6, 0.52, 0.52, 0.36], [0.36 / 0.52, 0.0, 0.0])
    # where it does not brake, it counts for nothing
    agree(made(rail, 0.06, braking=True, blended=False), [0.4, 0.32, 0.32, 0.24], [0.75, 0.0, 0.0])
    agree(made(rail, 0.06), [0.4, 0.32, 0.32, 0.24], [0.75, 0.0, 0.0])


def test_what_controllers_hold_back_is_told_apart_from_what_nobody_asks_for():
    """Unit 0 delivers 0.04 of 0.06, unit 1 0.08 of 0.2, of which the plan of 0.4 leaves it 0.28."""
    rail, force = weak(0.06, 0.06), np.array([0.04, 0.04, 0.08, 0.08, 0.0, 0.0])
    for factor, lost in (
        ([1.0, 1.0], 0.0),
        ([0.9, 1.0], 0.04),
        ([1.0, 0.9], 0.16),
        ([0.5, 0.9], 0.16),
    ):
        run = made(rail, force, factor=np.array(factor))
        assert METRICS["held_back"].function(run) == pytest.approx(lost / 0.4, rel=1e-12)
    # a train that reaches its bound has lost nothing, whatever its units could do
    run = made(rail, np.array([0.04, 0.04, 0.16, 0.16, 0.0, 0.0]), factor=0.5)
    assert METRICS["held_back"].function(run) == 0.0


def test_what_exceeds_the_plan_is_over_delivery_and_no_use():
    agree(made(force=0.13), [0.4, 0.4, 0.4, 0.52], [1.0, 0.0, 0.3])
    run = made(force=0.13)
    run["rail_force"].values[: -LAST // 2] *= 0.5  # what lacks before is not paid back
    use, _, over = found(run)[1]
    short = COUNT - LAST + LAST // 2 - (COUNT - LAST)
    assert use == pytest.approx(((LAST - short) + 0.65 * short) / LAST, rel=1e-12)
    assert over == pytest.approx(0.3 * (LAST - short) / LAST, rel=1e-12)


def test_torque_has_two_seconds_to_rise_whenever_the_driver_asks_for_more():
    assert SETTLING == 2.0
    command = [0, 0, 1, 1, 1, 1, 1, 1, 0.5, 1, 0, 0, 0]
    chosen = settled(made(command=command))
    assert np.flatnonzero(chosen).tolist() == [6, 7, 8]
    # less is delivered at once
    command = [1, 1, 1, 1, 1, 0.8, 0.6, 0.6, 0.6, 0, 0, 0, 0]
    assert np.flatnonzero(settled(made(command=command))).tolist() == [4, 5, 6, 7, 8]


def test_bounds_stand_in_their_order():
    """Apart <= bound <= plan; forces that the rail and the motors allow use at most all of it."""
    for seed in range(50):
        rng = np.random.default_rng(seed)
        adhesion, motor = rng.uniform(0.02, 0.25, 6), rng.uniform(0.02, 0.25, 2)
        braking, blended = rng.random(2) < 0.5
        weakest = np.repeat(adhesion.reshape(3, 2).min(axis=1), 2)
        most = weakest.copy()
        most[4:] = np.minimum(most[4:], EXPECTED)
        if not (braking and blended):
            most[:4] = np.minimum(most[:4], np.repeat(motor, 2))
        run = made(adhesion, most * rng.uniform(0.3, 1.0), braking, blended, motor)
        forces, (use, headroom, over) = found(run)
        plan, bound, apart, force = forces
        assert 0.0 <= apart <= bound * (1 + 1e-12), seed
        assert bound <= plan, seed
        assert 0.0 <= headroom <= 1.0, seed
        assert use <= 1.0 + 1e-12, seed
        assert use + METRICS["held_back"].function(run) <= 1.0 + 1e-12, seed
        assert over == pytest.approx(max(force / plan - 1.0, 0.0), rel=1e-9, abs=1e-15), seed


def test_shares_of_the_bound_stay_within_it_whatever_wheels_and_motors_do():
    """Motors that give nothing or less than their wheelsets take, forces against the demand and beyond the rail."""
    rng = np.random.default_rng(37)
    for _ in range(300):
        adhesion, motor = rng.uniform(1e-6, 0.25, 6), rng.choice([0.0, 1e-9, 0.1], 2)
        force, turning = 10.0 ** rng.uniform(-3.0, 1.0) * rng.normal(size=6), rng.choice([0.0, 0.5])
        braking, blended = rng.random(2) < 0.5
        run = made(adhesion, force, braking, blended, motor, turning, factor=rng.random(2))
        use, held, room_left = (
            METRICS[name].function(run) for name in ("bound_use", "held_back", "headroom")
        )
        assert 0.0 <= room_left <= 1.0
        if train_bounds(run).bound.any():
            assert min(use, held) >= 0.0
            assert use + held <= 1.0 + 1e-12
        else:
            assert np.isnan([use, held]).all()
