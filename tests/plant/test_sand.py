"""Sand on the rail: what a sander lays, what axles leave of it, and what it gives."""

from dataclasses import replace

import casadi
import numpy as np
import pytest

from alloc.plant.laws import SLOWEST_SANDING, sand_laid
from alloc.plant.model import build
from alloc.plant.rail import Rail, sanded_peak
from alloc.plant.train import Sander, Train

SPEED, RATE, DECAY = 20.0, 0.04, 0.2
RAIL = Rail(0.05, sanded_coefficient=0.2, sand_saturation=5e-3, sand_decay=DECAY)
AMOUNTS = np.linspace(0.0, 0.05, 11)


def sanded(train: Train, *axles: int) -> Train:
    """The train with sanders ahead of these axles of its first car."""
    own = tuple(Sander(axle, RATE) for axle in axles)
    return replace(train, cars=(replace(train.cars[0], sanders=own), *train.cars[1:]))


def test_gain_grows_to_the_sanded_rail_and_never_takes_away():
    weak = sanded_peak(0.02, AMOUNTS, 0.2, 5e-3)
    assert weak[0] == 0.02
    assert np.all(np.diff(weak) > 0.0)
    assert np.all(np.diff(weak, 2) < 0.0)
    assert float(sanded_peak(0.02, 5e-3, 0.2, 5e-3)) == pytest.approx(0.2 - 0.18 / np.e)
    assert float(sanded_peak(0.02, 1.0, 0.2, 5e-3)) == pytest.approx(0.2)
    np.testing.assert_array_equal(sanded_peak(0.3, AMOUNTS, 0.2, 5e-3), 0.3)


def test_casadi_has_the_same_gain():
    peak, amount = casadi.SX.sym("peak"), casadi.SX.sym("amount")
    gain = casadi.Function("gain", [peak, amount], [sanded_peak(peak, amount, 0.2, 5e-3)])
    for mu in (0.02, 0.19, 0.3):
        symbolic = [float(gain(mu, x)) for x in AMOUNTS]
        np.testing.assert_allclose(symbolic, sanded_peak(mu, AMOUNTS, 0.2, 5e-3), rtol=1e-12)


def test_a_metre_gets_what_is_discharged_while_it_passes():
    assert float(sand_laid(RATE, SPEED)) == RATE / SPEED
    assert float(sand_laid(RATE, -SPEED)) == RATE / SPEED
    assert float(sand_laid(RATE, 0.0)) == RATE / SLOWEST_SANDING


@pytest.mark.parametrize("step", [1e-3, 2.5e-4])
@pytest.mark.parametrize("speed", [1.0, 7.3, 20.0, 83.0])
def test_each_axle_leaves_its_share_to_the_next(run, train, speed, step):
    """Whatever the step is: sand is laid by the metre."""
    model = build(sanded(train("TT"), 1), RAIL)
    duration = 45.0 / speed
    trace = run(
        model, duration, speed, sand_rate=RATE, step=step, sample=duration / 8.0 // step * step
    )
    laid = RATE / speed * (1.0 - DECAY) ** np.arange(7)
    np.testing.assert_array_equal(trace.sand[:, 0], 0.0)
    np.testing.assert_allclose(trace.sand[-1, 1:], laid, rtol=1e-3)


def test_sanders_add_up(run, train):
    trace = run(build(sanded(train("T"), 0, 2), RAIL), 2.0, SPEED, sand_rate=RATE, sample=0.5)
    keep, laid = 1.0 - DECAY, RATE / SPEED
    expected = laid * np.array([1.0, keep, keep**2 + 1.0, keep**3 + keep])
    np.testing.assert_allclose(trace.sand[-1], expected, rtol=1e-3)


def test_sand_lies_where_it_was_laid(run, train):
    """An axle meets it when it comes there, and no longer than it was laid."""
    model = build(sanded(train("T"), 0), RAIL)
    trace = run(
        model, 3.0, SPEED,
        sand_rate=lambda t: RATE if 0.5 < t < 1.0 else 0.0, sample=2e-3, position=33.0,
    )  # fmt: skip
    offset = model.structure.axle_offset
    for axle in range(4):
        meets = trace.time[trace.sand[:, axle] > 1e-9]
        late = (offset[0] - offset[axle]) / SPEED
        assert meets[0] - late == pytest.approx(0.5, abs=0.02)
        assert meets[-1] - late == pytest.approx(1.0, abs=0.02)
        assert trace.sand[:, axle].max() == pytest.approx(RATE / SPEED * 0.8**axle, rel=1e-3)


def test_sanded_axles_brake_harder(run, train):
    def slowed(one):
        trace = run(build(one, RAIL), 3.0, SPEED, sand_rate=RATE, pressure=3e5, sample=0.1)
        return SPEED - trace.rows("speed")[-1, 0]

    bare = train("TT")
    assert slowed(sanded(bare, 0)) > 1.3 * slowed(bare)
    assert slowed(sanded(bare, 0)) > slowed(sanded(bare, 3)) > slowed(bare)


def test_without_sanders_nothing_is_computed(run, train):
    """The rail's numbers for sand then change no bit."""
    rail = Rail(
        0.05, conditioning=0.3, sanded_coefficient=0.4, sand_saturation=1e-3, sand_decay=0.9
    )
    traces = [
        run(build(train("MT"), one), 1.0, SPEED, pressure=3e5, sample=0.1)
        for one in (rail, Rail(0.05, conditioning=0.3))
    ]
    np.testing.assert_array_equal(*(trace.state for trace in traces))


def test_sand_and_cleaning_do_not_touch_each_other(run, train):
    """Sand that gives nothing leaves the wheels' slides, and so the cleaning, as they were."""
    rail = replace(RAIL, conditioning=0.3, sanded_coefficient=0.01)
    sandy, bare = sanded(train("TT"), 1), train("TT")
    both, clean, sand = (
        run(
            build(one, where), 3.0, SPEED,
            sand_rate=RATE, pressure=lambda t: 3e5 if t < 0.8 else 0.0, sample=0.1,
        )
        for one, where in (
            (sandy, rail), (bare, rail), (sandy, replace(rail, conditioning=0.0)),
        )
    )  # fmt: skip
    np.testing.assert_array_equal(both.state, clean.state)
    np.testing.assert_array_equal(both.cleaning, clean.cleaning)
    assert clean.cleaning.max() > 0.1
    rolled = sand.time < 0.5  # before the cleaning changes how the train moves
    np.testing.assert_allclose(both.sand[rolled], sand.sand[rolled], rtol=1e-3, atol=1e-12)
    assert both.sand.max() > 0.0


def test_a_train_that_runs_the_other_way_lays_sand_ahead_of_the_same_axle(car):
    one = replace(car(False), sanders=(Sander(0, 0.01), Sander(2, 0.02)))
    turned = one.reversed().sanders
    assert [(s.axle, s.rate) for s in turned] == [(1, 0.02), (3, 0.01)]
    assert one.reversed().reversed() == one
