"""Conformance kit of readhesion controllers and adhesion curves; that of allocation rules is `alloc.old.rules.testing`.

`check_controller` runs a controller on a train of three cars over a few rails, `check_curve` asks a curve at drawn peaks and
speeds. Both raise `BrokenLaw` with the law, the worst value and a counterexample.
"""

import json
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from functools import lru_cache
from numbers import Real
from typing import Any

import numpy as np
import xarray as xr

from alloc.old.errors import InputError
from alloc.old.event import DriverCommand, Event
from alloc.old.onboard.controllers.base import BuiltInController
from alloc.old.onboard.controllers.collection import BUILT_IN
from alloc.old.onboard.host import HostedController, TellingController, TorqueDecision, UnitSense
from alloc.old.onboard.telegrams import AddedNumbers, Attachment
from alloc.old.plant.adhesion import (
    POLACH_DRY,
    POLACH_WET,
    AdhesionCurve,
    PiecewiseCurve,
    SlipRatioCurve,
)
from alloc.old.plant.model import build
from alloc.old.plant.rail import Patch, Rail
from alloc.old.plant.sets import find_set
from alloc.old.recording import attributes_of
from alloc.old.rules.rule import Rule
from alloc.old.rules.testing import Law, Unusable, Verdict, brief, check, laws_of_rule, needed
from alloc.old.simulation import simulate

Controller = type[BuiltInController] | HostedController

# Answers of hosted controllers, looked at one by one.


def looked_at(controller: Controller) -> Controller:
    """The same controller, which raises `Unusable` where an answer of it is no torque."""
    if not isinstance(controller, HostedController):
        return controller

    def made(contexts: Any) -> Any:
        host = controller.factory(contexts)
        if isinstance(host, tuple):  # compiled: its compiler has looked at it
            return host
        if not hasattr(host, "decide"):
            raise Unusable(f"makes a {type(host).__name__} without decide(); define it")
        return (_LookedAtTelling if isinstance(host, TellingController) else _LookedAt)(host)

    return replace(controller, factory=made)


class _LookedAt:
    """A `TrainController` whose every answer is checked."""

    def __init__(self, host: Any) -> None:
        self.host = host

    def decide(self, senses: Sequence[UnitSense]) -> Sequence[TorqueDecision]:
        """Answers of the controller; raises `Unusable` for one that is no decision."""
        answers: Sequence[TorqueDecision] = self.host.decide(senses)
        if not isinstance(answers, Sequence) or len(answers) != len(senses):
            wanted = f"{len(senses)} units; return a list with one answer each"
            raise Unusable(f"returns {brief(answers)} for {wanted}")
        for answer in answers:
            if not isinstance(answer, TorqueDecision):
                wanted = "return TorqueDecision(torque, ok, status, solve_time)"
                raise Unusable(f"returns {brief(answer)}; {wanted}")
            if not isinstance(answer.torque, Real):
                raise Unusable(f"sets torque {brief(answer.torque)}; give one number in N m")
        return answers


class _LookedAtTelling(_LookedAt):
    """A `TellingController` of the same kind."""

    @property
    def added(self) -> AddedNumbers:
        """What its units tell."""
        added: AddedNumbers = self.host.added
        return added

    def connect(self, reports: Attachment, orders: Attachment) -> None:
        """Hand the arrays on."""
        self.host.connect(reports, orders)


def tried(controller: Controller, event: Event) -> xr.Dataset:
    """A run of `event` under `controller`; raises `Unusable` where it gives no torque that can be used."""
    run = simulate(event, "alone", looked_at(controller))  # type: ignore[arg-type]
    told = attributes_of(run)
    if 0 < told["controller_calls"] == told["controller_failures"]:
        reason = ", ".join(json.loads(told["messages"])).replace("controller: ", "")
        wanted = f"gives no usable torque in a trial run ({reason}); return a finite torque in N m"
        raise Unusable(wanted)
    return run


# Laws of controllers.


