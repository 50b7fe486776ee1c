"""Updates of the MPC's beliefs equal a second transcription; what the curve belief keeps is sums, here of lists of pairs."""

import math

import numpy as np
import pytest

from alloc.onboard.observer import observer_gains
from alloc.plant.adhesion import POLACH_WET, PiecewiseCurve, SlipRatioCurve
from alloc.plant.adhesion_laws import tangential_coefficient
from mpc import belief as beliefs
from mpc import curve_belief
from mpc.belief import FOREIGN_FORCE, CurveObserver, GroupBelief, measured_noise
from mpc.curve_belief import CLASS, SUMS, Constants, Memory, Sums, micro_slip, stretch_estimate
from mpc.settings import CurveBelief, PeakBelief

CURVES = {"piecewise": PiecewiseCurve(), "polach": POLACH_WET, "slip-ratio": SlipRatioCurve()}
C = Constants(
    prior=0.004, fading=3.0, smallest=0.4, largest=2.5, tested=0.75, untested=0.5, resolution=0.002
)


def limit(curve, peak, speed):
    return tuple(map(float, curve.limit(peak, speed)))


def coefficient_at(curve, slip, speed, peak):
    return tangential_coefficient(curve.kind, curve.q, slip, speed, speed + slip, peak)


# --- peaks


@pytest.mark.parametrize("kind", CURVES)
def test_peaks_follow_what_slipping_axles_feel(make_context, kind):
    context = make_context(kind, axles=3)
    b = PeakBelief(
        initial=0.15, probe=0.5, noise_margin=2.0, slip_error=0.01, floor=0.05, ceiling=0.22
    )
    observer = CurveObserver(context, b, CurveBelief(estimate=False))
    rng, period = np.random.default_rng(4), context.period
    keep, old, new = observer_gains(b.pole, period)
    peak, noise, told, delayed = np.full(3, 0.15), np.full(3, 0.01), np.zeros(3), None
    speed, branches = 9.0, set()
    for tick in range(40):
        speed += 0.01 * rng.uniform(-0.5, 1.0)
        measured = rng.choice([0.005, 0.03, 1.2], 3) * rng.uniform(0.5, 1.5, 3)
        omega, torque = (speed + measured) / context.radius, rng.uniform(100.0, 900.0)
        measured = context.radius * omega - speed
        if tick in (0, 20):
            observer.forget_forces()
        observer.axle_load[:] = context.axle_load * rng.uniform(0.9, 1.1, 3)
        observer.update(speed, omega, torque)
        # tau_c = z - a J w, z the filtered input
        value = torque * context.gear_ratio + b.pole * context.inertia * omega
        if tick in (0, 20):
            delayed = last_slip = measured
            filtered = last = value
        filtered = keep * filtered + old * last + new * value
        last = value
        felt = (filtered - b.pole * context.inertia * omega) / (observer.axle_load * context.radius)
        delayed = keep * delayed + old * last_slip + new * measured
        last_slip = measured
        for i in range(3):
            off = abs(measured[i] - delayed[i])
            micro = off - b.noise_margin * noise[i] - b.slip_error <= 0.2 * abs(delayed[i])
            noise[i] += (1.0 - math.exp(-period / 1.0)) * (off - noise[i])
            top_value, top = limit(context.curve, peak[i], speed)
            rate = 1.0 - math.exp(-b.gain * period)
            if delayed[i] >= b.informative * top + b.slip_error + b.noise_margin * noise[i]:
                branches.add("slips")
                share = coefficient_at(context.curve, delayed[i], speed, peak[i]) / peak[i]
                peak[i] = (1.0 - rate) * peak[i] + rate * felt[i] / share
                told[i], micro = peak[i], False
            elif felt[i] > top_value:
                branches.add("more")
                peak[i] *= 1.0 + rate * (felt[i] / top_value - 1.0)
            else:
                branches.add("untested")
                peak[i] *= math.exp(b.probe * period)
            peak[i] = np.clip(peak[i], b.floor, b.ceiling)
            assert observer.axles.micro[i] == micro
            assert observer.peak_slip[i] == pytest.approx(
                limit(context.curve, peak[i], speed)[1], rel=1e-6
            )
        for found, expected in ((observer.peak, peak), (observer.coefficient, felt), (observer.axles.told, told),
                                (observer.axles.slip, delayed), (observer.axles.noise, noise)):  # fmt: skip
            np.testing.assert_allclose(found, expected, rtol=1e-9, atol=1e-12)
    assert branches == {"slips", "more", "untested"}


