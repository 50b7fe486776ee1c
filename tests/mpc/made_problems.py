"""Units, groups, random problems and programs for the tests of the MPC, and axles and telegrams that no simulation moves."""

from collections.abc import Sequence
from dataclasses import replace
from types import SimpleNamespace
from typing import NamedTuple
from unittest.mock import patch

import numpy as np

from alloc.compilation import jit
from alloc.onboard.host import UnitContext
from alloc.onboard.telegrams import Attachment, channel, deliver, exchange
from alloc.plant.adhesion import PiecewiseCurve
from alloc.plant.sets import find_set
from alloc.records import ByReference, numbers_of
from mpc.belief import UnitBelief, with_predicted_curve
from mpc.condensing import condense, simulate, trajectory_cost
from mpc.model import Units, curve_place, group_of, leading, parameters, unit_of_axle
from mpc.period import HorizonProblem, Problem
from mpc.settings import MpcSettings
from mpc.slip_search import search_of
from mpc.solver import linearise_at
from tests.mpc.conftest import make_unit

UNLOADING = tuple(find_set("commuter-8car").cars[1].unloading_factors().tolist())


"""Load lost per newton by the axles of a motor car, front axle first: the front ones lose."""


def unit(number, car, axles, unloading, curve=None, **values):
    """One unit of a motor car."""
    defaults = {
        "unit": number, "car": car, "axles": axles, "radius": 0.43, "inertia": 155.0,
        "gear_ratio": 7.07, "axle_load": 78e3, "mass": 13.75e3 * axles, "torque_lag": 5e-3,
        "curve": curve or PiecewiseCurve(), "period": 0.01, "unloading": unloading,
    }  # fmt: skip
    return UnitContext(**(defaults | values))


def car_of_four(transfer=1.0):
    """A car with a motor and an inverter per axle; `transfer` scales the load transfer."""
    return [unit(k, 0, 1, (transfer * UNLOADING[k],)) for k in range(4)]


def small_cars(cars, curve=None):
    """Cars of two axles with an inverter each: the least group of its kind, quickly compiled."""
    return [unit(2 * c + k, c, 1, (0.1 - 0.2 * k,), curve) for c in range(cars) for k in range(2)]


def train_of(cars, **values):
    """Cars with one inverter for four motors each."""
    return [unit(c, c, 4, UNLOADING, **values) for c in range(cars)]


def problem(group, seed):
    """Slip from none to three times the peak's, peaks of each unit its own, any torques."""
    rng = np.random.default_rng(seed)
    units, of_axle = len(group), unit_of_axle(group)
    peak = rng.uniform(0.06, 0.2, units)[of_axle]
    speed, torque = rng.uniform(2.0, 30.0), rng.uniform(0.0, 800.0, units)
    top = group[0].curve.limit(peak, speed)[1]
    omega = (speed + rng.uniform(0.0, 3.0, of_axle.size) * top) / 0.43
    return HorizonProblem(
        state=np.concatenate([[speed], omega, torque]),
        parameters=parameters(group, peak, rng.uniform(-0.02, 0.02)),
        slip_limit=top,
        target=rng.uniform(300.0, 800.0, units),
        before=torque,
        upper=rng.uniform(600.0, 1000.0, units),
        reference=rng.uniform(200.0, 800.0, units),
    )


def rolling(group, peak, torque, target, upper=1150.0):
    """Problem of a group that rolls without slip; `peak`, `torque`, `target`, `upper` one for all or per unit."""
    of_axle = unit_of_axle(group)
    peak = np.broadcast_to(np.asarray(peak, dtype=float), (len(group),))[of_axle]
    torque, target, upper = (np.full(len(group), value, float) for value in (torque, target, upper))
    return HorizonProblem(
        state=np.concatenate([[10.0], np.full(of_axle.size, 10.005 / 0.43), torque]),
        parameters=parameters(group, peak),
        slip_limit=group[0].curve.limit(peak, 10.0)[1],
        target=target,
        before=torque,
        upper=upper,
        reference=np.full(len(group), target.mean()),
    )


def _predicted(group: Sequence[UnitContext]) -> list[UnitContext]:
    return [with_predicted_curve(one) for one in group]


