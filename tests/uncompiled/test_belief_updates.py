"""Updates of the MPC's belief equal a second transcription, in complex numbers and one axle at a time."""

import cmath
import math

import numpy as np
import pytest

from alloc.onboard.observer import observer_gains
from mpc import axle_observer, slip_search
from mpc.belief import FOREIGN_FORCE, GroupBelief, UnitBelief
from mpc.settings import MpcSettings, PeakBelief, SlipSearch

PERIOD = 0.01


class Axle:
    """Pair, noise, peak and demodulated values of one axle."""

    def __init__(self, context, settings):
        self.context, self.b, self.s = context, settings.belief, settings.search
        self.keep, self.old, self.new = observer_gains(self.b.pole, PERIOD)
        self.noise, self.peak = axle_observer.FIRST_NOISE, self.b.initial
        self.variance = (axle_observer.DOUBT * self.peak) ** 2
        self.mean, self.of_slip, self.of_coefficient = None, 0j, 0j

    def observe(self, speed, omega, torque, load, fresh):
        c, b = self.context, self.b
        w = c.radius * omega - speed
        value = torque * c.gear_ratio + b.pole * c.inertia * omega
        if fresh:
            self.slip = self.w1 = self.w2 = w
            self.filtered = self.last = value
        self.filtered = self.keep * self.filtered + self.old * self.last + self.new * value
        self.last = value
        self.mu = (self.filtered - b.pole * c.inertia * omega) / (load * c.radius)
        rough = abs((w - self.w1) - (self.w1 - self.w2)) / 1.95
        most = axle_observer.ROUGHEST * max(self.noise, axle_observer.SMALLEST_NOISE)
        share = 1.0 - math.exp(-PERIOD / axle_observer.NOISE_TIME)
        self.noise = (1.0 - share) * self.noise + share * min(rough, most)
        self.slip = self.keep * self.slip + self.old * self.w1 + self.new * w
        self.w2, self.w1 = self.w1, w

    def estimate(self, noise, top, n):
        c, b = self.context, self.b

        def curve(s):
            x = s / top
            return n * x / (1.0 + (n - 2.0) * x + x * x)

        s = max(self.slip, 0.0)
        x = s / top
        slope = self.peak * n * (1.0 - x * x) / (1.0 + (n - 2.0) * x + x * x) ** 2 / top
        felt = b.pole * c.inertia / (c.radius**2 * c.axle_load) * noise
        own = b.coefficient_error + b.relative_error * abs(self.mu)
        of_slip = b.slip_error**2 + (1.0 - self.keep) / (1.0 + self.keep) * noise**2
        repeat = max(1.0, 2.0 / (b.pole * PERIOD))
        error = (own**2 + felt**2 + slope**2 * of_slip) * repeat
        error += (0.5 * slope * (self.w1 - self.slip)) ** 2
        off = self.mu - curve(s) * self.peak
        total, doubted = curve(s) ** 2 * self.variance + error, False
        if abs(off) > b.gate * math.sqrt(total):
            self.variance += (axle_observer.DOUBT * self.peak) ** 2
            total, doubted = curve(s) ** 2 * self.variance + error, True
        tells = curve(max(0.0, s + slope * of_slip * repeat / total * off))
        gain = tells * self.variance / (tells * curve(s) * self.variance + error)
        before = self.peak
        self.peak = float(np.clip(before + gain * off, b.floor, b.ceiling))
        grown = self.variance * (1.0 - gain * curve(s)) + b.walk**2 * PERIOD * before**2
        self.variance = min(grown, (axle_observer.DOUBT * before) ** 2)
        return doubted

    def demodulate(self, phase, felt):
        """Whether the axle is listened to, and whether its rail jumped."""
        if self.slip < slip_search.LEAST_SLIP or self.mu < slip_search.LEAST_COEFFICIENT:
            self.mean = None
            return False, False
        pair = np.log([self.slip, self.mu])
        jump = max(
            slip_search.JUMP,
            slip_search.WHOLE_SWING * self.s.swing,
            slip_search.SURE * felt / self.mu,
        )
        if self.mean is None:
            self.mean, self.of_slip, self.of_coefficient = pair, 0j, 0j
            return True, False
        if abs(pair[1] - self.mean[1]) > jump:
            self.mean = pair
            self.of_slip, self.of_coefficient = 0.3 * self.of_slip, 0.3 * self.of_coefficient
            return True, True
        self.mean = self.mean + (1.0 - math.exp(-PERIOD / slip_search.MEAN_TIME)) * (
            pair - self.mean
        )
        turn, kept = cmath.exp(1j * phase) * PERIOD, math.exp(-PERIOD / self.s.memory)
        self.of_slip = kept * self.of_slip + turn * (pair - self.mean)[0]
        self.of_coefficient = kept * self.of_coefficient + turn * (pair - self.mean)[1]
        return True, False


