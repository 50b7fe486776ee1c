"""Whole runs: what holds under every rule and every controller."""

import gc
import signal
import weakref
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr

from alloc.evaluation.metrics import evaluate
from alloc.evaluation.recorded_run import RecordedRun
from alloc.onboard.columns import TABLES as BOARD_TABLES
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.onboard.settings import Onboard, Sensors
from alloc.plant.columns import TABLES as PLANT_TABLES
from alloc.plant.rail import Line, Patch, Rail, logarithmic_increments
from alloc.plant.trains import find_train
from alloc.rules import RULES, Rule
from alloc.run.event import DriverCommand, Event
from alloc.run.recording import load, save
from alloc.run.simulation import ADVANCE, COMMAND, PLAN, Simulation, simulate
from alloc.schema.errors import InputError
from studies.files.scenario_files import load_scenario
from studies.population import population

PULL, STOP = DriverCommand((0.0,), (0.8,)), DriverCommand((0.0,), (-1.0,))


def event(set_="commuter-8car", command=PULL, level=0.13, duration=4.0, **given):
    train = find_train(set_)
    rail = Rail(
        level,
        increments=tuple(logarithmic_increments(train.axle_count)),
        patches=given.pop("patches", (Patch(0.7, 5.0, 30.0),)),
    )
    speed = 12.0 if command is STOP else 2.0
    return Event(
        "made", train, rail, command, duration=duration, **{"initial_speed": speed} | given
    )


def served(rule, controller):
    """The same parts as plain Python."""
    plain = replace(
        rule,
        share=getattr(rule.share, "py_func", rule.share),
        belief=rule.belief._replace(function=rule.belief.function.py_func),
    )
    control = getattr(controller.control, "py_func", controller.control)
    return plain, replace(controller, control=control)


@pytest.mark.parametrize(("rule", "controller"), [("oracle", "none"), ("cooperative", "mpc")])
def test_the_bound_of_a_start_holds_from_the_first_instant_on_and_on_dry_rail_it_is_reached(
    rule, controller
):
    for level in (0.12, 0.6):
        run = simulate(event(level=level, patches=()), rule, controller)
        bounds, used = RecordedRun(run).bounds, evaluate(run)["bound_use"]
        beyond = np.minimum(bounds.force, bounds.plan) - bounds.bound
        assert (beyond < 5e-3 * bounds.plan.max()).all()
        assert used > (0.998 if level == 0.6 else 0.8)


def test_no_controller_gives_the_first_two_seconds_of_a_start_away():
    """Of what motors and rail allow from the first instant on. The table's rise of 1.8 s is its paper's."""
    starts = [k for k in range(40) if population.draw(65, k)["case"] == "start"]
    for name in set(CONTROLLERS.shipped()) - {"none", "table", "mpc-casadi"}:
        used = []
        for k in starts:
            event = replace(population.event(65, k).event(0), duration=2.0)
            used.append(evaluate(simulate(event, "cooperative", name))["bound_use"])
        assert np.mean(used) > 0.85
        assert min(used) > (0.65 if name in ("mpc", "cut-and-ramp") else 0.3)


PAIRS = [(rule, "perturb-observe") for rule in RULES] + [
    ("cooperative", one) for one in CONTROLLERS
]


@pytest.mark.parametrize(("rule", "controller"), PAIRS)
def test_a_run_served_by_python_equals_the_compiled_one_to_the_last_bit(rule, controller):
    made = event(
        duration=0.8,
        command=STOP if len(rule) % 2 else PULL,
        onboard=Onboard(sensors=Sensors(speed_noise=0.01)),
    )
    ours = simulate(made, rule, controller)
    plain = simulate(made, *served(RULES[rule], CONTROLLERS[controller]))
    last_bits = 1e-9 if RULES[rule].answer else 0.0  # of a solver that starts from its last answer
    for name, values in ours.variables.items():
        np.testing.assert_allclose(
            plain[name].values, values.values, last_bits, last_bits, err_msg=str(name)
        )


@pytest.mark.parametrize("command", [PULL, STOP])
@pytest.mark.parametrize(
    ("rule", "controller"), [one for one in PAIRS if not {"table", "most"} & {*one}]
)  # the first rises slowly, the second asks for more than the plan
def test_on_a_dry_rail_every_pair_keeps_the_plan(rule, controller, command):
    run = simulate(event(command=command, level=0.5, patches=(), duration=8.0), rule, controller)
    found = evaluate(run)
    trailers = (
        4e-3 if command is STOP else 0.0
    )  # their cylinders lag, and most rules leave that to them
    assert found["bound_use"] == pytest.approx(1.0, abs=1e-3 + trailers)
    assert found["slip_time"] == 0.0
    lost = found["distance_lost" if command is STOP else "time_lost"]
    least, most = (-1.0, 1.0) if command is STOP else (-0.02, 0.02)
    if command is STOP and rule == "uniform":
        least = -3.0  # it asks the motors for more until the trailers' cylinders have filled, and stops earlier
    assert least < lost < most


