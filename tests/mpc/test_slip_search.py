"""The search of the best slip: what it reads is the curve's own elasticity, and it ends where that is worth its friction."""

import math
from dataclasses import replace

import numpy as np
import pytest

from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve, RationalCurve, SlipRatioCurve
from alloc.records import ByReference
from mpc import slip_search as search_step
from mpc.condensing import STEEPEST_SLOPE, no_steeper
from mpc.settings import MpcSettings, SlipSearch
from tests.cases import looped
from tests.mpc.made_problems import SyntheticUnit

CURVES = {"piecewise": PiecewiseCurve(), "polach": POLACH_WET, "slip-ratio": SlipRatioCurve()}


STILL = MpcSettings(search=SlipSearch(seek=False))


"""It swings and reads, but does not search."""


def own_elasticity(unit, slip, d=1e-4):
    """d ln mu / d ln s of the true curve at `slip` [m/s]."""
    return math.log(unit.coefficient(slip * (1.0 + d)) / unit.coefficient(slip * (1.0 - d))) / (
        2.0 * d
    )


def read_elasticity(unit):
    """What was read, without the prior: numerator and denominator."""
    search = unit.belief.record.search
    z = search.demodulated[int(np.nanargmax(search.mean_slip))]
    answer = np.array([search.pace.cosine, search.pace.sine])
    return z[2:] @ answer, z[:2] @ answer


def _swinging(unit, slip, seconds):
    """Slip that follows the unit's swing about `slip` [m/s]; yields at every period."""
    for _ in range(round(seconds / unit.context.period)):
        unit.period(slip * unit.swing)
        yield


# --- elasticity


@looped("kind", CURVES)
@looped("share", [0.3, 0.6, 0.8])
@looped("peak", [0.05, 0.12, 0.25])
def test_elasticity_is_the_curves_own(kind, share, peak):
    unit = SyntheticUnit(CURVES[kind], peak, STILL)
    slip = share * float(CURVES[kind].limit(peak, unit.speed)[1])
    for _ in _swinging(unit, slip, 3.0):
        pass
    above, below = read_elasticity(unit)
    own = own_elasticity(unit, slip)
    assert above / below == pytest.approx(own, rel=0.1, abs=0.02)
    # the prior, which holds it where nothing is felt, moves it little
    assert unit.search.elasticity == pytest.approx(own, rel=0.25, abs=0.03)


def test_beyond_the_peak_it_is_below_zero():
    unit = SyntheticUnit(RationalCurve(0.1, 6.0), 0.12, STILL)
    for _ in _swinging(unit, 0.25, 3.0):
        pass
    assert unit.search.elasticity == pytest.approx(own_elasticity(unit, 0.25), rel=0.25)
    assert unit.search.elasticity < -0.05


def test_noise_of_measured_slip_does_not_bias_it():
    """Where slip divided by slip, with noise in both, is too small."""
    settings = MpcSettings(search=SlipSearch(seek=False, swing=0.05))
    own, told, plain = 0.0, [], []
    for seed in range(8):
        unit = SyntheticUnit(RationalCurve(0.5, 2.0), 0.12, settings, 0.03, seed, axles=1)
        own = own_elasticity(unit, 0.25)
        for k, _ in enumerate(_swinging(unit, 0.25, 8.0)):
            unit.search.swing = 0.05  # it would grow above the noise
            if k > 250 and k % 10 == 0:
                told.append(read_elasticity(unit))
                z = unit.belief.record.search.demodulated[0]
                plain.append((z[2:] @ z[:2], z[:2] @ z[:2]))
    told, plain = (
        above / below for above, below in (np.mean(told, axis=0), np.mean(plain, axis=0))
    )
    assert told == pytest.approx(own, rel=0.15)
    assert plain < 0.85 * own


@looped("kind", CURVES)
@looped("rate", [-0.2, 0.2])
def test_a_rail_that_changes_by_itself_does_not_bias_it(kind, rate):
    unit, level = SyntheticUnit(CURVES[kind], settings=STILL), 0.12
    slip = 0.6 * float(CURVES[kind].limit(level, unit.speed)[1])
    found, own = [], []
    for k, _ in enumerate(_swinging(unit, slip, 4.0)):
        if k > 150:
            above, below = read_elasticity(unit)
            found.append(above / below)
            own.append(own_elasticity(unit, slip))
        unit.peak = level * math.exp(rate * (0.01 * k - 2.0))
    assert np.mean(found) == pytest.approx(np.mean(own), abs=0.1 * abs(np.mean(own)) + 0.02)


# --- the slip sought


def _following(unit, seconds):
    """The slips sought while the axles follow the limit with a lag of two periods."""
    slip, sought = unit.search.slip if unit.now is None else unit.now, []
    for _ in range(round(seconds / unit.context.period)):
        slip = slip + 0.4 * (unit.belief.slip_limit - slip)
        unit.period(slip)
        sought.append(float(unit.search.slip))
    return np.array(sought)