class Unit:
    """The search, and what it asks of the axles."""

    def __init__(self, context, settings):
        self.context, self.s = context, settings.search
        self.axles = [Axle(context, settings) for _ in range(context.axles)]
        self.slip = self.s.first
        self.phase = slip_search.GOLDEN * context.unit
        self.answer, self.limited_for, self.fresh = 0j, 0.0, True
        self.top, self.n = self.slip / slip_search.USUAL_SHARE, 2.0
        self.below = 1e-4
        self.above = 1e-4 * 2.0 * settings.belief.initial / self.top
        self.elasticity = self.excitation = 0.0
        self.seen = set()

    def slope(self):
        for a in self.axles:
            y = a.mu / a.peak
            if a.mu > 2.0 * slip_search.LEAST_COEFFICIENT and y < slip_search.MICRO:
                self.seen.add("slope")
                x = float(np.min(np.roots([y, y * (self.n - 2.0) - self.n, y]).real))
                bend = 1.0 + (self.n - 2.0) * x + x * x
                share = slip_search.SLOPE_SHARE
                self.above += share * (a.mu**2 * bend - self.above)
                self.below += share * (a.mu * a.slip - self.below)

    def search(self, limited):
        s = self.s
        noise = float(np.mean([a.noise for a in self.axles]))
        felt = (
            self.axles[0].b.pole
            * self.context.inertia
            / (self.context.radius**2 * self.context.axle_load)
            * noise
        )
        self.phase += 2.0 * math.pi * PERIOD / s.swing_time
        self.slope()
        if not limited:
            self.limited_for = 0.0
            for a in self.axles:
                a.mean = None
            self.seen.add("not limited")
            return
        self.limited_for += PERIOD
        heard = []
        for a in self.axles:
            listened, jumped = a.demodulate(self.phase, felt)
            if jumped:
                self.seen.add("jump")
            if listened:
                heard.append(a)
        if not heard:
            self.seen.add("nothing heard")
            return
        a = max(heard, key=lambda one: one.mean[0])
        full = 0.5 * s.memory * s.swing
        self.answer += (1.0 - math.exp(-PERIOD / slip_search.INSTRUMENT_TIME)) * (
            a.of_slip - self.answer
        )
        unit = self.answer / (abs(self.answer) + 1e-12)
        below, above = (
            max((a.of_slip * unit.conjugate()).real, 0.0),
            (a.of_coefficient * unit.conjugate()).real,
        )
        prior, wanted = slip_search.PRIOR * full, s.friction_price * self.slip
        self.elasticity = (above + prior * wanted) / (below + prior)
        self.excitation = (below / full) ** 2
        settled = self.limited_for > slip_search.SETTLED
        if s.seek and settled and math.exp(a.mean[0]) > slip_search.AT_LIMIT * self.slip:
            rate = float(
                np.clip(s.gain * (self.elasticity - wanted), -s.fastest_fall, s.fastest_rise)
            )
            lowest = max(s.lowest, s.noise_margin * noise)
            self.slip = min(max(self.slip * math.exp(PERIOD * rate), lowest), s.highest)
            self.seen.add("moved")
        known = self.excitation / (self.excitation + 0.3) if settled else 0.0
        slope = float(np.clip(self.above / max(self.below, 1e-7), 1.0, 80.0))
        ratio = max(slope * math.exp(a.mean[0]) / math.exp(a.mean[1]), 1.05)
        x = math.sqrt(np.clip(1.0 - self.elasticity * ratio, 0.3, 1.1))
        x = known * x + (1.0 - known) * slip_search.USUAL_SHARE
        share = 1.0 - math.exp(-PERIOD / slip_search.SHAPE_TIME)
        top = float(np.clip(self.slip / x, *slip_search.PEAK_SLIPS))
        self.top = self.top ** (1.0 - share) * top**share
        n = float(np.clip(slope * self.top / a.peak, *slip_search.STEEPNESS))
        self.n = self.n ** (1.0 - share) * n**share

    def update(self, speed, omega, torque, wanted, estimate, load):
        for i, a in enumerate(self.axles):
            a.observe(speed, omega[i], torque, load[i], self.fresh)
        self.fresh = False
        foreign = abs(estimate - np.mean([a.mu for a in self.axles])) > FOREIGN_FORCE
        self.search(torque < slip_search.LIMITING * wanted and not foreign)
        noise = float(np.mean([a.noise for a in self.axles]))
        for a in self.axles:
            if a.estimate(noise, self.top, self.n):
                self.seen.add("doubt")
        if not self.s.seek:
            top = self.context.curve.limit(min(a.peak for a in self.axles), speed)[1]
            self.slip = self.s.given_share * float(top)


