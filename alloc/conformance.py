"""What controllers, beliefs and adhesion curves must keep; requirements of rules are in `alloc.rules.conformance`.

check_controller(my_controller)  # {requirement: worst amount}; raises `BrokenLaw` with a counterexample
check_curve("piecewise")         # a part, or its name
check_belief("front")
check_part("perturb-observe")    # a rule, a controller, a belief or a curve by its name
"""

import math
from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import lru_cache, partial
from typing import Any, NamedTuple

import numpy as np

from alloc.onboard.beliefs import BELIEFS, Belief
from alloc.onboard.controllers import CONTROLLERS, Controller
from alloc.plant.curves import (
    CURVES,
    LARGEST,
    POLACH_WET,
    AdhesionCurve,
    PiecewiseCurve,
    SlipRatioCurve,
)
from alloc.plant.rail import Patch, Rail
from alloc.plant.trains import find_train
from alloc.rules import RULES
from alloc.rules.conformance import (
    Requirement,
    Verdict,
    check_requirements,
    check_rule,
    require,
)
from alloc.run.event import DriverCommand, Event
from alloc.run.simulation import Simulation, simulate
from alloc.schema.errors import InputError, blamed_on
from alloc.schema.registry import find_part

# Controllers; amounts are shares of the greatest target

DROPS, RETURNS, SETTLED = 2.0, 4.0, 12.0
"""Instants [s]: between the first two a `drop` multiplies adhesion; from the last on the target must pass."""


@dataclass(frozen=True)
class Start:
    """A trailer and two motor cars, units of so many driven axles, pull away; the plan needs a coefficient of 0.10."""

    adhesion: float
    curve: AdhesionCurve = PiecewiseCurve()  # noqa: RUF009 (frozen)
    drop: float = 1.0
    axles: int = 4
    duration: float = SETTLED + 1.0
    coasts: float = math.inf
    """Instant from which the driver asks for nothing [s]."""

    @property
    def event(self) -> Event:
        """The event; its driver asks for the less, the fewer axles are driven."""
        train, driven = find_train("commuter-8car"), tuple(k < self.axles for k in range(4))
        cars = [replace(car, driven=driven) if car.motors else car for car in train.cars[:3]]
        patch = Patch(self.drop, begin=DROPS, until=RETURNS)
        rail = Rail(self.adhesion, curve=self.curve, patches=(patch,))
        command = DriverCommand((0.2,), (0.6 * self.axles / 3.6,))
        if self.coasts < self.duration:
            command = DriverCommand((0.2, self.coasts), (*command.accelerations, 0.0))
        train = replace(train, cars=tuple(cars))
        return Event("conformance", train, rail, command, duration=self.duration)


DRY = Start(0.5, SlipRatioCurve()), Start(0.5, POLACH_WET)
DROP, SLIPPERY = Start(0.25, drop=0.25), Start(0.03, duration=2.0)
COASTS = Start(0.05, duration=3.0, coasts=2.5)
AXLES = tuple(Start(0.08, axles=n, duration=2.5) for n in (1, 2, 3, 4))


CONTROLLER_REQUIREMENTS: list[Requirement] = []
BELIEF_REQUIREMENTS: list[Requirement] = []
CURVE_REQUIREMENTS: list[Requirement] = []
of_controllers = partial(require, CONTROLLER_REQUIREMENTS)
of_beliefs = partial(require, BELIEF_REQUIREMENTS)
of_curves = partial(require, CURVE_REQUIREMENTS)


@lru_cache(maxsize=8)
def record_torques(controller: Controller, start: Start) -> Any:
    """Commands, and what they exceed their targets by, over the greatest target, (2, ticks, units)."""
    run = simulate(start.event, "alone", controller)
    command, target = run["torque_command"].values, run["torque_target"].values
    return np.array([command, command - target]) / target.max()


