"""The motion behind a log, fitted: one robust estimate of the train's speed and of the errors of all channels at once.

Unknown are the train's speed v(t), and of each channel a few numbers that most likely are nothing. The speed is

    v(t) = g P(t + h) - W(t) - R(t) + B(t),    B a line between knots, whose slopes walk randomly

with the impulse P of the forces and the momentum W of the wheelsets over the train's mass, the impulse R of resistance and
known gradient, the scale g of forces over mass, and their delay h. Wheels and the speed's channel are

    rim_i(t) = (1 + e_i) v(t) + (k0 + k1 v) mu_i(t) + noise, or the wheel slips to the side to which its force drives it
    z(t_j)   = (1 + s) v(t_j - d) + noise

with errors e_i of radii, creep by the force over load mu_i, and scale s and delay d of the speed. All of it is fitted at
once by Gauss-Newton, reweighted (Geman-McClure, the width of the wheels narrows turn by turn). Priors of g, e, s, h and d
have a spike at nothing and are flat elsewhere. What is wrong with the law of creep lasts for seconds, so a wheel that pulls
tells the speed far less often than it is sampled; one that rolls tells it each time. Knots make a banded matrix, the other
numbers its border: time and memory grow with the length of a log. Time passes for the knots only while the train moves.
"""

from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import cho_solve_banded, cholesky_banded
from scipy.sparse import csr_array

from alloc.compilation import equation, jit
from alloc.estimation.series import spans, usual_period
from studies.logs.aligned_log import Log, evened, integral, parts_of
from studies.logs.own_samples import SEEN, Samples

Floats = NDArray[np.float64]
Flags = NDArray[np.bool_]

KNOT, CELL = 0.5, 0.1
"""Time between knots, and over which channels are averaged for the fit [s]."""
TURNS, RADII = 18, (8, 13)
"""Turns of the fit, and those in which radii are looked for all over: the speed may not be settled at the first."""
WALKS, WALK_UNSURE = (2e-3, 8e-3, 0.03), 0.05
"""Changes of the slope of B per root s that are tried [m/s2], and where wheels are locked or rows lost."""
START = 1.0
"""Time [s] after a standstill for which the same holds."""
ENDS, WALK_ENDS = 2, 0.12
"""Knots at the ends of a log, and changes per root s there [m/s2], where forces are late or early."""
SPIKE = {"g": 0.01, "h": 3e-3, "s": 1e-3, "d": 3e-3, "e": 4e-4}
"""Widths of what counts as nothing."""
PERSISTS = 20.0
"""Cells over which what is wrong with the law of creep is the same."""
MEAN_RADIUS = 2e-4
"""Mean error of radii where no single one is wrong."""
CREEP_UNSURE = 0.15
"""Standard deviation of creep, relative."""
LEAST_RADIUS = 1e-3
"""Error of a radius below which nothing is changed."""
STEADY = 0.1
"""Share of a wheel's usual difference from the others that its least one may lack, if it is no slip."""
WORN = 2.5e-3
"""Error of rolling wheels' radii from which on they are worn; where a third of them is, the others count as worn too."""
UNLIKE = 2.6e-3
"""Mean by which wheels that always pull are on the side to which none slips, relative, above which they count as worn."""


@dataclass
class Fit:
    """What was found."""

    speed: Floats
    """[m/s], (instants,)."""
    cost: float
    evidence: float
    """Minus twice the logarithm of the marginal likelihood, but for a constant."""
    x: dict[str, float]
    """g, h, k0, k1, s and d."""
    radius: Floats
    """Errors e of radii, (axles,)."""
    noise: float
    """Of the speed's channel [m/s]."""
    contact: bool
    """Whether forces act between wheel and rail."""
    worn: bool
    """Whether wheels that always pull differ, so that radii and creep cannot be told apart."""
    posterior: "Posterior"