def test_what_was_supposed_of_the_noise_is_forgotten_as_noise_is_learnt(make_context):
    b = PeakBelief(slip_error=0.02)
    observer = CurveObserver(make_context(axles=2), b, CurveBelief())
    for _ in range(50):
        observer.update(8.0, np.full(2, 8.01 / 0.43), 100.0)
    # steady slip: no noise at all
    assert measured_noise(observer.record) == pytest.approx(0.0, abs=1e-12)
    observer.axles.noise[:] += [0.003, 0.005]
    left = math.exp(-50 * 0.01)
    assert measured_noise(observer.record) == pytest.approx(0.004 / (1.0 - left), rel=1e-9)


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_other_brakes_keep_the_slope_as_it_is(make_context, monkeypatch, share):
    observer = CurveObserver(make_context(axles=2), PeakBelief(), CurveBelief())
    calls = []
    monkeypatch.setattr(beliefs, "update_slope", lambda *arguments: calls.append(arguments))
    observer.update(8.0, np.full(2, 8.01 / 0.43), 300.0)
    felt = observer.coefficient.mean()
    for sign in (-1.0, 1.0):
        observer.update(8.0, np.full(2, 8.01 / 0.43), 300.0, felt + sign * share * FOREIGN_FORCE)
    assert len(calls) == (3 if share < 1.0 else 1)
    assert calls[0][-2:] == (4.0 * measured_noise(observer.record), 0.015)


def test_loads_of_a_group_follow_the_forces_of_the_car(make_context):
    units = [
        make_context(axles=2, car=0, unloading=(0.03, 0.01), axle_load=70e3),
        make_context(axles=2, car=0, unloading=(-0.01, -0.03), axle_load=74e3),
        make_context(
            axles=4, car=1, unloading=(0.05, 0.02, -0.02, -9.0), axle_load=80e3, mass=60e3
        ),
    ]
    group = GroupBelief(units, PeakBelief())
    static = np.repeat([70e3, 74e3, 80e3], [2, 2, 4])
    unloading = np.concatenate([u.unloading for u in units])
    omega, torque, load = np.full(8, 8.02 / 0.43), np.array([200.0, 300.0, 400.0]), static.copy()
    for _ in range(3):
        group.update(np.full(3, 8.0), omega, torque)
        felt = np.repeat(torque * 7.07 / 0.43, [2, 2, 4]) / load
        np.testing.assert_allclose(
            np.concatenate([o.coefficient for o in group.observers]), felt, rtol=1e-9
        )
        force = np.repeat([(felt * load)[:4].sum(), (felt * load)[4:].sum()], 4)
        load = np.maximum(static - unloading * force, 0.5 * static)
        np.testing.assert_allclose(group.load, load, rtol=1e-9)
    np.testing.assert_array_equal(group.peak, np.concatenate([o.peak for o in group.observers]))
    np.testing.assert_array_equal(
        group.peak_slip, np.concatenate([o.peak_slip for o in group.observers])
    )
    group.peak[:] = np.linspace(0.1, 0.17, 8)
    share = group.peak * load / static
    rim = [155.0 * u.axles / (0.43**2 * u.mass) for u in units]
    carried = [u.axle_load * 0.43 / 7.07 * (1.0 + r) for u, r in zip(units, rim, strict=True)]
    weakest = [share[:2].min(), share[2:4].min(), share[4:].min()]
    np.testing.assert_allclose(group.carried_torque(), np.multiply(weakest, carried), rtol=1e-12)


# --- the slope of the curve


@pytest.mark.parametrize("kind", CURVES)
@pytest.mark.parametrize("share", [-0.6, 0.3, 0.9])
def test_micro_slip_is_the_rising_branch_read_backwards(kind, share):
    curve, speed = CURVES[kind], 8.0
    top_value, top = limit(curve, 0.12, speed)
    slip = micro_slip(curve.kind, curve.q, share * top_value, 0.12, top, speed)
    assert math.copysign(1.0, slip) == math.copysign(1.0, share)
    assert 0.0 < abs(slip) < top
    felt = coefficient_at(curve, abs(slip), speed, 0.12)
    assert felt == pytest.approx(abs(share) * top_value, rel=1e-5)


