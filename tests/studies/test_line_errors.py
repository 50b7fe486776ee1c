"""Errors of position and map: what a belief is made of, the file that says them, and what a late position costs."""

import math

import numpy as np
import pytest

from alloc.errors import OnboardError
from alloc.onboard.line_memory import Odometer, PositionDetector
from alloc.plant.rail import Line
from studies.command_line.options import settings_of
from studies.files.study_error import StudyError
from studies.resistance.driven_cases import (
    CARS,
    FEEDBACK,
    SETTLE,
    TAUGHT,
    TIME_CONSTANT,
    disturbances,
    drive_case,
    feedback,
)
from studies.resistance.line_errors import (
    ALL,
    ARMS,
    DELAY,
    NONE,
    ODOMETER,
    TYPICAL,
    Draw,
    LineErrors,
    arms_of,
    believed,
    detector,
    driven_axles,
    read_line_errors,
    with_errors,
)
from studies.resistance.line_position_study import LINE_POSITION
from tests.studies.short_route import short_route

MANY = Line(
    tuple(100.0 * k for k in range(400)), tuple(0.01 * (-1.0) ** k for k in range(400)),
    tuple((400.0 * k + 50.0, 400.0 * k + 250.0) for k in range(100)),
)  # fmt: skip


def drawn_for(line, seed=0):
    g = np.random.default_rng(seed)
    places = len(line.stations) + 2 * len(line.tunnels)
    return Draw(
        float(g.uniform(-1.0, 1.0)),
        (),
        *(tuple(g.standard_normal(n).tolist()) for n in (places, len(line.stations), 2)),
    )


def test_without_errors_the_belief_is_the_line_and_the_signals_are_true():
    of = short_route()
    draw = Draw.of(of, np.random.default_rng(0))
    assert believed(of.line, LineErrors(), draw).line == of.line
    assert detector(of, LineErrors(), draw, 0.0, 0) == PositionDetector()
    for reading in ("front", "middle", "cars"):
        assert with_errors(of, LineErrors(), draw).memory(reading) == of.memory(reading)
    assert with_errors(of, LineErrors(), draw).believed_weights(5).tolist() == of.true_weights(5).tolist()  # fmt: skip


def test_deviations_of_the_map_are_those_stated_and_places_keep_their_order():
    found = believed(MANY, LineErrors(place_deviation=9.0, gradient_deviation=0.2), drawn_for(MANY)).line  # fmt: skip
    shift = np.subtract(found.stations, MANY.stations)
    assert shift[0] == 0.0
    assert np.std(shift[1:]) == pytest.approx(9.0, rel=0.15)
    assert np.std(np.subtract(found.tunnels, MANY.tunnels)) == pytest.approx(9.0, rel=0.2)
    assert np.std(np.divide(found.grades, MANY.grades)) == pytest.approx(0.2, rel=0.15)
    wild = believed(MANY, LineErrors(place_deviation=1e3), drawn_for(MANY)).line
    assert list(wild.stations) == sorted(wild.stations)
    assert wild.stations[0] == MANY.stations[0]
    assert all(start < end for start, end in wild.tunnels)


def test_arms_have_each_error_alone_and_all():
    arms = arms_of(TYPICAL)
    assert arms[NONE] == LineErrors()
    assert arms[ALL] == TYPICAL
    assert arms[DELAY] == LineErrors(delay=TYPICAL.delay)
    alone = [arms[arm] for arm in ARMS if arm not in (NONE, ALL)]
    assert sum(one.odometer_error > 0.0 for one in alone) == 1
    assert arms[f"{ODOMETER} 4 %"].odometer_error == 0.04


def test_the_odometer_counts_the_axles_with_motors():
    of = short_route()
    assert len(driven_axles(of)) == 16
    assert driven_axles(of)[:4] == (4, 5, 6, 7)
    found = detector(of, TYPICAL, Draw.of(of, np.random.default_rng(2)), 0.01, 7)
    assert found.odometer is not None
    assert abs(found.odometer.scale_error) <= TYPICAL.odometer_error
    assert (found.delay, found.speed_noise, found.seed) == (TYPICAL.delay, 0.01, 7)


def test_a_file_says_the_errors_with_units(tmp_path):
    path = tmp_path / "errors.toml"
    path.write_text("odometer_error = 0.02\nplace_deviation_m = 35.0\ndelay_s = 0.5\n")
    assert read_line_errors(str(path)) == LineErrors(0.02, 0.0, 0.5, 35.0)
    assert settings_of(LINE_POSITION, {"errors": [str(path)]}) == {"errors": str(path)}


@pytest.mark.parametrize(
    ("text", "named"),
    [
        ("odometer_eror = 0.01", "did you mean 'odometer_error'"),
        ("odometer_error = -0.01", "odometer_error"),
        ("odometer_error = 2.0", "odometer_error"),
        ("delay_s = nan", "delay_s"),
        ("place_deviation_m = '20'", "place_deviation_m"),
        ("place_deviation_m = 1e9", "place_deviation_m"),
        ("air_deviation = ", "TOML"),
    ],
)
def test_a_file_that_says_what_cannot_be_is_refused(tmp_path, text, named):
    path = tmp_path / "errors.toml"
    path.write_text(text)
    with pytest.raises((StudyError, OnboardError), match=named) as raised:
        read_line_errors(str(path))
    assert "\n" not in str(raised.value)


@pytest.mark.parametrize("behind", [20.0, 60.0])
def test_a_position_that_is_behind_leaves_the_share_that_the_loop_lets_pass(behind):
    """One car under P control is compensated T = d/V late: its speed moves by 1 - exp(-T/tau) of what it would in the end.

    The feedback alone is looked at until the end of the window, in which it moves by 1 - exp(-window/tau).
    """
    of = short_route().one_car()
    late = PositionDetector(Odometer(stations=(0.0,), residuals=(-behind,)))
    alone, found = (
        disturbances(of, drive_case(of, case, "P", detector=late)).groupby("kind")["speed_peak"].mean()
        for case in (FEEDBACK, CARS)
    )  # fmt: skip
    empty = of.train.loaded((0.0,))
    tau = (
        TIME_CONSTANT
        * (of.train.mass + of.train.rotating_mass)
        / (empty.mass + empty.rotating_mass)
    )
    assert feedback(of, "P").integral == 0.0
    window = SETTLE + 0.5 * of.length / 18.0
    expected = math.expm1(-behind / 18.0 / tau) / math.expm1(-window / tau)
    np.testing.assert_allclose(found / alone, expected, rtol=0.08)


def test_a_case_that_was_taught_needs_its_teacher():
    with pytest.raises(StudyError, match="learner"):
        drive_case(short_route(), TAUGHT)