@dataclass(frozen=True)
class Start:
    """A train of two motor cars and a trailer pulls away; adhesion may drop for a time."""

    adhesion: float
    curve: AdhesionCurve = field(default_factory=PiecewiseCurve)
    duration: float = 3.0
    """[s]"""
    drop: float = 1.0
    """Factor on the adhesion from `DROPS` to `RETURNS`."""

    @property
    def event(self) -> Event:
        """The event; the plan needs a coefficient of 0.12."""
        train = find_set("commuter-8car")
        short = replace(train, cars=train.cars[:3])
        patches = () if self.drop == 1.0 else (Patch(self.drop, begin=DROPS, until=RETURNS),)
        model = build(short, Rail(self.adhesion, curve=self.curve, patches=patches))
        command = DriverCommand((0.2,), (0.75,))
        return Event("conformance", model, command, duration=self.duration, record_period=0.02)


SETTLED = 2.0
"""Time [s] from which a hosted controller must pass its target: one that weighs changes of torque lags while that rises."""
DROPS, RETURNS, RECOVERED = 2.0, 4.0, 7.0
"""Instants [s] from and to which adhesion is low, and from which the target must pass again."""
DRY, SHORT = Start(0.35), Start(0.2, duration=8.0, drop=0.4)
BELOW_PEAK = (
    Start(0.18), Start(0.18, SlipRatioCurve()), Start(0.2, POLACH_WET), Start(0.2, POLACH_DRY)
)  # fmt: skip
"""Rails that carry more than the plan, whose peaks are at slips that controllers allow."""


@lru_cache(maxsize=8)
def _run(controller: Any, start: Start) -> xr.Dataset:
    return tried(controller, start.event)


def _finite(controller: Any, start: Start) -> float:
    run = _run(controller, start)
    wrong = [
        name for name in ("torque_command", "torque_factor", "motor_torque", "speed") if not np.isfinite(run[name]).all()
    ]  # fmt: skip
    if wrong:
        raise Unusable(f"{wrong[0]} of the run is not finite")
    return 0.0


def _within_target(controller: Any, start: Start) -> float:
    run = _run(controller, start)
    command, target = run["torque_command"].values, run["torque_target"].values
    return float(max((command - target).max(), (-command).max()) / target.max())


def _lacks(controller: Any, start: Start, begin: float) -> float:
    run = _run(controller, start)
    return 1.0 - float(run["torque_factor"].values[run["time"].values >= begin].min())


def _plan_reached(controller: Any, start: Start) -> float:
    return _lacks(controller, start, SETTLED if isinstance(controller, HostedController) else 0.0)


def _recovers(controller: Any, start: Start) -> float:
    return _lacks(controller, start, RECOVERED)


def _repeats(controller: Any, start: Start) -> float:
    first, again = _run(controller, start), tried(controller, start.event)
    return max(float(np.abs(first[name] - again[name]).max()) for name in ("torque_command", "speed"))  # fmt: skip


_BOTH = (DRY, SHORT)
CONTROLLER_LAWS = (
    Law("finite", "every torque and speed of a run is a number", _finite, known=_BOTH),
    Law("within target", "no command is beyond its target or against it, as a share of it", _within_target, known=_BOTH),
    Law("plan reached", "on dry rail the target passes; share that lacks", _plan_reached, known=(DRY,),
        tolerance=5e-4),
    Law("recovers", f"{RECOVERED - RETURNS:g} s after a drop it passes again; share that lacks", _recovers, known=(SHORT,),
        tolerance=1e-3),
    Law("no cut below the peak", "what the rail carries is not cut; share that lacks", _plan_reached, known=BELOW_PEAK,
        tolerance=5e-4),
    Law("repeatable", "the same event makes the same run", _repeats, known=(replace(DRY, duration=1.0),), tolerance=0.0),
)  # fmt: skip


# Laws of adhesion curves. Amounts are shares of the peak, of its slope, or of the steepest slope.


@dataclass(frozen=True)
class Rolling:
    """Where a curve is asked."""

    peak: float
    speed: float
    """[m/s]"""

    def slips(self, curve: AdhesionCurve) -> np.ndarray:
        """Slip velocities up to 30 m/s, dense up to three times that of the peak, which is one of them [m/s]."""
        top = float(curve.limit(self.peak, self.speed)[1])
        grid = np.concatenate([np.linspace(0.0, 3.0 * top, 400), np.geomspace(1e-6, 30.0, 200)])
        return np.sort(np.append(grid, top))

    def on(self, curve: AdhesionCurve, slip: np.ndarray) -> np.ndarray:
        """Coefficients over the peak; raises `Unusable` where they are none."""
        value = curve.coefficient(slip, self.peak, self.speed)
        if np.shape(value) != np.shape(slip) or not np.all(np.isfinite(value)):
            raise Unusable("gives no finite coefficient for every slip velocity")
        return value / self.peak