def _spike(x: Any, name: str, least: float = 0.0) -> Any:
    """Weight of what most likely is nothing, and else may be anything."""
    w = max(SPIKE[name], least)
    return 12.0 / w**2 / (1 + (x / w) ** 2) ** 2 if name in "gse" else 2.0 / (w**2 + x**2)


def _rest(log: Log, late: float, dense: bool) -> Flags:
    """Where the train stands: all wheels do, and the speed says so, or they have for 2.5 s, for they may be locked."""
    t, size = log.time, np.zeros(log.time.size)
    for i in np.flatnonzero(log.turning):
        np.maximum(size, np.abs(log.rim[:, i]), out=size)  # nan stays
    still = size < min(max(0.003, 4 * float(np.median(log.noise))), 0.05)
    if dense and log.fixes is not None:
        return np.asarray(still & (np.interp(t, log.fixes.time - late, log.fixes.value) < 0.05))
    for a, b in spans(still):
        if a > 0:
            still[a : np.searchsorted(t, min(t[a] + 2.5, t[b - 1]))] = False
    return np.asarray(still)


class _Impulses:
    """What does not change during a fit: impulses, cells and knots."""

    def __init__(
        self, log: Log, first: Floats, late: float, dense: bool, contact: bool, drift: float, forces_late: bool,
    ) -> None:  # fmt: skip
        t, (n, a), load, mass = log.time, log.rim.shape, log.train.axle_load, log.mass
        still = _rest(log, late, dense)
        moves = ~(still[1:] & still[:-1])
        jumps = np.diff(parts_of(t)) > 0
        self.at_rest = np.zeros(n)
        for i, k in spans(still):
            self.at_rest[np.searchsorted(t, t[i] + 0.3) : np.searchsorted(t, t[k - 1] - 0.3)] = 1.0
        # time passes while the train moves; over a gap two knots do
        self.passed = np.concatenate(
            [[0.0], np.cumsum(np.where(jumps, 3.0 * KNOT, np.diff(t) * moves))]
        )
        moves &= ~jumps
        self.every = every = max(1, round(CELL / usual_period(t)))
        self.cells = m = max(n // every, 1)
        self.every = every = min(every, n)
        pulls = np.abs(log.force.sum(1)) > 1e-3 * load.sum()
        total, share, size = np.zeros(n), np.zeros(n), np.zeros(n)
        turned, mu, free = np.zeros(n), np.zeros((m, a)), np.zeros((m, a), dtype=np.bool_)
        wheel, span = np.full((m, a), np.nan), self.mean(np.append(np.diff(t), 1.0)) * every
        for i in range(a):
            own = log.rim[:, i] if log.turning[i] else first
            own = np.where(np.isfinite(own), own, np.maximum(first, 0.0))
            acting = log.force[:, i]
            locked = (np.abs(own) < 0.05) & ~still & pulls
            size += np.abs(acting)
            if locked.any():  # a locked wheel brakes no more than the rail did before
                acting = acting.copy()
                share += np.abs(acting) * locked
                for b, k in spans(locked):
                    before = -np.abs(acting[max(b - 30, 0) : max(b - 5, 1)]).mean()
                    acting[b:k] = np.maximum(acting[b:k], before)
            total += acting
            if log.turning[i]:
                turned += own * (log.rotating[i] / mass)
                wheel[:, i] = self.mean(log.against_train(i))
            ends = own[: m * every].reshape(m, every)
            spent = (np.append(ends[1:, 0], ends[-1, -1]) - ends[:, 0]) / span
            force = self.mean(log.force[:, i])
            mu[:, i] = np.clip(
                (force - (not contact) * log.rotating[i] * spent) / load[i], -0.3, 0.3
            )
            free[:, i] = np.abs(force) < 2e-3 * load[i]
        self.time, self.total, self.moves, self.mass = t, total / mass, moves, mass
        self.turned = np.concatenate([[0.0], np.cumsum(np.diff(turned) * moves)]) * (not contact)
        self.given = integral(t, self.total, moves)
        if log.uphill is not None:
            self.turned += integral(t, log.uphill, moves)
        resistance = np.zeros(3) if log.train.resistance is None else log.train.resistance.sum(0)
        self.resistance = resistance / mass
        demand = evened(total / load.sum(), 12)
        driven = self.mean(np.sign(demand) * (np.abs(demand) >= 2e-3))
        self.stands = self.mean(still.astype(float)) > 0.99
        self.mean_time, self.mean_passed = self.mean(t), self.mean(self.passed)
        self.mean_turned = self.mean(self.turned)
        # knots, and the walk of their slopes
        self.knots = np.arange(0.0, self.passed[-1] + KNOT, KNOT)
        if self.knots.size < 4:
            self.knots = KNOT * np.arange(4.0)
        locked_share = np.interp(self.knots, self.passed, share / np.maximum(size, 1.0))
        unsure = np.maximum(locked_share[1:], locked_share[:-1]) > 0.25
        unsure |= np.histogram(self.passed[log.lost], self.knots)[0] > 0
        for k in np.flatnonzero(still[:-1] & ~still[1:]):  # slack runs out, and brakes let go
            unsure |= np.abs(self.knots[:-1] - self.passed[k]) < START
        over = np.histogram(self.passed[1:][jumps] - KNOT, self.knots)[0] > 0
        for shift in (-2, -1, 1, 2):
            over |= np.roll(over, shift) & over.any()
        walk = np.where(unsure[1:] | unsure[:-1], max(WALK_UNSURE, drift), drift) ** 2 * KNOT
        self.walk = np.where(over[1:] | over[:-1], 1e4, walk)
        if forces_late:  # what acted before the log, or after it, is not in it
            inside = np.arange(self.walk.size)
            outer = (inside < ENDS) | (inside >= self.walk.size - ENDS)
            self.walk[outer] = np.maximum(self.walk[outer], WALK_ENDS**2 * KNOT)
        self.hats = self.hats_at(self.mean_passed)
        fine = np.where(log.span > 0, log.noise, log.noise / np.sqrt(every))
        self.wheels = Wheels(
            np.nan_to_num(wheel), np.isfinite(wheel), mu, free, driven, fine**2 + 3e-4**2,
            self.hats.indices[::2].astype(np.int64), self.hats.data[1::2],
        )  # fmt: skip

    def mean(self, x: Floats) -> Floats:
        """Means over cells."""
        return np.asarray(x[: self.cells * self.every].reshape(self.cells, self.every).mean(1))

    def resisted(self, v: Floats) -> Floats:
        """Impulse of the resistance at a speed, means over cells [m/s]."""
        against = np.vander(np.clip(np.abs(v), 0.0, 160.0), 3, increasing=True) @ self.resistance
        against *= np.clip(v / 0.01, -1.0, 1.0)
        spent = np.diff(self.mean_passed, prepend=self.mean_passed[0])
        return np.asarray(np.cumsum(against * np.minimum(spent, 4 * CELL)))

    def hats_at(self, passed: Floats) -> csr_array:
        """Weights of the knots at some instants, (instants, knots)."""
        place = np.clip(passed / KNOT, 0.0, self.knots.size - 1.000001)
        k = place.astype(np.int64)
        f, rows = place - k, np.arange(place.size)
        return csr_array(
            (np.concatenate([1 - f, f]), (np.tile(rows, 2), np.concatenate([k, k + 1]))),
            shape=(place.size, self.knots.size),
        )

    def forces_at(self, late: float) -> tuple[Floats, Floats]:
        """Impulse of forces that are so late, and its change with that, means over cells."""
        if late == 0.0:
            return self.mean(self.given), self.mean(self.total) - self.total[0]
        moved = np.interp(self.time + late, self.time, self.total)
        return self.mean(integral(self.time, moved, self.moves)), self.mean(moved) - moved[0]


class Posterior:
    """The inverse of an arrow: a banded matrix of the knots, and a border of the other numbers."""

    def __init__(self, band: Floats, side: Floats, corner: Floats) -> None:
        self.factor, self.side = cholesky_banded(band, check_finite=False), side
        self.beside = cho_solve_banded((self.factor, False), side, check_finite=False)
        # (threads of a BLAS take longer to meet than this takes)
        self.corner = corner - np.einsum("ki,kj->ij", side, self.beside)
        self.hats: csr_array | None = None
        self.columns: dict[int, Floats] = {}

    def solve(self, knots: Floats, others: Floats) -> tuple[Floats, Floats]:
        """Solution for right-hand sides of the knots (knots,) and of the border."""
        x = cho_solve_banded((self.factor, False), knots, check_finite=False)
        border = np.linalg.solve(self.corner, others - self.side.T @ x)
        return x - self.beside @ border, border

    @property
    def volume(self) -> float:
        """Logarithm of the determinant of the matrix."""
        return float(2 * np.log(self.factor[-1]).sum() + np.linalg.slogdet(self.corner)[1])

    def deviation_of(self, name: str) -> float:
        """Standard deviation of a number of the border, see `PLACE`."""
        unit = np.zeros(self.corner.shape[0])
        unit[PLACE[name]] = 1.0
        return float(np.sqrt(self.solve(np.zeros(self.factor.shape[1]), unit)[1][PLACE[name]]))

    def deviation(self, weight: Floats) -> float:
        """Standard deviation of the integral of a `weight` (instants,) times the speed."""
        assert self.hats is not None
        knots, others = self.hats.T @ weight, np.zeros(self.corner.shape[0])
        for k, column in self.columns.items():
            others[k] = column @ weight
        x, border = self.solve(knots, others)
        return float(np.sqrt(max(knots @ x + others @ border, 0.0)))


PLACE = {"g": 0, "h": 1, "k0": 2, "k1": 3, "s": 4, "d": 5}
"""Numbers of the border; errors of radii follow."""
FIRST = len(PLACE)
LIMITS = {"g": (9.0, -99.0, 99.0), "h": (0.1, -0.6, 0.6), "k0": (9.0, 0.0, 0.9), "k1": (9.0, 0.0, 0.6),
          "s": (9.0, -9.0, 9.0), "d": (0.1, -1.0, 2.5)}  # fmt: skip
"""Largest step of a turn, least and largest value of each."""


class Wheels(NamedTuple):
    """What is known of all wheels by cells, and where the cells lie among the knots."""

    speed: Floats
    """[m/s], 0 where unknown, (cells, axles)."""
    known: Flags
    mu: Floats
    """Force at the rail over load, (cells, axles)."""
    free: Flags
    """Whether hardly a force acts, (cells, axles)."""
    side: Floats
    """Side to which forces drive all wheels: -1, 0 or 1, (cells,)."""
    least: Floats
    """Least variance of a cell [m2/s2], (axles,)."""
    knot: NDArray[np.int64]
    """The knot before each cell, (cells,)."""
    part: Floats
    """How far each cell is to the knot after it, 0 to 1, (cells,)."""


class State(NamedTuple):
    """Where a turn begins; (cells,) but for the errors e (axles,)."""

    speed: Floats
    first: Floats
    columns: Floats
    """Change of the speed with g and h, and of the creep over mu with k0 and k1, (cells, 4)."""
    e: Floats
    k0: float
    k1: float
    narrow: float
    """Width of the wheels beside their noise [m/s]."""
    alike: float
    """Share of the axles that err independently."""


class Normal(NamedTuple):
    """Normal equations: the band of the knots, the border beside it and its corner, and both right-hand sides."""

    band: Floats
    side: Floats
    corner: Floats
    knots: Floats
    border: Floats


@equation
def creep_unsure(mu: Any, over: Any, k0: Any, k1: Any) -> Any:
    """Variance [m2/s2] of what is wrong with the law of creep, at a speed `over` 0."""
    return (mu * (0.15 + 0.01 * over)) ** 2 + (CREEP_UNSURE * mu * (k0 + k1 * over)) ** 2


@jit
def add_wheels(wheels: Wheels, state: State, begins: bool, normal: Normal) -> float:
    """Add all wheels to the normal equations, whose corner becomes upper triangular; returns their cost.

    `begins`: in the first turn wheels stand for the first guess of the speed.
    """
    band, side, corner, border, cost = normal.band, normal.side, normal.corner, normal.border, 0.0
    for c in range(state.speed.size):
        v, k, after = state.speed[c], wheels.knot[c], wheels.part[c]
        if v < 0.05 and not begins:
            continue
        before, over = 1.0 - after, max(v, 0.0)
        total, pulled, squared, pushed, moved = 0.0, 0.0, 0.0, 0.0, 0.0
        column = state.columns[c]
        for i in range(state.e.size):
            if not wheels.known[c, i]:
                continue
            mu = wheels.mu[c, i]
            law = creep_unsure(mu, over, state.k0, state.k1)
            square = wheels.least[i] + law + state.narrow**2
            # what is wrong with the law of creep lasts
            tells = state.alike * square / (square + (PERSISTS - 1.0) * law)
            y = wheels.speed[c, i] - v * (1.0 + state.e[i]) - mu * (state.k0 + state.k1 * v)
            u2 = y * y / square
            if wheels.free[c, i] or np.sign(y) == wheels.side[c]:
                weight = tells / ((1.0 + 0.25 * u2) ** 2 * square)
                cost += tells * 4.0 * u2 / (4.0 + u2)
            else:
                far = np.sqrt(u2)
                weight = tells / (max(1.0, far / 3.0) * square)
                cost += tells * (u2 if u2 < 9.0 else 6.0 * far - 9.0)
            if begins:
                y, weight = state.first[c] - v, 10.0 * tells
            total += weight
            pulled += weight * mu
            squared += weight * mu * mu
            pushed += weight * y
            moved += weight * y * mu
            own = FIRST + i
            turned = weight * v
            side[k, own] += before * turned
            side[k + 1, own] += after * turned
            corner[0, own] += column[0] * turned
            corner[1, own] += column[1] * turned
            corner[2, own] += mu * turned
            corner[3, own] += mu * turned * v
            corner[own, own] += turned * v
            border[own] += turned * y
        band[2, k] += total * before * before
        band[1, k + 1] += total * before * after
        band[2, k + 1] += total * after * after
        normal.knots[k] += before * pushed
        normal.knots[k + 1] += after * pushed
        for p in range(4):
            one = (total if p < 2 else pulled) * column[p]
            side[k, p] += before * one
            side[k + 1, p] += after * one
            border[p] += (pushed if p < 2 else moved) * column[p]
            for q in range(p, 4):
                both = total if q < 2 else squared if p > 1 else pulled
                corner[p, q] += both * column[p] * column[q]
    return cost


def fit(
    log: Log, first: Floats, late: float | None = None, use_speed: bool = True, contact: bool = False, scaled: bool = False,
    force_late: float | None = None, drift: float = WALKS[0],
) -> Fit:  # fmt: skip
    """The fit from a `first` speed (instants,) on.

    `late`, `force_late`: delays d and h [s] from which the fit begins, where they are free; `scaled`: whether s is.
    """
    a = log.rim.shape[1]
    im = _Impulses(
        log, first, late or 0.0, use_speed and log.dense, contact, drift, force_late is not None
    )
    hats, K, least = im.hats, im.knots.size, im.wheels.least
    # axles of one train err together, and for half a second
    alike = 1.0 / (1.0 + 0.2 * np.count_nonzero(log.turning))
    z = thinned(log.fixes) if use_speed and log.fixes is not None else None
    x = {"g": 1.0, "h": force_late or 0.0, "k0": 0.2, "k1": 0.02, "s": 0.0, "d": late or 0.0}
    fixed = {
        "h": force_late is None,
        "s": not scaled,
        "d": z is None or late is None,
        "g": not log.told.any(),
    }
    b, e, noise, cost = np.zeros(K), np.zeros(a), 0.02, np.inf
    begun, worn = im.mean(first), False
    resisted = im.resisted(begun)
    b += first[0]
    bend = np.diff(np.eye(3), 2, axis=0)[0] / KNOT  # change of the slope
    for turn in range(TURNS + 1):
        given, by_delay = im.forces_at(x["h"])
        by_delay = x["g"] * by_delay
        driven = x["g"] * given - im.mean_turned
        if turn:  # B takes up how the resistance changes, else the two turns of a long log part
            vc, before = driven - resisted + hats @ b, resisted
            resisted = im.resisted(vc)
            b += np.interp(im.knots, im.mean_passed, resisted - before)
        vc = driven - resisted + hats @ b
        if turn == TURNS:
            break
        band, side, corner = (
            np.zeros((3, K)),
            np.zeros((K, FIRST + a)),
            np.zeros((FIRST + a, FIRST + a)),
        )
        r, rb, cost = np.zeros(FIRST + a), np.zeros(K), 0.0
        E = slice(FIRST, None)
        narrow = 0.6 * 0.65**turn
        if turn in RADII:
            over = np.maximum(vc, 0.0)[:, None]
            creep = im.wheels.mu * (x["k0"] + x["k1"] * vc[:, None])
            law = creep_unsure(im.wheels.mu, over, x["k0"], x["k1"])
            e, worn = _radii(im.wheels, creep, vc, np.sqrt(least + law + narrow**2), alike)
        both = np.stack([given, by_delay], axis=1)
        columns = np.column_stack([both, np.ones(vc.size), vc])
        state = State(vc, begun, columns, e, x["k0"], x["k1"], narrow, alike)
        cost += add_wheels(im.wheels, state, turn == 0, Normal(band, side, corner, rb, r))
        # the speed's channel
        if z is not None and turn > 0:
            noise, extra = _add_speed(
                im, z, x, b, resisted, noise if turn > 3 else None, band, side, corner, rb, r
            )
            cost += extra
        # what is known beforehand, and rest
        w = 1.0 / im.walk
        for p in range(3):
            for q in range(p, 3):
                band[2 + p - q, q : K - 2 + q] += w * bend[p] * bend[q]
        change = np.diff(b, 2) / KNOT
        for p in range(3):
            rb[p : K - 2 + p] -= w * bend[p] * change
        start = (b[1] - b[0]) / KNOT / 0.3**2
        for p, q, one in ((0, 0, 1.0), (1, 1, 1.0), (0, 1, -1.0)):
            band[2 + p - q, q] += one / (0.3 * KNOT) ** 2
        rb[0], rb[1] = rb[0] + start / KNOT, rb[1] - start / KNOT
        cost += (w * change**2).sum() + (start * 0.3) ** 2
        prior = {
            "g": (x["g"] - 1, _spike(x["g"] - 1, "g", 0.1 * 0.7**turn)), "h": (x["h"], _spike(x["h"], "h")),
            "s": (x["s"], _spike(x["s"], "s")), "d": (x["d"], _spike(x["d"], "d")),
            "k0": (x["k0"] - 0.15, 0.15**-2), "k1": (x["k1"] - 0.02, 0.1**-2),
        }  # fmt: skip
        for name, (value, w0) in prior.items():
            k, free_one = PLACE[name], not fixed.get(name)
            corner[k, k] += w0 if free_one else 1e12
            r[k] -= w0 * value * free_one
            cost += w0 * value**2 * free_one
        we = _spike(e, "e", 0.02 * 0.7**turn)
        corner[E, E] += np.diag(we)
        # nor do all together leave nothing but a few: that is creep, or a clock
        most = 1 / (1 + (e / LEAST_RADIUS / 3) ** 2) ** 2
        most /= most.sum()
        corner[E, E] += MEAN_RADIUS**-2 * np.outer(most, most)
        r[E] -= MEAN_RADIUS**-2 * (most @ e) * most
        r[E] -= we * e
        cost += (12 * e**2 / (e**2 + SPIKE["e"] ** 2)).sum()
        rest = np.asarray(5e4 * im.stands, dtype=np.float64)
        _add(band, hats, rest)
        side[:, 0:2] += hats.T @ (rest[:, None] * both)
        corner[0:2, 0:2] += both.T @ (rest[:, None] * both)
        rb -= hats.T @ (rest * vc)
        r[0:2] -= both.T @ (rest * vc)
        band[2] += 1e-6
        corner = np.triu(corner) + np.triu(corner, 1).T + 1e-6 * np.eye(FIRST + a)
        found = Posterior(band, side, corner)
        step, border = found.solve(rb, r)
        b, e = b + step, e + np.clip(border[E], -0.02, 0.02)
        for name, (limit, low, high) in LIMITS.items():
            x[name] = float(
                np.clip(x[name] + np.clip(border[PLACE[name]], -limit, limit), low, high)
            )
    force = np.interp(log.time + x["h"], log.time, im.total) if x["h"] else im.total
    pushed = integral(log.time, force, im.moves)
    found.hats = im.hats_at(im.passed)
    found.columns = {PLACE["g"]: pushed, PLACE["h"]: x["g"] * (force - force[0])}
    speed = x["g"] * pushed - im.turned + found.hats @ b
    speed -= np.interp(im.passed, im.mean_passed, resisted)
    evidence = cost + found.volume + np.log(im.walk).sum()
    return Fit(speed, cost, evidence, x, e, noise, contact, worn, found)


def _add(band: Floats, hats: csr_array, weight: Floats) -> None:
    """Add a weighted square of rows of hats to a band of the knots."""
    k, f = hats.indices.reshape(-1, 2), hats.data.reshape(-1, 2)
    for p, q in ((0, 0), (1, 1), (0, 1)):
        band[2 + p - q] += np.bincount(k[:, q], weight * f[:, p] * f[:, q], band.shape[1])


def _add_speed(
    im: _Impulses, z: Samples, x: dict[str, float], b: Floats, resisted: Floats, noise: float | None,
    band: Floats, side: Floats, corner: Floats, rb: Floats, r: Floats,
) -> tuple[float, float]:  # fmt: skip
    """Add the speed's channel to the normal equations; its noise, estimated where one is given, and its cost."""
    t = im.time
    tau = z.time - x["d"]
    ok = (tau > t[0] - 0.02) & (tau < t[-1] + 0.02) & (np.interp(tau, t, im.at_rest) < 0.5)
    tau, value = tau[ok], z.value[ok]

    def at_times(when: Floats) -> tuple[Floats, Floats, csr_array]:
        passed = np.interp(when, t, im.passed)
        given = np.interp(when + x["h"], t, im.given) - (
            np.interp(t[0] + x["h"], t, im.given) if x["h"] else 0.0
        )
        rows = im.hats_at(passed)
        past = np.interp(when, t, im.turned) + np.interp(passed, im.mean_passed, resisted)
        return x["g"] * given - past + rows @ b, given, rows

    v, given, rows = at_times(tau)
    rate = (at_times(tau + 0.05)[0] - at_times(tau - 0.05)[0]) / 0.1
    y = value - v * (1 + x["s"])
    if noise is not None:
        own = z.noise if z.period < SEEN else 0.0  # of a rare one it is its motion
        noise = max(1.4826 * float(np.median(np.abs(y))) if y.size else 0.0, own, 3e-4)
    used = 0.02 if noise is None else noise
    spread = np.hypot(used, rate * z.span)
    u2 = (y / spread) ** 2
    weight = 1 / (1 + u2 / 6) ** 2 / spread**2
    by_delay = x["g"] * (
        np.interp(tau + x["h"], t, im.total) - np.interp(t[0] + x["h"], t, im.total)
    )
    columns = np.stack([given, by_delay, v, -rate], axis=1)
    place = [0, 1, 4, 5]
    _add(band, rows, weight)
    side[:, place] += rows.T @ (weight[:, None] * columns)
    corner[np.ix_(place, place)] += columns.T @ (weight[:, None] * columns)
    rb += rows.T @ (weight * y)
    r[place] += columns.T @ (weight * y)
    return used, float((6 * u2 / (6 + u2) + 2 * np.log(spread)).sum())


def _radii(
    wheels: Wheels, creep: Floats, v: Floats, sigma: Floats, alike: float
) -> tuple[Floats, bool]:
    """Errors of radii, each where most instants of its wheel agree; 0 unless another one is much better.

    Where a wheel rolls freely, that alone tells. Of wheels that always pull one that stands out against all is changed, for
    creep looks like a radius of them all; if neighbours differ none is, and the second result says so.
    """
    grid = np.concatenate([[0.0], np.linspace(-0.05, 0.05, 101)])
    use = v > 1.0
    w = np.where(wheels.known, wheels.speed - creep, np.nan)[use]
    v, s = v[use, None], np.hypot(sigma[use], 5e-4 * v[use, None])
    rolling = wheels.free[use]
    if len(w) > 6000:
        some = slice(None, None, len(w) // 6000 + 1)
        alike *= len(w) // 6000 + 1
        w, v, s, rolling = w[some], v[some], s[some], rolling[some]
    rolls = rolling & np.isfinite(w)
    tell = np.where(rolls.sum(0) >= 5, rolls, np.isfinite(w))
    loss, near = np.zeros((grid.size, w.shape[1])), np.zeros((grid.size, w.shape[1]))
    known, w = np.where(tell, w, np.nan), np.where(tell, w, np.inf)
    for k, e in enumerate(grid):
        u2 = ((w - v * (1 + e)) / s) ** 2
        loss[k], near[k] = alike * (4 - 16 / (4 + u2)).sum(0, where=tell), (u2 < 9).sum(0)
    best, axles = loss.argmin(0), np.arange(w.shape[1])
    tight = (near / np.maximum(tell.sum(0), 1))[best, axles] > 0.6
    found = np.where(
        tight & (loss[0] - loss.min(0) > 8) & (np.abs(grid[best]) < 0.049), grid[best], 0.0
    )
    if np.mean(found != 0.0) > 0.6 and np.std(found) < 0.4 * abs(np.mean(found)):
        found[:] = 0.0  # all by as much: creep, or a clock
    never = np.flatnonzero(rolls.sum(0) < 5)
    never = never[np.isfinite(known[:, never]).any(axis=0)]
    if never.size == 0:
        return found, False
    side = np.sign(wheels.side[use].sum())
    ratio = known[:, never] / v - 1
    ratio = ratio[np.isfinite(ratio).any(axis=1)]
    own = np.nanmedian(ratio, axis=0)
    spread = np.nanmedian(np.abs(ratio - own), axis=0)
    beside = own - np.median(own)
    against, apart = ratio, own
    if never.size > 3:
        against, apart = ratio - np.nanmedian(ratio, axis=1)[:, None], beside
    others = found[rolls.sum(0) >= 5]
    if others.size > 3:  # a train's wheels wear alike: those that roll tell whether they have
        worn = bool(np.mean(np.abs(others) > WORN) > 0.3)
    else:
        worn = bool(never.size > 1 and np.mean(np.maximum(-side * beside, 0.0)) > UNLIKE)
    # slip that lasts looks like a radius, to its side, but a radius is the same before a slip
    least, usual = np.nanquantile(side * against, (0.1, 0.5), axis=0)
    sure = (side * apart < 0.0) | (usual - least < STEADY * usual)
    sure &= np.abs(apart) > np.maximum(5e-3, 5.0 * spread)
    found[never] = np.where(sure & (not worn), apart, 0.0)
    return found, worn


def thinned(z: Samples) -> Samples:
    """Means over a cell of dense samples."""
    k = round(CELL / z.period) if z.time.size > 1 else 1
    if k < 2 or z.kind == "quantised":
        return z
    time, value = (x[: x.size // k * k].reshape(-1, k).mean(1) for x in (z.time, z.value))
    return z._replace(time=time, value=value, noise=z.noise / np.sqrt(k))
