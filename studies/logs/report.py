"""Everything that the analysis of a log found, for JSON; `studies.logs.report_tables` prints it."""

from typing import Any

import numpy as np
from numpy.typing import NDArray

from alloc.estimation.slip_events import SMALL, SlipCriterion, SlipEvent
from studies.logs.brake_report import BRAKING
from studies.logs.measured_log import MeasuredLog
from studies.logs.measured_run import Findings, train_acceleration
from studies.logs.open_questions import MOVED, delay_flagged, fit_remarks, moved_by_delay, withheld
from studies.logs.remarks import grouped


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
