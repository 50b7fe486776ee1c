"""Everything that the analysis of a log found, for JSON; `studies.logs.report_tables` prints it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.slip_events import SMALL, SlipCriterion, SlipEvent
from studies.logs.estimator import LEAST_DELAY, LEAST_LATE, LEAST_SCALE
from studies.logs.force_reports import BRAKING
from studies.logs.measured_log import MeasuredLog
from studies.logs.measured_run import Findings, train_acceleration
from studies.logs.motion_fit import LEAST_RADIUS
from studies.logs.remarks import Remark, grouped


def content(log: MeasuredLog, found: Findings, criterion: SlipCriterion) -> dict[str, Any]:
    """Everything found, for JSON: SI units but where a key says otherwise, None for what is not known."""
    remarks = [*log.remarks, *fit_remarks(log, found)]
    untold = bool(withheld(log, found))
    return {
        "log": log.source,
        "train": log.train.name,
        "origin": log.origin or None,
        "rows": log.rows or int(log.run.time.size),
        "duration_s": float(log.run.time[-1] - log.run.time[0]),
        "period_s": log.period,
        "speed_source": log.run.speed_source,
        "speed_error_ms": _speed_error(log),
        "speed_delay": _delay(log, found),
        "parts": int(log.run.part[-1]) + 1,
        "force_window_s": found.window,
        "criterion": {"slip_velocity_ms": criterion.velocity, "slip_ratio": criterion.ratio},
        "small_criterion": {"slip_ratio": SMALL.ratio, "slip_velocity_ms": _list(found.least_slip)},
        "remarks": [
            {
                "kind": remark.kind,
                "column": remark.column,
                "row": remark.row,
                "time_s": remark.time,
                "text": remark.text,
            }
            for remark in remarks
        ],
        "remark_groups": [
            {
                "kind": group.kind,
                "count": group.count,
                "columns": list(group.columns),
                "text": group.text,
            }
            for group in grouped(remarks)
        ],
        "damage_kj": None
        if untold or not found.covered.any()
        else _number(1e-3 * found.total_damage),
        "filled_kj": 1e-3 * found.filled_damage,
        "damage_error_kj": _damage_error(found),
        "utilisation": _number(found.utilisation),
        "axles": [_axle(log, found, i, untold) for i in range(log.train.radius.size)],
        "events": [_event(log, event) for event in found.events],
        "small_events": [_event(log, event) for event in found.small_events],
        "cars": _cars(log, found),
        "car_acceleration": None
        if found.car_force is None
        else ("of the train" if log.run.car_acceleration is None else "of each car"),
    }


def _event(log: MeasuredLog, event: SlipEvent) -> dict[str, Any]:
    return {
        "axle": event.axle + 1,
        "car": int(log.train.axle_car[event.axle]) + 1,
        "kind": event.kind,
        "start_s": event.start,
        "end_s": event.end,
        "cut": event.cut,
        "largest_slip_ms": event.largest_slip,
        "slip_ratio": event.slip_ratio,
        "onset_s": _number(event.onset_time),
        "onset_coefficient": _number(event.onset_coefficient),
        "utilisation": _number(event.utilisation),
        "damage_kj": _number(1e-3 * event.damage),
    }


def _delay(log: MeasuredLog, found: Findings) -> dict[str, Any] | None:
    """How late the train's speed was, and whether the log is flagged for it; None where it is not measured."""
    delay = log.run.speed_delay
    if delay is None:
        return None
    moved = moved_by_delay(log, found)
    return {
        "delay_s": delay.value,
        "deviation_s": delay.deviation,
        "made_up_for": log.run.speed_source == "followed",
        "moves_damage": moved,
        "flagged": delay_flagged(log, found),
        "threshold": MOVED,
    }