SETTINGS = {
    "default": MpcSettings(),
    "others": MpcSettings(
        belief=PeakBelief(
            initial=0.15, pole=40.0, walk=0.2, slip_error=0.003, coefficient_error=0.002, relative_error=0.02,
            gate=2.0, floor=0.05, ceiling=0.3,
        ),
        search=SlipSearch(
            first=0.06, lowest=0.03, highest=0.09, noise_margin=2.0, friction_price=1.0, swing=0.3, swing_time=0.15,
            memory=0.5, gain=10.0, fastest_rise=1.0, fastest_fall=0.8,
        ),
    ),
    "given": MpcSettings(search=SlipSearch(seek=False, given_share=0.8)),
}  # fmt: skip


@pytest.mark.parametrize("kind", ["piecewise", "polach"])
@pytest.mark.parametrize("name", SETTINGS)
def test_belief_is_its_second_transcription(make_context, kind, name):
    context = make_context(kind, axles=3, unit=2)
    belief, other = UnitBelief(context, SETTINGS[name]), Unit(context, SETTINGS[name])
    rng, speed, slip, level = np.random.default_rng(4), 9.0, np.full(3, 0.05), 0.12
    for tick in range(420):
        speed += 0.005
        level = 0.06 if tick > 250 else 0.12
        if tick in (0, 200):
            belief.forget_forces()
            other.fresh = True
        goal = belief.slip_limit if tick % 140 > 30 else 0.002 + 0.0003 * (tick % 140)
        slip += 0.3 * (goal * np.array([1.0, 0.9, 0.8]) - slip)
        measured = slip + 0.002 * rng.standard_normal(3)
        mu = (
            float(context.curve.coefficient(slip, level, speed).mean())
            + 0.001 * rng.standard_normal()
        )
        torque = mu * context.axle_load * context.radius / context.gear_ratio
        wanted = 0.5 * torque if 60 < tick < 70 else 900.0
        estimate = mu + 0.05 if 80 < tick < 84 else math.nan
        load = context.axle_load * rng.uniform(0.95, 1.05, 3)
        omega = (speed + measured) / context.radius
        belief.axle_load[:] = load
        belief.update(speed, omega, torque, wanted, estimate)
        other.update(speed, omega, torque, wanted, estimate, load)
        state, axles = belief.record.search.state[0], belief.record.axles
        for key in (
            "slip",
            "top",
            "n",
            "limited_for",
            "elasticity",
            "excitation",
            "above",
            "below",
        ):
            field = {
                "top": "peak_slip",
                "n": "steepness",
                "above": "slope_above",
                "below": "slope_below",
            }
            found = float(state[field.get(key, key)])
            assert found == pytest.approx(getattr(other, key), rel=1e-6, abs=1e-9), (tick, key)
        for key, attribute in (("coefficient", "mu"), ("slip", "slip"), ("noise", "noise"), ("peak", "peak"), ("variance", "variance")):  # fmt: skip
            expected = [getattr(a, attribute) for a in other.axles]
            np.testing.assert_allclose(getattr(axles, key), expected, rtol=1e-6, atol=1e-12)
        limit = other.slip * (1.0 + SETTINGS[name].search.swing * math.sin(other.phase))
        assert belief.slip_limit == pytest.approx(limit, rel=1e-6)
    common = {"slope", "not limited", "jump", "doubt"}
    assert other.seen >= common | (set() if name == "given" else {"moved"})