@pytest.mark.parametrize(("rule", "controller"), PAIRS)
def test_no_pair_exceeds_rail_motors_or_its_targets(rule, controller):
    run = simulate(event(), rule, controller)
    grip = run["adhesion_limit"] * run["axle_load"]
    assert (abs(run["rail_force"]) <= grip * (1.0 + 1e-9)).all()
    assert (run["motor_torque"] <= run["drive_limit"] * 1.01 + 1.0).all()
    assert (run["torque_command"] <= run["torque_target"] * (1.0 + 1e-12) + 1e-9).all()
    assert (run["torque_command"] >= 0.0).all()


@pytest.mark.parametrize("command", [PULL, STOP])
@pytest.mark.parametrize("name", ["commuter-8car", "freight-5"])
def test_energy_balances(name, command):
    """JP4209318 (27) for the whole train: what motors give is motion, friction, heat of shoes and couplers, and height."""
    run = simulate(event(name, command, line=Line((0.0, 20.0), (0.0, 0.01))), "cooperative", "none")
    motion = 0.5 * (run["car_mass"] * run["car_speed"] ** 2).sum("car")
    turning = 0.5 * (run["axle_turning_mass"] * run["rim_speed"] ** 2).sum("axle")
    stored = motion + turning
    work = run["motor_work"] - run["shoe_work"] - run["resistance_work"] - run["coupler_work"]
    work = work - run["friction_work"].sum("axle")
    scale = float(abs(stored - stored[0]).max() + run["friction_work"].sum("axle").max())
    spring = (
        0.02 if name.startswith("freight") else 1e-6
    )  # what couplers store is not in the record
    assert float(abs(stored - stored[0] - work).max()) < spring * scale


def test_a_shorter_step_changes_nothing():
    one, half = (simulate(event(step=step), "cooperative", "none") for step in (2e-3, 1e-3))
    assert float(abs(one["car_speed"] - half["car_speed"]).max()) < 1e-5


def test_a_rarer_record_is_the_same_run():
    often, seldom = (simulate(event(record_period=one), "greedy") for one in (0.01, 0.05))
    np.testing.assert_array_equal(often["speed"].values[::5], seldom["speed"].values)


THREADED = [("cooperative", "mpc"), ("qp", "cut-and-ramp"), ("in Python", "in Python")]


def test_four_threads_give_the_rows_of_one():
    """The compiled loop lets other threads run; each has the parts in Python of its own run."""
    made = [event(duration=1.0, level=level) for level in (0.09, 0.11)]

    def row(k):
        rule, controller = THREADED[k % len(THREADED)]
        if rule not in RULES:
            rule, controller = served(RULES["cooperative"], CONTROLLERS["cut-and-ramp"])
        return evaluate(simulate(made[k % len(made)], rule, controller))

    with ThreadPoolExecutor(4) as threads:
        assert list(threads.map(row, range(12))) == [row(k) for k in range(12)]


def failing(unit, axles, memory, run):
    if run.time > 0.5:
        raise RuntimeError("no torque")


def interrupted(unit, axles, memory, run):
    if run.time > 0.5:
        signal.raise_signal(signal.SIGINT)


@pytest.mark.parametrize(
    ("control", "raised"), [(failing, InputError), (interrupted, KeyboardInterrupt)]
)
def test_what_a_part_in_python_raises_ends_the_run_and_frees_its_memory(control, raised):
    run = Simulation(event(), "alone", Controller("own", control, ""))
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    with pytest.raises(raised, match="no torque" if raised is InputError else None):
        run.run_to_end()
    assert signal.signal(signal.SIGINT, before) is signal.default_int_handler
    assert 0.5 < run.world.run[0].time < 0.52
    left = weakref.ref(run.world.state)
    del run
    gc.collect()
    assert left() is None


def test_a_run_goes_on_after_a_signal_that_is_noted_and_at_its_end():
    """A handler that raises nothing hears of the first before the next call; no step lies beyond the end."""
    noted, run = [], Simulation(event(), "alone", Controller("own", once_interrupted, ""))
    before = signal.signal(signal.SIGINT, lambda number, _: noted.append(run.world.run[0].time))
    run.run_to_end()
    signal.signal(signal.SIGINT, before)
    assert noted == pytest.approx([0.51], abs=0.011)
    state = run.world.state.copy()
    run.run_to(COMMAND)
    assert run.tick == run.ticks
    np.testing.assert_array_equal(run.world.state, state)


def once_interrupted(unit, axles, memory, run):
    if 0.5 < run.time < 0.512 and axles[0].unit == 0:
        signal.raise_signal(signal.SIGINT)


def test_a_rule_in_python_may_run_an_event_itself():
    def share(units, run):
        ahead = simulate(event(duration=0.2), "qp", "none")
        units.wanted = np.minimum(0.1 + 0.01 * float(ahead.speed[-1]), units.most)
        return np.nan

    rule = Rule("looks ahead", "", share, "delivered always")
    limits = simulate(event(duration=0.4), rule, "cut-and-ramp").wanted.values
    assert len(np.unique(limits[np.isfinite(limits)])) == 1