DRAWN_KINDS: dict[str, Units] = {
    "unit": with_predicted_curve(make_unit()),
    "unit of one axle": with_predicted_curve(make_unit(axles=1)),
    "car": _predicted(car_of_four()),
    "train": _predicted(small_cars(3)),
    "train without load transfer": _predicted([unit(k, k, 1, ()) for k in range(3)]),
}


"""Units, or groups of them, as controllers predict them."""


def drawn(kind: str, seed: int, settings: MpcSettings) -> Problem:
    """Problem `seed` of a kind: slip from none to three times the peak's, gradient within 30 per mille."""
    units = DRAWN_KINDS[kind]
    of_axle, m = unit_of_axle(units), len(group_of(units))
    rng = np.random.default_rng([seed, of_axle.size, m])
    values = parameters(units, rng.uniform(0.05, 0.25, m)[of_axle], rng.uniform(-0.03, 0.03))
    top, speed = rng.uniform(0.04, 0.5), rng.uniform(2.0, 30.0)
    values[curve_place(units)] = top, rng.uniform(1.0, 4.0)
    slip = rng.uniform(0.0, 3.0, of_axle.size) * top
    torque, upper = rng.uniform(0.0, 900.0, m), rng.uniform(600.0, 1100.0, m)
    period = HorizonProblem(
        state=np.concatenate([[speed], (speed + slip) / group_of(units)[0].radius, torque]),
        parameters=values,
        slip_limit=top * rng.uniform(0.5, 1.5, of_axle.size),
        target=rng.uniform(200.0, 1000.0, m),
        before=np.minimum(torque, upper),
        upper=upper,
        reference=rng.uniform(200.0, 800.0, m),
    )
    return Problem(units, settings, period)


def model_at_guess(solver, problem):
    """The solver's quadratic model of `problem` around its guess."""
    solver.take(problem)
    made = solver.period
    linearise_at(solver.torques, ByReference(made))
    parts = (ByReference(part) for part in (made.around, made.terms, made.quadratic))
    around, terms, quadratic = parts
    condense(around, solver.torques, terms, quadratic)
    return made.quadratic


def cost_of_torques(solver, problem, torques):
    """Cost of `problem`, the last that the solver took, under `torques` [N m], (horizon * units,)."""
    made = solver.period
    made.guess.nodes[0] = problem.state
    simulate(
        solver._model.slope, torques, made.now.constants, made.rules.step / made.now.substeps[0],
        int(made.now.substeps[0]), made.guess.nodes, made.guess.scratch,
    )  # fmt: skip
    return trajectory_cost(made.guess.nodes, torques, ByReference(made.terms))


def violation(hessian, gradient, lower, upper, x):
    """Greatest slope that could be followed within the bounds, over the size of the terms that slopes consist of."""
    assert np.all((lower <= x) & (x <= upper))
    slope = hessian @ x + gradient
    followed = np.where(slope > 0.0, x > lower, x < upper)
    size = np.abs(gradient).max() + np.abs(hessian).sum(axis=1).max() * np.abs(x).max()
    return np.abs(slope * followed).max() / size if size else 0.0