@pytest.mark.parametrize("share", [0.99, 1.01])
def test_other_brakes_let_the_search_rest(make_context, share):
    belief = UnitBelief(make_context(axles=2), MpcSettings())
    belief.update(8.0, np.full(2, 8.01 / 0.43), 300.0)
    felt = belief.coefficient.mean()
    for sign in (-1.0, 1.0):
        belief.update(
            8.0, np.full(2, 8.01 / 0.43), 300.0, math.inf, felt + sign * share * FOREIGN_FORCE
        )
    limited = belief.record.search.state[0].limited_for
    assert limited == pytest.approx(0.03 if share < 1.0 else 0.0)


@pytest.mark.parametrize("share", [0.9985, 0.9995])
def test_a_unit_that_gives_what_is_wanted_is_not_limited(make_context, share):
    belief = UnitBelief(make_context(axles=2), MpcSettings())
    belief.update(8.0, np.full(2, 8.01 / 0.43), 300.0 * share, 300.0)
    assert (belief.record.search.state[0].limited_for > 0.0) == (share < slip_search.LIMITING)


def test_loads_of_a_group_follow_the_forces_of_the_car(make_context):
    units = [
        make_context(axles=2, car=0, unloading=(0.03, 0.01), axle_load=70e3),
        make_context(axles=2, car=0, unloading=(-0.01, -0.03), axle_load=74e3),
        make_context(
            axles=4, car=1, unloading=(0.05, 0.02, -0.02, -9.0), axle_load=80e3, mass=60e3
        ),
    ]
    group = GroupBelief(units, MpcSettings())
    static = np.repeat([70e3, 74e3, 80e3], [2, 2, 4])
    unloading = np.concatenate([u.unloading for u in units])
    omega, torque, load = np.full(8, 8.02 / 0.43), np.array([200.0, 300.0, 400.0]), static.copy()
    for _ in range(3):
        group.update(np.full(3, 8.0), omega, torque, np.full(3, 900.0))
        felt = np.repeat(torque * 7.07 / 0.43, [2, 2, 4]) / load
        np.testing.assert_allclose(
            np.concatenate([o.coefficient for o in group.observers]), felt, rtol=1e-9
        )
        force = np.repeat([(felt * load)[:4].sum(), (felt * load)[4:].sum()], 4)
        load = np.maximum(static - unloading * force, 0.5 * static)
        np.testing.assert_allclose(group.load, load, rtol=1e-9)
    np.testing.assert_array_equal(group.peak, np.concatenate([o.peak for o in group.observers]))
    limits = [np.full(o.peak.size, o.slip_limit) for o in group.observers]
    np.testing.assert_array_equal(group.slip_limit, np.concatenate(limits))
    group.peak[:] = np.linspace(0.1, 0.17, 8)
    share = group.peak * load / static
    rim = [155.0 * u.axles / (0.43**2 * u.mass) for u in units]
    carried = [u.axle_load * 0.43 / 7.07 * (1.0 + r) for u, r in zip(units, rim, strict=True)]
    weakest = [share[:2].min(), share[2:4].min(), share[4:].min()]
    np.testing.assert_allclose(group.carried_torque(), np.multiply(weakest, carried), rtol=1e-12)