def test_stopping_between_instants_changes_nothing():
    run = Simulation(event(duration=2.0), "cooperative", "cut-and-ramp")
    while run.tick < 100:
        for step in (PLAN, COMMAND, ADVANCE):
            run.run_to(step)
    run.run_to_end()
    whole = simulate(event(duration=2.0), "cooperative", "cut-and-ramp")
    np.testing.assert_array_equal(run.recorded()["rim_speed"].values, whole["rim_speed"].values)


PARTS = [(rule, "perturb-observe") for rule in RULES.shipped()]
PARTS += [("cooperative", controller) for controller in CONTROLLERS.shipped()]


@pytest.mark.parametrize(("rule", "controller"), PARTS)
@pytest.mark.parametrize("name", ["lost-sensors", "wet-stop"])
def test_what_is_commanded_is_the_same_with_all_that_is_true_nan(name, rule, controller):
    """The law of the house: nothing on board reads the plant but over the wire."""
    start = load_scenario(name).changed(duration_s=1.0).event(1)
    seen, blind = Simulation(start, rule, controller), Simulation(start, rule, controller)
    seen.run_to_end()
    blind.run_blind()
    for table, columns in (
        ("units", ["torque_command", "wanted"]),
        ("cylinders", ["pressure_target", "valve"]),
    ):
        for column in columns:
            commands = [getattr(run.recording, table)[column] for run in (seen, blind)]
            np.testing.assert_array_equal(*commands)


def test_a_run_is_not_changed_by_the_next():
    """They share their layout, which is kept."""
    run = simulate(event(duration=1.0))
    before = run.copy(deep=True)
    after = simulate(event(duration=1.0), "alone", "none")
    xr.testing.assert_identical(run, before)
    run["speed"].attrs["units"], run["speed"].values[:] = "km/h", np.nan
    for other in (after, simulate(event(duration=1.0))):
        assert other["speed"].attrs["units"] == "m s-1"
        assert np.isfinite(other["speed"].values).all()
    assert all(variable.values.flags.c_contiguous for variable in run.data_vars.values())


def test_a_file_gives_the_run_back(tmp_path):
    run = simulate(event(duration=1.0))
    save(run, tmp_path / "run.nc")
    xr.testing.assert_identical(load(tmp_path / "run.nc"), run)


def test_every_recorded_column_is_written_in_some_run():
    names = (
        "wet-stop",
        "freight-start",
        "jp4209318-stop",
        "lost-sensors",
        "failed-unit",
        "lost-telegrams",
    )
    runs = [simulate(load_scenario(name).event(1), "greedy", "cut-and-ramp") for name in names]
    more = (
        ("wet-stop", "exact", "none"),
        ("lost-sensors", "alone", "none"),
        ("freight-start", "alone", "perturb-observe"),
    )
    runs += [simulate(load_scenario(name).event(1), *parts) for name, *parts in more]
    for table in (*PLANT_TABLES, *BOARD_TABLES):
        for name in table.recorded.names:
            default = table.columns[name].default
            assert any(
                (run[name] != default).any() and run[name].notnull().any() for run in runs
            ), name


def test_every_variable_says_what_it_is():
    run = simulate(event(duration=0.5))
    for name, variable in run.variables.items():
        assert variable.attrs["long_name"], name
        assert variable.attrs.get("units") or name in ("axle", "car", "unit"), name


def test_a_part_that_fails_is_named():
    def wrong(units, run):
        raise KeyError("limit")

    rule = replace(RULES["alone"], name="mine", share=wrong, belief=RULES["wear"].belief)
    with pytest.raises(InputError, match=r"'mine'.*KeyError"):
        simulate(event(), rule)
    with pytest.raises(InputError, match="unknown rule 'gredy'; did you mean 'greedy'"):
        simulate(event(), "gredy")


def test_the_bound_of_a_stretch_and_of_a_reversed_demand():
    """A stretch begins as it is asked for then; behind a pull brakes build up from nothing, and nobody exceeds that."""
    dry = {"level": 0.5, "patches": ()}
    run = simulate(event(command=PULL, duration=8.0, **dry), "alone", "none")
    part = evaluate(run.isel(time=slice(300, 700)))
    assert (part["bound_use"], part["over_delivery"]) == pytest.approx((1.0, 0.0), abs=2e-3)
    reversed_at = DriverCommand((0.0, 4.0), (0.8, -0.8))
    run = simulate(event(command=reversed_at, duration=8.0, **dry), "alone", "none")
    level = RecordedRun(run).built_up
    switch = int(np.argmax(run.driver_command.values < 0.0))
    assert level[switch - 1].max() > 0.9 * float(run.planned_coefficient[switch - 1])
    assert level[switch].max() < 0.05 * float(run.planned_coefficient[switch])
    assert evaluate(run)["over_delivery"] < 0.01
