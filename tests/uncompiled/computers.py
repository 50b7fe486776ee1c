"""The train's computers written a second time, in arrays and queues; only equipment and settings are shared.

`Computers` takes one control period at a time. Names are those of `alloc.onboard.state`. The reference speed is given to
it; the estimate of it is tested in `tests/onboard/test_reference_speed.py`.
"""

import math

import numpy as np

from alloc.rules.rule import Trigger

GRAVITY = 9.80665


class Line:
    """Telegrams to one receiver, who believes the one that was sent last."""

    def __init__(self, nothing):
        self.queue, self.sent, self.heard, self.read = [], -math.inf, 0.0, nothing

    def receive(self, time):
        arrived = [item for item in self.queue if item[0] <= time + 1e-9]
        self.queue = [item for item in self.queue if item[0] > time + 1e-9]
        if arrived:
            self.heard = time
            _, sent, told = max(arrived, key=lambda item: item[1])
            if sent > self.sent:
                self.sent, self.read = sent, told


class Computers:
    """What `sense`, the reports, `prepare_allocation`, `distribute` and the actuation do."""

    def __init__(self, eq, st, speed, expected):
        self.eq, self.st = eq, st
        n, bodies = eq.axles.size, eq.axle_body.max() + 1
        self.reference = np.full(bodies, speed)
        self.speed, self.differentiator = np.full(n, speed), np.full(n, speed)
        self.observer, self.observer_input = np.full(n, np.nan), np.zeros(n)
        self.axles_seen, self.slipping = eq.axles.copy(), np.zeros(n)
        self.torque_command, self.foreseen = np.zeros(n), np.zeros(n)
        self.taken, self.kept = np.full(n, np.inf), np.ones(n)
        self.air_there = np.zeros(n)
        self.air, self.rise, self.target = np.zeros(n), np.zeros(n), np.zeros(n)
        self.coefficient, self.limit = np.zeros(n), np.full(n, expected)
        self.expected, self.brake_rise = expected, 0.0
        self.slipped = self.detected = -math.inf
        self.estimate = self.case = 0.0
        self.limit_wanted, self.delivered = np.full(n, expected), np.full(n, expected)
        self.cap, self.most, self.limit_max = np.full(n, expected), np.zeros(n), np.full(n, np.inf)
        self.first = 0
        self.fallen_back = np.zeros(n)
        self.orders = [Line(np.inf) for _ in range(n)]
        # what each would report: delivered, limited by what, last slip; coefficient at its last detection and when
        self.own = [(expected, "", -math.inf, math.nan, -math.inf)] * n
        self.found = [(math.nan, -math.inf)] * n
        self.counted = [-math.inf] * n
        self.increment, self.spread = eq.learnt.increment.copy(), eq.learnt.deviation.copy()
        self.behind, self.new = eq.learnt.behind.copy(), [[] for _ in range(n)]
        self.stored_anew, self.data = np.zeros(n), []
        self.heard_of = np.full(n, -np.inf)
        self.reports = [Line(self.own[j]) for j in range(n)]
        self.limited_at, self.by_rail = np.full(n, -np.inf), np.zeros(n, bool)
        self.slipped_at = np.full(n, -np.inf)
        self.gained, self.before = 0.0, speed
        self.marks, self.upper_bound = np.full(n, np.inf), np.full(n, np.inf)
        self.counts = dict.fromkeys(
            ("detections", "unit_detections", "telegrams_sent", "telegrams_lost", "fallbacks", "blinded"), 0
        )  # fmt: skip

    # --- sensing

    def sense(self, time, commanded, omega, torque, pressure, noise, in_service):
        eq, st, d = self.eq, self.st, self.st.detector
        n = eq.axles.size
        self.sign = sign = -1.0 if commanded < 0.0 else 1.0
        self.blended = eq.blended and commanded < 0.0
        self.in_service = in_service
        dropout = st.sensors.dropout
        gone = (dropout.begin <= time) & (time < dropout.until)
        seen = ~np.isin(np.arange(eq.axle_unit.size), dropout.axle[gone])
        count = np.array([(seen & (eq.axle_unit == j)).sum() for j in range(n)], dtype=float)
        if dropout.axle.size:
            anew = count != self.axles_seen
            self.differentiator[anew] = self.observer[anew] = np.nan
            self.counts["blinded"] += int(((self.axles_seen > 0) & (count == 0)).sum())
            self.axles_seen = count
        self._speeds(omega, noise, seen)
        rim = eq.axle_radius * self.axle_omega
        slip = sign * (rim - self.reference[eq.axle_body])
        self.worst_slip = np.array([slip[eq.axle_unit == j].max() for j in range(n)])
        anew = np.isnan(self.differentiator)
        self.differentiator[anew] = self.speed[anew]
        self.acceleration = d.pole * (self.speed - self.differentiator)
        self.differentiator += (1.0 - math.exp(-d.pole * st.period)) * (
            self.speed - self.differentiator
        )
        self._air_brakes(pressure)
        self._coefficients(torque)
        self._detect(time, commanded)
        kmh = np.abs(self.speed) * 3.6
        tables = [[np.interp(x, np.arange(t.size), t) for x, t in zip(kmh, kind, strict=True)]
                  for kind in (eq.drive_table, eq.brake_table)]  # fmt: skip
        self.drive_limit, self.brake_limit = np.array(tables).reshape(2, n)
        bound = self.drive_limit if sign > 0.0 else self.brake_limit
        at_rail = bound * eq.gear / eq.radius / eq.axle_load / (1.0 + eq.own_inertia)
        self.limit_max = np.full(n, np.inf) if self.blended else np.where(in_service, at_rail, 0.0)

    def _speeds(self, omega, noise, seen):
        eq, sensors = self.eq, self.st.sensors
        rim = eq.axle_radius * omega + noise
        if sensors.speed_quantum > 0.0:
            rim = sensors.speed_quantum * np.floor(rim / sensors.speed_quantum + 0.5)
        for j in range(eq.axles.size):
            read = rim[seen & (eq.axle_unit == j)]
            mean = read.mean() if read.size else self.reference[eq.unit_body[j]]
            share = 1.0 - math.exp(-sensors.pole * self.st.period) if sensors.pole else 1.0
            self.speed[j] += share * (mean - self.speed[j])
        for i, j in enumerate(eq.axle_unit):
            if j >= 0 and (sensors.pole or not seen[i]):
                rim[i] = self.speed[j]
            elif not seen[i]:
                rim[i] = self.reference[eq.axle_body[i]]
        self.axle_omega = rim / eq.axle_radius

    def _air_brakes(self, pressure):
        eq = self.eq
        self.air_there = self.air.copy()
        if not (self.blended and self.st.brakes.by_pressure):
            return
        shod = eq.axle_group >= 0
        g = eq.axle_group[shod]
        a, b, c = eq.group.friction[g].T
        rim = (eq.axle_radius * self.axle_omega)[shod]
        force = eq.group.gain[g] * pressure[g] * (a / (3.6 * np.abs(rim) + b) + c)
        for j in range(eq.axles.size):
            own = eq.axle_unit == j
            self.air_there[j] = force[own[shod]].sum() / own.sum()

    def _coefficients(self, torque):
        eq, o = self.eq, self.st.observer
        turning = o.pole * eq.inertia * self.speed / eq.radius
        value = torque * eq.gear + turning
        fresh = np.isnan(self.observer)
        self.observer[fresh] = self.observer_input[fresh] = value[fresh]
        self.observer = o.keep * self.observer + o.old * self.observer_input + o.new * value
        self.observer_input = value
        self.coefficient = self.sign * (self.observer - turning) / (eq.axle_load * eq.radius)
        self.torque = torque
        if self.blended:
            if not self.st.brakes.inertia_in_estimate:
                self.coefficient = -torque * eq.gear / eq.radius / eq.axle_load
            self.coefficient = self.coefficient + self.air_there / eq.axle_load

    def _detect(self, time, commanded):
        d, along = self.st.detector, self.sign * self.acceleration
        self.allocate = False
        for j in range(self.eq.axles.size):
            was, slip = self.slipping[j], self.worst_slip[j]
            on = along[j] > d.on or slip > d.speed_on
            off = along[j] <= d.off and slip < 0.5 * d.speed_on
            self.slipping[j] = 1.0 if on else 0.0 if off else was
            if self.slipping[j] and commanded:
                self.slipped = time
            if self.slipping[j] and not was:
                self.counts["unit_detections"] += 1
                if commanded and self.in_service[j] and self.axles_seen[j]:
                    self.found[j] = (float(np.clip(self.coefficient[j], 0.0, 1.0)), time)
                if j == self.first and commanded:
                    self.counts["detections"] += 1
                    self.estimate, self.detected = (
                        float(np.clip(self.coefficient[j], 0.0, 1.0)),
                        time,
                    )
                    self.allocate = True

    # --- telegrams

    def _send(self, lines, told, time, tick, delay, fate):
        """Tell each line's receiver; the leader's own is told at once."""
        t = self.st.telegrams
        for j, line in enumerate(lines):
            if j == self.first:
                line.sent, line.heard, line.read = time, time, told[j]
                continue
            if tick % t.ticks == 0:
                self.counts["telegrams_sent"] += 1
                if fate[j] < t.loss:
                    self.counts["telegrams_lost"] += 1
                else:
                    line.queue.append((time + t.latency + t.jitter * delay[j], time, told[j]))
            line.receive(time)

    def report(self, time, tick, commanded, delay, fate, factor, relieved, sliding):
        """`factor`: of the targets; `relieved`: units that are relieved; `sliding`: whose slide protection acts."""
        eq, gain = self.eq, self.st.period / (0.2 + self.st.period)
        self.relieved = relieved
        self.gained += gain * ((self.reference[0] - self.before) / self.st.period - self.gained)
        self.before = self.reference[0]
        reached = float(np.clip(self.gained / commanded, 0.0, 1.0)) if commanded else 0.0
        turning = eq.brake_inertia if self.blended else eq.own_inertia
        at_rail = np.maximum(self.coefficient, 0.0) + turning * reached * self.expected
        wanted = np.abs(self.target) * eq.gear / (eq.axle_load * eq.radius)
        rail = (factor < 0.985) & (wanted > 0.5 * self.expected) | (sliding & self.blended)
        limited = np.where(rail, "rail", "")
        helped = self.in_service | self.blended
        limited[~helped | (self.axles_seen == 0.0)] = "self"
        for j in range(factor.size):
            if not (relieved[j] and self.in_service[j]):
                old, new = self.own[j][0], at_rail[j] / (1.0 + turning[j])
                by = limited[j] if commanded else ""
                slipped = time if self.slipping[j] else self.own[j][2]
                self.own[j] = (old + gain * (new - old), by, slipped)
            self.own[j] = (*self.own[j][:3], *self.found[j])
        self._send(self.reports, self.own, time, tick, delay, fate)
        told = [line.read for line in self.reports]
        self.delivered, by, self.slipped_at, self.told_estimate, self.told_at = map(
            np.array, zip(*told, strict=True)
        )
        self.limited = by != ""
        self.by_rail = np.where(self.limited, by == "rail", self.by_rail)
        sent = np.array([line.sent for line in self.reports])
        self.limited_at = np.where(self.limited, sent, self.limited_at)
        self.slips = self.slipped_at > sent - self.st.telegrams.ticks * self.st.period

    # --- distribution

    def prepare(self, time, tick, commanded, failed):
        eq, st = self.eq, self.st
        share = eq.brake_share if self.blended else eq.planned_share
        changed, self.expected = share * abs(commanded) != self.expected, share * abs(commanded)
        before = self.first
        working = np.flatnonzero(self.in_service)
        self.first = int(working[0]) if working.size else eq.axles.size - 1
        self.estimate += self.increment[self.first] - self.increment[before]
        if st.learning.learner:
            self._learn(time)
        on_telegram = tick % st.telegrams.ticks == 0
        if st.rule.trigger == Trigger.ANY_SLIP:
            before = list(self.counted)
            self.counted = [at if time - at <= st.hold_time else -math.inf for at in self.told_at]
            active = max(self.counted) > -math.inf
            asked = changed or self.counted != before
            if active and self.expected:
                self.cap = self._caps_of_slips()
        elif st.rule.trigger >= Trigger.SLIP:
            stepwise = st.rule.trigger == Trigger.SLIPPING
            active = time - (self.slipped if stepwise else self.detected) <= st.hold_time
            asked = changed or (on_telegram if stepwise else self.allocate)
            self.cap = self.estimate + self.increment - self.increment[self.first]
            self.cap = np.maximum(self.cap, 0.0)
            if st.learning.learner:
                recent = time - self.heard_of <= st.hold_time
                self.cap = np.where(recent, self.told_estimate, self.cap)
        else:
            recent = (time - self.limited_at < 1.0) | ~(self.in_service | self.blended)
            active = (recent | (self.limit_max < self.expected)).any()
            asked = on_telegram or failed or changed
        if self.expected == 0.0 or not active:
            self.limit_wanted[:], self.case = self.expected, 0.0
            self.marks[:] = self.upper_bound[:] = np.inf
            return False
        if asked and st.rule.trigger < Trigger.SLIP:
            self._find_caps(recent, time)
        return asked

    def _caps_of_slips(self):
        slipped = np.isfinite(self.counted)
        front = int(np.flatnonzero(slipped)[0])
        implied = self.told_estimate[front] + self.increment - self.increment[front]
        caps = np.where(slipped, self.told_estimate, np.maximum(implied, 0.0))
        caps[:front] = self.expected
        return caps

    def _learn(self, time):
        s, first = self.st.learning, self.first
        asked = self.torque_command[first]
        follows = asked != 0.0 and self.torque[first] / asked >= 0.5
        able = self.in_service[first] and self.axles_seen[first] > 0 and not self.relieved[first]
        base = self.estimate if s.held else self.coefficient[first]
        for j, line in enumerate(self.reports):
            shown, at = (self.own[j] if j == first else line.read)[3:]
            if not at > self.heard_of[j]:
                continue
            self.heard_of[j] = at
            self.allocate |= j != first
            in_force = time - self.detected <= self.st.hold_time
            known = in_force if s.held else able and follows
            if j == first or not known or time - at > self.st.hold_time:
                continue
            datum = shown - base + self.increment[first]
            self.data.append((j, datum))
            if s.learner == 2:
                prior, noise = self.spread[j] ** 2 + s.drift, s.noise**2 + self.spread[first] ** 2
                precision = 1.0 / prior + 1.0 / noise
                self.increment[j] = (self.increment[j] / prior + datum / noise) / precision
                self.spread[j] = precision**-0.5
                continue
            self.new[j].append(datum)
            if len(self.new[j]) == (s.further if self.stored_anew[j] else s.first):
                total = self.increment[j] * self.behind[j] + sum(self.new[j])
                self.behind[j] += len(self.new[j])
                self.increment[j] = total / self.behind[j]
                self.new[j], self.stored_anew[j] = [], self.stored_anew[j] + 1

    def _find_caps(self, recent, time):
        eq, st = self.eq, self.st
        step = 0.6 * self.expected * st.telegrams.ticks * st.period / st.rise_time
        self.most = np.minimum(self.limit_max, np.maximum(self.limit_wanted, self.expected) + step)
        period, got = st.telegrams.ticks * st.period, self.delivered
        weight = period / 5.0
        known = np.where(np.isinf(self.marks), got, self.marks)
        fallen = (1.0 - weight) * known + weight * got
        held = self.slipped_at >= self.limited_at - st.hold_time
        risen = self.marks + 0.01 * self.expected * period
        self.marks = np.maximum(got, np.where(self.limited, fallen, risen))
        tried = self.limited | ~held
        self.upper_bound = np.where(tried, np.maximum(self.marks, 1.06 * got), self.marks)
        itself = recent & ~self.by_rail
        bound = np.where(itself, np.minimum(self.limit_max, got), self.limit_max)
        spare = bound > self.expected
        short = (eq.mass * (self.expected - bound))[bound < self.expected].sum()
        open_cap = self.expected + (short / eq.mass[spare].sum() if spare.any() else 0.0)
        by_front = np.full(recent.size, open_cap)
        sound = np.flatnonzero(recent & self.in_service & self.by_rail)
        if sound.size:
            base = self.marks[sound[0]] - self.increment[sound[0]]
            by_front = np.maximum(base + self.increment, 0.0)
        least = np.minimum(self.marks, np.maximum(self.expected, got))
        free = np.where(self.slips, by_front, np.maximum(by_front, least))
        slipped = time - self.slipped_at <= st.hold_time
        held = np.where(slipped, 0.995 * self.marks, self.upper_bound)
        works = self.in_service | self.blended
        kept = np.minimum(np.where(works, got, held), self.expected)
        held = np.where(self.by_rail & works, held, kept)
        self.cap = np.where(recent & np.isfinite(self.marks), held, free)

    def distribute(self, time, tick, delay, fate):
        now = self.limit_wanted.copy() if self.case else np.full(self.limit_wanted.size, np.inf)
        self._send(self.orders, now, time, tick, delay, fate)
        for j, line in enumerate(self.orders):
            if j == self.first:
                continue
            if line.heard == time:
                self.fallen_back[j] = 0.0
            if time - line.heard > self.st.telegrams.silence:
                self.counts["fallbacks"] += int(self.fallen_back[j] == 0.0)
                self.fallen_back[j], line.read = 1.0, np.inf
        self.received = np.array([line.read for line in self.orders])
        self.limit = np.where(np.isinf(self.received), self.expected, self.received)
        if self.st.rule.trigger < Trigger.SLIP:
            blind = self.axles_seen == 0.0
            self.limit[blind] = np.maximum(self.limit[blind], self.expected)

    # --- actuation

    def targets(self, commanded):
        eq, st = self.eq, self.st
        per_coefficient = (1.0 + eq.own_inertia) * eq.axle_load * eq.radius / eq.gear
        step = self.expected * per_coefficient * st.period / st.rise_time
        bound = self.drive_limit if self.sign > 0.0 else self.brake_limit
        wanted = np.minimum(self.limit * per_coefficient, bound)
        self.rise = np.minimum(wanted, self.rise + step) if commanded else np.zeros_like(step)
        self.target, self.air, self.brake_rise = self.sign * self.rise, np.zeros_like(step), 0.0
        self.taken, self.kept = np.full_like(step, np.inf), np.ones_like(step)

    def brake_targets(self):
        eq, st = self.eq, self.st
        per_coefficient = (1.0 + eq.brake_inertia) * eq.axle_load * eq.radius / eq.gear
        full = self.expected * per_coefficient * st.period
        self.rise = np.minimum(self.limit * per_coefficient, self.rise + full / st.rise_time)
        rim, electric = eq.gear / eq.radius, np.maximum(-self.torque, 0.0)
        slow = full / st.brakes.blend_time
        foreseen = np.minimum.reduce([-self.foreseen, self.rise, self.brake_limit])
        refused = foreseen > electric + 2.0 * slow
        self.taken = np.maximum(np.where(refused, electric, self.taken), electric + slow)
        self.taken = np.where(self.in_service, self.taken, 0.0)
        motors = np.minimum.reduce([self.rise, self.brake_limit, self.taken])
        left = np.ones_like(motors)
        np.divide(-self.torque_command, motors, out=left, where=motors > 0.0)
        # over a second, about one half
        self.kept = np.clip(self.kept + st.period * (left - 0.5), 0.0, 1.0)
        self.air = self.kept * (self.rise - motors) * rim
        # beside what the cylinders give, at once
        beside = np.maximum(self.rise - self.air_there / rim, 0.0)
        motors = np.where(np.isfinite(self.received) & self.in_service, beside, motors)
        self.target = -np.minimum(motors, self.brake_limit)
        self.brake_rise = min(self.brake_rise + st.period / st.rise_time, 1.0)

    def foresee(self, applied):
        self.foreseen = self.foreseen + self.eq.response * (applied - self.foreseen)

    def restrain(self):
        self.target = np.where(
            self.axles_seen == 0.0, self.st.sensors.blind_share * self.target, self.target
        )

    def pressures(self, braking):
        eq = self.eq
        found = np.zeros(eq.group.unit.size)
        for g in range(found.size if braking else 0):
            kmh = 3.6 * max(self.reference[eq.group.body[g]], 1.0)
            a, b, c = eq.group.friction[g]
            planned = (
                self.expected * self.brake_rise * eq.group.weight[g] * (1.0 + eq.group.inertia[g])
            )
            force = self.air[eq.group.unit[g]] if eq.group.unit[g] >= 0 else planned
            found[g] = min(force / (eq.group.gain[g] * (a / (kmh + b) + c)), eq.group.pressure[g])
        return found
