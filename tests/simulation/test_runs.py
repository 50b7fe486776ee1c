"""Laws of whole runs: one plant, compiled and hosted parts alike, limits as the patent sets them, and what a run records."""

from dataclasses import dataclass, replace
from typing import Any, get_type_hints

import numpy as np
import pytest

from alloc import loop, simulation
from alloc.balance import check_run
from alloc.driving import Controls, TrainSense, drive
from alloc.errors import PlantError, UnsoundRun
from alloc.event import Event, SimulationError, canonical
from alloc.metrics import METRICS, evaluate
from alloc.onboard.parameters import Onboard, Sensors, Telegrams
from alloc.plant.model import build
from alloc.plant.rail import Line, Patch, Rail, logarithmic_increments
from alloc.plant.sets import SETS, find_set
from alloc.plant.train import Car, Train
from alloc.recording import (
    VARIABLES,
    RunAttributes,
    attributes_of,
    load,
    save,
)
from alloc.rules import AllocationProblem, Rule, find_rule
from alloc.rules.problem import Allocation
from alloc.simulation import DriverCommand, simulate
from studies.scenario import Scenario
from studies.scenario import load as load_scenario
from tests.cases import looped


def _b1_onsets(run):
    signal = run["slipping"].values[:, 0]
    return np.flatnonzero((signal[1:] == 1) & (signal[:-1] == 0)) + 1


def test_runs_are_reproducible_to_the_bit(make_event, dip):
    onboard = Onboard(
        sensors=Sensors(speed_noise=0.01, seed=4), telegrams=Telegrams(jitter=0.02, loss=0.1)
    )
    event = make_event(0.13, patches=[dip], onboard=onboard, scatter=0.006, seed=4)
    first, second = simulate(event, "greedy"), simulate(event, "greedy")
    first.attrs = second.attrs = {}
    assert first.identical(second)


def test_hosted_rule_and_compiled_rule_make_the_same_run(make_event, dip):
    event = make_event(0.13, patches=[dip])
    compiled = simulate(event, "exact")

    class Hosted:
        """The exact rule called from Python."""

        inner = find_rule("exact")
        name = "exact"
        trigger, caps, needs_truth = inner.trigger, inner.caps, inner.needs_truth
        law, onboard = None, inner.onboard

        def __call__(self, problem):
            return self.inner(problem)

    hosted = simulate(event, Hosted())
    assert compiled.attrs["rule_calls"] == hosted.attrs["rule_calls"] > 0
    for name in compiled.data_vars:
        np.testing.assert_allclose(hosted[name], compiled[name], rtol=1e-9, atol=1e-9, err_msg=name)


def test_estimate_at_detection_is_near_the_true_adhesion(make_event):
    for level in (0.09, 0.10, 0.11):
        run = simulate(make_event(level), "greedy")
        error = evaluate(run)["estimate_error"]
        assert abs(error) < 0.1 * level


def test_without_slip_nothing_acts(make_event):
    run = simulate(make_event(0.30), "greedy")
    metrics = evaluate(run)
    assert metrics["detections"] == metrics["unit_detections"] == metrics["slip_time"] == 0
    assert metrics["rule_calls"] == 0
    settled = run.sel(time=slice(1.5, None))
    np.testing.assert_allclose(
        settled["limit"], settled["expected"].values[:, None] + 0 * settled["limit"]
    )
    # delivers the plan less running resistance, and rotates its wheels without slip beyond the peak
    resistance = 3000.0 + 60.0 * settled["speed"] + 6.0 * settled["speed"] ** 2
    planned = 0.75 - resistance / (run.attrs["train_mass"] + run.attrs["train_rotating_mass"])
    # (6) compensates the units' own loads; the plan counts empty cars, all loaded by the same share here but for
    # the rotating parts, which do not grow with load
    assert settled["acceleration"].values == pytest.approx(planned.values, rel=0.02)


def test_common_random_numbers(make_event):
    event = make_event(0.11, scatter=0.01, seed=7, onboard=Onboard(sensors=Sensors(0.01, seed=7)))
    one, other = simulate(event, "alone"), simulate(event, "greedy")
    assert one.attrs["event_hash"] == other.attrs["event_hash"]
    k = _b1_onsets(one)[0]  # until the first detection both runs are the same run
    assert one["slip_velocity"].values[: k - 1] == pytest.approx(
        other["slip_velocity"].values[: k - 1]
    )
    assert make_event(0.13, scatter=0.01, seed=8).model.rail != event.model.rail


