"""The speed control on the plant: what compensation leaves to the feedback, what is learnt, and what follows from it."""

import numpy as np
import pytest

from alloc.driving import drive
from alloc.errors import EstimationError, OnboardError
from alloc.estimation.running_resistance import LeastSquaresLearner, RunLog, learn_from_log
from alloc.onboard.equipment import equipment
from alloc.onboard.line_memory import PositionDetector
from alloc.onboard.parameters import Belief, Onboard
from alloc.onboard.speed_controller import Feedback, SpeedControl, Traction
from studies.files.study_error import StudyError
from studies.resistance.driven_cases import (
    CARS,
    CURRENT_PER_FORCE,
    EXACT,
    FEEDBACK,
    LEARNED,
    PERIOD,
    RIGHT,
    USED,
    disturbances,
    drive_case,
    feedback,
)
from studies.resistance.learners import (
    SQUARES,
    boarding,
    even_loads,
    learn_passes,
    learners,
    load_compensation,
)
from studies.resistance.routes import route
from tests.studies.short_route import short_route


@pytest.fixture(scope="module")
def driven():
    return {case: drive_case(short_route(), case, "P") for case in (FEEDBACK, RIGHT, CARS, EXACT)}


def feedback_force(done):
    return np.abs(done.log["feedback_current"].values) / CURRENT_PER_FORCE


def test_with_true_weights_the_feedback_has_nothing_to_do(driven):
    """A car passes a change over LINE_SPACING and its gradient is read once per period: a few kN for an instant."""
    force = feedback_force(driven[EXACT])
    assert force.max() < 0.01 * feedback_force(driven[FEEDBACK]).max()
    speed = driven[EXACT].log["commanded_speed"].values - driven[EXACT].run["speed"].values
    assert np.abs(speed).max() < 0.01


def test_the_current_is_the_force_of_the_motors(driven):
    log, run = driven[RIGHT].log, driven[RIGHT].run
    traction = Traction.of(short_route().train, CURRENT_PER_FORCE)
    force = run["torque_command"].values @ traction.rim_force
    np.testing.assert_allclose(log["current"], CURRENT_PER_FORCE * force)
    np.testing.assert_allclose(log["force"], force)
    # the log's force acts: torques follow within milliseconds
    np.testing.assert_allclose(RunLog.of_run(run).force[:-1], force[:-1], atol=20.0)


def test_results_do_not_depend_on_the_unit_of_the_current():
    of, speeds = short_route(), []
    for per_force in (1e-3, 0.5):
        own = Feedback.for_train(250e3, per_force, 4.0, 16.0)
        driver = SpeedControl(
            of.command, own, Traction.of(of.train, per_force), PERIOD, "compensation", of.memory(),
            of.true_weights(),
        )  # fmt: skip
        run = drive(of.model(), driver, 10.0, initial_speed=15.0, period=PERIOD, step=PERIOD)
        speeds.append(run["speed"].values)
    np.testing.assert_allclose(speeds[0], speeds[1], rtol=1e-9)


def test_compensation_steadies_the_speed_and_car_by_car_the_acceleration_too(driven):
    found = {
        case: disturbances(short_route(), done).groupby("kind").mean() for case, done in driven.items()
    }  # fmt: skip
    for kind in ("tunnel mouth", "gradient change"):
        peak = {case: f.loc[kind] for case, f in found.items()}
        assert peak[RIGHT]["speed_peak"] < 0.5 * peak[FEEDBACK]["speed_peak"]
        assert peak[CARS]["acceleration_peak"] < 0.6 * peak[FEEDBACK]["acceleration_peak"]
        # at one position the memory switches at once what the train meets car by car
        assert peak[RIGHT]["jerk_peak"] > 1.5 * peak[FEEDBACK]["jerk_peak"]


def test_on_one_car_the_resistance_jumps_as_the_memory_does():
    of = short_route().one_car()
    assert of.length == 20.0
    assert of.train.resistance[2] == pytest.approx(short_route().train.resistance[2] / 8)
    alone, right = (
        disturbances(of, drive_case(of, case, "P")).groupby("kind").mean() for case in (FEEDBACK, RIGHT)
    )  # fmt: skip
    for quantity in ("speed_peak", "acceleration_rms"):
        assert (right[quantity] < 0.3 * alone[quantity]).all()


