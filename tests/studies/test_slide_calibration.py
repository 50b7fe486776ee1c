"""The calibration of the slide protection's demonstration: its method, its coordinates, its table and its command."""

from dataclasses import asdict, replace

import numpy as np
import pandas as pd
import pytest

from studies.slides import calibration as slide_calibration
from studies.slides.calibration import (
    BY_HAND,
    best,
    calibrate,
    draw,
    equally_good,
    from_unit_cube,
    jitter,
    main,
    to_unit_cube,
    undisclosed_of,
)
from studies.slides.damped_least_squares import minimise
from studies.slides.jp4209318 import BOUNDS, CALIBRATED
from studies.slides.targets import TARGETS, implausible

WELL = {name: target.value for name, target in TARGETS.items()} | {
    "locked": 0.0, "time-outs": 0.0, "slides": 0.0,
}  # fmt: skip


def squares(deviations):
    return float((deviations**2).sum())


def valley(point):
    """Rosenbrock's, as least squares, with its bottom at 0.75 and 0.75."""
    a, b = 4.0 * point - 2.0
    return np.array([10.0 * (b - a * a), 1.0 - a])


def test_damped_least_squares_find_the_bottom_of_a_bent_valley():
    point, least = minimise(valley, squares, np.array([0.2, 0.8]), 0.01, 60)
    assert least < 1e-4
    np.testing.assert_allclose(point, 0.75, atol=0.01)


def test_they_see_through_a_ripple_and_stop_when_it_is_enough():
    asked = []

    def rippled(point):
        asked.append(point.copy())
        return valley(point) + 0.02 * np.sin(4e3 * point)

    _, least = minimise(rippled, squares, np.array([0.6, 0.6]), 0.05, 60, enough=0.01)
    assert least <= 0.01
    assert len(asked) < 60 * 5


def test_they_keep_to_the_cube():
    asked = []

    def beyond(point):
        asked.append(point.copy())
        return point + 1.0

    point, least = minimise(beyond, squares, np.array([0.3, 0.01]), 0.05, 20)
    np.testing.assert_allclose(point, 0.0, atol=1e-8)
    assert least == pytest.approx(2.0)
    assert np.min(asked) >= 0.0
    assert np.max(asked) <= 1.0


def test_the_cube_is_the_bounds():
    for x, k in ((0.0, 0), (1.0, 1)):
        corner = asdict(from_unit_cube(np.full(len(BOUNDS), x)))
        assert corner == pytest.approx({name: bound[k] for name, bound in BOUNDS.items()})
    for one in (CALIBRATED, BY_HAND):
        assert asdict(from_unit_cube(to_unit_cube(one))) == pytest.approx(asdict(one))


def test_drawn_sets_are_plausible_and_differ():
    sets = draw(5, seed=0)
    assert len(set(sets)) == 5
    assert all(implausible(one) == 0.0 for one in sets)
    assert draw(5, seed=0) == sets


@pytest.fixture
def outcomes(monkeypatch):
    """Outcomes of any set without running it: distance of three cars by the front's adhesion, else as printed."""

    def found(undisclosed, step=1e-3):
        off = undisclosed.front_adhesion - CALIBRATED.front_adhesion
        return WELL | {"distance 3": WELL["distance 3"] - 5e3 * off}

    monkeypatch.setattr(slide_calibration, "outcomes", found)


def test_a_calibration_improves_on_its_start(outcomes):
    table = calibrate(4, 2, seed=0, jobs=1, iterations=2)
    assert table["stage"].value_counts().to_dict() == {"wide": 4, "refined": 2, "held out": 2}
    start = slide_calibration.row_of(BY_HAND, "wide", 0)["misfit"]
    refined = table[table["stage"] == "refined"].set_index("start")
    assert refined.loc[0, "misfit"] < start
    chosen = best(table)
    assert chosen["misfit"] == refined["misfit"].min()
    assert undisclosed_of(chosen).front_adhesion == chosen["front_adhesion"]
    assert set(equally_good(table)["unreached"]) <= {""}


def test_what_is_not_free_stays_as_it_is(outcomes):
    start = replace(CALIBRATED, front_adhesion=0.099)
    row = slide_calibration.refine(start, 0, iterations=2, free=("front_adhesion",))
    found = undisclosed_of(row)
    assert row["misfit"] < slide_calibration.row_of(start, "wide", 0)["misfit"]
    assert found == replace(start, front_adhesion=found.front_adhesion)


def test_jitter_is_small_noise(outcomes):
    noise = jitter(CALIBRATED, seed=0, draws=20)
    assert len(noise) == 20
    expected = 5e3 * CALIBRATED.front_adhesion * slide_calibration.JITTER
    assert noise["distance 3"].std() == pytest.approx(expected, rel=0.5)
    assert noise["distance 1"].std() == pytest.approx(0.0, abs=1e-9)


def test_the_command_writes_every_set(outcomes, tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(slide_calibration, "ITERATIONS", 1)
    out = tmp_path / "table.parquet"
    arguments = ["--samples", "1", "--starts", "1", "--jobs", "1", "--out", str(out)]
    assert main(arguments) == 0
    assert len(pd.read_parquet(out)) == 3
    printed = capsys.readouterr().out
    assert "front_adhesion" in printed
    assert "jitter: distance 1 0" in printed


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--starts", "0"], "--starts 0: must be 1 or greater"),
        (["--seed", "-1"], "--seed -1: must be 0 or greater"),
        (["--out", "/proc/none/table.parquet"], "cannot be written"),
    ],
)
def test_impossible_options_are_refused(arguments, words, capsys):
    with pytest.raises(SystemExit) as stop:
        main(arguments)
    assert stop.value.code == 2
    assert words in capsys.readouterr().err
