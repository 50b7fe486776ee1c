"""Built-in readhesion controllers of units equal their second transcription, driving and braking, under random signals."""

import math
from types import SimpleNamespace

import numpy as np
import pytest

from alloc.onboard.controllers.collection import BUILT_IN, RESERVE, control
from alloc.onboard.controllers.creep import move_reference
from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import Onboard
from alloc.onboard.state import RuleSettings, memory, settings
from alloc.plant.model import build
from alloc.plant.rail import Rail
from tests.cases import looped
from tests.onboard.uneven import uneven_train

MODEL = build(uneven_train(), Rail(0.15))


ONBOARD = Onboard()


EQ = equipment(MODEL, ONBOARD)


TORQUE = EQ.axle_load * EQ.radius / EQ.gear


"""Of a coefficient of 1, by unit."""


PERIOD = ONBOARD.period


VALVE = ((0, 0, 1), (0, 1, 2), (1, 2, 2))


"""Action of the slide protection's valve by slip, rows, and slip rate."""


class Nothing:
    """Follows its target."""

    def __init__(self, j):
        self.j, self.torque = j, 0.0

    def decide(self, s):
        return s["target"], 1.0


class Cut(Nothing):
    """Cut, hold, ramp."""

    phase, clock, base = "follow", 0.0, 0.0

    def decide(self, s):
        p, carried = ONBOARD.cut_and_ramp, s["coefficient"] * TORQUE[self.j]
        self.clock += PERIOD
        if s["slipping"] and self.phase != "cut":
            self.phase, self.clock = "cut", 0.0
            carried -= s["air"] * EQ.radius[self.j] / EQ.gear[self.j]
            self.base = float(np.clip(carried, 0.0, s["target"]))
        elif self.phase == "cut" and not s["slipping"]:
            self.phase, self.clock = "hold", 0.0
        elif self.phase == "hold" and self.clock >= p.hold:
            self.phase = "ramp"
        elif self.phase == "ramp" and self.torque >= s["target"]:
            self.phase = "follow"
        self.torque = {
            "cut": p.cut * self.base if self.clock < 3.0 else 0.0,
            "hold": p.recover * self.base,
            "ramp": self.torque + s["expected"] * TORQUE[self.j] / p.ramp * PERIOD,
            "follow": s["target"],
        }[self.phase]
        self.torque = min(self.torque, s["target"])
        return self.torque, self.torque / s["target"] if s["target"] else 1.0


class Creep(Nothing):
    """PI control of slip."""

    allowed, share = math.nan, 1.0

    def reference(self, s):
        return ONBOARD.creep.reference

    def decide(self, s):
        p, ceiling, reference = ONBOARD.creep, s["target"] / TORQUE[self.j], self.reference(s)
        allowed = ceiling if math.isnan(self.allowed) else self.allowed
        error = reference - s["slip"]
        self.allowed = float(np.clip(allowed + p.integral * error * PERIOD, 0.0, ceiling))
        torque = (
            float(np.clip(self.allowed + p.proportional * error, 0.0, ceiling)) * TORQUE[self.j]
        )
        self.share = torque / s["target"] if s["target"] else 1.0
        return torque, self.share


class Search(Creep):
    """Creep control whose reference moves."""

    def __init__(self, j, parameters, step):
        super().__init__(j)
        self.p, self.step = parameters, step
        self.held, self.last_step, self.last, self.means, self.clock = 0.0, 0.0, None, [], 0.0

    def reference(self, s):
        if math.isnan(self.allowed):
            self.held = ONBOARD.creep.reference
        if self.share >= 0.999:
            self.clock, self.means, self.last = 0.0, [], None
            return self.held
        self.clock += PERIOD
        if self.clock > 0.5 * self.p.interval:
            self.means.append((s["coefficient"], s["slip"]))
        if self.clock >= self.p.interval:
            now = np.mean(self.means, axis=0)
            change = None if self.last is None else now - self.last
            step = self.step(self.p, self.last_step, change)
            wanted = self.held + step
            inside = self.p.lowest <= wanted <= self.p.highest
            self.last_step, self.held = (
                step if inside else -step,
                float(np.clip(wanted, self.p.lowest, self.p.highest)),
            )
            self.clock, self.means, self.last = 0.0, [], now
        return self.held


def perturbed(p, last, change):
    if change is None:
        return math.copysign(p.step, last)
    return p.step * (1.0 if last >= 0.0 else -1.0) * (-1.0 if change[0] < 0.0 else 1.0)


def climbing(p, last, change):
    if change is None or abs(change[1]) < 0.3 * p.least:
        return math.copysign(p.least, last)
    slope = p.gain * change[0] / change[1]
    return math.copysign(np.clip(abs(slope), p.least, p.largest), slope)


