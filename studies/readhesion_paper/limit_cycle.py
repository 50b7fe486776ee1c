"""What the torque table must do, predicted without simulating the plant: its limit cycle, and why it fails.

The readhesion paper's loop is reduced to four states, piecewise linear: slip velocity s, motor torque T, deviation of
acceleration d and filtered torque command y,

    s' = g_T T - (g_mu + h_mu) mu(s)            T' = (y - T) / lag
    d' = (g_T T - g_mu mu(s) - a - d) / tau     y' = (F(d) T_ref - y) / (T_u rising, T_d falling)

with g_T, g_mu, h_mu from the plant's own equations, the table F(d), and the adhesion curve as two lines: micro slip with
its slope to the peak, macro slip falling with g2 down to mu_inf. Between switchings the solution is a matrix exponential.
"""

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray
from scipy.linalg import expm
from scipy.optimize import brentq

from alloc.metrics.search import PROMINENCE
from alloc.onboard.controllers.simple import TorqueTable, torque_factor
from alloc.onboard.equipment import equipment
from alloc.onboard.parameters import Onboard
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.laws import motor_torque_rate, wheel_acceleration
from alloc.plant.model import build
from alloc.plant.rail import Rail
from alloc.plant.train import Train

Floats = NDArray[np.float64]

SLIP, TORQUE, DEVIATION, COMMAND = range(4)
"""States of the reduced model; the fifth is the constant 1 that makes its modes linear."""

STEP = 2e-4
"""Time [s] between looks for a switching, which is then found within the step."""

PERIODS = 40
"""Most periods that a prediction follows until it repeats itself."""

SWINGS = 24
"""Number of swings followed to find their growth; the second half counts."""

Mode = tuple[int, int, int]
"""Region of slip: micro, macro, residual; of the table: full, sloping, none; of the filter: falling, rising."""


@dataclass(frozen=True)
class LimitCycle:
    """Period [s], extremes of slip velocity [m/s] and of motor torque [N m]."""

    period: float
    slip: tuple[float, float]
    torque: tuple[float, float]


@dataclass(frozen=True)
class Runaway:
    """Equilibrium of torque and deviation while the slip grows for ever at constant adhesion."""

    factor: float
    """Factor at which the table settles."""
    deviation: float
    """Deviation of acceleration there [m/s2]."""
    slip_rate: float
    """Growth of the slip velocity [m/s2]."""


@dataclass(frozen=True)
class ReducedModel:
    """The loop of one axle under the table at a command of `acceleration` a [m/s2] on a rail of `peak`."""

    torque_gain: float
    """g_T: acceleration of the rim per motor torque [m/s2 per N m]."""
    wheel_gain: float
    """g_mu: deceleration of the rim per coefficient [m/s2]."""
    train_gain: float
    """h_mu: acceleration of the train per coefficient [m/s2]."""
    lag: float
    target: float
    """T_ref [N m]."""
    acceleration: float
    peak: float
    curve: PiecewiseCurve
    table: TorqueTable

    @property
    def top(self) -> float:
        """Slip velocity of the peak [m/s] where the curve is two lines."""
        return self.peak / self.curve.micro_slope

    @property
    def gain(self) -> float:
        """Loop gain of the table: change of the deviation per change of the factor, over the table's width."""
        return self.torque_gain * self.target / self.table.width

    def runaway(self) -> Runaway:
        """Where factor and deviation rest while the wheels run away at mu_inf."""
        residual = self.curve.residual(self.peak)
        pull = self.torque_gain * self.target
        rest = self.wheel_gain * residual + self.acceleration
        factor = (1.0 + (rest + self.table.margin) / self.table.width) / (1.0 + self.gain)
        factor = min(max(factor, 0.0), 1.0)
        deviation = pull * factor - rest
        growth = deviation + self.acceleration - self.train_gain * residual
        return Runaway(factor, deviation, growth)

    def mode(self, state: Floats) -> Mode:
        """Mode that `state` (5,) is in: region of slip (micro, macro, residual), of the table, of the filter."""
        t, slip, deviation = self.table, state[SLIP], state[DEVIATION]
        region = 0 if slip <= self.top else (1 if slip < self._residual_slip else 2)
        zone = 0 if deviation <= t.margin else (1 if deviation < t.margin + t.width else 2)
        rising = self.target * torque_factor(deviation, t.margin, t.width) > state[COMMAND]
        return region, zone, int(rising)

    @property
    def _residual_slip(self) -> float:
        """Slip velocity from which on the two lines end at mu_inf [m/s]."""
        return self.top + (self.peak - self.curve.residual(self.peak)) / self.curve.macro_slope

    def rates(self, mode: Mode) -> Floats:
        """Matrix of a mode, (5, 5): state' = matrix state."""
        t = self.table
        region, zone, rising = mode
        slope, offset = (
            (self.curve.micro_slope, 0.0),
            (-self.curve.macro_slope, self.peak + self.curve.macro_slope * self.top),
            (0.0, self.curve.residual(self.peak)),
        )[region]
        per_deviation = -1.0 / t.width if zone == 1 else 0.0
        at_zero = (1.0, 1.0 + t.margin / t.width, 0.0)[zone]
        share = 1.0 / (t.rise if rising else t.fall)
        forced = share * self.target
        both, wheel = self.wheel_gain + self.train_gain, self.wheel_gain
        tau, lag = t.time_constant, self.lag
        return np.array([
            [-both * slope, self.torque_gain, 0.0, 0.0, -both * offset],
            [0.0, -1.0 / lag, 0.0, 1.0 / lag, 0.0],
            [-wheel * slope / tau, self.torque_gain / tau, -1.0 / tau, 0.0, -(wheel * offset + self.acceleration) / tau],
            [0.0, 0.0, forced * per_deviation, -share, forced * at_zero],
            [0.0, 0.0, 0.0, 0.0, 0.0],
        ])  # fmt: skip

    def limit_cycle(self, tolerance: float = 1e-6) -> LimitCycle | None:
        """The cycle that the loop settles in after adhesion has dropped to `peak`; None where slip grows or it rests.

        Section: the instants at which the filtered command turns from falling to rising. The state there repeats
        to within `tolerance` of its scale once the cycle is reached.
        """
        scale = np.array([self.top, self.target, self.acceleration, self.target, 1.0])
        # driven by the plan in adhesion, when the rail gives way
        state = np.array([self.top, self.target, 0.0, self.target, 1.0])
        matrices: dict[Mode, tuple[Floats, Floats]] = {}
        time, last_time, last = 0.0, math.nan, np.full(5, math.nan)
        low = high = state.copy()
        mode = self.mode(state)
        while time < PERIODS * 10.0 * (self.table.time_constant + self.table.fall):
            if mode not in matrices:
                rates = self.rates(mode)
                matrices[mode] = rates, expm(rates * STEP)
            rates, whole = matrices[mode]
            before, passed = mode, STEP
            ahead = whole @ state
            mode = self.mode(ahead)
            if mode != before:
                passed = self._switching(rates, state, before)
                ahead = expm(rates * passed) @ state
                mode = self.mode(ahead)
            time += passed
            turned = before[2] == 0 and mode[2] == 1
            start, state = state, ahead
            low, high = np.minimum(low, state), np.maximum(high, state)
            moved = np.max(np.abs(state - start) / scale)
            if state[SLIP] > 100.0 * self.top or moved < 1e-3 * tolerance * passed / STEP:
                return None
            # at rest rounding turns the filter to and fro: a cycle must swing
            if turned and high[TORQUE] - low[TORQUE] > PROMINENCE * self.target:
                if np.max(np.abs(state - last) / scale) < tolerance:
                    return LimitCycle(
                        time - last_time,
                        (float(low[SLIP]), float(high[SLIP])),
                        (float(low[TORQUE]), float(high[TORQUE])),
                    )
                last, last_time = state, time
                low = high = state.copy()
        return None

    def _switching(self, rates: Floats, state: Floats, mode: Mode) -> float:
        """Time [s] within a step just after which the mode is another one."""
        low, high = 0.0, STEP
        for _ in range(30):
            middle = 0.5 * (low + high)
            left = self.mode(expm(rates * middle) @ state) != mode
            low, high = (low, middle) if left else (middle, high)
        return high