class Pairs:
    """Accepted pairs with their weights: number, expected and measured slip."""

    def __init__(self, pairs=()):
        self.pairs = list(pairs)

    def take(self, expected, slip, number, offset):
        if abs(expected) < C.resolution:
            expected = 0.0
        along = slip * np.sign(expected) if expected else slip
        least, most = C.smallest / 2.0 * abs(expected), C.largest * 2.0 * abs(expected)
        if least - offset <= along <= most + offset:
            keep = math.exp(-C.fading * number * expected**2)
            self.pairs = [(n * keep, x, s) for n, x, s in self.pairs] + [(number, expected, slip)]

    def sums(self):
        n, x, s = np.array(self.pairs).reshape(-1, 3).T
        return [n.sum(), (n * x).sum(), (n * x * x).sum(), (n * s).sum(), (n * x * s).sum()]


def judge(curve, kept, peak, share, speed, offset, into):
    """Take what was `kept` (class -> [number, sum of coefficients, sum of slips]) into `into`."""
    top_value, top = limit(curve, peak, speed)
    least = math.inf
    for k in sorted(kept):
        n, total, slips = kept[k]
        if total / n > share * top_value:
            continue
        expected, slip = micro_slip(curve.kind, curve.q, total / n, peak, top, speed), slips / n
        if expected > 3.0 * C.resolution:
            if slip > 1.5 * least * expected:
                return
            least = min(least, max(slip, 0.0) / expected)
        into.take(expected, slip, n, offset)