def test_the_mass_is_learnt_from_a_run_of_the_plant(driven):
    of = short_route()
    for weights in (3, 5):
        learner = learners(of, weights)[SQUARES]
        _, found = learn_passes(of, driven[FEEDBACK].run, learner)
        assert learner.weights[2] == pytest.approx(of.train.mass, rel=0.03)
        # nearly one speed: A and B cannot be told from the square, and that is said
        assert found.excitation.learned("W3" if weights == 3 else "W1") == (weights == 3)
    # the same from plain arrays; W3 takes in part of the rotating mass where that is not known
    run = driven[FEEDBACK].run
    log = RunLog(*(run[n].values for n in ("time", "position", "speed")), RunLog.of_run(run).force)
    learner = learners(of)[SQUARES]
    learn_from_log(log, of.memory(), learner, 0.0, 1.0, of.length)
    turning = of.train.mass + of.train.rotating_mass
    assert of.train.mass < learner.weights[2] < 1.02 * turning


def test_learning_from_commanded_values_needs_them(driven):
    of, run = short_route(), driven[EXACT].run
    base = RunLog.of_run(run)
    with pytest.raises(EstimationError, match="commanded"):
        learn_from_log(base, of.memory(), learners(of)[SQUARES], source="commanded")
    speed, rate = of.command.at(base.time)
    log = RunLog(base.time, base.position, base.speed, base.force, speed, rate)
    learner = learners(of, 5)[SQUARES]
    learn_from_log(
        log, of.memory(), learner, of.train.rotating_mass, 1.0, of.length, source="commanded"
    )
    assert learner.weights[2] == pytest.approx(of.train.mass, rel=0.03)


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"speed": np.zeros(3)}, "speed"),
        ({"force": np.full(4, np.nan)}, "force"),
        ({"time": np.array([0.0, 1.0, 1.5, 3.0])}, "even steps"),
    ],
)
def test_logs_that_are_none_are_refused(changes, named):
    arrays = {n: np.arange(4.0) for n in ("time", "position", "speed", "force")}
    with pytest.raises(EstimationError, match=named):
        RunLog(**{**arrays, **changes})


def test_a_log_too_short_for_the_filter_is_refused():
    log = RunLog(*(np.arange(4.0) for _ in range(4)))
    learner = LeastSquaresLearner(np.ones(3), np.ones(3))
    with pytest.raises(EstimationError, match="settle"):
        learn_from_log(log, short_route().memory(), learner, filter_time=10.0)
    with pytest.raises(EstimationError, match="no sample"):
        learn_from_log(log, short_route().memory(), learner, keep=lambda time: time < 0.0)


def test_learning_while_compensating_and_learning_then_using_find_the_mass():
    of = short_route()
    for case in (LEARNED, USED):
        done = drive_case(of, case, detector=PositionDetector(speed_noise=0.005))
        # it began 30 % too light
        assert done.control.weights[2] == pytest.approx(of.train.mass, rel=0.15)
        assert done.log["weights"].shape == (done.log.sizes["time"], 3)
    assert set(np.unique(done.log["switch"])) == {1.0, 2.0}
    with pytest.raises(StudyError, match="unknown case"):
        drive_case(of, "learned, then")


def test_feedback_gains_come_from_the_empty_train():
    assert feedback(short_route(), "P").integral == 0.0
    assert feedback(short_route(), "PI") == feedback(route("commuter"), "PI")


def test_the_mass_after_boarding_feeds_the_load_compensation():
    loads = (9e3,) * 8
    found = boarding(loads)
    assert found.learned["five weights"] == pytest.approx(found.mass, rel=0.02)
    assert found.learned["three weights, rotating mass not known"] > 1.05 * found.mass
    table = load_compensation(loads, found.learned["five weights"], 0.3).set_index("belief")
    reached = table["acceleration"] / table.loc["true loads", "acceleration"] - 1.0
    assert reached["sensors wrong"] < -0.05
    assert abs(reached["mass learned"]) < 0.02
    assert even_loads(-5.0, 2) == (0.0, 0.0)


def test_believed_loads_stand_in_for_the_sensors():
    model = route("commuter", load_share=0.5).model()
    true = equipment(model, Onboard())
    same = equipment(model, Onboard(belief=Belief(loads=(6e3,) * 8)))
    for one, other in (
        (true.group, same.group),
        (true.chain, same.chain),
        (true.sander, same.sander),
        (true, same),
    ):
        for name in set(one._fields) - {"group", "chain", "sander"}:
            np.testing.assert_array_equal(getattr(one, name), getattr(other, name), err_msg=name)
    light = equipment(model, Onboard(belief=Belief(loads=(0.0,) * 8)))
    assert np.all(light.load_per_axle == 0.0)
    with pytest.raises(OnboardError, match="loads"):
        equipment(model, Onboard(belief=Belief(loads=(1.0,))))
    with pytest.raises(OnboardError, match="loads"):
        Belief(loads=(-1.0,) * 8)
