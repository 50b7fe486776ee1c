"""The adhesion field and sand: laws of speed, patches, increments, scatter, cleaned rail, and what sanders lay."""

from dataclasses import replace

import casadi
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from alloc.plant.array_model import ArrayModel
from alloc.plant.laws import SLOWEST_SANDING, conditioning_deposit, hyperbolic_speed_law, sand_laid
from alloc.plant.model import build
from alloc.plant.rail import (
    PEAK_FLOOR,
    SPEED_LAWS,
    Patch,
    Rail,
    logarithmic_increments,
    sanded_peak,
    smooth_step,
    window,
)
from alloc.plant.train import Sander, Train
from tests.cases import looped
from tests.plant.numpy_plant import environment_at


def _peak(train, rail, speed=20.0, position=500.0, time=0.0) -> np.ndarray:
    model = build(train, rail)
    return environment_at(model, time, model.initial_state(speed, position)).peak


@looped(
    ("law", "kmh", "expected"),
    [
        ("shinkansen", 0.0, 13.6 / 85.0),
        ("shinkansen", 100.0, 13.6 / 185.0),
        ("shinkansen", 300.0, 13.6 / 385.0),
        ("curtius-kniffler", 0.0, 7.5 / 44.0 + 0.161),
        ("curtius-kniffler", 80.0, 7.5 / 124.0 + 0.161),
        ("none", 250.0, 1.0),
    ],
)
def test_speed_laws(train, law, kmh, expected):
    """JP5484215 (12) and Curtius and Kniffler (1950), V in km/h; the level scales them."""
    assert hyperbolic_speed_law(kmh / 3.6, *SPEED_LAWS[law]) == pytest.approx(expected, rel=1e-14)
    assert _peak(train("M"), Rail(0.9, law), kmh / 3.6) == pytest.approx(0.9 * expected)


FRONT, REAR = (15.0, 150.0, 0.0), (6.0, 150.0, 0.09)


"""0.100 to 0.060 and 0.130 to 0.114 from standstill to 100 km/h."""


def test_further_back_the_rear_law_takes_over(train):
    """JP4209318 par. 0051: lower in front (1), less dependent on speed further back (2)."""
    rail = Rail(0.9, FRONT, rear_speed_law=REAR, rear_axles=3.0)
    standing, fast = _peak(train("TMT"), rail, 0.0), _peak(train("TMT"), rail, 100.0 / 3.6)
    share = 1.0 - np.exp(-np.arange(12) / 3.0)
    np.testing.assert_allclose(standing, 0.9 * (0.100 + share * 0.030), rtol=1e-12)
    np.testing.assert_allclose(fast, 0.9 * (0.060 + share * 0.054), rtol=1e-12)
    assert np.all(np.diff(standing) > 0.0)
    assert np.all(np.diff(fast / standing) > 0.0)


@given(st.floats(0.0, 100.0), st.floats(0.5, 20.0), st.booleans())
def test_the_greatest_peak_bounds_every_axle(speed, axles, swapped):
    front, rear = (REAR, FRONT) if swapped else (FRONT, REAR)
    rail = Rail(1.1, front, rear_speed_law=rear, rear_axles=axles)
    laws = rail.axle_laws(16)
    assert np.all(hyperbolic_speed_law(speed, *laws) <= rail.greatest_peak() * (1.0 + 1e-12))


def test_patches_raise_the_greatest_peak_together_only_where_they_overlap():
    def greatest(*patches):
        return Rail(0.1, patches=patches).greatest_peak()

    assert greatest(Patch(2.0, 0.0, 10.0), Patch(3.0, 30.0, 40.0), Patch(0.5)) == pytest.approx(0.3)
    assert greatest(Patch(2.0, 0.0, 10.0), Patch(3.0, 12.0, 40.0)) == pytest.approx(0.6)  # edges
    assert greatest(Patch(2.0, begin=1.0, until=2.0), Patch(3.0, begin=4.0)) == pytest.approx(0.3)
    assert greatest(Patch(2.0, 0.0, 10.0), Patch(3.0, begin=4.0)) == pytest.approx(0.6)


def test_a_rear_law_like_the_fronts_changes_nothing(train):
    one, other = Rail(0.9, FRONT), Rail(0.9, FRONT, rear_speed_law=FRONT)
    np.testing.assert_array_equal(_peak(train("TM"), one), _peak(train("TM"), other))


