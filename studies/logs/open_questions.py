"""What the fit of a log found that is not as it should be, what that does to the wheel damage Q, and whether Q is told."""

import numpy as np
from numpy.typing import NDArray

from studies.logs.estimator import LEAST_DELAY, LEAST_LATE, LEAST_SCALE
from studies.logs.measured_log import MeasuredLog
from studies.logs.measured_run import Findings
from studies.logs.motion_fit import LEAST_RADIUS
from studies.logs.remarks import Remark

Floats = NDArray[np.float64]

MOVED = 0.05
"""Share of Q by which a delay changes it, above which the log is flagged."""
MOST_UNSURE, LITTLE = 0.25, 500.0
"""Error of Q, as a share and [J], both of which are exceeded where Q is withheld."""
HEAVIER = 0.03
"""Error of the forces over the train's mass above which it is said."""
MOST_FILLED = 0.02
"""Share of Q filled in above which it is said."""
NAMED = 6
"""Axles that a line names."""


def withheld(log: MeasuredLog, found: Findings) -> str:
    """Why no Q is told; "" where one is."""
    if log.fit is not None and log.fit.worn:
        return "wheels that always pull differ as worn ones do: their radii and their creep cannot be told apart"
    error = np.inf if found.errors is None else found.errors.total
    damage = abs(found.total_damage)
    if found.covered.any() and error > max(MOST_UNSURE * damage, LITTLE):
        return f"{1e-3 * found.total_damage:.3g} ± {1e-3 * error:.2g} kJ is too uncertain"
    return ""


def moved_by_delay(log: MeasuredLog, found: Findings) -> float | None:
    """By how much the delay that was found would move Q if it were left in the speed, as a share of Q; None if none was."""
    if found.errors is None or log.run.speed_delay is None or log.run.speed_source != "followed":
        return None
    return found.errors.of_delay / max(abs(found.total_damage), 1e-9)


def delay_flagged(log: MeasuredLog, found: Findings) -> bool:
    """Whether the delay of the train's speed, or what is not known of it, matters."""
    moved = moved_by_delay(log, found)
    return moved is not None and abs(moved) > MOVED


def fit_remarks(log: MeasuredLog, found: Findings) -> list[Remark]:
    """What differs from nothing by more than its error, a line each, with what it does to Q."""
    fit, run = log.fit, log.run
    if fit is None:
        return []
    remarks, x = [], fit.x
    damage = max(abs(found.total_damage), 1e-9)
    if run.speed_source == "estimated" and run.speed_deviation is not None:
        text = f"no channel of it: estimated from wheels and forces, ± {np.median(run.speed_deviation):.2g} m/s"
        remarks.append(Remark("estimate", "speed", text))
    delay = run.speed_delay
    if delay is not None and abs(delay.value) > max(
        LEAST_DELAY, 2.0 * delay.deviation, 0.6 * log.period
    ):
        how = f"{abs(delay.value):.3f} ± {delay.deviation:.3f} s {'late' if delay.value > 0.0 else 'early'}"
        moved = moved_by_delay(log, found)
        effect = "" if moved is None else f"; left alone it moves Q by {100.0 * moved:+.0f} %"
        remarks.append(Remark("delay", "speed", f"the train's speed is {how}: made up for{effect}"))
    if abs(x["h"]) > max(LEAST_LATE, log.period):
        how = f"{abs(x['h']):.3f} s {'later' if x['h'] > 0.0 else 'earlier'}"
        text = (
            f"all forces are recorded {how} than the wheels, by the train's momentum: made up for"
        )
        remarks.append(Remark("delay", "axleN_force", text))
    if abs(x["s"]) > LEAST_SCALE:
        moved = x["s"] * _work(found, run.speed) / damage
        text = f"the train's speed is {1e2 * x['s']:+.2f} % off, by all wheels: made up for, moves Q by {1e2 * moved:.0f} %"
        remarks.append(Remark("radius", "speed", text))
    remarks += _radii(log, found, damage)
    if fit.worn:
        text = "wheels that always pull differ as worn ones do: neither radii nor Q are told; measure the wheels"
        remarks.append(Remark("radius", "axleN_speed", text))
    if abs(x["g"] - 1.0) > HEAVIER:
        text = (
            f"the train moves as if forces over mass were {x['g']:.3f} of what is told: the load, a unit or the clock; "
            "Q is by the told forces"
        )
        remarks.append(Remark("balance", "axleN_force", text))
    share = abs(found.filled_damage) / damage
    if share > MOST_FILLED:
        remarks.append(Remark("gap", "axleN_speed", f"{100.0 * share:.0f} % of Q is filled in"))
    reason = withheld(log, found)
    if reason:
        remarks.append(Remark("withheld", "", f"no Q: {reason}"))
    return remarks


def _work(found: Findings, speed: Floats, axle: int | None = None) -> float:
    """Work of the rail's forces on all axles, or on one [J]."""
    chosen = slice(None) if axle is None else slice(axle, axle + 1)
    load = found.run.applied_force[:, chosen]
    step = np.gradient(found.run.time)
    return float(np.nansum(load * (step * speed)[:, None]))


def _radii(log: MeasuredLog, found: Findings, damage: float) -> list[Remark]:
    """One line on all radii that are not as told."""
    assert log.fit is not None
    error = log.fit.radius
    wrong = np.flatnonzero(np.abs(error) > LEAST_RADIUS)
    if wrong.size == 0:
        return []
    moved = sum(float(error[i]) * _work(found, log.run.speed, int(i)) for i in wrong) / damage
    axles = ", ".join(f"{i + 1} ({100.0 * error[i]:+.1f} %)" for i in wrong[:NAMED])
    more = f" and {wrong.size - NAMED} more" if wrong.size > NAMED else ""
    text = f"rim speeds of axles {axles}{more} are off by a radius: made up for; that moves Q by {100.0 * moved:+.0f} %"
    return [Remark("radius", "axleN_speed", text)]