def _sought(curve, peak, settings=None, seconds=25.0, noise=0.0, first=None):
    """A unit that sought its slip for so long, and the slips sought."""
    unit = SyntheticUnit(curve, peak, settings, noise)
    unit.acceleration = 0.0  # the curve by slip ratio would move with the speed
    if first:
        unit.search.slip = first
    return unit, _following(unit, seconds)


PRICE = MpcSettings().search.friction_price


BOUNDS = MpcSettings().search.lowest, MpcSettings().search.highest


def best_slip(unit):
    """Where elasticity is what friction costs, within the bounds of the search."""
    slip = np.geomspace(*BOUNDS, 4000)
    gain = [own_elasticity(unit, s) - PRICE * s for s in slip]
    return float(slip[np.argmax(np.array(gain) < 0.0)]) if min(gain) < 0.0 else BOUNDS[1]


@looped("kind", CURVES)
@looped("peak", [0.08, 0.15])
def test_it_ends_where_elasticity_is_the_price_of_friction(kind, peak):
    for first in (0.05, 0.3):
        unit, limits = _sought(CURVES[kind], peak, first=first, noise=0.003)
        assert np.mean(limits[-500:]) == pytest.approx(best_slip(unit), rel=0.25)


def test_what_is_sought_yields_most():
    """Rail force less the price of its friction is within half a percent of the best."""
    for kind, curve in CURVES.items():
        unit, limits = _sought(curve, 0.12)
        slip = np.geomspace(*BOUNDS, 2000)
        worth = unit.coefficient(slip) * (1.0 - PRICE * slip)
        found = unit.coefficient(limits[-1]) * (1.0 - PRICE * limits[-1])
        assert found > 0.994 * worth.max(), kind


def test_dear_friction_means_less_slip():
    slips = []
    for price in (0.1, 0.3, 0.9):
        settings = MpcSettings(search=SlipSearch(friction_price=price))
        slips.append(_sought(POLACH_WET, 0.15, settings, 15.0)[1][-100:].mean())
    assert slips[0] > 1.2 * slips[1] > 1.44 * slips[2]


def test_it_moves_no_faster_than_it_may_and_keeps_its_bounds():
    search = SlipSearch(lowest=0.05, highest=0.15, first=0.1)
    for curve in (RationalCurve(0.02, 2.0), RationalCurve(0.6, 2.0)):
        _, limits = _sought(curve, 0.12, MpcSettings(search=search), 6.0)
        assert limits.min() >= 0.05
        assert limits.max() <= 0.15
        assert limits[-1] == (0.05 if curve.peak_slip < 0.1 else 0.15)
        # before an elasticity is heard the slip sought follows the pairs, and the noise as it is learnt
        rates = np.diff(np.log(limits[50:])) / 0.01
        far = search_step.EAGER * (1.0 - search_step.FAR_BELOW)  # no elasticity is above 1
        assert rates.max() <= search.fastest_rise * (1.0 + far) * (1.0 + 1e-9)
        assert rates.min() >= -search.fastest_fall * (1.0 + 1e-9)


@looped(("apart", "again"), [(0.2, True), (0.6, True), (3.0, False)])
def test_slip_that_runs_away_a_second_time_within_a_second_tells_that_it_is_too_large(apart, again):
    unit, said = SyntheticUnit(PiecewiseCurve(), 0.12), []
    unit.search.slip, period = 0.03, round(apart / 0.01)
    search, axles = ByReference(unit.belief.record.search), unit.belief.record.axles
    reference = ByReference(axles)
    for k in range(3 * period):
        axles.slip[:] = 0.03
        axles.slip[-1] = 0.09 if k % period < 8 else 0.03
        said.append(bool(search_step.runs_away(search, reference, 0.001)))
    assert not any(said[:period])  # once: the rail may have changed
    assert any(said) == again
    assert all(k % period < 8 for k, one in enumerate(said) if one)


def test_noise_is_not_slip_that_runs_away():
    unit = SyntheticUnit(PiecewiseCurve(), 0.12, noise=0.012)
    search, axles = (
        ByReference(record) for record in (unit.belief.record.search, unit.belief.record.axles)
    )
    unit.search.slip = 0.05
    for _ in range(600):
        unit.period(0.05, wanted=0.0)
        noise = float(unit.belief.record.axles.noise.mean())
        assert not search_step.runs_away(search, axles, noise)


@looped("noise", [0.0, 0.012])
def test_where_noise_hides_the_answer_the_swing_grows_above_it(noise):
    unit, _ = _sought(PiecewiseCurve(), 0.12, noise=noise, seconds=6.0)
    assert unit.search.swing <= search_step.LARGEST_SWING
    assert (unit.search.swing > SlipSearch().swing) == (noise > 0.0)


@looped("steepness", [1.5, 2.0, 4.0, 12.0])
def test_the_slip_comes_to_rest_at_a_peak_of_any_steepness(steepness):
    """A step that is right on a wide peak would go to and fro on one that falls at once."""
    _, limits = _sought(RationalCurve(0.15, steepness), 0.1, seconds=12.0)
    assert np.ptp(np.log(limits[-300:])) < 0.06