def program(seed, kind, most=60):
    """A random convex program of up to `most` variables."""
    rng = np.random.default_rng(seed)
    n = int(rng.integers(1, most))
    rows = max(1, n // 2) if kind == "singular" else n
    root = rng.standard_normal((rows, n))
    if kind == "columns of other sizes":
        root *= 10.0 ** rng.uniform(-4.0, 4.0, n)
    if kind == "nearly singular":
        root *= 10.0 ** rng.uniform(-6.0, 0.0, (rows, 1))
    hessian = root.T @ root
    hessian = 0.5 * (hessian + hessian.T)
    if kind == "regular":
        hessian += np.eye(n)
    gradient = rng.standard_normal(n) * 10.0 ** rng.uniform(-3.0, 3.0)
    lower = -rng.uniform(0.0, 1.0, n)
    upper = lower + rng.uniform(0.0, 2.0, n)
    if kind == "equal bounds":
        upper[::3] = lower[::3]
    return hessian, gradient, lower, upper


PROGRAM_KINDS = ["regular", "equal bounds", "columns of other sizes", "nearly singular", "singular"]


class SyntheticUnit:
    """Axles on rails of a known `curve`, with the torque that holds their slip: no dynamics but the wheelsets' inertia.

    `noise`: deviation of a speed sensor [m/s].
    """

    acceleration = 0.5
    air = 0.0
    """Coefficient that an air brake gives, of which the unit's own estimate knows."""

    def __init__(self, curve, peak=0.12, settings=None, noise=0.0, seed=0, speed=10.0, **context):
        # with so long a lag, torque changes evenly from reading to reading
        self.context = make_unit(**({"believed": curve, "torque_lag": 10.0} | context))
        self.settings = settings or MpcSettings()
        # but slip is given: it follows its limit as with quick motors
        quick = replace(self.context, torque_lag=0.0)
        with patch("mpc.belief.search_of", lambda _, *others: search_of(quick, *others)):
            self.belief = UnitBelief(self.context, self.settings)
        self.curve, self.peak, self.noise = curve, peak, noise
        self.rng, self.speed = np.random.default_rng(seed), speed
        self.known = self.before = self.now = None
        """Slip of the period before and of this one [m/s]; none yet at first."""

    @property
    def search(self):
        """State of the search."""
        return self.belief.record.search.state[0]

    @property
    def believed(self):
        """State of the curve's filter."""
        return self.belief.record.curve.state[0]

    @property
    def swing(self):
        """Slip limit over its mean."""
        return self.belief.slip_limit / self.search.slip

    def coefficient(self, slip):
        """What the axles feel at `slip` [m/s]."""
        return self.curve.coefficient(slip, self.peak, self.speed)

    def period(self, slip, **reading):
        """A control period of readings; `slip` [m/s] of the axles a period later, one for all or (axles,)."""
        c = self.context
        after = np.broadcast_to(np.asarray(slip, dtype=float), (c.axles,))
        if self.now is None:
            self.before = self.now = after
        # torque is known at the instants of the readings: so must the rate be
        rate = self.acceleration + 0.5 * (after - self.before) / c.period
        force = self.coefficient(self.now) * self.belief.axle_load * c.radius
        shoes = self.air * self.belief.axle_load * c.radius
        torque = float(np.mean(force - shoes + c.inertia * rate / c.radius)) / c.gear_ratio
        if self.air:
            # by the unit's observer, as late as those of the axles
            felt, share = (
                float(np.mean(self.coefficient(self.now))),
                self.belief.record.constants.keep,
            )
            self.known = felt if self.known is None else share * self.known + (1.0 - share) * felt
            reading = {"estimate": self.known} | reading
        rim = self.speed + self.now + self.noise * self.rng.standard_normal(c.axles)
        self.belief.update(self.speed, rim / c.radius, torque, **reading)
        self.before, self.now = self.now, after
        self.speed += self.acceleration * c.period


TELEGRAPH_PERIOD = 0.01


class Count(NamedTuple):
    telegrams_sent: np.ndarray
    telegrams_lost: np.ndarray


@jit
def _carry(line, leader, time, message, sending, telegrams, counter, lost):
    for j in range(message.shape[0]):
        if j == leader:
            deliver(line, j, time, message)
        else:
            exchange(line, j, time, message, sending, telegrams, counter, 0.0, lost[j])


class Telegraphy:
    """The lines of a controller, which it is connected to; `lost` says whose telegrams are lost from now on."""

    def __init__(self, controller, units, telegrams):
        self.controller, self.telegrams = controller, telegrams
        self.lost = np.zeros(units, dtype=bool)
        self.counter = Count(np.zeros(1, np.int64), np.zeros(1, np.int64))
        self._lines = [
            SimpleNamespace(
                channel=channel(units, size, np.nan),
                message=np.full((units, size), np.nan),
                size=size,
            )
            for size in controller.added
        ]
        self.reports, self.orders = (
            Attachment(line.message, line.channel.read, line.channel.heard) for line in self._lines
        )
        controller.connect(self.reports, self.orders)

    def decide(self, senses):
        """What the controller answers in a control period, after the telegrams, as in the loop."""
        time, t = senses[0].time, self.telegrams
        ticks = max(1, round(t.period / TELEGRAPH_PERIOD))
        settings = ByReference(numbers_of(t, loss=0.5, ticks=ticks))
        for line in self._lines:
            _carry(
                line.channel, leading(senses), time, line.message, round(time / TELEGRAPH_PERIOD) % ticks == 0, settings,
                self.counter, np.where(self.lost, 0.0, 1.0),
            )  # fmt: skip
        return self.controller.decide(senses)