def test_increments_add_by_axle(train):
    """JP5484215 (15): 0.0083 ln j - 0.0066, mean of the first four axles near zero."""
    growth = logarithmic_increments(12)
    assert abs(growth[:4].mean()) < 5e-5
    assert growth[9] == pytest.approx(0.0083 * np.log(10.0) - 0.0066)
    peak = _peak(train("TMT"), Rail(0.12, increments=tuple(growth)))
    np.testing.assert_allclose(peak, 0.12 + growth, rtol=1e-12)


def test_patch_acts_where_and_when_it_lies(train):
    """Front at 500 m: axles at -2.5, -5, -15, -17.5 m from it."""
    patch = Patch(0.5, start=484.0, end=496.0, edge=1.0, begin=1.0, until=2.0, fade=0.2)
    rail = Rail(0.2, patches=(patch,))
    np.testing.assert_allclose(_peak(train("M"), rail, time=1.5), [0.2, 0.1, 0.1, 0.2])
    np.testing.assert_allclose(_peak(train("M"), rail, time=2.2), 0.2)
    np.testing.assert_allclose(
        _peak(train("M"), rail, time=2.0)[1], 0.15
    )  # half way through the fade


def test_patches_multiply(train):
    rail = Rail(0.2, patches=(Patch(0.5), Patch(0.6)))
    np.testing.assert_allclose(_peak(train("M"), rail), 0.2 * 0.5 * 0.6)


def test_window_is_twice_continuously_differentiable():
    for x in (0.0, 1.0):
        d = 1e-4
        around = smooth_step(x + d * np.arange(-3, 4))
        assert np.abs(np.diff(around, 2)).max() < 1000.0 * d**3
    assert window(5.0, 0.0, 10.0, 1.0) == 1.0
    assert window(0.0, 0.0, 10.0, 1.0) == 0.5
    assert window(-0.5, 0.0, 10.0, 1.0) == 0.0


@settings(max_examples=50, deadline=None, derandomize=True)
@given(level=st.floats(1e-4, 1.0), scatter=st.floats(0.0, 0.3), seed=st.integers(0, 10**6))
def test_peak_never_falls_below_its_floor(level, scatter, seed):
    from tests.plant.conftest import make_car

    rail = Rail(level, scatter=scatter, seed=seed)
    peak = _peak(Train("one", (make_car(),)), rail)
    assert np.all(peak >= PEAK_FLOOR)


def test_scatter_is_reproducible_and_seeded():
    table = Rail(0.2, scatter=0.012, seed=5).noise_table()
    np.testing.assert_array_equal(table, Rail(0.2, scatter=0.012, seed=5).noise_table())
    assert not np.array_equal(table, Rail(0.2, scatter=0.012, seed=6).noise_table())


def test_scatter_has_its_standard_deviation_along_the_rail(train):
    """Over 60 seeds and 1 km each; JP5484215 gives 0.012."""
    spots = np.linspace(400.0, 1400.0, 49)
    models = [build(train("M"), Rail(0.2, scatter=0.012, seed=seed)) for seed in range(60)]
    arrays = ArrayModel.of(models[0])
    values = [
        environment_at(model, 0.0, model.initial_state(20.0, x), arrays=arrays).peak[0] - 0.2
        for model in models
        for x in spots
    ]
    assert np.std(values) == pytest.approx(0.012, rel=0.05)
    assert abs(np.mean(values)) < 0.001


def test_axles_meet_the_same_scatter_one_after_the_other(train):
    """The rail stays where it is: what the first axle met at x, the last one meets there."""
    rail = Rail(0.2, scatter=0.012, seed=3)
    first = _peak(train("M"), rail, position=500.0)[0]
    last = _peak(train("M"), rail, position=515.0)[3]
    assert last == pytest.approx(first, rel=1e-12)


def _sliding_train(car):
    """Foremost bogie slides, all others roll."""
    return Train("pair", (car(False), car(False, brake=False), car(False, brake=False)))


