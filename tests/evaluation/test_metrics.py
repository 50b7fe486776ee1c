"""Laws of the metrics, on records made by hand: a rigid train of units with an axle each, without resistance or inertia,
whose torques and cylinders rise at once unless a test says otherwise."""

import numpy as np
import pytest
import xarray as xr

from alloc.evaluation import metrics
from alloc.evaluation.metrics import METRICS, evaluate, metric
from alloc.evaluation.recorded_run import RecordedRun, car_jerk, series
from alloc.plant.curves import PiecewiseCurve
from alloc.schema.errors import UnsoundRun
from alloc.schema.registry import Registry

LOAD, MASS, ASKED = 1e5, 1e5, 0.8
"""Of an axle [N], of the train [kg], by the driver [m/s2]: two axles carry the plan at a coefficient of 0.4."""
CURVE = PiecewiseCurve(micro_slope=5.0, top_curvature=2e3)
"""A line nearly up to its peak."""
PER_UNIT = ("drive_limit", "brake_limit", "motor_torque")
ON_BOARD = (
    "plan",
    "torque_command",
    "torque_target",
    "limit",
    "reference_speed",
    "coefficient_estimate",
    "level",
    "case",
)


def made(force, level=0.5, command=ASKED, period=0.01, unit=None, **changes):
    """A record of this force of each axle (instants, axles) [N] in the direction of the command; wheels in balance.

    `unit`: that of each axle, -1 for one that air alone brakes; by default each axle is one. `changes`: other values of
    variables, attributes or statics.
    """
    force = np.asarray(force, dtype=float)
    t, n = force.shape
    way, level = np.sign(command), np.broadcast_to(level, force.shape)
    slip = force / LOAD / CURVE.micro_slope
    gain = way * force.sum(axis=1) / MASS
    speed = 20.0 * (way < 0.0) + np.cumsum(gain) * period
    axle = np.arange(n)
    unit = axle if unit is None else np.array(unit)
    count = np.bincount(unit[unit >= 0])
    full = {"rail_force": way * force, "slip_velocity": way * slip, "axle_load": LOAD,
            "rim_speed": speed[:, None] + way * slip, "offered": level, "adhesion_limit": level,
            "peak_slip": CURVE.top(speed[:, None], level)[1],
            "friction_work": np.cumsum(force * slip, axis=0) * period}  # fmt: skip
    every = {"driver_command": command, "planned_coefficient": abs(command) * MASS / (n * LOAD),
             "speed": speed, "acceleration": gain, "position": np.cumsum(speed) * period, "motor_work": 0.0}  # fmt: skip
    still = {"axle_unit": unit, "axle_group": axle, "axle_car": 0, "axle_contact": 1.0,
             "axle_static_load": LOAD, "axle_radius": 0.43, "axle_turning_mass": 0.0, "axle_fill_time": 0.0,
             "axle_dead_time": 0.0}  # fmt: skip
    of_unit = {
        "unit_static_load": count * LOAD,
        "unit_gear": 1.0,
        "unit_radius": 1.0,
        "unit_lag": 0.0,
        "unit_parallel": 0,
    }
    of_unit = {
        name: ("unit", np.broadcast_to(value, count.shape)) for name, value in of_unit.items()
    }
    data = {name: (("time", "axle"), np.broadcast_to(v, force.shape)) for name, v in full.items()}
    data |= {name: ("time", np.broadcast_to(v, (t,))) for name, v in every.items()}
    data |= {name: ("axle", np.broadcast_to(v, (n,))) for name, v in still.items()}
    data |= {name: (("time", "unit"), np.full((t, count.size), 1e9)) for name in PER_UNIT} | of_unit
    data |= {"car_speed": (("time", "car"), speed[:, None]), "car_mass": ("car", [MASS]),
             "car_acceleration": (("time", "car"), gain[:, None]),
             "coupler_force": (("time", "coupler"), np.zeros((t, 0)))}  # fmt: skip
    attrs = {"blended_brakes": 0, "target_speed": np.nan, "rule_failures": 0, "controller_failures": 0,
             "curve": CURVE.number, "curve_values": CURVE.values, "control_period": period, "rise_time": 1e-9}  # fmt: skip
    for name, value in changes.items():
        if name in attrs:
            attrs[name] = value
        else:
            dims, old = data[name]
            data[name] = dims, np.broadcast_to(value, np.shape(old))
    return xr.Dataset(data, {"time": period * np.arange(t)}, attrs)