def _damage_error(found: Findings) -> dict[str, float] | None:
    """Standard deviation of Q and where it is from [kJ], and what 1 per mille of the wheels' radius makes of it."""
    if found.errors is None:
        return None
    e = found.errors
    return {
        "total": 1e-3 * e.total,
        "by_speed": 1e-3 * e.by_speed,
        "by_delay": 1e-3 * e.by_delay,
        "by_sensors": 1e-3 * e.by_sensors,
        "by_sampling": 1e-3 * e.by_sampling,
        "by_filled": 1e-3 * e.by_filled,
        "by_forces": 1e-3 * e.by_forces,
        "per_permille_of_radius": 1e-3 * e.of_radius,
    }


def _list(values: NDArray[np.float64] | None) -> list[float | None]:
    return [] if values is None else [_number(value) for value in values]


def _speed_error(log: MeasuredLog) -> dict[str, float] | None:
    """Mean and largest standard deviation of the speed [m/s]."""
    if log.run.speed_deviation is None:
        return None
    known = log.run.speed_deviation[np.isfinite(log.run.speed_deviation)]
    if known.size == 0:
        return None
    return {"mean": float(known.mean()), "largest": float(known.max())}


def _number(value: float) -> float | None:
    return float(value) if np.isfinite(value) else None


def _axle(log: MeasuredLog, found: Findings, axle: int, untold: bool) -> dict[str, Any]:
    own = [event for event in found.events if event.axle == axle]
    onsets = np.array([event.onset_coefficient for event in own])
    onsets = onsets[np.isfinite(onsets)]
    used = np.abs(found.coefficient[:, axle])
    return {
        "axle": axle + 1,
        "car": int(log.train.axle_car[axle]) + 1,
        "driven": bool(log.train.driven[axle]),
        "known_s": float(found.covered[axle]),
        "slips": sum(event.kind == "slip" for event in own),
        "slides": sum(event.kind == "slide" for event in own),
        "slipping_s": float(found.slipping_time[axle]),
        "largest_slip_ms": max((event.largest_slip for event in own), key=abs, default=None),
        "onset_coefficient": float(onsets.mean()) if onsets.size else None,
        "largest_coefficient": float(np.nanmax(used)) if np.isfinite(used).any() else None,
        "damage_kj": None if untold else _number(1e-3 * found.axle_damage[axle]),
    }


def _cars(log: MeasuredLog, found: Findings) -> list[dict[str, Any]] | None:
    """Mean brake force of each car while the train brakes and while it drives [kN]."""
    if found.car_force is None:
        return None
    rate = train_acceleration(log.run, found.window)
    return [
        {
            "car": car + 1,
            "brake_force_braking_kn": _mean(1e-3 * force, rate < -BRAKING),
            "brake_force_driving_kn": _mean(1e-3 * force, rate > BRAKING),
        }
        for car, force in enumerate(found.car_force.T)
    ]


def _mean(values: NDArray[np.float64], chosen: NDArray[np.bool_]) -> float | None:
    known = values[chosen & np.isfinite(values)]
    return float(known.mean()) if known.size else None


Floats = NDArray[np.float64]

MOVED = 0.05
"""Share of Q by which a delay changes it, above which the log is flagged."""
MOST_UNSURE, LITTLE = 0.25, 500.0
"""Error of Q, as a share and [J], both of which are exceeded where Q is withheld."""
HEAVIER = 0.03
"""Error of the forces over the train's mass above which it is said."""
MOST_FILLED = 0.02
"""Share of Q filled in above which it is said."""
AXLES_NAMED = 6
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
    axles = ", ".join(f"{i + 1} ({100.0 * error[i]:+.1f} %)" for i in wrong[:AXLES_NAMED])
    more = f" and {wrong.size - AXLES_NAMED} more" if wrong.size > AXLES_NAMED else ""
    text = f"rim speeds of axles {axles}{more} are off by a radius: made up for; that moves Q by {100.0 * moved:+.0f} %"
    return [Remark("radius", "axleN_speed", text)]