def test_cleaned_rail_arrives_after_distance_over_speed(run, car):
    """JP4209318 par. 0051: what the second axle leaves at a place, the third one meets d / v later."""
    gain, scale = 0.5, 0.05
    rail = Rail(0.08, conditioning=gain, conditioning_slip=scale)
    model = build(_sliding_train(car), rail)
    trace = run(
        model, 4.0, 20.0, position=100.0,
        pressure=lambda t: np.array([200e3 if 0.5 < t < 1.2 else 0.0, 0.0]),
    )  # fmt: skip
    speed = trace.rows("speed")[:, 0]
    rim = 0.43 * trace.rows("omega")
    ratio = (rim - speed[:, None]) / np.maximum(rim, speed[:, None])
    deposit = conditioning_deposit(ratio[:, :2], scale).max(axis=1)
    assert deposit.max() > 0.5
    position = trace.rows("position")[:, 0]
    offset = model.structure.axle_offset

    def left(where):
        """The greater of what axles 1 and 2 left at a place."""
        return np.maximum(
            *(
                np.interp(where, position + offset[i], conditioning_deposit(ratio[:, i], scale))
                for i in (0, 1)
            )
        )

    where = position + offset[2]
    passed = where > position[0] + 1.0
    met = trace.cleaning[passed, 2]
    cells = [left(where + k * rail.cleaning_spacing)[passed] for k in (-2, -1, 0, 1, 2)]
    assert np.all(met >= np.min(cells, axis=0) - 5e-3)
    assert np.all(met <= np.max(cells, axis=0) + 5e-3)
    assert met.max() > 0.5
    met = trace.cleaning[:, 2]
    begin_deposit, begin_met = (trace.time[np.argmax(x > 0.5)] for x in (deposit, met))
    assert begin_met - begin_deposit == pytest.approx((offset[1] - offset[2]) / speed[0], abs=0.02)


def test_a_spinning_wheel_cleans_by_its_creep_over_the_faster_of_rim_and_car(run, car):
    """As a sliding one does: at half the rim's speed, or twice, the rail is worn alike."""
    gain, scale, step = 0.5, 0.6, 1e-3
    cars = (car(True, brake=False), car(False, brake=False), car(False, brake=False))
    model = build(Train("pair", cars), Rail(0.05, conditioning=gain, conditioning_slip=scale))
    for speed, torque in ((3.0, 1200.0), (8.0, 1600.0), (20.0, 2500.0)):
        trace = run(model, 25.0 / speed, speed, command=torque, position=100.0, step=step)
        speeds, rim = trace.rows("speed")[:, :1], 0.43 * trace.rows("omega")[:, :4]
        ratio = (rim - speeds) / np.maximum(rim, speeds)
        deposit = conditioning_deposit(ratio, scale)
        position, offset = trace.rows("position")[:, 0], model.structure.axle_offset
        left = np.max(
            [
                np.interp(position + offset[4], position + offset[i], deposit[:, i])
                for i in range(4)
            ],
            axis=0,
        )
        passed = position + offset[4] > position[0] + 1.0
        assert np.abs(trace.cleaning[passed, 4] - left[passed]).max() < 0.05 * left[passed].max()
        assert np.median(rim[passed] / speeds[passed]) > 1.3


def test_foremost_axle_meets_uncleaned_rail(run, car):
    model = build(_sliding_train(car), Rail(0.05, conditioning=0.5))
    trace = run(model, 2.0, 20.0, pressure=np.array([300e3, 300e3]), sample=0.01)
    assert np.all(trace.cleaning[:, 0] == 0.0)
    assert trace.cleaning[-1, 2:8].min() > 0.1


def test_rolling_wheels_clean_nothing(run, car):
    model = build(_sliding_train(car), Rail(0.2, conditioning=0.5))
    trace = run(model, 2.0, 20.0, sample=0.01)
    assert trace.cleaning.max() < 1e-6


def test_cleaning_raises_all_of_the_peak(train):
    """(law x patches + increment + scatter) x (1 + gain x cleaning)."""
    rail = Rail(
        0.1, patches=(Patch(0.8),), increments=(0.0, 0.01, 0.02, 0.03), scatter=0.01, seed=2,
        conditioning=0.3,
    )  # fmt: skip
    model = build(train("M"), rail)
    cleaning = np.array([0.0, 0.5, 1.0, 0.2])
    state = model.initial_state(20.0, 333.0)
    dirty, clean = (environment_at(model, 0.0, state, c).peak for c in (None, cleaning))
    np.testing.assert_allclose(clean, dirty * (1.0 + 0.3 * cleaning), rtol=1e-12)
    bare = environment_at(build(train("M"), Rail(1e-6, scatter=0.01, seed=2)), 0.0, state).peak
    above = bare > 2.0 * PEAK_FLOOR  # where the floor does not hide the scatter
    expected = 0.08 - 1e-6 + np.array(rail.increments) + bare
    np.testing.assert_allclose(dirty[above], expected[above], rtol=1e-12)
    assert above.any()


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


@looped("step", [1e-3, 2.5e-4])
@looped("speed", [1.0, 7.3, 20.0, 83.0])
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