def reduced_model(
    train: Train, table: TorqueTable, curve: PiecewiseCurve, peak: float, acceleration: float
) -> ReducedModel:
    """Reduce `train` (one driven axle) to the states of the limit cycle; `acceleration` [m/s2] is the driver's command."""
    model = build(train, Rail(peak, curve=curve))
    s = model.structure
    eq = equipment(model, Onboard())
    radius, inverse, gear, load = s.radius[0], 1.0 / s.inertia[0], s.gear[0], s.static_load[0]
    to_torque = eq.axle_load[0] * eq.radius[0] / eq.gear[0] * (1.0 + eq.own_inertia[0])
    rate = motor_torque_rate(0.0, 1.0, math.inf, math.inf, 1.0, 1.0 / s.unit_lag[0])
    return ReducedModel(
        torque_gain=float(radius * wheel_acceleration(gear, 0.0, radius, 0.0, inverse)),
        wheel_gain=float(-radius * wheel_acceleration(0.0, load, radius, 0.0, inverse)),
        train_gain=float(load / s.body_mass[0]),
        lag=float(1.0 / rate),
        target=float(acceleration * eq.planned_share * to_torque),
        acceleration=acceleration,
        peak=peak,
        curve=curve,
        table=table,
    )


def growth(table: TorqueTable, lag: float, gain: float) -> float:
    """Factor by which a small swing about the runaway equilibrium changes from one swing to the next; 1: it persists.

    About the equilibrium the loop has three states (torque, deviation, filtered command) and no scale, because its only
    nonlinearity is the filter's two time constants. A swing keeps its shape and changes its size. 0: no swing at all.
    """
    step = 0.05 * lag  # a swing takes tens of lags
    matrices = []
    for constant in (table.fall, table.rise):
        a = np.array([
            [-1.0 / lag, 0.0, 1.0 / lag],
            [gain / table.time_constant, -1.0 / table.time_constant, 0.0],
            [0.0, -1.0 / constant, -1.0 / constant],
        ])  # fmt: skip
        matrices.append(expm(a * step))
    state, sizes, largest, rising = np.array([1.0, 0.0, 1.0]), [1.0], 0.0, False
    for _ in range(SWINGS * 3000):
        state = matrices[int(-state[1] > state[2])] @ state
        largest = max(largest, abs(float(state[1])))
        now_rising = bool(-state[1] > state[2])
        if now_rising and not rising:
            sizes.append(largest)
            if len(sizes) > SWINGS:
                return (sizes[-1] / sizes[SWINGS // 2]) ** (1.0 / (SWINGS - SWINGS // 2))
            largest = 0.0
        rising = now_rising
    return 0.0


def critical_gain(table: TorqueTable, lag: float) -> float:
    """Loop gain below which the runaway equilibrium is stable: the factor then settles, and the wheels run away."""
    return float(brentq(lambda gain: growth(table, lag, gain) - 1.0, 5.0, 2e3, rtol=1e-4))


def critical_width(model: ReducedModel) -> float:
    """Width a_w of the table [m/s2] above which the table settles while the wheels run away, on every rail alike."""
    return model.torque_gain * model.target / critical_gain(model.table, model.lag)
