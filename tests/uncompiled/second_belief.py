"""Second transcription of a unit's belief: in complex numbers, one axle at a time."""

import cmath
import math

import numpy as np

from alloc.onboard.laws import observer_gains
from mpc import belief as air_brake
from mpc import estimator as axle_observer
from mpc import estimator as curve_filter
from mpc import slip_search
from mpc import slip_search as search_step

PERIOD = 0.01


def torque_weights(pole, lag):
    """Weights of the torques at both ends of a period in the filtered one, by quadrature."""
    time = (np.arange(200000) + 0.5) * PERIOD / 200000
    kernel = pole * np.exp(-pole * (PERIOD - time)) * PERIOD / time.size
    left = math.exp(-PERIOD / lag)
    # T = command + (T_0 - command) exp(-t / lag) for T_0 = 1 and T_1 = 0, then the other way round
    shapes = [(np.exp(-time / lag) - left) / (1 - left), (1 - np.exp(-time / lag)) / (1 - left)]
    return [float(kernel @ shape) for shape in shapes]


class Axle:
    """Pair, noise, peak and demodulated values of one axle."""

    def __init__(self, context, settings):
        self.context, self.b, self.s = context, settings.belief, settings.search
        self.keep, self.old, self.new = observer_gains(self.b.pole, PERIOD)
        self.weights = torque_weights(self.b.pole, context.torque_lag)
        self.noise, self.peak = axle_observer.FIRST_NOISE, self.b.initial
        self.age, self.of_first = axle_observer.FIRST_READINGS, 1.0
        self.variance = (axle_observer.DOUBT * self.peak) ** 2
        self.mean, self.of_slip, self.of_coefficient = None, 0j, 0j

    def observe(self, speed, omega, torque, load, fresh):
        c, b = self.context, self.b
        w = c.radius * omega - speed
        torque, turned = torque * c.gear_ratio, b.pole * c.inertia * omega
        if fresh:
            self.slip = self.w1 = self.w2 = w
            self.filtered, self.turned, self.torque = torque + turned, turned, torque
        self.filtered = (
            self.keep * self.filtered
            + self.old * self.turned
            + self.new * turned
            + self.weights[0] * self.torque
            + self.weights[1] * torque
        )
        self.turned, self.torque = turned, torque
        self.mu = (self.filtered - turned) / (load * c.radius)
        rough = abs((w - self.w1) - (self.w1 - self.w2)) / 1.95
        most = axle_observer.ROUGHEST * max(self.noise, axle_observer.SMALLEST_NOISE)
        # a plain mean, in which the guess stands for readings, until it is as old as the memory of an exponential one
        old = self.age / (self.age + 1.0)
        self.age += 1.0
        kept = min(old, math.exp(-PERIOD / axle_observer.NOISE_TIME))
        self.noise = kept * self.noise + (1.0 - kept) * min(rough, most)
        # weight that the first reading has in the filtered slip
        self.of_first = 1.0 if fresh else self.keep * self.of_first
        self.slip = self.keep * self.slip + self.old * self.w1 + self.new * w
        self.w2, self.w1 = self.w1, w

    def estimate(self, noise, curve):
        """A step of the peak's filter, and of the curve's slope; whether the rail seems to have changed."""
        c, b, top, n = self.context, self.b, curve.predicted, curve.n

        def shape(s):
            x = s / top
            return n * x / (1.0 + (n - 2.0) * x + x * x)

        def by_peak(s):  # at equal k = n peak / top, as long as nothing was heard
            return shape(s) ** 2 if curve.heard_for == 0.0 else shape(s)

        s = max(self.slip, 0.0)
        x = s / top
        slope = self.peak * n * (1.0 - x * x) / (1.0 + (n - 2.0) * x + x * x) ** 2 / top
        felt = b.pole * c.inertia / (c.radius**2 * c.axle_load) * noise
        own = b.coefficient_error + b.relative_error * abs(self.mu)
        settled = (1.0 - self.keep) / (1.0 + self.keep)
        of_slip = b.slip_error**2 + max(settled, self.of_first**2) * noise**2
        repeat = max(1.0, 2.0 / (b.pole * PERIOD))
        single = own**2 + felt**2 + slope**2 * of_slip
        moving = (0.5 * slope * (self.w1 - self.slip)) ** 2
        rising = s < top and shape(s) < curve_filter.RISING
        by_slope = self.peak * shape(s) * (1.0 - shape(s)) * rising
        of_curve = by_slope**2 * curve.variance + moving
        off = self.mu - shape(s) * self.peak
        doubted = False
        if off**2 > b.gate**2 * (by_peak(s) ** 2 * self.variance + of_curve + single):
            self.variance += (axle_observer.DOUBT * self.peak) ** 2
            doubted = True
        error = of_curve + single * repeat
        total = by_peak(s) ** 2 * self.variance + error
        tells = by_peak(max(0.0, s + slope * of_slip * repeat / total * off))
        gain = tells * self.variance / (tells * by_peak(s) * self.variance + error)
        before = self.peak
        self.peak = float(np.clip(before + gain * off, b.floor, b.ceiling))
        grown = self.variance * (1.0 - gain * by_peak(s)) + b.walk**2 * PERIOD * before**2
        self.variance = min(grown, (axle_observer.DOUBT * before) ** 2)
        curve.log_slope += curve.variance * by_slope / total * off
        curve.variance *= 1.0 - by_slope**2 * curve.variance / total
        return doubted

    def demodulate(self, phase, felt, noise, sought, swing):
        """What the pair is: "none" to listen to, the "first", a "return" of adhesion, a "jump" of the rail, or "heard".

        `sought`: slip that the search has arrived at, `swing`: its swing, a share.
        """
        if self.slip < slip_search.LEAST_SLIP or self.mu < slip_search.LEAST_COEFFICIENT:
            self.mean = None
            return "none"
        pair = np.log([self.slip, self.mu])
        swung = slip_search.WHOLE_SWING * max(self.s.swing, swing)
        kind = "heard"
        if self.mean is None:
            kind = "first"
        else:
            held = min(math.exp(self.mean[0]), sought)
            leap = max(held * slip_search.LEAP, held * swung, slip_search.FELL * noise)
            jump = max(slip_search.JUMP, swung, slip_search.SURE * felt / self.mu)
            if self.slip < held - leap:
                kind = "return"
            elif abs(pair[1] - self.mean[1]) > jump:
                kind = "jump"
        if kind != "heard":
            kept = slip_search.KEPT_AFTER_JUMP if kind == "jump" else 0.0
            self.mean = pair
            self.of_slip, self.of_coefficient = kept * self.of_slip, kept * self.of_coefficient
            return kind
        self.mean = self.mean + (1.0 - math.exp(-PERIOD / slip_search.MEAN_TIME)) * (
            pair - self.mean
        )
        turn, kept = cmath.exp(1j * phase) * PERIOD, math.exp(-PERIOD / self.s.memory)
        self.of_slip = kept * self.of_slip + turn * (pair - self.mean)[0]
        self.of_coefficient = kept * self.of_coefficient + turn * (pair - self.mean)[1]
        return kind


