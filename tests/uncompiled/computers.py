"""The train's computers written a second time, in arrays and queues; only equipment and settings are shared.

`Computers` takes one control period at a time. Names are those of `alloc.onboard.memory`. The reference speed is given to
it; the estimate of it is tested in `tests/onboard/test_reference_speed.py`.
"""

import math

import numpy as np

GRAVITY = 9.80665


class Computers:
    """What `sense`, `prepare_allocation`, `distribute` and the actuation do."""

    def __init__(self, eq, st, speed, expected):
        self.eq, self.st = eq, st
        n, bodies = eq.axles.size, eq.axle_body.max() + 1
        self.reference = np.full(bodies, speed)
        self.speed, self.differentiator = np.full(n, speed), np.full(n, speed)
        self.observer, self.observer_input = np.full(n, np.nan), np.zeros(n)
        self.axles_seen, self.slipping = eq.axles.copy(), np.zeros(n)
        self.torque_command = np.zeros(n)
        self.air_there = np.zeros(n)
        self.air, self.rise, self.target = np.zeros(n), np.zeros(n), np.zeros(n)
        self.coefficient, self.limit = np.zeros(n), np.full(n, expected)
        self.expected, self.brake_rise = expected, 0.0
        self.slipped = self.detected = -math.inf
        self.estimate = self.case = 0.0
        self.limit_wanted, self.delivered = np.full(n, expected), np.full(n, expected)
        self.received, self.last_heard = np.full(n, np.inf), np.zeros(n)
        self.fallen_back = np.zeros(n)
        self.mail = [[] for _ in range(n)]
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
        self.first = int(np.argmax(in_service)) if in_service.any() else n - 1
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
        if sensors.quantum > 0.0:
            rim = sensors.quantum * np.floor(rim / sensors.quantum + 0.5)
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
        a, b, c = eq.group.friction.T
        friction = a / (3.6 * np.abs(self.reference[eq.group.body]) + b) + c
        of_group = eq.group.gain * pressure * friction
        for j in range(eq.axles.size):
            groups = eq.axle_group[eq.axle_unit == j]
            self.air_there[j] = of_group[groups[groups >= 0]].sum() / groups.size

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
                if j == self.first and commanded:
                    self.counts["detections"] += 1
                    self.estimate, self.detected = (
                        float(np.clip(self.coefficient[j], 0.0, 1.0)),
                        time,
                    )
                    self.allocate = True

    # --- distribution

    def prepare(self, time, tick, commanded):
        eq, st = self.eq, self.st
        share = eq.brake_share if self.blended else eq.planned_share
        changed, self.expected = share * abs(commanded) != self.expected, share * abs(commanded)
        held = time - (self.slipped if st.rule.periodic else self.detected) <= st.hold_time
        self.cap = np.maximum(self.estimate + eq.increment - eq.increment[self.first], 0.0)
        if self.expected == 0.0 or not (held or st.rule.needs_truth):
            self.limit_wanted[:], self.case = self.expected, 0.0
            return False
        return changed or (tick % st.telegrams.ticks == 0 if st.rule.periodic else self.allocate)

    def distribute(self, time, tick, delay, fate):
        t = self.st.telegrams
        now = self.limit_wanted if self.case else np.full(self.limit_wanted.size, np.inf)
        others = [j for j in range(now.size) if j != self.first]
        if tick % t.ticks == 0:
            self.delivered = self.coefficient.copy()
            self.counts["telegrams_sent"] += len(others)
            for j in others:
                if fate[j] < t.loss:
                    self.counts["telegrams_lost"] += 1
                else:
                    self.mail[j].append((time + t.latency + t.jitter * delay[j], now[j]))
        self.received[self.first], self.last_heard[self.first] = now[self.first], time
        for j in others:
            arrived = sorted(item for item in self.mail[j] if item[0] <= time + 1e-9)
            self.mail[j] = [item for item in self.mail[j] if item not in arrived]
            if arrived:
                self.received[j], self.last_heard[j] = arrived[-1][1], time
                self.fallen_back[j] = 0.0
            if time - self.last_heard[j] > t.silence:
                self.counts["fallbacks"] += int(self.fallen_back[j] == 0.0)
                self.fallen_back[j], self.received[j] = 1.0, np.inf
        self.limit = np.where(np.isinf(self.received), self.expected, self.received)

    # --- actuation

    def targets(self, commanded):
        eq, st = self.eq, self.st
        per_coefficient = (1.0 + eq.own_inertia) * eq.axle_load * eq.radius / eq.gear
        step = self.expected * per_coefficient * st.period / st.rise_time
        bound = self.drive_limit if self.sign > 0.0 else self.brake_limit
        wanted = np.minimum(self.limit * per_coefficient, bound)
        self.rise = np.minimum(wanted, self.rise + step) if commanded else np.zeros_like(step)
        self.target, self.air, self.brake_rise = self.sign * self.rise, np.zeros_like(step), 0.0

    def brake_targets(self):
        eq, st = self.eq, self.st
        per_coefficient = (1.0 + eq.brake_inertia) * eq.axle_load * eq.radius / eq.gear
        full = self.expected * per_coefficient * st.period
        self.rise = np.minimum(self.limit * per_coefficient, self.rise + full / st.rise_time)
        for j in range(self.rise.size):
            rim, pattern = eq.gear[j] / eq.radius[j], self.rise[j]
            electric = max(-self.torque[j], 0.0)
            slow = electric + full[j] / st.brakes.blend_time
            motors = min(pattern, self.brake_limit[j], max(pattern - self.air[j] / rim, slow))
            asked = min(-self.torque_command[j], motors)
            self.air[j] = (pattern - motors + (asked - electric if asked > electric else 0.0)) * rim
            if math.isfinite(self.received[j]):  # beside what the cylinders give, at once
                motors = np.clip(pattern - self.air_there[j] / rim, 0.0, self.brake_limit[j])
            self.target[j] = -motors
        self.brake_rise = min(self.brake_rise + st.period / st.rise_time, 1.0)

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