@of_controllers(
    "within target", "every command is a number from 0 to its target", cases=(*AXLES, *DRY, DROP)
)
def _target_excess(controller: Controller, start: Start) -> float:
    command, excess = record_torques(controller, start)
    return float(np.maximum(excess, -command).max())


@of_controllers(
    "recovers",
    f"{SETTLED - RETURNS:g} s after a drop the target passes again",
    cases=(DROP,),
    allowed=2e-2,
)
@of_controllers("dry rail", "the target passes where the rail carries it", cases=DRY, allowed=1e-2)
def _target_shortfall(controller: Controller, start: Start) -> float:
    late = round(SETTLED / start.event.onboard.period)
    return -float(record_torques(controller, start)[1, late:].min())


@of_controllers("plain", "compiled and plain it commands the same", cases=(SLIPPERY,))
def _plain_difference(controller: Controller, start: Start) -> float:
    control = getattr(controller.control, "py_func", controller.control)
    plain = record_torques(replace(controller, control=control), start)
    return float(np.abs(record_torques(controller, start)[0] - plain[0]).max())


@of_controllers(
    "blind", "with all that is true nan while it decides it commands the same", cases=(SLIPPERY,)
)
def _truth_read(controller: Controller, start: Start) -> float:
    blind = Simulation(start.event, "alone", controller)
    blind.run_blind()
    units = blind.recording.units
    command = record_torques(controller, start)[0]
    return _difference(command, units.torque_command / units.torque_target.max())


def _difference(values: Any, reference: Any) -> float:
    """Largest difference; infinite where one alone is a number."""
    apart = np.where(values == reference, 0.0, np.abs(values - reference))
    apart[np.isnan(values) & np.isnan(reference)] = 0.0
    return float(np.nan_to_num(apart, nan=np.inf).max())


def check_controller(controller: str | Controller, tolerance: float = 1e-6) -> dict[str, Verdict]:
    """Worst amount of every requirement of controllers; raises `BrokenLaw` for one that is broken by over `tolerance`."""
    part = find_part(CONTROLLERS, controller, isinstance(controller, Controller))
    return check_requirements(part, part.name, CONTROLLER_REQUIREMENTS, tolerance)


# Beliefs, under a rule that goes by all caps; amounts are coefficients


@lru_cache(maxsize=8)
def record_limits(belief: Belief, start: Start, blind: bool = False) -> Any:
    """Recorded rows of the units and of the run, (ticks, units) and (ticks,)."""
    run = Simulation(start.event, replace(RULES["exact"], belief=belief), "perturb-observe")
    if blind:
        run.run_blind()
    else:
        run.run_to_end()
    return run.recording.units, run.recording.run[:, 0]


@of_beliefs(
    "caps", "every cap is a number of at least 0, or infinite", cases=(SLIPPERY, DROP, COASTS)
)
def _cap_error(belief: Belief, start: Start) -> float:
    caps = record_limits(belief, start)[0].cap
    return float(np.nan_to_num(np.maximum(-caps, 0.0), nan=np.inf).max())


@of_beliefs(
    "lifts",
    "where the driver asks for nothing, no limit is ordered and no level is left",
    cases=(COASTS,),
)
def _limit_without_demand(belief: Belief, start: Start) -> float:
    units, run = record_limits(belief, start)
    coasting = run.time > start.coasts
    limited = np.isfinite(units.wanted[coasting]).any(axis=1) | np.isfinite(run.level[coasting])
    return float(limited.any())


@of_beliefs("plain", "compiled and plain it orders the same", cases=(SLIPPERY,))
def _belief_difference(belief: Belief, start: Start) -> float:
    plain = belief._replace(function=getattr(belief.function, "py_func", belief.function))
    return _difference(*(record_limits(part, start)[0].wanted for part in (belief, plain)))


@of_beliefs(
    "blind", "with all that is true nan while it decides it orders the same", cases=(SLIPPERY,)
)
def _truth_believed(belief: Belief, start: Start) -> float:
    return _difference(*(record_limits(belief, start, blind)[0].wanted for blind in (False, True)))