class Curve:
    """Slope at the origin and slip of the peak."""

    def __init__(self, settings):
        self.walk = settings.belief.slope_walk
        self.first = settings.search.first / slip_search.USUAL_SHARE
        self.predicted = self.top = self.first
        self.log_slope = math.log(curve_filter.USUAL_STEEPNESS / self.top)
        self.variance, self.heard_for = curve_filter.FIRST_DEVIATION**2, 0.0

    @property
    def slope(self):
        return math.exp(self.log_slope)

    @property
    def n(self):
        return float(np.clip(self.slope * self.predicted, *curve_filter.STEEPNESS))

    def older(self):
        grown = self.variance + self.walk**2 * PERIOD
        self.variance = min(grown, curve_filter.FIRST_DEVIATION**2)

    def guess(self, axles, before):
        """Keep the mean of k where the peaks moved from those `before`, as long as nothing was heard."""
        if self.heard_for == 0.0:
            self.log_slope += math.log(sum(before) / sum(a.peak for a in axles))
            guess = curve_filter.USUAL_STEEPNESS / self.slope
            self.top = float(np.clip(guess, *curve_filter.PEAK_SLIPS))
            if self.top < self.first:  # half way, in the logarithm, back to where it began
                self.top = math.exp(0.5 * (math.log(self.top) + math.log(self.first)))

    def hear(self, slip, e, told):
        self.heard_for += PERIOD * told
        e = max(e, -0.5)
        # (1 - x^2) / ((1 - x)^2 + slope slip) = e, the larger root where there is one
        x = np.roots([1.0 + e, -2.0 * e, e * (1.0 + self.slope * slip) - 1.0])
        missing = e * (1.0 + e) * self.slope * slip - 1.0
        x = max(float(np.max(x.real)), curve_filter.LEAST_X)
        top = float(np.clip(slip / x, *curve_filter.PEAK_SLIPS))
        share = (1.0 - math.exp(-PERIOD / curve_filter.SHAPE_TIME)) * told
        self.top = self.top ** (1.0 - share) * top**share
        if missing > 0.0:
            self.log_slope -= share * math.log(1.0 + missing)
        return missing > 0.0


