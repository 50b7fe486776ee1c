"""The laws that readhesion controllers and adhesion curves keep; those of rules are in `alloc.rules.conformance`.

check_controller(my_controller)  # {law: worst amount}; raises `BrokenLaw` with a counterexample
check_curve(my_curve)
check_part("perturb-observe")    # a rule, a controller or a curve by its name
"""

from dataclasses import dataclass, replace
from difflib import get_close_matches
from functools import lru_cache
from typing import Any, NamedTuple

import numpy as np

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
from alloc.rules.conformance import Law, Verdict, check, check_rule
from alloc.run.event import DriverCommand, Event
from alloc.run.simulation import simulate
from alloc.schema.errors import InputError, blamed_on

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

    @property
    def event(self) -> Event:
        """The event; its driver asks for the less, the fewer axles are driven."""
        train, driven = find_train("commuter-8car"), tuple(k < self.axles for k in range(4))
        cars = [replace(one, driven=driven) if one.motors else one for one in train.cars[:3]]
        rail = Rail(self.adhesion, curve=self.curve, patches=(Patch(self.drop, begin=DROPS, until=RETURNS),))  # fmt: skip
        command = DriverCommand((0.2,), (0.6 * self.axles / 3.6,))
        return Event("conformance", replace(train, cars=tuple(cars)), rail, command, duration=self.duration)  # fmt: skip


DRY = Start(0.5, SlipRatioCurve()), Start(0.5, POLACH_WET)
DROP, SLIPPERY = Start(0.25, drop=0.25), Start(0.03, duration=2.0)
AXLES = tuple(Start(0.08, axles=n, duration=2.5) for n in (1, 2, 3, 4))


@lru_cache(maxsize=8)
def _torques(controller: Controller, start: Start) -> Any:
    """Commands, and what they exceed their targets by, over the greatest target, (2, ticks, units)."""
    run = simulate(start.event, "alone", controller)
    command, target = run["torque_command"].values, run["torque_target"].values
    return np.array([command, command - target]) / target.max()


def _beyond(controller: Controller, start: Start) -> float:
    command, excess = _torques(controller, start)
    return float(np.maximum(excess, -command).max())


def _lacks(controller: Controller, start: Start) -> float:
    late = round(SETTLED / start.event.onboard.period)
    return -float(_torques(controller, start)[1, late:].min())


def _differs(one: Controller, start: Start) -> float:
    plain = replace(one, control=getattr(one.control, "py_func", one.control))
    return float(np.abs(_torques(one, start)[0] - _torques(plain, start)[0]).max())


CONTROLLER_LAWS = (
    Law("within target", "every command is a number from 0 to its target", _beyond, (*AXLES, *DRY, DROP)),
    Law("dry rail", "the target passes where the rail carries it", _lacks, DRY, 1e-2),
    Law("recovers", f"{SETTLED - RETURNS:g} s after a drop the target passes again", _lacks, (DROP,), 2e-2),
    Law("plain", "compiled and plain it commands the same", _differs, (SLIPPERY,)),
)  # fmt: skip


def check_controller(controller: Controller, tolerance: float = 1e-6) -> dict[str, Verdict]:
    """Worst amount of every law of controllers; raises `BrokenLaw` for one that is broken by over `tolerance`."""
    return check(controller, controller.name, CONTROLLER_LAWS, tolerance)


# Curves; amounts are shares of the greatest coefficient


class Rolling(NamedTuple):
    """Where a curve is asked: what the rail offers [1], and the car's speed [m/s]."""

    peak: float
    speed: float

    def on(self, curve: AdhesionCurve, sign: float = 1.0) -> tuple[Any, int]:
        """Coefficients at growing slips from 0 on, over the greatest; the index of the greatest. `sign`: turned round."""
        most, top = (float(one) for one in curve.top(self.speed, self.peak))
        slip = np.unique([top, *np.linspace(0.0, 3.0 * top, 400), *np.geomspace(1e-6, LARGEST)])
        found = sign * curve(sign * slip, self.peak, sign * self.speed) / most
        return found, int(np.searchsorted(slip, top))


def _top(curve: AdhesionCurve, at: Rolling) -> float:
    found, top = at.on(curve)
    return float(np.max([1.0 - found[top], *(found - 1.0)]))


def _turns(curve: AdhesionCurve, at: Rolling) -> float:
    found, top = at.on(curve)
    return float(np.max([*-np.diff(found[: top + 1]), *np.diff(found[top:]), *-found]))


ROLLING = [Rolling(peak, v) for peak in (0.002, 0.03, 0.3, 0.9) for v in (0.0, 0.5, 8.0, 95.0)]
CURVE_LAWS = (
    Law("finite", "a number at every slip", lambda curve, at: 1.0 - np.isfinite(at.on(curve)[0]).all(), ROLLING),
    Law("zero", "no slip, no force", lambda curve, at: abs(at.on(curve)[0][0]), ROLLING),
    Law("odd", "turned round, slip turns the force round",
        lambda curve, at: np.abs(at.on(curve)[0] - at.on(curve, -1.0)[0]).max(), ROLLING),
    Law("top", "the greatest coefficient is what and where `top` says", _top, ROLLING),
    Law("one maximum", "it rises from 0 up to there and falls beyond, but not below 0", _turns, ROLLING),
)  # fmt: skip


def check_curve(curve: Any, tolerance: float = 1e-6) -> dict[str, Verdict]:
    """As `check_controller`, of an adhesion curve; of a class by its defaults."""
    with blamed_on(f"adhesion curve {getattr(curve, '__name__', '')}"):
        curve = curve() if isinstance(curve, type) else curve
    return check(curve, getattr(curve, "name", type(curve).__name__), CURVE_LAWS, tolerance)


def check_part(name: str, tolerance: float = 1e-6) -> dict[str, Verdict]:
    """Check the rule, controller or curve of this name; raises `InputError` where there is none."""
    kinds: Any = (RULES, check_rule), (CONTROLLERS, check_controller), (CURVES, check_curve)
    for parts, kept_by in kinds:
        if name in parts:
            return dict(kept_by(parts[name], tolerance))
    near = get_close_matches(name, [*RULES, *CONTROLLERS, *CURVES], 1, 0.0)[0]
    raise InputError(f"no rule, controller or curve is called {name!r}; did you mean {near!r}?")
