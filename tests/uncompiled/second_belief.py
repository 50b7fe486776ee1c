"""Second transcription of a unit's belief: in complex numbers, one axle at a time."""

import cmath
import math

import numpy as np

from alloc.onboard.observer import observer_gains
from mpc import axle_observer, slip_search
from mpc.belief import FOREIGN_FORCE

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
        filtered = 1.0 - math.exp(-PERIOD / slip_search.INSTRUMENT_TIME)
        self.answer += max(filtered, PERIOD / self.limited_for) * (a.of_slip - self.answer)
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
            told = self.excitation / (self.excitation + slip_search.UNTOLD)
            step = told * s.gain * (self.elasticity - wanted)
            rate = float(np.clip(step, -s.fastest_fall, s.fastest_rise))
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