class Unit:
    """The search, and what it asks of the axles."""

    def __init__(self, context, settings):
        self.context, self.s = context, settings.search
        self.axles = [Axle(context, settings) for _ in range(context.axles)]
        self.curve = Curve(settings)
        self.slip, self.swing = self.s.first, self.s.swing
        self.phase = slip_search.GOLDEN * context.unit
        self.limited_for, self.fresh = 0.0, True
        turning = 2.0 * math.pi / self.s.swing_time
        # the answer is behind by the filter of the pairs, by the motors, and by the rest of the loop
        passed = (1.0 + 1j * turning / settings.belief.pole) * (
            1.0 + 1j * turning * context.torque_lag
        )
        rest = cmath.exp(1j * turning * slip_search.ANSWER_LAG)
        self.answer = 1j * passed / abs(passed) * rest
        self.noise = (slip_search.FIRST_ERROR * 0.5 * self.s.memory * self.s.swing) ** 2
        self.elasticity = self.certainty = self.air = 0.0
        self.step_share, self.error, self.away, self.beyond = 1.0, 0.0, 0.0, False
        self.below = 0.0
        self.seen = set()

    def doubt_peaks(self, follows, felt):
        weakest = min(self.axles, key=lambda one: one.peak)
        left = search_step.FULL * weakest.peak - weakest.mu
        if follows:
            self.below = 0.0
        elif weakest.mu > weakest.peak:
            self.below += search_step.MORE * PERIOD
            self.seen.add("felt more")
        elif left < search_step.WITHIN_NOISE * felt:
            self.below += PERIOD
            self.seen.add("used up")
            if left >= 0.0:
                self.seen.add("used up but for noise")
        else:
            self.below = max(self.below - PERIOD, 0.0)
        if self.below > search_step.UNTESTED:
            self.seen.add("doubted peak")
            for a in self.axles:
                a.peak *= math.exp(search_step.DOUBTED_RISE * PERIOD)
                if a.peak > a.b.ceiling:
                    a.peak = a.b.ceiling
                    self.seen.add("doubted to the ceiling")

    def search(self, noise, limited):
        s = self.s
        felt = (
            self.axles[0].b.pole
            * self.context.inertia
            / (self.context.radius**2 * self.context.axle_load)
            * noise
        )
        self.phase += 2.0 * math.pi * PERIOD / s.swing_time
        lowest = max(s.lowest, s.noise_margin * noise)
        if self.curve.heard_for == 0.0:
            usual = slip_search.USUAL_SHARE * self.curve.top
            self.slip = min(max(usual, lowest), s.highest)
        if not limited:
            self.limited_for = 0.0
            for a in self.axles:
                a.mean = None
            self.seen.add("not limited")
            return
        self.limited_for += PERIOD
        heard = []
        for a in self.axles:
            kind = a.demodulate(self.phase, felt, noise, self.slip, self.swing)
            self.seen.add(kind)
            if kind == "none":
                continue
            heard.append(a)
            if kind != "heard":
                self.swing = max(self.swing, s.swing)
                self.step_share = 1.0
            if kind == "return":
                self.certainty = 0.0
        a = max(heard, key=lambda one: one.mean[0]) if heard else None
        slip = math.exp(a.mean[0]) if heard else 0.0
        follows = slip > slip_search.AT_LIMIT * self.slip
        told = self.certainty > search_step.HARDLY
        self.doubt_peaks(follows and (told or slip > slip_search.BINDS * self.slip), felt)
        if not heard:
            self.seen.add("nothing heard")
            return
        wanted = s.friction_price * self.slip
        along, across = (
            (a.of_slip * self.answer.conjugate()).real,
            (a.of_slip * self.answer.conjugate()).imag,
        )
        along = max(along, 0.0)
        coefficient = a.of_coefficient * self.answer.conjugate()
        share = 1.0 - math.exp(-PERIOD / slip_search.NOISE_TIME)
        rest = coefficient.imag - self.elasticity * across
        if follows or rest**2 < self.noise:
            self.noise += share * (rest**2 - self.noise)
        # power of white noise at the swing's frequency, through the filter of the pairs and the memory of the answer
        turning = 2.0 * math.pi / s.swing_time
        passed = abs(1.0 / (1.0 + 1j * turning / a.b.pole)) ** 2 * PERIOD * s.memory / 4.0
        doubt = slip_search.FOLLOWS * passed * (noise / slip) ** 2
        doubt += self.noise / slip_search.PRIOR**2 + 1e-12
        self.certainty = along**2 / (along**2 + doubt)
        alone = coefficient.real / max(along, 1e-9)
        self.elasticity = self.certainty * alone + (1.0 - self.certainty) * wanted
        if self.runs_away(noise):
            alone, self.elasticity, self.certainty = search_step.FALLING, search_step.FALLING, 1.0
            self.seen.add("runs away")
        swing = self.swing * math.exp(
            search_step.SWING_RATE * PERIOD * (search_step.GOAL - self.certainty)
        )
        most = max(s.swing, min(search_step.LARGEST_SWING, search_step.OVER_NOISE * noise / slip))
        self.swing = min(max(swing, s.least_swing), most)
        if self.limited_for > slip_search.SETTLED and follows:
            if s.seek:
                self.move(self.elasticity - wanted, noise / slip, lowest)
                self.seen.add("moved")
            if self.curve.hear(slip, alone, self.certainty):
                self.seen.add("too steep")

    def runs_away(self, noise):
        beyond = max(a.slip for a in self.axles) > (
            search_step.BEYOND * self.slip * (1.0 + self.swing) + 2.0 * noise
        )
        self.away *= math.exp(-PERIOD / search_step.AWAY_TIME)
        self.away += beyond and not self.beyond
        self.beyond = beyond
        return beyond and self.away > search_step.AGAIN

    def move(self, error, rough, lowest):
        s = self.s
        if error * self.error < -search_step.ROUNDING:
            self.step_share *= 1.0 - search_step.LOST * self.certainty
            self.seen.add("turned")
        self.error = error
        self.step_share *= 1.0 + search_step.RECOVERY * PERIOD * self.certainty
        least = max(search_step.LEAST_STEP_SHARE, min((self.curve.n / search_step.WIDE) ** 2, 1.0))
        self.step_share = float(np.clip(self.step_share, least, 1.0))
        far = max(self.elasticity - search_step.FAR_BELOW, 0.0)
        step = self.step_share * self.certainty * s.gain * error
        rate = float(
            np.clip(step, -s.fastest_fall, s.fastest_rise * (1.0 + search_step.EAGER * far))
        )
        if search_step.OVER_NOISE * rough > s.swing and self.away < search_step.SELDOM:
            rate += search_step.EXPLORE * max(1.0 - self.certainty / search_step.HARDLY, 0.0)
            self.seen.add("on trial")
        self.slip = min(max(self.slip * math.exp(PERIOD * rate), lowest), s.highest)

    def update(self, speed, omega, torque, wanted, estimate, load):
        for i, a in enumerate(self.axles):
            a.observe(speed, omega[i], torque, load[i], self.fresh)
        self.fresh = False
        share = 1.0 - math.exp(-PERIOD / air_brake.AIR_TIME)
        more = estimate - np.mean([a.mu for a in self.axles])
        self.air = 0.0 if math.isnan(more) else (1.0 - share) * self.air + share * more
        if self.air > air_brake.LEAST_AIR:
            self.seen.add("air")
            for a in self.axles:
                a.mu += self.air
        noise = float(np.mean([a.noise for a in self.axles]))
        self.curve.older()
        before = [a.peak for a in self.axles]
        for a in self.axles:
            if a.estimate(noise, self.curve):
                self.seen.add("doubt")
        self.curve.guess(self.axles, before)
        self.search(noise, torque < slip_search.LIMITING * wanted)
        if not self.s.seek:
            top = self.context.curve.limit(min(a.peak for a in self.axles), speed)[1]
            self.slip = self.s.given_share * float(top)
        self.curve.predicted = max(self.curve.top, curve_filter.REACH * self.slip)