def check_belief(belief: str | Belief, tolerance: float = 1e-6) -> dict[str, Verdict]:
    """As `check_controller`, of a belief of the leader or its name."""
    part = find_part(BELIEFS, belief, isinstance(belief, Belief))
    return check_requirements(part, part.name, BELIEF_REQUIREMENTS, tolerance)


# Curves; amounts are shares of the greatest coefficient


class CurvePoint(NamedTuple):
    """Where a curve is asked: what the rail offers [1], and the car's speed [m/s]."""

    peak: float
    speed: float

    def sample(self, curve: AdhesionCurve, sign: float = 1.0) -> tuple[Any, int]:
        """Coefficients at growing slips from 0 on, over the greatest; the index of the greatest. `sign`: turned round."""
        most, top = (float(number) for number in curve.top(self.speed, self.peak))
        slip = np.unique([top, *np.linspace(0.0, 3.0 * top, 400), *np.geomspace(1e-6, LARGEST)])
        coefficient = sign * curve(sign * slip, self.peak, sign * self.speed) / most
        return coefficient, int(np.searchsorted(slip, top))


POINTS = [CurvePoint(peak, v) for peak in (0.002, 0.03, 0.3, 0.9) for v in (0.0, 0.5, 8.0, 95.0)]


@of_curves("finite", "a number at every slip", cases=POINTS)
def _finite_error(curve: AdhesionCurve, point: CurvePoint) -> float:
    return 1.0 - np.isfinite(point.sample(curve)[0]).all()


@of_curves("zero", "no slip, no force", cases=POINTS)
def _zero_error(curve: AdhesionCurve, point: CurvePoint) -> float:
    return abs(point.sample(curve)[0][0])


@of_curves("odd", "turned round, slip turns the force round", cases=POINTS)
def _odd_error(curve: AdhesionCurve, point: CurvePoint) -> float:
    return np.abs(point.sample(curve)[0] - point.sample(curve, -1.0)[0]).max()


@of_curves("top", "the greatest coefficient is what and where `top` says", cases=POINTS)
def _top_error(curve: AdhesionCurve, point: CurvePoint) -> float:
    coefficient, top = point.sample(curve)
    return float(np.max([1.0 - coefficient[top], *(coefficient - 1.0)]))


@of_curves(
    "one maximum", "it rises from 0 up to there and falls beyond, but not below 0", cases=POINTS
)
def _shape_error(curve: AdhesionCurve, point: CurvePoint) -> float:
    coefficient, top = point.sample(curve)
    rise, fall = np.diff(coefficient[: top + 1]), np.diff(coefficient[top:])
    return float(np.max([*-rise, *fall, *-coefficient]))


def check_curve(curve: Any, tolerance: float = 1e-6) -> dict[str, Verdict]:
    """As `check_controller`, of an adhesion curve or its name; of a class by its defaults."""
    curve = find_part(CURVES, curve, callable(curve))
    with blamed_on(f"adhesion curve {getattr(curve, '__name__', '')}"):
        curve = curve() if isinstance(curve, type) else curve
    name = getattr(curve, "name", type(curve).__name__)
    return check_requirements(curve, name, CURVE_REQUIREMENTS, tolerance)


def check_part(name: str, tolerance: float = 1e-6) -> dict[str, Verdict]:
    """Check the rule, controller, curve or belief of this name; raises `InputError` where there is none."""
    kinds: Any = (
        (RULES, check_rule),
        (CONTROLLERS, check_controller),
        (CURVES, check_curve),
        (BELIEFS, check_belief),
    )
    for registry, check_kind in kinds:
        if name in registry:
            return dict(check_kind(name, tolerance))
    names = [name for registry, _ in kinds for name in registry]
    near = get_close_matches(name, names, 1, 0.0)[0]
    reason = "no rule, controller, curve or belief is called"
    raise InputError(f"{reason} {name!r}; did you mean {near!r}?")