class Table(Nothing):
    """Torque factor by the deviation of acceleration, behind an asymmetric lag."""

    filtered = math.nan

    def decide(self, s):
        p = ONBOARD.table
        if math.isnan(self.filtered):
            self.filtered, self.torque = s["speed"], s["command"]
        acceleration = (s["speed"] - self.filtered) / p.time_constant
        self.filtered += (1.0 - math.exp(-PERIOD / p.time_constant)) * (s["speed"] - self.filtered)
        deviation = s["sign"] * acceleration - abs(s["commanded"])
        factor = float(np.clip((p.margin + p.width - deviation) / p.width, 0.0, 1.0))
        lag = p.rise if factor * s["target"] > self.torque else p.fall
        self.torque += (1.0 - math.exp(-PERIOD / lag)) * (factor * s["target"] - self.torque)
        return self.torque, factor


class FuzzyTorque(Nothing):
    """Fuzzy inference of slip and slip rate."""

    allowed, filtered = math.nan, 0.0

    def decide(self, s):
        p, ceiling = ONBOARD.fuzzy_creep, s["target"] / TORQUE[self.j]
        if math.isnan(self.allowed):
            self.allowed, self.filtered = ceiling, s["slip"]
        rate = p.pole * (s["slip"] - self.filtered)
        self.filtered += (1.0 - math.exp(-p.pole * PERIOD)) * (s["slip"] - self.filtered)
        rows, columns = (0.0, p.reference, p.large), (-p.rate, 0.0, p.rate)
        weight = [np.interp(s["slip"], rows, row) for row in np.eye(3)]
        action = weight @ np.array(VALVE) @ [np.interp(rate, columns, row) for row in np.eye(3)]
        self.allowed += PERIOD * p.change * (1.0 - action)
        self.allowed = float(np.clip(self.allowed, 0.0, ceiling))
        return self.allowed * TORQUE[self.j], self.allowed / ceiling if ceiling else 1.0


def inferred(last, change):
    p = ONBOARD.fuzzy_tracking
    if change is None:
        return math.copysign(p.least, last)
    rise, way = np.clip(change[0] / p.coefficient, -1, 1), np.clip(change[1] / p.way, -1, 1)
    wanted = p.largest * rise * way
    if wanted == 0.0:
        return -math.copysign(p.least, last)
    return math.copysign(max(abs(wanted), p.least), wanted)


class Draws:
    """Park and Miller's generator of a unit."""

    def __init__(self, j, seed):
        self.state = 1 + (seed * 1000003 + (j + 1) * 48271) % 2147483646
        self(), self()

    def __call__(self):
        self.state = self.state * 48271 % 2147483647
        return self.state / 2147483647


class Tried(Search):
    """Particles that are held in turn."""

    def __init__(self, j):
        super().__init__(j, ONBOARD.perturb_observe, self.next_step)
        self.draw, self.turn, self.particles = Draws(j, int(ONBOARD.swarm_tracking.seed)), -1, []

    def clip(self, place):
        return min(max(place, self.p.lowest), self.p.highest)

    def scatter(self):
        spread = ONBOARD.swarm_tracking.spread
        places = [self.clip(self.held + spread * away) for away in (0.0, 1.0, -1.0)]
        self.particles = [[place, 0.0, place, -math.inf] for place in places]
        self.turn = 0

    def leader(self):
        return max(self.particles, key=lambda one: one[3])[2]

    def next_step(self, p, last_step, change):
        s, coefficient = ONBOARD.swarm_tracking, np.mean(self.means, axis=0)[0]
        if self.turn < 0 or change is None:
            self.scatter()
        elif self.turn == 3:
            if abs(change[0]) > s.change * abs(self.last[0]):
                self.scatter()
        else:
            one = self.particles[self.turn]
            if coefficient > one[3]:
                one[3], one[2] = coefficient, one[0]
            self.turn += 1
            if self.turn == 3:
                leader = self.leader()
                for one in self.particles:
                    own, common = self.draw(), self.draw()
                    speed = (
                        0.6 * one[1]
                        + 1.2 * own * (one[2] - one[0])
                        + 1.2 * common * (leader - one[0])
                    )
                    place = self.clip(one[0] + speed)
                    one[1], one[0], one[3] = place - one[0], place, one[3] * s.keep
                if max(abs(one[0] - leader) for one in self.particles) > s.gathered:
                    self.turn = 0
        return (self.leader() if self.turn == 3 else self.particles[self.turn][0]) - self.held