@pytest.mark.parametrize("kind", CURVES)
@pytest.mark.parametrize("seed", range(2))
def test_pairs_are_kept_until_the_peak_is_known(kind, seed):
    curve, speed, offset, initial = CURVES[kind], 8.0, 0.004, 0.15
    rng = np.random.default_rng(seed)
    memory = Memory(Sums.zeros(), Sums.zeros(), np.zeros((2, 40), CLASS), np.zeros(2))
    kept, most, good = [{}, {}], np.zeros(2), Pairs()
    told, twin_told = np.zeros(2), np.zeros(2)
    top = limit(curve, 0.13, speed)[1]
    for tick in range(48):
        coefficient = rng.uniform(-0.02, 0.13, 2) * (1.5 if tick > 40 else 1.0)
        slips = np.array(
            [micro_slip(curve.kind, curve.q, c, 0.14, top, speed) for c in coefficient]
        )
        slips *= rng.uniform(0.6, 2.0, 2) * np.where(rng.random(2) < 0.1, 8.0, 1.0)
        peak, micro = rng.uniform(0.11, 0.16, 2), rng.random(2) < 0.8
        if tick in (15, 30):
            told[tick // 30] = twin_told[tick // 30] = 0.125
        news = curve_belief._update(
            curve.kind,
            curve.q,
            C,
            initial,
            offset,
            speed,
            slips,
            coefficient,
            peak,
            told,
            micro,
            memory,
        )
        for i in np.flatnonzero(micro):
            if 0.0 < 1.2 * twin_told[i] < coefficient[i]:
                twin_told[i], most[i] = 0.0, 0.0
            if twin_told[i] > 0.0:
                known = min(twin_told[i], peak[i])
                if most[i] > 0.0:
                    judge(curve, kept[i], max(known, most[i]), C.tested, speed, offset, good)
                    kept[i], most[i] = {}, 0.0
                top_value, at = limit(curve, known, speed)
                if abs(coefficient[i]) <= C.tested * top_value:
                    good.take(
                        micro_slip(curve.kind, curve.q, coefficient[i], known, at, speed),
                        slips[i],
                        1.0,
                        offset,
                    )
            else:
                k = min(max(int(coefficient[i] / 0.0125), 0), 39)
                row = np.array(kept[i].get(k, [0.0, 0.0, 0.0]))
                kept[i][k] = row * (0.5 if row[0] >= 200.0 else 1.0) + [
                    1.0,
                    coefficient[i],
                    slips[i],
                ]
                most[i] = max(most[i], coefficient[i])
        np.testing.assert_array_equal(told, twin_told)
        np.testing.assert_allclose(memory.sums.flat, good.sums(), rtol=1e-9, atol=1e-12)
        if not news or tick % 7:
            continue
        total = Pairs(good.pairs)
        for i in np.flatnonzero(most > 0.0):
            supposed = min(peak[i], initial, twin_told.max() or math.inf)
            judge(curve, kept[i], max(most[i], supposed), C.untested, speed, offset, total)
        np.testing.assert_allclose(memory.total.flat, total.sums(), rtol=1e-9, atol=1e-12)
    assert good.pairs


def test_a_full_class_forgets_its_older_half():
    bins = np.zeros(40, CLASS)
    for _ in range(201):
        curve_belief._keep(bins, 0.03, 0.002)
    assert bins[2].pairs == pytest.approx(101.0)
    assert bins[2].coefficient == pytest.approx(101.0 * 0.03)
    assert bins[2].slip == pytest.approx(101.0 * 0.002)
    curve_belief._keep(bins, 3.0, 0.0)
    curve_belief._keep(bins, -3.0, 0.0)
    assert (bins[39].pairs, bins[0].pairs) == (1.0, 1.0)


@pytest.mark.parametrize(
    ("offset", "resolution"), [(0.0, 0.0), (0.0, 0.01), (0.004, 0.002), (0.02, 0.0)]
)
def test_the_stretch_is_the_regression_of_the_module(offset, resolution):
    rng = np.random.default_rng(1)
    n, pair = 30, rng.uniform(0.002, 0.03, (2, 30)) * [[1.0], [1.3]]
    x, s = pair
    sums = np.zeros(1, SUMS)
    sums[0] = (n, x.sum(), (x * x).sum(), s.sum(), (x * s).sum())
    k = offset**2 / (offset**2 + resolution**2) if offset else 0.0
    top = C.prior + (x * s).sum() - k * x.sum() * s.sum() / n
    expected = top / (C.prior + (x * x).sum() - k * x.sum() ** 2 / n)
    assert stretch_estimate(sums[0], C, offset, resolution) == pytest.approx(expected, rel=1e-12)
    assert 0.4 < expected < 2.5
    assert stretch_estimate(np.zeros(1, SUMS)[0], C, offset, resolution) == 1.0
    sums[0].x_slip = 9.0
    assert stretch_estimate(sums[0], C, offset, resolution) == C.largest
    sums[0].x_slip = -9.0
    assert stretch_estimate(sums[0], C, offset, resolution) == C.smallest


def _judged(rows, resolution, offset, share=0.9):
    """Pairs taken of the classes `rows`: (coefficient, slip), one pair each."""
    curve = CURVES["piecewise"]
    bins, sums = np.zeros(40, CLASS), Sums.zeros()
    for coefficient, slip in rows:
        curve_belief._keep(bins, coefficient, slip)
    c = C._replace(resolution=resolution, fading=0.0)
    curve_belief._judge(curve.kind, curve.q, c, bins, 0.15, share, 8.0, offset, sums)
    return sums.named[0].pairs


def _expected(coefficient):
    curve = CURVES["piecewise"]
    return micro_slip(curve.kind, curve.q, coefficient, 0.15, limit(curve, 0.15, 8.0)[1], 8.0)


def test_pairs_are_taken_up_to_where_the_curve_bends():
    low, high = _expected(0.04), _expected(0.08)
    assert _judged([(0.04, low), (0.08, 1.49 * high)], 1e-5, 0.0) == 2.0
    assert _judged([(0.04, low), (0.08, 1.51 * high)], 1e-5, 0.0) == 1.0
    # a slip against the force counts as none: whatever slips more than nothing is beyond the bend
    assert _judged([(0.04, -0.5 * low), (0.08, -0.4 * low)], 1e-5, 1.0) == 2.0
    assert _judged([(0.04, -0.5 * low), (0.08, 0.1 * low)], 1e-5, 1.0) == 1.0
    # what is no more than noise says nothing of a bend
    third = low / 3.0
    exact = next(
        r for r in (third, np.nextafter(third, 0.0), np.nextafter(third, 1.0)) if 3.0 * r <= low
    )
    bent = [(0.04, 0.3 * low), (0.08, high)]
    assert _judged(bent, exact if 3.0 * exact == low else 1.01 * third, 1.0) == 2.0
    assert _judged(bent, 0.99 * third, 1.0) == 1.0


def test_times_of_the_belief_are_told_in_excitation():
    # one axle that slips by the scale of 0.02 m/s excites by 0.0004 m2/s2 in each of 50 periods a second
    belief = CurveBelief(slip_scale=0.02, memory=4.0, prior=0.5, smallest=0.6, largest=1.7)
    slope = curve_belief.slope_belief(CURVES["polach"], 3, 0.02, belief, 0.17)
    c = slope.constants
    assert c.prior == pytest.approx(0.5 * 50 * 0.0004)
    assert c.fading * 4.0 * 50 * 0.0004 == pytest.approx(1.0)
    assert (c.smallest, c.largest, c.tested, c.untested) == (0.6, 1.7, 0.75, 0.5)
    assert c.resolution == pytest.approx(0.002)
    assert slope.initial == 0.17
    assert (slope.memory.bins.shape, slope.memory.most.shape) == ((3, 40), (3,))
    assert slope.stretch.tolist() == [1.0]
    np.testing.assert_array_equal(slope.q, CURVES["polach"].q)