def test_no_slip_is_sought_that_noise_hides():
    search = SlipSearch(noise_margin=3.0)
    unit, limits = _sought(RationalCurve(0.01, 2.0), 0.12, MpcSettings(search=search), 8.0, 0.02)
    assert limits[-200:].min() > 2.5 * 0.02
    assert unit.belief.record.axles.noise.mean() == pytest.approx(0.02, rel=0.15)


@looped("noise", [0.0, 0.01])
def test_the_slip_sought_does_not_fall_because_adhesion_returns(noise):
    """Slip falls while adhesion rises, as on a curve that falls; and the peak believed soon is no bound any more."""
    unit, _ = _sought(SlipRatioCurve(0.02), 0.09, noise=noise, seconds=6.0)
    before = float(unit.search.slip)
    unit.peak = 0.16
    for k in range(40):
        unit.period(before * max(0.3, 1.0 - 0.1 * k))
        assert unit.search.slip > 0.9 * before
    assert unit.belief.peak.min() > 1.1 * unit.coefficient(0.3 * before)


# --- when it rests


def test_nothing_moves_while_the_rail_does_not_limit():
    unit = SyntheticUnit(PiecewiseCurve())
    heard = "elasticity", "certainty", "swing", "noise"
    before = [float(unit.search[name]) for name in heard]
    for _ in range(300):
        unit.period(0.04 * unit.swing, wanted=0.0)
    assert [float(unit.search[name]) for name in heard] == before
    assert unit.believed.heard_for == 0.0


def test_the_slip_sought_stays_while_slip_is_far_below_it():
    unit = SyntheticUnit(PiecewiseCurve())
    unit.believed.heard_for = 1.0  # else the slip sought follows what pairs tell of the curve
    before = float(unit.search.slip)
    for _ in _swinging(unit, 0.2 * before, 3.0):
        assert unit.search.slip == before


def test_without_an_answer_to_the_swing_elasticity_is_as_wanted():
    unit = SyntheticUnit(POLACH_WET)
    for _ in range(300):
        unit.period(0.09)
    assert unit.search.certainty < 0.02
    assert unit.search.elasticity == pytest.approx(PRICE * unit.search.slip, abs=2e-3)


def test_the_limit_swings_about_what_is_sought(make_context):
    search = SlipSearch(seek=False, swing=0.2, swing_time=0.25)
    unit = SyntheticUnit(PiecewiseCurve(), settings=MpcSettings(search=search), unit=3)
    swing = []
    for _ in range(250):
        unit.belief.record.axles.noise[:] = 0.0  # it would swing more at first
        unit.period(0.03)
        swing.append(unit.swing - 1.0)
    assert max(swing) == pytest.approx(0.2, rel=0.01)
    assert min(swing) == pytest.approx(-0.2, rel=0.01)
    np.testing.assert_allclose(swing[25:], swing[:-25], atol=1e-9)


# --- the predicted curve


@looped("truth", [RationalCurve(0.08, 2.0), RationalCurve(0.2, 4.0)])
@looped(("price", "within"), [(PRICE, 0.1), (4.0, 0.2)])
def test_the_predicted_curve_is_the_rails(truth, price, within):
    # dear friction: far below the peak its slip follows from elasticity and slope
    settings = MpcSettings(search=SlipSearch(friction_price=price))
    unit, _ = _sought(truth, 0.12, settings, 10.0)
    for _ in range(3):
        # on its way to the limit the axle shows the slope at the origin
        for slip in np.linspace(0.0, unit.search.slip, 200):
            unit.period(slip, wanted=0.0)
        _following(unit, 5.0)
    top, steepness = unit.belief.curve
    slip = np.linspace(0.0, truth.peak_slip, 50)
    predicted = RationalCurve(top, steepness).coefficient(slip, unit.belief.peak.mean())
    np.testing.assert_allclose(predicted, unit.coefficient(slip), atol=within * 0.12)


def test_it_is_never_steeper_than_the_prediction_allows():
    rng = np.random.default_rng(7)
    for _ in range(2000):
        peak, top, n = np.exp(rng.uniform(np.log([0.01, 0.01, 1.0]), np.log([0.5, 1.5, 60.0])))
        found = no_steeper(top, n, peak)
        assert RationalCurve(*found).steepest_slope(peak) <= STEEPEST_SLOPE * (1.0 + 1e-9)
        if RationalCurve(top, n).steepest_slope(peak) < 0.8 * STEEPEST_SLOPE:
            assert found == (top, n)
        np.testing.assert_allclose(no_steeper(*found, peak), found, rtol=1e-12)


def test_a_unit_predicts_with_no_steeper_curve_whatever_it_reads(make_context):
    rng = np.random.default_rng(8)
    for curve in (RationalCurve(0.005, 2.0), POLACH_WET):
        unit = SyntheticUnit(replace(curve), 0.4, noise=0.005)
        for _ in range(300):
            unit.period(rng.choice([0.002, 0.01, 0.1]) * rng.uniform(0.5, 1.5))
            predicted = RationalCurve(*unit.belief.curve)
            slope = predicted.steepest_slope(unit.belief.peak.max())
            assert slope <= STEEPEST_SLOPE * (1.0 + 1e-9)