def _rollings() -> Any:
    st = needed("hypothesis").strategies
    return st.builds(Rolling, st.floats(1e-3, 1.0), st.floats(0.0, 100.0))


def _odd(curve: AdhesionCurve, at: Rolling) -> float:
    """Turning slip, speed and rim speed round turns the force round."""
    slip = at.slips(curve)
    back = curve.coefficient(-slip, at.peak, -at.speed) / at.peak
    ahead = at.on(curve, slip)
    return float(max(np.abs(ahead + back).max(), -ahead.min()))


def _bounded(curve: AdhesionCurve, at: Rolling) -> float:
    slip = at.slips(curve)
    return float(np.abs(at.on(curve, np.append(slip, -slip))).max()) - 1.0


def _greatest(curve: AdhesionCurve, at: Rolling) -> float:
    limit, top = curve.limit(at.peak, at.speed)
    at_top = float(at.on(curve, np.asarray(top))) * at.peak / float(limit)
    highest = at.on(curve, at.slips(curve)).max() * at.peak / float(limit)
    return max(abs(at_top - 1.0), float(highest) - 1.0)


def _rises_and_falls(curve: AdhesionCurve, at: Rolling) -> float:
    slip, top = at.slips(curve), float(curve.limit(at.peak, at.speed)[1])
    step = np.diff(at.on(curve, slip))
    return float(max((-step[slip[1:] <= top]).max(), step[slip[:-1] >= top].max()))


def _slopes(curve: AdhesionCurve, at: Rolling) -> tuple[Any, Any, float]:
    """Slopes to the left and to the right of every slip velocity, and the steepest that the curve names."""
    slip, d = at.slips(curve), 1e-7 * at.peak
    left, here, right = (at.on(curve, slip + k * d) * at.peak for k in (-1.0, 0.0, 1.0))
    return (here - left) / d, (right - here) / d, curve.steepest_slope(at.peak)


def _smooth(curve: AdhesionCurve, at: Rolling) -> float:
    left, right, steepest = _slopes(curve, at)
    return float(np.abs(left - right).max()) / steepest


def _steepest(curve: AdhesionCurve, at: Rolling) -> float:
    _, right, steepest = _slopes(curve, at)
    return float(np.abs(right).max()) / steepest - 1.0


CURVE_LAWS = (
    Law("odd", "turned round, slip makes the force turned round, never one against it", _odd, _rollings, tolerance=1e-15),
    Law("bounded", "no coefficient exceeds the peak", _bounded, _rollings, tolerance=1e-12),
    Law("greatest at the limit", "the maximum is where and what `limit` says", _greatest, _rollings),
    Law("one maximum", "the coefficient rises up to it and falls beyond", _rises_and_falls, _rollings),
    Law("smooth", "slopes from the left and from the right agree", _smooth, _rollings, tolerance=1e-3),
    Law("steepest slope", "no slope exceeds `steepest_slope`", _steepest, _rollings, tolerance=1e-3),
)  # fmt: skip


# Whole checks.


def laws_of_part(part: Any) -> Sequence[Law]:
    """The laws of a rule, a controller or an adhesion curve; raises `InputError` for something else."""
    if isinstance(part, Rule):
        return laws_of_rule(part)
    if isinstance(part, HostedController) or part in BUILT_IN.values():
        return CONTROLLER_LAWS
    if isinstance(part, AdhesionCurve):
        return CURVE_LAWS
    raise InputError(f"{brief(part)} is no Rule, HostedController or adhesion curve")


def check_controller(controller: Controller) -> list[Verdict]:
    """Raise `BrokenLaw` for the first law that a controller breaks; else the verdicts."""
    return check(controller, CONTROLLER_LAWS)


def check_curve(curve: AdhesionCurve | type[AdhesionCurve], examples: int = 100) -> list[Verdict]:
    """Raise `BrokenLaw` for the first law that an adhesion curve breaks; else the verdicts. A class: by its defaults."""
    return check(curve() if isinstance(curve, type) else curve, CURVE_LAWS, examples)