def test_load_compensation_keeps_the_acceleration(make_event, train):
    light, heavy = train.loaded((0.0,) * 5), train.loaded((9e3, 12e3, 12e3, 12e3, 9e3))
    accelerations = []
    for loaded in (light, heavy):
        free = replace(loaded, resistance=(0.0, 0.0, 0.0))
        run = simulate(make_event(0.35, train=free), "greedy")
        accelerations.append(run["acceleration"].sel(time=slice(2.0, 4.0)).mean().item())
    # without compensation the heavy train would lose a quarter
    assert accelerations[1] == pytest.approx(accelerations[0], rel=0.03)


@looped(
    ("change", "message"),
    [
        ({"duration": float("nan")}, "duration = nan"),
        ({"step": 0.0}, r"step = 0\.0"),
    ],
)
def test_impossible_events_are_refused(make_event, change, message):
    with pytest.raises(SimulationError, match=message):
        make_event(0.13, **change)


def _steady(run):
    return run.isel(time=slice(run.sizes["time"] // 2, None))


def test_rail_coefficient_of_every_unit_is_its_limit(make_event):
    run = _steady(simulate(make_event(0.30), "greedy"))
    for j in range(run.sizes["unit"]):
        axles = run["axle_unit"].values == j
        felt = run["coefficient"].values[:, axles].mean(axis=1)
        np.testing.assert_allclose(felt, run["limit"].values[:, j], rtol=0.03)


def test_limit_as_printed_delivers_less_by_the_wheelsets_inertia(make_event):
    with_inertia, as_printed = (
        _steady(simulate(make_event(0.30, onboard=Onboard(inertia_in_limit=flag)), "greedy"))
        for flag in (True, False)
    )
    # both ask the motors for the same torque where nothing slips; as printed, the limit names more than the rail receives
    np.testing.assert_allclose(
        as_printed["motor_torque"].values, with_inertia["motor_torque"].values, rtol=0.01
    )
    ratio = as_printed["limit"].values / with_inertia["limit"].values
    assert np.all(ratio > 1.02)


@looped("loaded", [False, True])
def test_plan_counts_what_the_wagons_carry(loaded):
    train = find_set("freight-17")
    wagons = tuple(
        car if k == 0 else replace(car, load=car.load if loaded else 0.0)
        for k, car in enumerate(train.cars)
    )
    event = Event(
        "start",
        build(replace(train, cars=wagons), Rail(0.6)),
        DriverCommand((0.0,), (0.1,)),
        duration=20.0,
    )
    run = simulate(event, "alone", "none")
    late = run.sel(time=slice(10.0, None))
    force = late["rail_force"].values[:, late["axle_unit"].values >= 0].sum(axis=1)
    # a few per cent more: the wagons' wheelsets have to be turned as well
    ratio = force.mean() / (0.1 * run.attrs["train_mass"])
    assert 1.0 < ratio < 1.08


def test_a_coupled_cars_reference_speed_is_its_own():
    train = find_set("freight-17")
    event = Event("start", build(train, Rail(0.6)), DriverCommand((0.0,), (0.1,)), duration=6.0)
    run = simulate(event, "alone", "none")
    # while the couplers stretch one after another the locomotive is faster than the last wagon, and does not slip
    spread = run["car_speed"].values[:, 0] - run["car_speed"].values[:, -1]
    assert spread.max() > 0.05
    error = np.abs(run["reference_speed"].values - run["car_speed"].values[:, 0])
    assert error.max() < 0.5 * spread.max()
    assert not run["slipping"].values.any()
    own = run["slide_reference"].values
    np.testing.assert_array_equal(own[:, 0], run["reference_speed"])
    assert np.abs(own[:, -1] - run["car_speed"].values[:, -1]).max() < 0.5 * spread.max()


def faulty(monkeypatch, change):
    """Every plant is changed before its run."""
    made = loop.compiled.workspace

    def workspace(model, step):
        found = made(model, step)
        change(found)
        return found

    monkeypatch.setattr(loop.compiled, "workspace", workspace)


@pytest.fixture(scope="module")
def short_start():
    return load_scenario("wet-start").changed(duration_s=4.0).event(0)


@pytest.mark.parametrize("part", ["bodies", "wheels"])
def test_a_force_that_is_wrong_by_a_hundredth_is_noticed(monkeypatch, short_start, part):
    def change(w):
        inverse = w.car.inverse_body_mass if part == "bodies" else w.axle.inverse_inertia
        inverse[:] *= 1.01

    faulty(monkeypatch, change)
    with pytest.raises(UnsoundRun, match=r"its energy balance lacks more than 0.0001 .* at \d"):
        simulate(short_start, "alone", "cut-and-ramp")


def test_each_limit_and_each_missing_number_is_noticed(monkeypatch, short_start):
    told = []
    monkeypatch.setattr(simulation, "check_run", lambda *given: told.extend(given))
    simulate(short_start, "alone", "cut-and-ramp")
    model, record, run = told
    check_run(model, record, run)
    axles, brakes = model.layout.axles, model.train.brake_groups
    for name, value, words in (
        ("motor_torque", 1.01 * model.structure.drive_table.max(), "a motor's torque exceeds its greatest at 2 s"),
        ("cylinder_pressure", 1.01 * brakes[0].maximum_pressure, "pressure is outside 0 to its supply at 2 s"),
        ("cylinder_pressure", -100.0, "pressure is outside 0 to its supply at 2 s"),
        ("coefficient", -1.03 * run["adhesion_limit"].values[200, 0], "force exceeds what its rail carries at 2 s"),
        ("reference_speed", np.nan, "reference_speed is not finite at 2 s"),
    ):  # fmt: skip
        changed = run.copy(deep=True)
        changed[name].values[200, ...] = value
        with pytest.raises(UnsoundRun, match=words):
            check_run(model, record, changed)
    record.state[200, model.layout.omega.stop - axles] = np.inf
    with pytest.raises(UnsoundRun, match="the state is not finite at 2 s"):
        check_run(model, record, run)


DRY = Rail(0.3)


def one_wagon(cut_out: tuple[int, ...] = ()) -> Train:
    """The last wagon of a freight train, alone, without resistance."""
    car: Car = find_set("freight-5").cars[-1]
    assert car.air_brake is not None
    car = replace(car, air_brake=replace(car.air_brake, cut_out=cut_out))
    return Train("one wagon", (car,))


def braking(pressure: float):
    def driver(sense: TrainSense, controls: Controls) -> bool:
        controls.pressure[:] = pressure
        return sense.speed > 1.0

    return driver


def test_a_bogie_that_is_cut_out_does_not_brake():
    speeds = [
        drive(build(one_wagon(cut), DRY), braking(200e3), 10.0, initial_speed=20.0)["speed"].values
        for cut in ((), (1,), (0, 1))
    ]
    losses = [speed[0] - speed[-1] for speed in speeds]
    assert losses[2] == 0.0
    assert losses[1] == pytest.approx(0.5 * losses[0], rel=0.05)  # shoes grip better when slower


def test_cutting_out_turns_with_the_car():
    train = one_wagon((1,)).reversed()
    assert train.cars[0].air_brake is not None
    assert train.cars[0].air_brake.cut_out == (0,)
    assert train.reversed().cars[0].air_brake == one_wagon((1,)).cars[0].air_brake


def test_the_driver_reads_what_the_plant_does():
    seen = []

    def driver(sense: TrainSense, controls: Controls) -> bool:
        controls.torque[:] = 500.0
        seen.append(sense)
        return True

    model = build(find_set("commuter-8car"), DRY, Line((0.0,), (0.01,)))
    run = drive(model, driver, 2.0, initial_speed=10.0, period=0.05)
    np.testing.assert_array_equal([s.speed for s in seen], run["car_speed"].values[:, 0])
    np.testing.assert_array_equal([s.position for s in seen], run["position"].values)
    np.testing.assert_allclose(run["torque_command"].values, 500.0)
    np.testing.assert_allclose(seen[-1].torque, 500.0, rtol=1e-6)
    np.testing.assert_allclose(
        [s.acceleration for s in seen[20:]], run["acceleration"].values[20:], atol=2e-3
    )


def test_neither_control_period_nor_recording_changes_the_run():
    def run(period: float, record_period: float) -> np.ndarray:
        model = build(one_wagon(), DRY)
        result = drive(
            model, braking(200e3), 5.0, initial_speed=20.0, period=period, record_period=record_period
        )  # fmt: skip
        return result["speed"].sel(time=[1.0, 5.0], method="nearest").values

    np.testing.assert_allclose(run(0.1, 0.5), run(0.1, 0.1), rtol=0.0, atol=0.0)
    np.testing.assert_allclose(run(0.5, 0.5), run(0.1, 0.1), rtol=1e-12)


@looped(
    ("changes", "named"),
    [
        ({"duration": -1.0}, "duration"),
        ({"period": float("nan")}, "period"),
        ({"step": -1.0}, "step"),
        ({"record_period": 0.15}, "multiple"),
    ],
)
def test_impossible_runs_are_refused(changes, named):
    arguments = {"duration": 1.0, **changes}
    with pytest.raises(SimulationError, match=named):
        drive(build(one_wagon(), DRY), braking(0.0), **arguments)


def test_a_brake_that_is_not_there_cannot_be_cut_out():
    with pytest.raises(PlantError, match="cut_out"):
        one_wagon((2,))
    with pytest.raises(PlantError, match="cut_out"):
        one_wagon((-1,))


def test_nan_torque_is_refused():
    def driver(sense: TrainSense, controls: Controls) -> bool:
        controls.torque[:] = np.nan
        return True

    with pytest.raises(SimulationError, match="finite"):
        drive(build(find_set("commuter-8car"), DRY), driver, 0.5)


@pytest.fixture(scope="module")
def recorded(make_event, dip):
    return simulate(make_event(0.13, patches=[dip], duration=5.0), "greedy")


def test_every_variable_has_unit_and_name(recorded):
    # of trains with sanders, with cars that move apart, drives that twist, on rail that recovers, and that learn
    others = {"sand_rate", "slide_reference", "shaft_torque", "shaft_swing", "recovery"}
    others |= {name for name in VARIABLES if name.startswith(("increment", "learnt"))}
    assert set(recorded.data_vars) == set(VARIABLES) - others
    for name in recorded.data_vars:
        assert recorded[name].attrs["units"], name
        assert recorded[name].attrs["long_name"], name
        assert recorded[name].dims == VARIABLES[name].dims
    assert recorded["time"].attrs["units"] == "s"


def test_netcdf_round_trip_is_equal(recorded, tmp_path):
    path = tmp_path / "run.nc"
    save(recorded, path)
    assert load(path).identical(recorded)


def test_attributes_are_those_that_are_typed(recorded, tmp_path):
    path = tmp_path / "run.nc"
    save(recorded, path)
    for one in (recorded, load(path)):
        assert {key: type(value) for key, value in one.attrs.items()} == get_type_hints(
            RunAttributes
        )


def test_provenance_is_recorded(recorded):
    for key in ("event_hash", "seed", "rule", "controller", "git_revision", "version_numba"):
        assert str(recorded.attrs[key])


def test_hash_tells_events_apart(make_event, dip):
    plain = make_event(0.13)
    assert plain.hash == make_event(0.13).hash
    others = [
        make_event(0.14),
        make_event(0.13, patches=[dip]),
        make_event(0.13, duration=9.0),
        make_event(0.13, failures={1: 2.0}),
        make_event(0.13, seed=1, scatter=0.01),
    ]
    assert len({e.hash for e in [plain, *others]}) == 6


def test_recorded_quantities_obey_their_definitions(recorded):
    load_ = recorded["axle_load"].values
    np.testing.assert_allclose(
        recorded["rail_force"], recorded["coefficient"] * load_, rtol=1e-9, atol=1e-6
    )
    car = recorded["axle_car"].values
    slip = recorded["rim_speed"].values - recorded["car_speed"].values[:, car]
    np.testing.assert_allclose(recorded["slip_velocity"], slip, atol=1e-12)
    assert np.all(np.abs(recorded["coefficient"]) <= recorded["adhesion_limit"] * (1 + 1e-12))
    # position is the integral of speed (trapezoidal rule at the recording period)
    speed, instants = recorded["speed"].values, recorded["time"].values
    travelled = np.sum(0.5 * (speed[1:] + speed[:-1]) * np.diff(instants))
    assert recorded["position"].values[-1] - recorded["position"].values[0] == pytest.approx(
        travelled, rel=1e-5
    )


HINTS = get_type_hints(RunAttributes)


def test_what_a_user_reads_is_typed():
    assert set(HINTS.values()) <= {int, float, str}
    assert get_type_hints(attributes_of)["return"] is RunAttributes
    assert get_type_hints(Rule.__call__)["return"] is Allocation
    assert get_type_hints(Scenario.event)["return"] is Event
    assert get_type_hints(evaluate)["return"] == dict[str, float]
    assert Any not in get_type_hints(simulate).values()
    for kind in (Allocation, Event, AllocationProblem, Rule):
        vague = {name for name, hint in get_type_hints(kind).items() if hint is Any}
        assert vague <= {"law"}, kind  # compiled


@looped("name", SETS)
def test_event_train_and_model_fit_a_line_or_three(name):
    train = find_set(name)
    rail = Rail(0.1, increments=tuple(logarithmic_increments(train.axle_count)))
    model = build(train, rail)
    event = Event("start", model, DriverCommand((0.0,), (0.7,)))
    for thing in (train, rail, model, event):
        assert len(repr(thing)) < 300
    assert repr(name) in repr(train)
    assert repr(name) in repr(event)
    assert "level 0.1" in repr(rail)


def test_canonical_text_holds_what_repr_leaves_out():
    rail = Rail(0.1, patches=(Patch(0.5, start=1.0),))
    other = replace(rail, patches=(Patch(0.5, start=2.0),))
    assert repr(rail) == repr(other)
    assert canonical(rail) != canonical(other)
    assert canonical(rail) == canonical(replace(rail))
    long = np.zeros(5000)
    one = long.copy()
    one[2500] = 1e-15
    assert canonical({"a": [long]}) != canonical({"a": [one]})


def test_canonical_text_of_plain_records_is_their_repr():
    @dataclass
    class Record:
        a: tuple[float, ...]
        b: list[object]

    record = Record((1.0,), [{"x": None}, (), "s"])
    assert canonical(record) == repr(record)


def test_detector_finds_every_slip_of_a_clean_run_soon(make_event, dip):
    result = evaluate(simulate(make_event(0.15, patches=[dip]), "alone"))
    assert result["missed_slips"] <= 1  # one that ends by itself before it shows
    assert result["false_alarms"] == 0
    assert 0.0 <= result["detection_delay"] < 0.6


def test_noise_raises_false_alarms(make_event):
    quiet, noisy = (
        evaluate(simulate(make_event(0.30, onboard=Onboard(sensors=Sensors(noise, 0.0))), "alone"))
        for noise in (0.0, 0.06)
    )
    assert quiet["false_alarms"] == 0
    assert noisy["false_alarms"] > 0


def test_quantisation_of_the_speed_sensor_is_seen_on_board(make_event):
    exact, coarse = (
        simulate(make_event(0.30, onboard=Onboard(sensors=Sensors(speed_quantum=quantum))), "alone")
        for quantum in (0.0, 0.05)
    )
    ripple = [run["computed_acceleration"].values[300:].std() for run in (exact, coarse)]
    assert ripple[1] > 5 * ripple[0]


def test_damage_equals_the_integral_of_the_recorded_force_and_slip(make_event, dip):
    # Q from what a real train measures (28), on the recording's grid, against the plant's own integral
    run = simulate(make_event(0.13, patches=[dip], record_period=0.01), "alone")
    power = (run["rail_force"] * run["slip_velocity"]).sum("axle").values
    from_record = np.trapezoid(power, run["time"].values) / 1e3
    assert evaluate(run)["damage"] == pytest.approx(from_record, rel=5e-3)


def test_registry_is_complete(make_event):
    run = simulate(make_event(0.13, duration=3.0), "alone")
    result = evaluate(run)
    assert set(result) == set(METRICS)
    for name, metric in METRICS.items():
        assert metric.name == name
        assert metric.description
        assert isinstance(result[name], float)