class Fitted(Search):
    """A swarm of curves."""

    def __init__(self, j):
        super().__init__(j, ONBOARD.perturb_observe, self.next_step)
        self.draw, self.points = Draws(j, int(ONBOARD.swarm_slip.seed)), []

    def misfit(self, curve):
        return sum(
            (c - 2.0 * curve[0] * (s / curve[1]) / (1.0 + (s / curve[1]) ** 2)) ** 2
            for c, s in self.points
        )

    def next_step(self, p, last_step, change):
        now = np.mean(self.means, axis=0)
        if change is None:
            self.points = []
            shares = [(i + self.draw()) / 8 for i in range(8)]
            optima = [p.lowest * (p.highest / p.lowest) ** share for share in shares]
            self.now = [np.array([np.clip(now[0], 0.0, 0.6), place]) for place in optima]
            self.speed, self.best = [np.zeros(2)] * 8, list(self.now)
        self.points = [*self.points, tuple(now)][-12:]
        lead = min(self.best, key=self.misfit)
        for i in range(8):
            own, common = self.draw(), self.draw()
            self.speed[i] = (
                0.6 * self.speed[i]
                + 1.2 * own * (self.best[i] - self.now[i])
                + 1.2 * common * (lead - self.now[i])
            )
            self.now[i] = np.clip(self.now[i] + self.speed[i], [0.0, p.lowest], [0.6, p.highest])
            if self.misfit(self.now[i]) < self.misfit(self.best[i]):
                self.best[i] = self.now[i]
        way = min(self.best, key=self.misfit)[1] - self.held
        return float(np.clip(way, -ONBOARD.swarm_slip.largest, ONBOARD.swarm_slip.largest))


class Seek(Creep):
    """Extremum seeking on a cubature filter, in matrices."""

    def __init__(self, j):
        super().__init__(j)
        self.p, self.centre, self.phase, self.product = (
            ONBOARD.cubature_seeking,
            ONBOARD.creep.reference,
            0.0,
            0.0,
        )
        self.mean, self.cov, self.variance = None, np.diag([1e-4, 1e-4, 1e-2]), self.p.noise**2

    def decide(self, s):
        self.filter(s)
        return super().decide(s | {"slip": s["sign"] * (self.mean[0] - self.mean[1])})

    def filter(self, s):
        p, pull = (
            self.p,
            EQ.axle_load[self.j] * EQ.radius[self.j] ** 2 / EQ.inertia[self.j] * PERIOD,
        )
        train, self.sign = s["reference"], s["sign"]
        rim = train + s["sign"] * s["slip"]
        if self.mean is None:
            self.mean = np.array([rim, train, 0.1])
        root = math.sqrt(3.0) * np.linalg.cholesky(self.cov)
        points = np.concatenate([self.mean + root.T, self.mean - root.T])
        x = (points[:, 0] - points[:, 1]) / p.scale
        value, slope = 2 * x / (1 + x**2), 2 * (1 - x**2) / (1 + x**2) ** 2 / p.scale
        torque = s["sign"] * (s["known"] / TORQUE[self.j] + s["air"] / EQ.axle_load[self.j])
        points[:, 0] += (
            pull
            * (torque - points[:, 2] * value)
            / (1 + pull * np.maximum(points[:, 2] * slope, 0))
        )
        walk = [(p.rim_walk * PERIOD) ** 2, (p.train_walk * PERIOD) ** 2, p.height_walk**2 * PERIOD]
        self.mean = points.mean(axis=0)
        self.cov = np.cov(points.T, bias=True) + np.diag(walk)
        own = self.cov[0, 0]
        told = self.correct(0, rim, self.variance)
        self.variance = max((1 - p.adapt) * self.variance + p.adapt * (told**2 - own), p.noise**2)
        self.correct(1, train, p.train_noise**2)
        self.mean[2] = np.clip(self.mean[2], 0.0, 1.0)

    def correct(self, a, measured, variance):
        told, gain = measured - self.mean[a], self.cov[a] / (self.cov[a, a] + variance)
        self.mean = self.mean + gain * told
        self.cov = self.cov - np.outer(gain, self.cov[a])
        return told

    def reference(self, s):
        p = self.p
        if self.share >= 0.999:
            self.phase = self.product = 0.0
            return self.centre
        x = self.sign * (self.mean[0] - self.mean[1]) / p.scale
        self.phase += 2 * math.pi * PERIOD / p.cycle
        self.product += (
            self.mean[2] * 2 * x / (1 + x**2) * math.sin(self.phase - p.lag) * PERIOD / p.cycle
        )
        if self.phase >= 2 * math.pi:
            step = np.clip(p.gain * 2 * self.product / p.amplitude, -p.largest, p.largest)
            self.centre = float(np.clip(self.centre + step, p.lowest, p.highest))
            self.phase = self.product = 0.0
        return self.centre + p.amplitude * math.sin(self.phase)