def drawn(seed, ticks=1500, **options):
    """Random forces up to the plan, and somewhat beyond, on rail that carries them with little to spare."""
    draw = np.random.default_rng(seed)
    part, rail = (
        np.repeat(draw.uniform(*span, (ticks // hold, 3)), hold, axis=0) * ASKED / 3.0 * MASS
        for hold, span in ((100, (0.5, 1.02)), (300, (0.7, 1.3)))
    )
    return made(np.minimum(part, 0.95 * rail), rail / LOAD, **options)


def same(one, other, **tolerance):
    for name, value in evaluate(one).items():
        assert evaluate(other)[name] == pytest.approx(value, nan_ok=True, **tolerance), name


def test_equal_forces_have_equal_metrics_whatever_the_computers_on_board_think():
    run = drawn(1)
    noise = np.random.default_rng(2).normal(size=run.sizes["time"])
    same(run, run.assign(dict.fromkeys(ON_BOARD, ("time", noise))), rel=0.0, abs=0.0)


@pytest.mark.parametrize("command", [ASKED, -ASKED])
@pytest.mark.parametrize("unit", [(0, 0, -1), (0, 1, 2)])
def test_one_pass_sums_over_axles_as_numpy_does(command, unit):
    """Air brakes the trailer, which alone is no part of a pulling train."""
    record = drawn(3, command=command, unit=unit, blended_brakes=1)
    record = record.assign(slip_velocity=3.0 * record["slip_velocity"])
    run, way, motors = RecordedRun(record), np.sign(command), np.array(unit) >= 0
    force, rail = way * record["rail_force"].values, record["adhesion_limit"].values * LOAD
    acts = motors | (command < 0.0)
    np.testing.assert_allclose(run.sums.acting, force[:, acts].sum(axis=1))
    trailing = 0.0 * force[:, 0] if command > 0.0 else force[:, ~motors].sum(axis=1)
    np.testing.assert_allclose(run.sums.delivered, [force[:, motors].sum(axis=1), trailing])
    for k, carried in enumerate(run.sums.carried.T):
        np.testing.assert_allclose(carried, (k == run.part).sum() * rail[:, k == run.part].min(1))
    np.testing.assert_allclose(run.sums.used, [force[:, acts].ravel(), rail[:, acts].ravel()])
    slip = np.abs(record["slip_velocity"].values) > 2.0 * record["peak_slip"].values
    assert run.sums.slipping == slip.sum() > 0


@pytest.mark.parametrize("command", [ASKED, -ASKED])
@pytest.mark.parametrize("unit", [None, (-1, -1)])
def test_rail_that_carries_everything_gives_one_and_nothing_lost(command, unit):
    found = evaluate(made(np.full((1000, 2), 4e4), 0.6, command, unit=unit))
    if unit is None or command < 0.0:
        assert found["bound"] == found["bound_use"] == found["effort_ratio"] == pytest.approx(1.0)
    names = "headroom", "over_delivery", "slip_time", "time_lost", "distance_lost"
    values = [found[name] for name in names] + [found["excess_damage"]]
    assert np.nan_to_num(values) == pytest.approx(0.0, abs=2e-3)


def test_metrics_are_within_their_ranges_and_an_event_can_save_more_than_its_instants():
    for seed in range(8):
        found = evaluate(drawn(seed, command=ASKED if seed % 2 else -ASKED))  # raises beyond one
        assert found["event_excess"] > found["excess_damage"] - 2e-3 > -4e-3


def test_a_metric_beyond_its_range_is_an_unsound_run():
    run = drawn(0)
    with pytest.raises(UnsoundRun, match="metric 'damage' = -"):
        evaluate(run.assign(friction_work=-run["friction_work"]))


def test_metrics_do_not_depend_on_the_period_of_the_record():
    place = 0.01 * np.arange(1501)[:, None] + np.array([0.0, 1.0, 3.0])
    fine = made(2e4 + 8e3 * np.sin(place), 0.3 + 0.02 * np.sin(0.5 * place))
    same(fine, fine.isel(time=slice(None, None, 5)), rel=0.01, abs=0.01)


def test_the_least_damage_of_equal_units_is_that_of_equal_forces():
    """Below the peak power is proportional to the sum of the forces squared."""
    forces = np.array([1.2e4, 2.4e4])
    found = evaluate(made([forces] * 400))["excess_damage"]
    least = 2.0 * forces.mean() ** 2
    assert found == pytest.approx((forces**2).sum() / least - 1.0, rel=0.01)
    assert evaluate(made(np.full((400, 2), 1.8e4)))["event_excess"] == pytest.approx(0.0, abs=2e-3)


def test_what_one_unit_cannot_carry_is_the_headroom_of_the_others():
    found = evaluate(made([[1e4, 3e4]] * 400, [[0.1, 0.5]]))
    expected = {"bound": 6e4 / 8e4, "headroom": 1e4 / 8e4, "bound_use": 4e4 / 6e4}
    assert {name: found[name] for name in expected} == pytest.approx(expected)


def test_in_blended_braking_a_unit_has_its_weakest_axles_force_and_a_trailer_its_own_part():
    """Of 80 kN the unit's two axles carry 2 x 20 kN, the trailer 15 kN of its third."""
    run = made([[1.5e4, 1.5e4, 1.5e4]] * 800, [[0.2, 0.6, 0.15]], -ASKED, unit=(0, 0, -1),
               blended_brakes=1, brake_limit=0.0)  # fmt: skip
    found, way = evaluate(run), np.abs(run["speed"].values).sum() * 0.01
    expected = {"bound": 55 / 80, "headroom": 0.0, "bound_use": 45 / 55,
                "effort_ratio": 45 / 80, "distance_lost": way * (1.0 - 45 / 80)}  # fmt: skip
    assert {name: found[name] for name in expected} == pytest.approx(expected)


def test_over_an_event_effort_moves_from_dear_instants_to_cheap_ones_but_not_beyond_the_plan():
    """Water filling by hand: 4 s at 18 kN, instead of 2 s at 12 kN and 2 s at 24 kN; or 2 s at a plan of 16, 2 s at 20."""
    course = np.where(np.arange(400)[:, None] % 100 < 50, 1.2e4, 2.4e4) * np.ones((1, 2))
    spent, plan, least = 12.0**2 + 24.0**2, 0.16, 2.0 * 18.0**2
    assert evaluate(made(course))["event_excess"] == pytest.approx(spent / least - 1.0, rel=0.02)
    found = evaluate(made(course, planned_coefficient=plan))
    least = 16.0**2 + 20.0**2
    assert found["event_excess"] == pytest.approx(spent / least - 1.0, rel=0.02)
    assert found["over_delivery"] == pytest.approx((24.0 - 16.0) / (2.0 * 16.0))


@pytest.mark.parametrize(("command", "name"), [(ASKED, "time_lost"), (-ASKED, "distance_lost")])
def test_half_of_the_plan_for_four_seconds_loses_two(command, name):
    force = np.full((1000, 2), 4e4)
    force[400:800] = 2e4
    run = made(force, 0.5, command)
    way = np.abs(run["speed"].values[400:800]).sum() * 0.01
    found = evaluate(run)
    assert found[name] == pytest.approx(2.0 if command > 0.0 else 0.5 * way, rel=1e-9)
    assert np.isnan(found["distance_lost" if command > 0.0 else "time_lost"])


@pytest.mark.parametrize(("command", "lag"), [(ASKED, 0.1), (-ASKED, 0.1), (-ASKED, 0.5)])
def test_who_follows_the_plan_from_the_first_instant_uses_the_bound_and_who_is_late_does_not(
    command, lag
):
    """A ramp of 1 s behind a lag, in closed form; by air, behind a dead time too."""
    air, time = lag == 0.5, 0.01 * np.arange(600)[:, None] * np.ones((1, 2))
    lags = {"axle_fill_time": lag, "axle_dead_time": 0.2} if air else {"unit_lag": lag}

    def rise(since):
        since = np.maximum(since, 0.0)
        return since + lag * np.expm1(-since / lag)

    for late in (0.0, 0.1):
        since = time - 0.2 * air - late
        run = made(4e4 * (rise(since) - rise(since - 1.0)), 0.6, command, rise_time=1.0,
                   control_period=0.0, unit=(-1, -1) if air else None, **lags)  # fmt: skip
        found = evaluate(run)
        used = 1.0 if late == 0.0 else 1.0 - late / (6.0 - 0.5 - lag - 0.2 * air)
        assert found["bound_use"] == pytest.approx(used, abs=1e-3)
        assert found["over_delivery"] == pytest.approx(0.0, abs=1e-6)
        if command > 0.0:
            assert found["time_lost"] == pytest.approx(late, abs=0.02 * (late > 0.0) + 1e-3)


def test_motors_and_not_the_rail_bound_a_unit_that_has_failed():
    limit = np.array([[1e9, 0.0]])
    run = made([[4e4, 0.0]] * 800, 0.6, drive_limit=limit)
    found = RecordedRun(run).bounds
    assert found.bound[-1] == pytest.approx(6e4)
    assert found.apart[-1] == pytest.approx(4e4)
    # its part of the plan is out of reach on any rail
    assert evaluate(run)["time_lost"] == pytest.approx(0.0, abs=1e-9)


def test_the_jerk_of_a_slow_oscillation_is_its_derivative():
    time = 0.01 * np.arange(2000)
    run = made(np.full((2000, 2), 1e4), car_acceleration=0.1 * np.sin(2.0 * time)[:, None])
    assert car_jerk(run)[200:-200, 0] == pytest.approx(0.2 * np.cos(2.0 * time)[200:-200], abs=1e-3)


@pytest.mark.parametrize("hertz", [2.0, 5.0, 10.0])
def test_jerk_above_the_cut_off_is_filtered_out(hertz):
    """To and fro a Butterworth filter of second order passes 1 / (1 + (f / 5 Hz)^4)."""
    turn = 2.0 * np.pi * hertz * 0.01
    run = made(np.full((2000, 2), 1e4), car_acceleration=np.sin(turn * np.arange(2000))[:, None])
    expected = np.sin(turn) / 0.01 / (1.0 + (hertz / 5.0) ** 4) / np.sqrt(2.0)
    assert np.std(car_jerk(run)[200:-200, 0]) == pytest.approx(expected, rel=0.01)


def test_torque_fluctuation_is_about_the_mean_of_a_second():
    swing = 1e3 * np.sin(2.0 * np.pi * np.arange(2000) / 100.0) + 10.0 * np.arange(2000)
    run = made(np.full((2000, 2), 1e4), motor_torque=swing[:, None])
    expected = 1e3 / np.sqrt(2.0) / (run["planned_coefficient"].values[0] * LOAD)
    assert evaluate(run)["torque_fluctuation"] == pytest.approx(expected, rel=0.05)


def test_an_own_metric_gets_the_recorded_run_and_joins_all_others(monkeypatch):
    monkeypatch.setattr(metrics, "METRICS", Registry("metric"))

    @metric("way", "m", "way of the train", better=+1)
    def way(run):
        assert isinstance(run, xr.Dataset)
        return series(run, "position")[-1] - run["position"].values[0]

    run = drawn(5)
    assert evaluate(run) == {"way": pytest.approx(metrics.distance(run))}


def test_every_metric_says_its_unit_and_its_meaning():
    for name, one in METRICS.items():
        assert one.name == name
        assert one.unit in {"1", "s", "m", "m/s", "m/s3", "kJ", "MJ", "kN"}
        assert one.description[-1] not in ".;"