TWINS = {
    "fuzzy-creep": FuzzyTorque,
    "fuzzy-tracking": lambda j: Search(
        j, ONBOARD.perturb_observe, lambda p, last, change: inferred(last, change)
    ),
    "swarm-tracking": Tried,
    "swarm-slip": Fitted,
    "cubature-seeking": Seek,
    "none": Nothing,
    "cut-and-ramp": Cut,
    "pi-creep": Creep,
    "perturb-observe": lambda j: Search(j, ONBOARD.perturb_observe, perturbed),
    "steepest-gradient": lambda j: Search(j, ONBOARD.steepest_gradient, climbing),
    "table": Table,
}


def test_every_controller_has_its_second_transcription():
    assert set(TWINS) == set(BUILT_IN)


@looped("sign", [1.0, -1.0])
@looped("name", TWINS)
def test_commands_equal_the_second_transcription(name, sign):
    st = settings(ONBOARD, RuleSettings(0), name)
    m, rng, n = memory(EQ, 10.0, 0.08), np.random.default_rng(7), EQ.axles.size
    twins, slip, speed = [TWINS[name](j) for j in range(n)], np.zeros(n), 10.0
    for tick in range(500):
        commanded = 0.0 if tick in (20, 21) and sign > 0.0 else 0.8 * sign
        m.train.expected[0] = 0.08
        target = (
            np.full(n, 0.0)
            if tick == 30
            else 500.0 + 30.0 * np.arange(n) + 200.0 * (tick % 97 > 60)
        )
        slip = 0.97 * slip + rng.normal(0.004, 0.02, n) + 0.5 * (tick in (50, 250))
        slip += 0.008 * (300 < tick < 420)  # long enough for searches
        speed += 0.8 * sign * PERIOD
        m.speed[:] = speed + sign * (slip + 0.3 * slip**2)
        m.worst_slip[:] = slip
        m.torque[:] = m.unit.torque_command
        m.unit.slipping[:] = slip > 0.25 if tick < 120 or tick > 240 else 0.0
        if tick > 280:
            m.unit.slipping[0] = 1.0
        m.unit.coefficient_estimate[:] = rng.uniform(-0.01, 0.12, n)
        m.air_force[:] = rng.uniform(0.0, 900.0, n) * (sign < 0.0)
        m.unit.torque_target[:] = sign * target
        before = sign * m.unit.torque_command.copy()
        control(name)(EQ, st, m, commanded)
        for j, twin in enumerate(twins):
            command, share = twin.decide({
                "sign": sign, "commanded": commanded, "target": target[j], "slip": slip[j], "speed": m.speed[j],
                "slipping": m.unit.slipping[j] > 0.0, "coefficient": m.unit.coefficient_estimate[j],
                "air": m.air_force[j], "expected": 0.08, "command": before[j], "known": sign * m.torque[j],
                "reference": m.reference[EQ.unit_body[j]],
            })  # fmt: skip
            assert sign * m.unit.torque_command[j] == pytest.approx(command, rel=1e-9, abs=1e-9), (
                tick,
                j,
            )
            assert m.unit.torque_factor[j] == pytest.approx(share, rel=1e-9, abs=1e-9), (tick, j)
    if isinstance(twins[0], Search):
        assert all(twin.last_step or isinstance(twin, Tried) for twin in twins)  # a swarm may rest
        assert any(twin.held != ONBOARD.creep.reference for twin in twins)


def test_a_hosted_controllers_share_is_not_its_reserves():
    st = settings(ONBOARD, RuleSettings(0), "mpc")
    m = memory(EQ, 10.0, 0.08)
    m.unit.torque_factor[:] = 0.3
    m.unit.torque_target[:] = 400.0
    control(RESERVE)(EQ, st, m, 0.5)
    assert m.unit.torque_command.tolist() == [400.0] * 4
    assert m.unit.torque_factor.tolist() == [0.3] * 4


@looped(
    ("reference", "step", "kept", "then"),
    [
        (0.5, -0.25, -0.25, 0.25),
        (0.5, -0.375, 0.375, 0.25),
        (0.5, 0.5, 0.5, 1.0),
        (0.5, 0.75, -0.75, 1.0),
    ],
)
def test_a_search_turns_round_beyond_its_bounds_and_not_at_them(reference, step, kept, then):
    k = memory(EQ, 10.0, 0.08).law[list(BUILT_IN).index("perturb-observe")]
    k.reference[0], k.clock[0] = reference, 3.0
    move_reference(SimpleNamespace(lowest=0.25, highest=1.0), k, 0, step, 0.1, 0.2)
    assert (k.step[0], k.reference[0], k.clock[0]) == (kept, then, 0.0)
    assert (k.last_coefficient[0], k.last_slip[0]) == (0.1, 0.2)
